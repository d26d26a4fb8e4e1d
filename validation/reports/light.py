"""Write the page on light damping: `python -m validation.reports.light ROWS.csv FOLDER [--records N] [--few N]`.

Damping ratios are 1e-2 to 1e-4 for oscillations, 1e-5 and 1e-6 for envelopes. The report tests whether the quality of
the answer depends on how small the damping is. Therefore the records of all decades come from the same distribution,
and the noise grows with the number of samples. Each row is saved as soon as it is computed, so that an interrupted run
resumes.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from bayesdamp.formatting import markdown_table as table
from bayesdamp.interface.answer import Answer, answer
from bayesdamp.interface.envelopes import analyse
from bayesdamp.priors import FURTHER_TERM, odds
from bayesdamp.records.envelope.record import make_record
from bayesdamp.types import OK, InputError, Signal
from validation.rows import make_page, page_options, rounded
from validation.scoring import share_of
from validation.truth.drawing import log_uniform
from validation.truth.motion import solve_motion
from validation.truth.oscillator import Oscillator
from validation.truth.rivals import loss_rate

MOTIONS, ENVELOPES = (1e-2, 1e-3, 1e-4), (1e-5, 1e-6)
"""Damping ratios for records of oscillations and of envelopes."""
LONG = 1e-4
"""The damping ratio of the oscillations with the longest records, of which each takes half a minute."""
SEED = 3141
"""Seed of the records. It is used only for this page: no prior and no threshold was chosen on these records."""
DAMPINGS = ("viscous", "viscous+coulomb", "viscous+quadratic")
SPREAD = 0.25
"""Largest difference, in decades, between the ratio of a record and the nominal ratio."""
SHARES, FALLS = (0.2, 0.5), (5.0, 11.0)
"""Ranges of the second term's fraction of the loss at the middle amplitude, and of first over last amplitude."""
NOISES = (0.003, 0.06)
"""Range of the standard deviation of the noise over the first amplitude, for a record of 40 cycles.

The noise grows with the square root of the number of samples, so that the information does not depend on the damping
ratio.
"""
CYCLES, A_CYCLE, READINGS = 40.0, 30.0, 600
"""Reference number of cycles, samples in a cycle, and number of readings of an envelope. The readings contain as much
information on the amplitude as the samples of 40 cycles, of which half is information on the phase."""
SIZES, RATES = (1e-3, 0.1), (0.5, 20.0)
"""Ranges of the first amplitude in m and the frequency in Hz."""
LEAST_LOG = -15.0
"""Dampings whose log probability relative to the best is smaller are omitted from a row."""
OTHER_FACTORS = (0.5, 0.25, 0.0625)
"""Other prior odds of a further term, instead of `FURTHER_TERM`."""
DECIDED = 0.95
EDGES = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0)
COLUMNS = (
    "record", "kind", "decade", "ratio", "truth", "share", "fall", "noise", "outcome", "p_truth", "first", "p_first",
    "decided", "right", "low", "high", "true_ratio", "holds", "seconds", "logs",
)  # fmt: skip
Row = Mapping[str, str]


@dataclass(frozen=True)
class Drawn:
    """The parameters of a simulated record.

    Attributes
    ----------
    damping : str
        The true sum.
    ratio : float
        Damping ratio at the middle amplitude.
    share : float
        Fraction of the loss at the middle amplitude that is due to the second term; 0 for a single term.
    size, fall : float
        First amplitude in m, and its ratio to the last amplitude.
    frequency : float
        Frequency in rad/s.
    noise : float
        Standard deviation of the noise over the first amplitude.
    """

    damping: str
    ratio: float
    share: float
    size: float
    fall: float
    frequency: float
    noise: float

    @property
    def middle(self) -> float:
        """The geometric mean of the first and the last amplitude, in m."""
        return self.size / math.sqrt(self.fall)

    @property
    def coefficients(self) -> dict[str, float]:
        """The coefficient of each term, in SI units."""
        first, *second = self.damping.split("+")
        shares = {first: 1 - self.share, **dict.fromkeys(second, self.share)}
        units = {term: float(loss_rate(term, self.middle, self.frequency)) for term in shares}
        return {term: share * self.ratio / units[term] for term, share in shares.items()}

    def ratio_at(self, amplitude: np.ndarray | float) -> np.ndarray | float:
        """Return the damping ratio at amplitudes in m."""
        return sum(c * loss_rate(term, amplitude, self.frequency) for term, c in self.coefficients.items())

    def decay(self) -> tuple[np.ndarray, np.ndarray]:
        """Return times in s and the amplitudes in m at these times, up to the last amplitude, (n,) each."""
        log = np.linspace(0.0, math.log(self.fall), 4001)
        amplitude = self.size * np.exp(-log)
        slow = 1 / (self.frequency * np.asarray(self.ratio_at(amplitude)))
        t = np.concatenate([[0.0], np.cumsum(0.5 * (slow[1:] + slow[:-1]) * np.diff(log))])
        return t, amplitude


