"""Write the page on light damping: `python -m validation.reports.light ROWS.csv FOLDER [--records N] [--few N]`.

Damping ratios are 1e-2 to 1e-4 for oscillations, 1e-5 and 1e-6 for envelopes. The report tests whether the quality of
the answer depends on how small the damping is. Therefore the records of all decades come from the same distribution,
and the noise grows with the number of samples.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pandas as pd
from scipy.integrate import cumulative_trapezoid
from scipy.special import softmax

from bayesdamp.formatting import markdown_table as table
from bayesdamp.interface.answer import Answer, answer
from bayesdamp.interface.envelopes import analyse
from bayesdamp.priors import FURTHER_TERM, odds
from bayesdamp.records.envelope.record import make_record
from bayesdamp.types import OK, InputError, Signal
from validation.rows import make_page, page_options, total, where
from validation.scoring import share
from validation.truth.drawing import log_uniform
from validation.truth.motion import solve_motion
from validation.truth.oscillator import Oscillator
from validation.truth.rivals import loss_rate

MOTIONS, ENVELOPES = (1e-2, 1e-3, 1e-4), (1e-5, 1e-6)
"""Nominal damping ratios of the simulated oscillations, and of the simulated envelopes."""
LONG = 1e-4
"""The nominal damping ratio of the longest records of oscillations; to answer one takes half a minute."""
SEED = 3141
"""Seed of the records. It is used only for this page: no prior and no threshold was chosen on these records."""
DAMPINGS = ("viscous", "viscous+coulomb", "viscous+quadratic")
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
LEAST_LOG = -15.0
"""A row omits dampings whose log probability (nats) is below that of the most probable one by more than this."""
OTHER_FACTORS = (0.5, 0.25, 0.0625)
"""Prior odds of a further term for which the page also computes the answers, instead of `FURTHER_TERM`."""
DECIDED = 0.95
EDGES = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0)
COLUMNS = (
    "record", "kind", "decade", "ratio", "truth", "share", "fall", "noise", "outcome", "p_truth", "first", "p_first",
    "decided", "right", "low", "high", "true_ratio", "holds", "seconds", "logs",
)  # fmt: skip
HEADS = (
    "damping ratio", "kind", "records", "without an answer", "mean P(truth)", "named outright", "right", "coverage",
    "median s",
)  # fmt: skip


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
        return cumulative_trapezoid(slow, log, initial=0.0), amplitude


def draw_record(decade: float, number: int) -> tuple[Drawn, np.random.Generator]:
    """Draw the parameters of record `number` of a nominal damping ratio; return them and the generator of its noise."""
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
    """Draw record `number` of a nominal damping ratio, answer it, and return the row with answer and truth."""
    draw, rng = draw_record(decade, number)
    kind = "oscillation" if decade in MOTIONS else "envelope"
    row: dict[str, object] = {
        "record": f"{decade:g}-{number}", "kind": kind, "decade": decade, "ratio": draw.ratio, "truth": draw.damping,
        "share": draw.share, "fall": draw.fall, "noise": draw.noise,
    }  # fmt: skip
    if kind == "oscillation":
        signal, row["noise"] = oscillation(draw, rng)
        start = time.perf_counter()
        options = {"restoring": ["linear"], "deviation": "none", "measured": False, "sample": False}
        try:
            result = answer(signal, [draw.middle], **options)
        except InputError:  # the window ends before the middle amplitude
            result = answer(signal, **options)
        verdict, logs = result.verdict, log_weights(result)
        interval = next(iter(verdict.damping_ratio), None)
    else:
        t, amplitude = draw.decay()
        times = np.linspace(0.0, t[-1], READINGS)
        error = draw.noise * draw.size * rng.standard_normal((2, READINGS))
        y = np.hypot(np.interp(times, t, amplitude) + error[0], error[1])
        record = make_record(f"{decade:g}-{number}", times, y, "V", draw.frequency / (2 * math.pi))
        start = time.perf_counter()
        verdict = analyse(record).verdict
        logs = pd.Series(verdict.probabilities, dtype=float).map(
            lambda p: math.log(p) if p > 0 else -math.inf
        )
        interval = verdict.damping_ratio[len(verdict.damping_ratio) // 2] if verdict.damping_ratio else None
    row["seconds"] = time.perf_counter() - start
    if logs.empty or interval is None:
        return row | {"outcome": verdict.sentence}
    truth = float(draw.ratio_at(interval.amplitude))
    p = probabilities(logs)
    return row | {
        "outcome": OK, "p_truth": p.get(draw.damping, 0.0), "first": verdict.damping,
        "p_first": p.get(verdict.damping, 0.0), "decided": int(verdict.decided),
        "right": int(verdict.damping == draw.damping), "low": interval.low, "high": interval.high,
        "true_ratio": truth, "holds": int(interval.low <= truth <= interval.high),
        "logs": " ".join(f"{n}:{v:.2f}" for n, v in logs.items() if v - logs.max() > LEAST_LOG),
    }  # fmt: skip


def log_weights(result: Answer) -> pd.Series:
    """Return log evidence plus log prior odds of every damping under exact laws, relative to the best damping."""
    logs: dict[str, float] = {}
    for rows, other in ((result.content.candidates, False), (result.content.rivals, True)):
        for r in rows:
            if math.isfinite(r.exact):
                own = r.exact + math.log(odds(r.damping.split("+"), other))
                logs[r.damping] = float(np.logaddexp(logs.get(r.damping, -math.inf), own))
    weights = pd.Series(logs, dtype=float)
    return weights - weights.max()


def probabilities(logs: pd.Series, factor: float = FURTHER_TERM) -> pd.Series:
    """Return the probability of each damping if a further term has the prior odds `factor` instead of the usual ones.

    Parameters
    ----------
    logs : Series
        Log weight of each damping with the usual odds, `FURTHER_TERM`.
    factor : float
        Prior odds of each term after the first.
    """
    further = logs.index.str.count(r"\+")
    return pd.Series(softmax(logs + math.log(factor / FURTHER_TERM) * further), logs.index)


# --- the page ---


def page(rows: pd.DataFrame) -> str:
    """Return the page on these rows in Markdown."""
    answered = where(rows, outcome=OK)
    named, right, coverage = _shares(answered)
    lines, bins = [], []
    for decade in (*MOTIONS, *ENVELOPES):
        if (part := where(rows, decade=decade)).empty:
            continue
        own = where(part, outcome=OK)
        p = own["p_truth"].astype(float)
        mean = f"{p.mean():.3f} ± {p.sem():.3f}" if len(p) > 1 else "–"
        lines.append([
            f"{decade:g}", f"{part['kind'].iloc[0]}s", str(len(part)), str(len(part) - len(own)), mean, *_shares(own),
            f"{part['seconds'].median():.2g}",
        ])  # fmt: skip
    for low, high in pairwise(EDGES):
        own = where(answered, (answered["p_first"] > low) & (answered["p_first"] <= high))
        mean = f"{own['p_first'].mean():.3f}" if len(own) else "–"
        bins.append([f"{low:g} to {high:g}", str(len(own)), mean, str(share(total(own, "right"), len(own)))])
    refused = sorted(set(rows["outcome"]) - {OK})
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

{table(HEADS, lines)}

## Are the probabilities right?

{table(["probability of the leading damping", "records", "mean probability", "share right"], bins)}

## Does the result depend on the prior odds of a further term?

{_sensitivity(answered)}

{without}rows.csv has every record; `logs` are log probabilities before normalisation. `make reports` makes \
this report again.
"""


