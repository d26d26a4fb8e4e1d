"""The page on light damping: `python -m validation.reports.light ROWS.csv FOLDER [--records N] [--few N]`.

Damping ratios of 1e-2 to 1e-4 from oscillations, 1e-5 and 1e-6 from envelopes. How small the damping is must not change
what is said of it, so all records of all decades are drawn alike: the noise is larger in proportion where a record has
more samples. The rows are kept as they are done, and a run that was cut off goes on.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from bayesdamp.interface.answer import Answer, answer
from bayesdamp.interface.envelopes import analyse
from bayesdamp.odds import FURTHER_TERM, odds
from bayesdamp.records.envelope.record import made_record
from bayesdamp.report.markup import markdown_table as table
from bayesdamp.types import OK, InputError, Signal
from validation.rows import gathered, rounded, shipped
from validation.scoring import share_of
from validation.truth.drawing import log_uniform
from validation.truth.motion import solved
from validation.truth.oscillator import Oscillator
from validation.truth.rivals import loss_rate

MOTIONS, ENVELOPES = (1e-2, 1e-3, 1e-4), (1e-5, 1e-6)
"""Decades of the damping ratio, by what is recorded."""
LONG = 1e-4
"""The decade of oscillations whose records take half a minute each."""
SEED = 3141
"""Of this page alone: no prior and no threshold was chosen on these records."""
DAMPINGS = ("viscous", "viscous+coulomb", "viscous+quadratic")
SPREAD = 0.25
"""Decades by which the ratio differs from the one that a record stands for, at most."""
SHARES, FALLS = (0.2, 0.5), (5.0, 11.0)
"""Of the second term at the middle amplitude; of the amplitude over the record."""
NOISES = (0.003, 0.06)
"""Sd of the noise over the first amplitude, of a record of 40 cycles; of others it is larger with the square root of
the number of samples, so that the information does not depend on the damping ratio."""
CYCLES, A_CYCLE, READINGS = 40.0, 30.0, 600
"""Readings of an envelope tell as much of the amplitude as samples of 40 cycles, half of which show the phase."""
SIZES, RATES = (1e-3, 0.1), (0.5, 20.0)
"""First amplitudes in m, frequencies in Hz."""
LEAST_LOG = -15.0
"""Log probability below which a damping is left out of a row."""
OTHER_FACTORS = (0.5, 0.25, 0.0625)
"""Odds of a further term that are tried in place of `FURTHER_TERM`."""
DECIDED = 0.95
EDGES = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0)
COLUMNS = (
    "record", "kind", "decade", "ratio", "truth", "share", "fall", "noise", "outcome", "p_truth", "first", "p_first",
    "decided", "right", "low", "high", "true_ratio", "holds", "seconds", "logs",
)  # fmt: skip
Row = Mapping[str, str]


@dataclass(frozen=True)
class Drawn:
    """What a record is made of.

    Attributes
    ----------
    damping : str
        The true sum.
    ratio : float
        Its damping ratio at the middle amplitude.
    share : float
        Share of the second term there, 0 of a single term.
    size, fall : float
        First amplitude in m, and its ratio to the last one.
    frequency : float
        In rad/s.
    noise : float
        Its sd over the first amplitude.
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
        """The middle amplitude in m: half of the fall, as a logarithm."""
        return self.size / math.sqrt(self.fall)

    @property
    def coefficients(self) -> dict[str, float]:
        """Coefficient of each term, in SI units."""
        first, *second = self.damping.split("+")
        shares = {first: 1 - self.share, **dict.fromkeys(second, self.share)}
        units = {term: float(loss_rate(term, self.middle, self.frequency)) for term in shares}
        return {term: share * self.ratio / units[term] for term, share in shares.items()}

    def ratio_at(self, amplitude: np.ndarray | float) -> np.ndarray | float:
        """Damping ratio at amplitudes in m."""
        return sum(c * loss_rate(term, amplitude, self.frequency) for term, c in self.coefficients.items())

    def decay(self) -> tuple[np.ndarray, np.ndarray]:
        """Times in s, and the amplitudes in m then, until the last one, (n,) each."""
        log = np.linspace(0.0, math.log(self.fall), 4001)
        amplitude = self.size * np.exp(-log)
        slow = 1 / (self.frequency * np.asarray(self.ratio_at(amplitude)))
        t = np.concatenate([[0.0], np.cumsum(0.5 * (slow[1:] + slow[:-1]) * np.diff(log))])
        return t, amplitude