def draw_record(decade: float, number: int) -> tuple[Drawn, np.random.Generator]:
    """Draw the parameters of a record; return them and the generator of its noise."""
    rng = np.random.default_rng([SEED, round(-math.log10(decade)), number])
    damping = DAMPINGS[number % len(DAMPINGS)]
    ratio = decade * 10 ** rng.uniform(-SPREAD, SPREAD)
    share = rng.uniform(*SHARES) if "+" in damping else 0.0
    size, rate, noise = (log_uniform(rng, *ends) for ends in (SIZES, RATES, NOISES))
    fall = rng.uniform(*FALLS)
    return Drawn(damping, ratio, share, size, fall, 2 * math.pi * rate, noise), rng


def oscillation(draw: Drawn, rng: np.random.Generator) -> tuple[Signal, float]:
    """Simulate a record with the independent solver; return it and the sd of its noise over the first amplitude."""
    rest = rng.uniform(-1, 1) * draw.size
    oscillator = Oscillator("linear", {"stiffness": draw.frequency**2, "rest_angle": rest}, draw.coefficients)
    stop = float(draw.decay()[0][-1])
    t = np.arange(0.0, stop, 2 * math.pi / draw.frequency / A_CYCLE)
    noise = draw.noise * math.sqrt(t.size / (CYCLES * A_CYCLE))
    y = solve_motion(oscillator, draw.size, draw.frequency, stop).at(t)[0]
    return Signal(t, y + noise * draw.size * rng.standard_normal(t.size), unit="m"), noise


