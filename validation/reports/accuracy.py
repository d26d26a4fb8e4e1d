"""Write a page on the accuracy of the answer: `python -m validation.reports.accuracy ROWS.csv FOLDER PAGE`.

PAGE "deviation" tests answers on records for which one of the compared laws holds exactly (the family), and on records
with a discrepancy from all compared laws.

PAGE "light" tests whether the quality of the answer depends on how small the damping is: damping ratios of 1e-2 to 1e-4
for oscillations, 1e-5 and 1e-6 for envelopes. Therefore the records of all damping ratios come from the same
distribution, and the noise grows with the number of samples.

The records are answered as simulated ones (`measured=False`), so that their probabilities are not limited.
"""

import math
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from scipy.integrate import cumulative_trapezoid

from bayesdamp.interface.answer import answer, compare_models
from bayesdamp.interface.envelopes import analyse
from bayesdamp.records.envelope.record import make_record
from bayesdamp.types import OK, InputError, Signal
from bayesdamp.verdict.types import Verdict
from validation.scoring import (
    coverage,
    groups_of,
    hits_of,
    make_page,
    named,
    page_options,
    row_of,
    score_table,
)
from validation.truth.drawing import log_uniform, loss_rate
from validation.truth.motion import solve_motion
from validation.truth.oscillator import Oscillator
from validation.truth.records import FAMILY, KINDS, Case, case, name_of

SEED, LIGHT_SEED = 903, 3141
"""Seeds of the records of the two pages, "deviation" and "light". No threshold and no prior was chosen on these
records."""
FAMILY_COUNT, DISCREPANT_COUNT, DENSE_COUNT = 100, 60, 20
"""Numbers of records for which one of the compared laws holds exactly (the family), of records with a discrepancy from
these laws, and of records with a discrepancy that are sampled densely."""
DENSE = 10
"""Factor by which the sampling rate of densely sampled records is higher than that of the other records."""
ALL = "all discrepancies, auto"
"""Name of the table's line for all records that have a discrepancy from the compared laws."""
COUNTS = {1e-2: 100, 1e-3: 100, 1e-4: 20, 1e-5: 100, 1e-6: 100}
"""Nominal damping ratios of the page on light damping, and the number of records of each."""
ENVELOPES = (1e-5, 1e-6)
"""Nominal damping ratios at which the records are envelopes (amplitudes against time), not oscillations."""
DAMPINGS = ("viscous", "viscous+coulomb", "viscous+quadratic")
"""True damping sums of the records on light damping, in turn."""
SPREAD = 0.25
"""Largest difference, in decades, between the damping ratio of a record and the nominal damping ratio."""
SHARES, FALLS = (0.2, 0.5), (5.0, 11.0)
"""Range of the fraction of the energy loss, at the middle amplitude, that the second damping term causes; and range of
the ratio of the first amplitude to the last."""
NOISES = (0.003, 0.06)
"""Range of the standard deviation of the noise, divided by the first amplitude, for a record of 40 cycles.

In longer records the noise is larger, in proportion to the square root of the number of samples, so that the
information does not depend on the damping ratio.
"""
CYCLES, A_CYCLE, READINGS = 40.0, 30.0, 600
"""Number of cycles to which `NOISES` refers, number of samples in a cycle, and number of readings of an envelope. The
600 readings contain as much information on the amplitude as the 1,200 samples of 40 cycles, because half of the
information in the samples is on the phase."""
SIZES, RATES = (1e-3, 0.1), (0.5, 20.0)
"""Ranges of the first amplitude in m and the frequency in Hz."""
DEVIATION_TEXT = """The records are simulated, with a truth from an independent solver (`validation.truth.records`,
SciPy's DOP853). They are answered under all dampings and restoring laws with linear models, without sampling. Records
of the family are drawn until the true sum is 12 nats or more ahead of every sum that lacks one of its terms; among
arbitrary records, fewer dampings could be named. *none* assumes that laws hold exactly; *auto* averages over exact and
approximate laws.

Targets. Family, *none*: named outright at least 0.90, right at least 0.97, coverage 0.92 to 0.98. Family, *auto*: named
outright at least 0.75, right at least 0.95, coverage at least 0.95, intervals at most twice as wide. Discrepant
records, *auto*: coverage at least 0.92 (0.90 at ten times the sampling rate); named wrongly and *deviates* at most 0.05
each."""
"""Text of the page "deviation" that explains how it was computed."""
LIGHT_TEXT = f"""The true damping is viscous, or viscous with Coulomb friction, or viscous with quadratic drag, in turn;
the second term has {SHARES[0]:g} to {SHARES[1]:g} of the loss at the middle amplitude, at which ratios are judged. The
amplitude falls by a factor of {FALLS[0]:g} to {FALLS[1]:g}. Oscillations (1e-2 to 1e-4) have {A_CYCLE:g} samples in a
cycle and a linear spring, and are answered under exact laws; envelopes (1e-5 and 1e-6) have {READINGS} readings. The
noise is {NOISES[0]:g} to {NOISES[1]:g} of the first amplitude for {CYCLES:g} cycles, and grows with the square root of
the number of samples, so that the information does not depend on the damping ratio."""
"""Text of the page "light" that explains how it was computed."""