def drawn(decade: float, number: int) -> tuple[Drawn, np.random.Generator]:
    """Draw what a record is made of, and return the generator of its noise."""
    rng = np.random.default_rng([SEED, round(-math.log10(decade)), number])
    damping = DAMPINGS[number % len(DAMPINGS)]
    ratio = decade * 10 ** rng.uniform(-SPREAD, SPREAD)
    share = rng.uniform(*SHARES) if "+" in damping else 0.0
    size, rate, noise = (log_uniform(rng, *ends) for ends in (SIZES, RATES, NOISES))
    fall = rng.uniform(*FALLS)
    made = Drawn(damping, ratio, share, size, fall, 2 * math.pi * rate, noise)
    return made, rng


def oscillation(made: Drawn, rng: np.random.Generator) -> tuple[Signal, float]:
    """Return the record of a motion, by the validation's own solver, and the noise's sd over the first amplitude."""
    rest = rng.uniform(-1, 1) * made.size
    oscillator = Oscillator("linear", {"stiffness": made.frequency**2, "rest_angle": rest}, made.coefficients)
    stop = float(made.decay()[0][-1])
    t = np.arange(0.0, stop, 2 * math.pi / made.frequency / A_CYCLE)
    noise = made.noise * math.sqrt(t.size / (CYCLES * A_CYCLE))
    y = solved(oscillator, made.size, made.frequency, stop).at(t)[0]
    return Signal(t, y + noise * made.size * rng.standard_normal(t.size), unit="m"), noise