def row_of(decade: float, number: int) -> dict[str, object]:
    """Draw a record, answer it and compare the answer with the truth."""
    draw, rng = draw_record(decade, number)
    kind = "oscillation" if decade in MOTIONS else "envelope"
    head = {
        "record": f"{decade:g}-{number}", "kind": kind, "decade": f"{decade:g}", "ratio": draw.ratio,
        "truth": draw.damping, "share": draw.share, "fall": draw.fall, "noise": draw.noise,
    }  # fmt: skip
    if kind == "oscillation":
        signal, head["noise"] = oscillation(draw, rng)
        start = time.perf_counter()
        options = {"restoring": ["linear"], "deviation": "none", "measured": False, "sample": False}
        try:
            result = answer(signal, [draw.middle], **options)
        except InputError:  # the window ends before the middle amplitude
            result = answer(signal, **options)
        logs, verdict = log_weights(result), result.verdict
        interval = next(iter(verdict.damping_ratio), None)
        truth = math.nan if interval is None else float(draw.ratio_at(interval.amplitude))
        first, decided, why = verdict.damping, verdict.decided, verdict.sentence
    else:
        t, amplitude = draw.decay()
        times = np.linspace(0.0, t[-1], READINGS)
        error = draw.noise * draw.size * rng.standard_normal((2, READINGS))
        y = np.hypot(np.interp(times, t, amplitude) + error[0], error[1])
        record = make_record(f"{decade:g}-{number}", times, y, "V", draw.frequency / (2 * math.pi))
        start = time.perf_counter()
        judged = analyse(record).verdict
        logs = {name: math.log(p) if p > 0 else -math.inf for name, p in judged.probabilities.items()}
        interval = judged.damping_ratio[len(judged.damping_ratio) // 2] if judged.damping_ratio else None
        truth = math.nan if interval is None else float(draw.ratio_at(interval.amplitude))
        first, decided, why = judged.damping, judged.decided, judged.sentence
    row = {**head, "seconds": time.perf_counter() - start}
    if not logs or interval is None:
        return rounded({**row, "outcome": why})
    p = probabilities(logs)
    return rounded({
        **row, "outcome": OK, "p_truth": p.get(draw.damping, 0.0), "first": first, "p_first": p.get(first, 0.0),
        "decided": int(decided), "right": int(first == draw.damping), "low": interval.low, "high": interval.high,
        "true_ratio": truth, "holds": int(interval.low <= truth <= interval.high),
        "logs": " ".join(f"{n}:{v:.2f}" for n, v in logs.items() if v - max(logs.values()) > LEAST_LOG),
    })  # fmt: skip


def log_weights(result: Answer) -> dict[str, float]:
    """Return log evidence plus log prior odds of every damping under exact laws, relative to the best damping."""
    logs: dict[str, float] = {}
    for rows, other in ((result.content.candidates, False), (result.content.rivals, True)):
        for r in rows:
            if math.isfinite(r.exact):
                own = r.exact + math.log(odds(r.damping.split("+"), other))
                logs[r.damping] = float(np.logaddexp(logs.get(r.damping, -math.inf), own))
    top = max(logs.values(), default=0.0)
    return {name: value - top for name, value in logs.items()}


def probabilities(logs: Mapping[str, float], factor: float = FURTHER_TERM) -> dict[str, float]:
    """Return the probability of each damping under other prior odds of a further term.

    Parameters
    ----------
    logs : mapping
        Log weight of each damping with the usual odds, `FURTHER_TERM`.
    factor : float
        The other odds.
    """
    more = math.log(factor / FURTHER_TERM)
    weights = {name: value + more * name.count("+") for name, value in logs.items()}
    top = max(weights.values())
    total = sum(math.exp(value - top) for value in weights.values())
    return {name: math.exp(value - top) / total for name, value in weights.items()}


# --- the page ---


def page(rows: Sequence[Row]) -> str:
    """Return the page in Markdown."""
    answered = [r for r in rows if r["outcome"] == OK]
    named, right, coverage = _shares(answered)
    by_decade = {d: [r for r in rows if float(r["decade"]) == d] for d in (*MOTIONS, *ENVELOPES)}
    heads = (
        "damping ratio", "kind", "records", "without an answer", "mean P(truth)", "named outright", "right", "coverage",
        "median s",
    )  # fmt: skip
    bins = []
    for low, high in pairwise(EDGES):
        own = [r for r in answered if low < float(r["p_first"]) <= high]
        mean = f"{np.mean([float(r['p_first']) for r in own]):.3f}" if own else "–"
        bins.append([f"{low:g} to {high:g}", str(len(own)), mean, share_of(_count(own, "right"), len(own))])
    refused = sorted({r["outcome"] for r in rows if r["outcome"] != OK})
    without = f"Without an answer: {' '.join(refused)}\n\n" if refused else ""
    return f"""# Light damping: does the answer depend on how small the damping is?

In {len(answered)} simulated records with damping ratios from 1e-2 to 1e-6, the damping is named outright in \
{named}, correctly in {right} of these; 95 % intervals of the damping ratio at the middle amplitude contain \
the truth in {coverage}.

The true damping is viscous, or viscous with Coulomb friction, or viscous with quadratic drag, in turn; the second \
term has {SHARES[0]:g} to {SHARES[1]:g} of the loss at the middle amplitude. The amplitude falls by a factor of \
{FALLS[0]:g} to {FALLS[1]:g}. Oscillations (1e-2 to 1e-4) have {A_CYCLE:g} samples in a cycle and a linear \
spring; envelopes (1e-5 and 1e-6) have {READINGS} readings. The noise is {NOISES[0]:g} to {NOISES[1]:g} of \
the first amplitude for {CYCLES:g} cycles, and grows with the square root of the number of samples, so that the \
information does not depend on the damping ratio. For oscillations, the laws are assumed to hold exactly. The \
brackets contain 95 % intervals (Wilson) for this number of records.

{table(heads, [_line(decade, own) for decade, own in by_decade.items() if own])}

## Are the probabilities right?

{table(["probability of the leading damping", "records", "mean probability", "share right"], bins)}

## Does the result depend on the prior odds of a further term?

{_sensitivity(answered)}

{without}rows.csv has every record; `logs` are log probabilities before normalisation. `make reports` makes \
this report again.
"""


def _line(decade: float, rows: Sequence[Row]) -> list[str]:
    """Return the row of the first table for one decade of the damping ratio."""
    answered = [r for r in rows if r["outcome"] == OK]
    p = np.array([float(r["p_truth"]) for r in answered])
    mean = f"{p.mean():.3f} ± {p.std(ddof=1) / math.sqrt(p.size):.3f}" if p.size > 1 else "–"
    seconds = np.median([float(r["seconds"]) for r in rows])
    return [
        f"{decade:g}", f"{rows[0]['kind']}s", str(len(rows)), str(len(rows) - len(answered)), mean,
        *_shares(answered),
        f"{seconds:.2g}",
    ]  # fmt: skip


def _shares(answered: Sequence[Row]) -> tuple[str, str, str]:
    """Format the share of records named outright, the share of correct names, and the coverage of the intervals."""
    sure = [r for r in answered if r["decided"] == "1"]
    return (
        share_of(len(sure), len(answered)),
        share_of(_count(sure, "right"), len(sure)),
        share_of(_count(answered, "holds"), len(answered)),
    )


def _sensitivity(rows: Sequence[Row]) -> str:
    """Return the table of how many named dampings change under other prior odds of a further term."""
    logs = [
        {name: float(value) for name, _, value in (pair.rpartition(":") for pair in row["logs"].split())}
        for row in rows
    ]
    usual = [_leader(probabilities(each)) for each in logs]
    lines = []
    for factor in OTHER_FACTORS:
        both = [(a, _leader(probabilities(each, factor))) for a, each in zip(usual, logs, strict=True)]
        moved = sum(a != b for (a, _), (b, _) in both)
        lines.append([
            f"{factor:g}", f"{moved} of {len(rows)}",
            str(sum(sure and not changed for (_, sure), (_, changed) in both)),
            str(sum(changed and not sure for (_, sure), (_, changed) in both)),
            str(sum(sure and changed and a != b for (a, sure), (b, changed) in both)),
        ])  # fmt: skip
    heads = (
        "odds", "the leading damping changes", "named outright only with the usual odds",
        "named outright only with these odds", "named outright with both, but differently",
    )  # fmt: skip
    head = f"Each term after the first has prior odds of {FURTHER_TERM:g}. With other odds and the same evidence:"
    return f"{head}\n\n{table(heads, lines)}"


def _leader(by_damping: Mapping[str, float]) -> tuple[str, bool]:
    """Return the most probable damping, and whether its probability suffices to name it outright."""
    first = max(by_damping, key=by_damping.__getitem__)
    return first, by_damping[first] >= DECIDED


def _count(rows: Sequence[Row], column: str) -> int:
    """Return the number of rows with a 1 in a column."""
    return sum(r[column] == "1" for r in rows)


def jobs(records: int, few: int) -> dict[str, tuple[float, int]]:
    """Return the arguments of `row_of` by the name of a record.

    Parameters
    ----------
    records : int
        Number of records of each decade.
    few : int
        Largest number of records of the slow decade, `LONG`.
    """
    counts = {d: min(few, records) if d == LONG else records for d in (*MOTIONS, *ENVELOPES)}
    return {f"{d:g}-{i}": (d, i) for d, count in counts.items() for i in range(count)}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line: answer the records that the table lacks, and write the page."""
    parser = page_options(__doc__)
    parser.add_argument("--records", type=int, default=100, help="number of records of each decade")
    parser.add_argument("--few", type=int, default=100, help=f"largest number of records of {LONG:g}")
    options = parser.parse_args(arguments)
    make_page(options, "rows.csv", COLUMNS, jobs(options.records, options.few), row_of, page)


if __name__ == "__main__":
    main()