def simulate(decade: float, number: int) -> tuple[Case, float]:
    """Simulate record `number` with the nominal damping ratio `decade`; return it and its frequency in rad/s.

    The record is an oscillation, or an envelope if `decade` is in `ENVELOPES`. Answers are judged at the geometric mean
    of its first and last amplitude. Its `parameters` are the coefficients of the damping terms, by term.
    """
    rng = np.random.default_rng([LIGHT_SEED, round(-math.log10(decade)), number])
    damping = DAMPINGS[number % len(DAMPINGS)]
    at_middle = decade * 10 ** rng.uniform(-SPREAD, SPREAD)
    first, *second = damping.split("+")
    share = rng.uniform(*SHARES) if second else 0.0
    size, rate, noise = (log_uniform(rng, *ends) for ends in (SIZES, RATES, NOISES))
    fall, frequency = rng.uniform(*FALLS), 2 * math.pi * rate
    middle = size / math.sqrt(fall)
    coefficients = {
        term: part * at_middle / float(loss_rate(term, middle, frequency))
        for term, part in {first: 1 - share, **dict.fromkeys(second, share)}.items()
    }

    def ratio(amplitude: Any) -> Any:
        return sum(c * loss_rate(term, amplitude, frequency) for term, c in coefficients.items())

    log = np.linspace(0.0, math.log(fall), 4001)
    amplitudes = size * np.exp(-log)
    times = cumulative_trapezoid(1 / (frequency * ratio(amplitudes)), log, initial=0.0)
    if decade in ENVELOPES:
        t = np.linspace(0.0, times[-1], READINGS)
        error = noise * size * rng.standard_normal((2, READINGS))
        y = np.hypot(np.interp(t, times, amplitudes) + error[0], error[1])
    else:
        rest = rng.uniform(-1, 1) * size
        oscillator = Oscillator("linear", {"stiffness": frequency**2, "rest_angle": rest}, coefficients)
        t = np.arange(0.0, times[-1], 2 * math.pi / frequency / A_CYCLE)
        noise *= math.sqrt(t.size / (CYCLES * A_CYCLE))
        y = solve_motion(oscillator, size, frequency, float(times[-1])).at(t)[0]
        y = y + noise * size * rng.standard_normal(t.size)
    name, signal = f"{decade:g}", Signal(t, y, unit="m")
    known = {"ratio": ratio, "amplitudes": (middle,), "parameters": coefficients}
    return Case(f"{name}-{number}", name, signal, damping, **known), frequency