def row_of(decade: float, number: int) -> dict[str, object]:
    """Draw a record, ask for its damping and compare the answer with the truth."""
    made, rng = drawn(decade, number)
    kind = "oscillation" if decade in MOTIONS else "envelope"
    head = {
        "record": f"{decade:g}-{number}", "kind": kind, "decade": f"{decade:g}", "ratio": made.ratio,
        "truth": made.damping, "share": made.share, "fall": made.fall, "noise": made.noise,
    }  # fmt: skip
    if kind == "oscillation":
        signal, head["noise"] = oscillation(made, rng)
        start = time.perf_counter()
        asked = {"restoring": ["linear"], "deviation": "none", "measured": False, "sample": False}
        try:
            said = answer(signal, [made.middle], **asked)
        except InputError:  # the window ends before the amplitude in the middle
            said = answer(signal, **asked)
        logs, verdict = log_weights(said), said.verdict
        interval = next(iter(verdict.damping_ratio), None)
        truth = math.nan if interval is None else float(made.ratio_at(interval.amplitude))
        first, decided, why = verdict.damping, verdict.decided, verdict.sentence
    else:
        t, amplitude = made.decay()
        times = np.linspace(0.0, t[-1], READINGS)
        error = made.noise * made.size * rng.standard_normal((2, READINGS))
        y = np.hypot(np.interp(times, t, amplitude) + error[0], error[1])
        record = made_record(f"{decade:g}-{number}", times, y, "V", made.frequency / (2 * math.pi))
        start = time.perf_counter()
        found = analyse(record).verdict
        logs = {name: math.log(p) if p > 0 else -math.inf for name, p in found.probabilities.items()}
        interval = found.damping_ratio[len(found.damping_ratio) // 2] if found.damping_ratio else None
        truth = math.nan if interval is None else float(made.ratio_at(interval.amplitude))
        first, decided, why = found.damping, found.decided, found.sentence
    row = {**head, "seconds": time.perf_counter() - start}
    if not logs or interval is None:
        return rounded({**row, "outcome": why})
    p = probabilities(logs)
    return rounded({
        **row, "outcome": OK, "p_truth": p.get(made.damping, 0.0), "first": first, "p_first": p.get(first, 0.0),
        "decided": int(decided), "right": int(first == made.damping), "low": interval.low, "high": interval.high,
        "true_ratio": truth, "holds": int(interval.low <= truth <= interval.high),
        "logs": " ".join(f"{n}:{v:.2f}" for n, v in logs.items() if v - max(logs.values()) > LEAST_LOG),
    })  # fmt: skip


def log_weights(said: Answer) -> dict[str, float]:
    """Return log evidence and odds of every damping that was weighed under exact laws, the best at 0."""
    others = len({r.damping for r in said.rivals})
    logs: dict[str, float] = {}
    for rows, count in ((said.candidates, 0), (said.rivals, others)):
        for r in rows:
            if math.isfinite(r.exact):
                own = r.exact + math.log(odds(r.damping.split("+"), count))
                logs[r.damping] = float(np.logaddexp(logs.get(r.damping, -math.inf), own))
    top = max(logs.values(), default=0.0)
    return {name: value - top for name, value in logs.items()}


def probabilities(logs: Mapping[str, float], factor: float = FURTHER_TERM) -> dict[str, float]:
    """Return the probability of each damping from log weights with the usual odds, under other odds of a further
    term."""
    more = math.log(factor / FURTHER_TERM)
    weights = {name: value + more * name.count("+") for name, value in logs.items()}
    top = max(weights.values())
    total = sum(math.exp(value - top) for value in weights.values())
    return {name: math.exp(value - top) / total for name, value in weights.items()}


# --- the page ---


def page(rows: Sequence[Row]) -> str:
    """Write the page, in Markdown."""
    told = [r for r in rows if r["outcome"] == OK]
    named, right, held = _shares(told)
    by_decade = {d: [r for r in rows if float(r["decade"]) == d] for d in (*MOTIONS, *ENVELOPES)}
    heads = (
        "damping ratio", "of", "records", "without an answer", "mean P(truth)", "named outright", "rightly", "coverage",
        "median s",
    )  # fmt: skip
    bins = []
    for low, high in pairwise(EDGES):
        own = [r for r in told if low < float(r["p_first"]) <= high]
        mean = f"{np.mean([float(r['p_first']) for r in own]):.3f}" if own else "–"
        bins.append([f"{low:g} to {high:g}", str(len(own)), mean, share_of(_count(own, "right"), len(own))])
    refused = sorted({r["outcome"] for r in rows if r["outcome"] != OK})
    without = f"Without an answer: {' '.join(refused)}\n\n" if refused else ""
    return f"""# Light damping: does the answer depend on how small the damping is?

Of {len(told)} simulated records with damping ratios from 1e-2 to 1e-6 the damping is named outright in \
{named}, rightly in {right} of these; 95 % intervals of the damping ratio at the middle amplitude hold the truth in \
{held}.

The truth is viscous damping, alone or with Coulomb friction or quadratic drag in turn; the second term has \
{SHARES[0]:g} to {SHARES[1]:g} of the loss at the middle amplitude. The amplitude falls by a factor of \
{FALLS[0]:g} to {FALLS[1]:g}. Oscillations (1e-2 to 1e-4) have {A_CYCLE:g} samples a cycle and a linear \
spring; envelopes (1e-5 and 1e-6) have {READINGS} readings. The noise is {NOISES[0]:g} to {NOISES[1]:g} of \
the first amplitude for {CYCLES:g} cycles, and more in proportion to the square root of the number of \
samples, so that the information does not depend on the damping ratio. Laws are taken to hold exactly for \
oscillations. In brackets: 95 % intervals (Wilson) by the number of records.

{table(heads, [_line(decade, own) for decade, own in by_decade.items() if own])}

## Are the probabilities right?

{table(["probability of the leading damping", "records", "its mean", "share right"], bins)}

## Does the prior probability of sums decide the name?

{_sensitivity(told)}

{without}rows.csv has every record; `logs` are log probabilities before they are normalised. `make reports` makes it \
again.
"""


def _line(decade: float, rows: Sequence[Row]) -> list[str]:
    told = [r for r in rows if r["outcome"] == OK]
    p = np.array([float(r["p_truth"]) for r in told])
    mean = f"{p.mean():.3f} ± {p.std(ddof=1) / math.sqrt(p.size):.3f}" if p.size > 1 else "–"
    seconds = np.median([float(r["seconds"]) for r in rows])
    return [
        f"{decade:g}", f"{rows[0]['kind']}s", str(len(rows)), str(len(rows) - len(told)), mean, *_shares(told),
        f"{seconds:.2g}",
    ]  # fmt: skip


def _shares(told: Sequence[Row]) -> tuple[str, str, str]:
    """Write the shares of records that name a damping outright, of these rightly, and of intervals with the truth."""
    sure = [r for r in told if r["decided"] == "1"]
    return (
        share_of(len(sure), len(told)),
        share_of(_count(sure, "right"), len(sure)),
        share_of(_count(told, "holds"), len(told)),
    )


def _sensitivity(rows: Sequence[Row]) -> str:
    """Write how many names change under other odds of a further term."""
    logs = [
        {name: float(value) for name, _, value in (one.rpartition(":") for one in row["logs"].split())}
        for row in rows
    ]
    usual = [_leader(probabilities(each)) for each in logs]
    lines = []
    for factor in OTHER_FACTORS:
        both = [(a, _leader(probabilities(each, factor))) for a, each in zip(usual, logs, strict=True)]
        moved = sum(a != b for (a, _), (b, _) in both)
        lines.append([
            f"{factor:g}", f"{moved} of {len(rows)}",
            str(sum(here and not there for (_, here), (_, there) in both)),
            str(sum(there and not here for (_, here), (_, there) in both)),
            str(sum(here and there and a != b for (a, here), (b, there) in both)),
        ])  # fmt: skip
    heads = (
        "odds", "the leading damping is another", "named outright here only", "with the other odds only",
        "both, another name",
    )  # fmt: skip
    head = f"Each term beyond the first has prior odds of {FURTHER_TERM:g}. Under other odds, for the same evidence:"
    return f"{head}\n\n{table(heads, lines)}"


def _leader(found: Mapping[str, float]) -> tuple[str, bool]:
    """Return the most probable damping, and whether it is probable enough to be named outright."""
    first = max(found, key=found.__getitem__)
    return first, found[first] >= DECIDED


def _count(rows: Sequence[Row], column: str) -> int:
    return sum(r[column] == "1" for r in rows)


def jobs(records: int, few: int) -> dict[str, tuple[float, int]]:
    """Return the arguments of `row_of` by a record's name; few: records of the decade that takes long."""
    counts = {d: min(few, records) if d == LONG else records for d in (*MOTIONS, *ENVELOPES)}
    return {f"{d:g}-{i}": (d, i) for d, count in counts.items() for i in range(count)}


def main(arguments: Sequence[str] | None = None) -> None:
    """Answer the records that the table lacks; write README.md and rows.csv into the folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("table", type=Path, help="rows that are there, and are added to")
    parser.add_argument("folder", type=Path, help="of the page")
    parser.add_argument("--records", type=int, default=100, help="of each decade")
    parser.add_argument("--few", type=int, default=100, help=f"of {LONG:g}, at most")
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args(arguments)
    rows = gathered(asked.table, COLUMNS, jobs(asked.records, asked.few), row_of, asked.workers)
    shipped(asked.folder / "rows.csv", COLUMNS, rows)
    (asked.folder / "README.md").write_text(page(rows), encoding="utf-8")


if __name__ == "__main__":
    main()
