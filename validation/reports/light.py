"""Write the page on light damping: `python -m validation.reports.light ROWS.csv FOLDER [--records N] [--few N]`.

Options: the number of records of each decade, and the largest number of those with a damping ratio of 1e-4.

Damping ratios are 1e-2 to 1e-4 for oscillations, 1e-5 and 1e-6 for envelopes. The report tests whether the quality of
the answer depends on how small the damping is. Therefore the records of all decades come from the same distribution,
and the noise grows with the number of samples.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from scipy.integrate import cumulative_trapezoid

from bayesdamp.interface.answer import answer
from bayesdamp.interface.envelopes import analyse
from bayesdamp.records.envelope.record import make_record
from bayesdamp.types import OK, InputError, Signal
from validation.rows import make_page, page_options
from validation.scoring import (
    COLUMNS,
    KEY,
    Reply,
    answered,
    coverage,
    groups_of,
    hits_of,
    named,
    reply_of,
    row_of,
    score_table,
)
from validation.truth.drawing import log_uniform, loss_rate
from validation.truth.motion import solve_motion
from validation.truth.oscillator import Oscillator
from validation.truth.records import Case

MOTIONS, ENVELOPES = (1e-2, 1e-3, 1e-4), (1e-5, 1e-6)
"""Nominal damping ratios of the simulated oscillations, and of the simulated envelopes."""
LONG = 1e-4
"""The nominal damping ratio of the longest records of oscillations; to answer one takes half a minute."""
SEED = 3141
"""Seed of the records. It is used only for this page: no prior and no threshold was chosen on these records."""
DAMPINGS = ("viscous", "viscous+coulomb", "viscous+quadratic")
"""True damping sums of the records, in turn."""
SPREAD = 0.25
"""Largest difference, in decades, between the ratio of a record and the nominal ratio."""
SHARES, FALLS = (0.2, 0.5), (5.0, 11.0)
"""Range of the second term's fraction of the energy loss at the middle amplitude, and range of the first amplitude over
the last."""
NOISES = (0.003, 0.06)
"""Range of the standard deviation of the noise over the first amplitude, for a record of 40 cycles.

The noise grows with the square root of the number of samples, so that the information does not depend on the damping
ratio.
"""
CYCLES, A_CYCLE, READINGS = 40.0, 30.0, 600
"""Number of cycles to which `NOISES` refers, number of samples in a cycle, and number of readings of an envelope. The
600 readings contain as much information on the amplitude as the 1,200 samples of 40 cycles, half of whose information
is on the phase."""
SIZES, RATES = (1e-3, 0.1), (0.5, 20.0)
"""Ranges of the first amplitude in m and the frequency in Hz."""


def simulate(decade: float, number: int) -> tuple[Case, float]:
    """Return record `number` of a nominal damping ratio, and its frequency in rad/s.

    It is an oscillation or an envelope, to be judged at the geometric mean of its first and last amplitude. Its
    `parameters` are the coefficients by term.
    """
    rng = np.random.default_rng([SEED, round(-math.log10(decade)), number])
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
    if decade in MOTIONS:
        rest = rng.uniform(-1, 1) * size
        oscillator = Oscillator("linear", {"stiffness": frequency**2, "rest_angle": rest}, coefficients)
        t = np.arange(0.0, times[-1], 2 * math.pi / frequency / A_CYCLE)
        noise *= math.sqrt(t.size / (CYCLES * A_CYCLE))
        y = solve_motion(oscillator, size, frequency, float(times[-1])).at(t)[0]
        signal = Signal(t, y + noise * size * rng.standard_normal(t.size), unit="m")
    else:
        t = np.linspace(0.0, times[-1], READINGS)
        error = noise * size * rng.standard_normal((2, READINGS))
        y = np.hypot(np.interp(t, times, amplitudes) + error[0], error[1])
        signal = Signal(t, y, unit="m")
    name = f"{decade:g}-{number}"
    return Case(
        name, f"{decade:g}", signal, damping, ratio=ratio, amplitudes=(middle,), parameters=coefficients
    ), frequency


def row(decade: float, number: int) -> dict[str, Any]:
    """Simulate record `number` of a nominal damping ratio, answer it, and return its row."""
    case, frequency = simulate(decade, number)

    def answer_record(signal: Signal, amplitudes: tuple[float, ...]) -> Reply:
        if decade in ENVELOPES:
            record = make_record(case.name, signal.t, signal.y, "V", frequency / (2 * math.pi))
            verdict = analyse(record).verdict
        else:
            options = {"restoring": ["linear"], "deviation": "none", "measured": False, "sample": False}
            try:
                verdict = answer(signal, amplitudes, **options).verdict
            except InputError:  # the window ends before the middle amplitude
                verdict = answer(signal, **options).verdict
        at = verdict.damping_ratio
        return reply_of(replace(verdict, damping_ratio=at[len(at) // 2 :][:1]))

    return row_of(case, answer_record)


def page(rows: pd.DataFrame) -> str:
    """Return the page on these rows in Markdown."""
    sure = named(rows)
    refused = sorted(set(rows["outcome"]) - {OK})
    without = f"Without an answer: {' '.join(refused)}\n\n" if refused else ""
    scores = (
        "records",
        "answered",
        "mean P(truth)",
        "named outright",
        "of these correctly",
        "coverage",
        "CPU seconds",
    )
    return f"""# Light damping: does the answer depend on how small the damping is?

In {len(answered(rows))} simulated records with damping ratios from 1e-2 to 1e-6, the damping is named outright in \
{hits_of(sure, len(rows))}, correctly in {hits_of(named(rows, right=1), sure)} of these; 95 % intervals of the damping \
ratio at the middle amplitude contain the truth in {coverage(rows)}.

The true damping is viscous, or viscous with Coulomb friction, or viscous with quadratic drag, in turn; the second \
term has {SHARES[0]:g} to {SHARES[1]:g} of the loss at the middle amplitude. The amplitude falls by a factor of \
{FALLS[0]:g} to {FALLS[1]:g}. Oscillations (1e-2 to 1e-4) have {A_CYCLE:g} samples in a cycle and a linear \
spring; envelopes (1e-5 and 1e-6) have {READINGS} readings. The noise is {NOISES[0]:g} to {NOISES[1]:g} of \
the first amplitude for {CYCLES:g} cycles, and grows with the square root of the number of samples, so that the \
information does not depend on the damping ratio. For oscillations, the laws are assumed to hold exactly. \
*P(truth)* is the probability that the answer gives to the true damping. The \
brackets contain 95 % intervals (Wilson) for this number of records.

{score_table(groups_of(rows), *scores)}

{without}rows.csv has every record. `make reports` makes this report again.
"""


def main() -> None:
    """Run the command line: answer the records that the table lacks, and write the page."""
    options = page_options(__doc__, records=100, few=100).parse_args()
    todo = {}
    for decade in (*MOTIONS, *ENVELOPES):
        count = min(options.few, options.records) if decade == LONG else options.records
        todo |= {f"{decade:g}-{i}/bayesdamp": (decade, i) for i in range(count)}
    make_page(options, "rows.csv", COLUMNS, todo, row, page, KEY)


if __name__ == "__main__":
    main()