def row(kind: str, number: int, mode: str, oversample: int = 1) -> dict[str, Any]:
    """Simulate a record, answer it, and return its row of the table.

    kind: "family", the name of a discrepancy, or a nominal damping ratio such as "0.01". number: number of the record
    of this kind. mode: "none" (the laws hold exactly) or "auto" (also approximate laws). oversample: factor by which a
    record with a discrepancy is sampled faster.
    """
    light = kind not in KINDS
    record, frequency = (
        simulate(float(kind), number) if light else (case(kind, SEED, number, oversample), 0.0)
    )

    def answer_record(signal: Signal, amplitudes: tuple[float, ...]) -> Verdict:
        if light and float(kind) in ENVELOPES:
            envelope = make_record(record.name, signal.t, signal.y, "V", frequency / (2 * math.pi))
            verdict = analyse(envelope).verdict
        else:
            comparison = compare_models(signal, restoring=["linear"] if light else (), deviation=mode)
            quick = partial(answer, signal, comparison, measured=False, sample=False)
            try:
                verdict = quick(amplitudes).verdict
            except InputError:  # the analysed part of the record ends before the middle amplitude
                verdict = quick().verdict
        at = verdict.damping_ratio
        return replace(verdict, damping_ratio=at[len(at) // 2 :][:1]) if light else verdict

    return row_of(record, answer_record, mode)


def page(rows: pd.DataFrame) -> str:
    """Return the page in Markdown from the rows of its table.

    The column `peer` has the mode of the answer: "none" (the laws hold exactly) or "auto" (also approximate laws).
    """
    if set(rows["group"]) & set(KINDS):
        title, text = "Laws that hold approximately: how accurate is the answer?", DEVIATION_TEXT
        dense = rows["record"].str.endswith(f"-x{DENSE}")
        auto = rows.loc[~dense & (rows["peer"] == "auto")]
        groups = {
            "family, none": rows.loc[rows["peer"] == "none"],
            **{f"{kind}, auto": part for kind, part in groups_of(auto, order=KINDS).items()},
            ALL: auto.loc[auto["group"] != FAMILY],
            f"{ALL}, ×{DENSE}": rows.loc[dense],
        }
        conditions = {
            "If a law holds exactly": groups["family, auto"],
            "If a law holds only approximately": groups[ALL],
        }
    else:
        title, text = "Light damping: does the answer depend on how small the damping is?", LIGHT_TEXT
        groups, conditions = groups_of(rows), {"With damping ratios from 1e-2 to 1e-6": rows}
    sentences = " ".join(
        f"{condition}, 95 % intervals of the damping ratio contain the truth in {coverage(part)} of {len(part)} "
        f"records; the damping is named outright in {hits_of(named(part), len(part))}, correctly in "
        f"{hits_of(named(part, right=1), named(part))} of these."
        for condition, part in conditions.items()
    )
    refused = "".join(f"Without an answer: {why}\n\n" for why in sorted(set(rows["outcome"]) - {OK}))
    scores = (
        "records", "answered", "named outright", "of these correctly", "coverage", "median half width", "deviates",
        "mean P(truth)", "CPU seconds",
    )  # fmt: skip
    return f"""# {title}

{sentences}

{text}

No threshold and no prior was chosen on these seeds. Named outright: the answer states one damping without \
reservation. *deviates*: number of answers which warn that the laws do not hold. P(truth): probability that the answer \
gives to the true damping. The brackets contain 95 % intervals of the fractions for this number of records.

{score_table(groups, *scores)}

{refused}`make reports` makes this table again, from a clean working tree; rows.csv has every record.
"""


def main() -> None:
    """Run the command line: answer the records that the table lacks, and write the page."""
    parser = page_options(__doc__)
    parser.add_argument("page", choices=("deviation", "light"))
    options = parser.parse_args()
    todo: dict[str, tuple[Any, ...]] = {}
    if options.page == "light":
        for decade, count in COUNTS.items():
            todo |= {f"{decade:g}-{i}/none": (f"{decade:g}", i, "none") for i in range(count)}
    else:
        kinds = KINDS[1:]
        jobs = [(FAMILY, i, mode, 1) for mode in ("none", "auto") for i in range(FAMILY_COUNT)]
        for count, oversample in ((DISCREPANT_COUNT, 1), (DENSE_COUNT, DENSE)):
            jobs += [(kinds[i % len(kinds)], i // len(kinds), "auto", oversample) for i in range(count)]
        todo = {
            f"{name_of(kind, SEED, i, times)}/{mode}": (kind, i, mode, times) for kind, i, mode, times in jobs
        }
    make_page(options, todo, row, page)


if __name__ == "__main__":
    main()