def _shares(answered: pd.DataFrame) -> tuple[str, str, str]:
    """Return three shares with their intervals as text: records named outright, of these correctly, and coverage."""
    sure = where(answered, decided=1)
    return (
        str(share(len(sure), len(answered))),
        str(share(total(sure, "right"), len(sure))),
        str(share(total(answered, "holds"), len(answered))),
    )


def _sensitivity(rows: pd.DataFrame) -> str:
    """Return a Markdown table: how many dampings are named differently under `OTHER_FACTORS` as prior odds."""
    logs = [
        pd.Series({name: float(value) for name, _, value in (pair.rpartition(":") for pair in text.split())})
        for text in rows["logs"]
    ]

    def leaders(factor: float) -> pd.DataFrame:
        """Return the most probable damping of each record, and whether it is named outright."""
        each = [probabilities(log, factor) for log in logs]
        return pd.DataFrame([(p.idxmax(), p.max() >= DECIDED) for p in each], columns=["first", "sure"])

    usual, lines = leaders(FURTHER_TERM), []
    for factor in OTHER_FACTORS:
        other = leaders(factor)
        moved, sure, changed = usual["first"] != other["first"], usual["sure"], other["sure"]
        lines.append([
            f"{factor:g}", f"{moved.sum()} of {len(rows)}", str((sure & ~changed).sum()), str((changed & ~sure).sum()),
            str((sure & changed & moved).sum()),
        ])  # fmt: skip
    heads = (
        "odds", "the leading damping changes", "named outright only with the usual odds",
        "named outright only with these odds", "named outright with both, but differently",
    )  # fmt: skip
    head = f"Each term after the first has prior odds of {FURTHER_TERM:g}. With other odds and the same evidence:"
    return f"{head}\n\n{table(heads, lines)}"


def main() -> None:
    """Run the command line: answer the records that the table lacks, and write the page."""
    parser = page_options(__doc__)
    parser.add_argument("--records", type=int, default=100, help="number of records of each decade")
    parser.add_argument("--few", type=int, default=100, help=f"largest number of records of {LONG:g}")
    options = parser.parse_args()
    todo = {}
    for decade in (*MOTIONS, *ENVELOPES):
        count = min(options.few, options.records) if decade == LONG else options.records
        todo |= {f"{decade:g}-{i}": (decade, i) for i in range(count)}
    make_page(options, "rows.csv", COLUMNS, todo, row_of, page)


if __name__ == "__main__":
    main()
