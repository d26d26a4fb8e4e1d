"""Compare answers that must agree: `python -m validation.measured.agreement FILE.csv [halves] [runs]`.

Measured records have no known truth, so agreement is what can be tested: of the two halves of a record, and of runs of
one rig. The file has a row for each pair of answers. For each part, the output contains the mean square of the
standardised differences of the damping ratio at common amplitudes, how often the sum of one answer has a probability of
at least 0.05 in the other answer, and the records that could not be compared. The expected mean square is 1 if the
intervals are right, whether or not the pairs are independent. The answers are from linear approximations.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from bayesdamp.interface.answer import answer
from bayesdamp.types import InputError, Refusal, Signal
from bayesdamp.verdict.types import Verdict
from validation.contest.apart.shared import even, fit_sinusoid, spectral_peak
from validation.measured.run import signals
from validation.rows import where
from validation.scoring import Z, probability_of

SPECIMENS = {"ten-runs": ("ten-runs",), "stiff discs": ("stiff-disc-2", "stiff-disc-3")}
SINGLE = ("rotary", "video", "disc", "rig-80P", "rig-60", "rig-100", "stiff-disc-2", "stiff-disc-3", "ship")
CYCLES = 3.0
"""Least number of periods of a record whose range of amplitudes can be computed."""
AT = (5 / 6, 1 / 2, 1 / 6)
"""Amplitudes at which runs are compared, as fractions of their common range of ln(amplitude) from its lower end."""
LEAST_RANGE = 1.1
"""Runs are compared only if the upper end of their common range of amplitudes is at least this factor above the
lower."""
POSSIBLE = 0.05
"""The damping sum of one answer counts as possible in the other if it has at least this probability there."""

Answering = Callable[[Signal, tuple[float, ...]], Verdict]
"""A function of a record and amplitudes (rad) that returns a verdict, or raises Refusal if it has none."""


def quick_verdict(signal: Signal, amplitudes: tuple[float, ...]) -> Verdict:
    """Return the verdict on a record without sampling, with damping ratios at these amplitudes (unit of the record).

    Raises Refusal if the verdict has no damping ratio.
    """
    verdict = answer(signal, amplitudes, sample=False).verdict
    if not verdict.damping_ratio:
        raise Refusal(verdict.sentence)
    return verdict


def amplitude_range(signal: Signal) -> tuple[float, float]:
    """Return the amplitudes (unit of the record) half a period after its start and half a period before its end.

    Each is the amplitude of a sinusoid with a constant, fitted to one period by least squares. The period is that of
    the largest spectral line. Raises Refusal if the record has fewer than three periods.
    """
    t, y = signal.t, signal.y
    period = 1 / spectral_peak(*even(t, y))
    if t[-1] - t[0] < CYCLES * period:
        raise Refusal(f"the record has fewer than {CYCLES:g} periods")
    sizes = []
    for begin in (t[0], t[-1] - period):
        inside = (t >= begin) & (t <= begin + period)
        cosine, sine, _ = fit_sinusoid(2 * np.pi * (t[inside] - begin) / period, y[inside])
        sizes.append(float(np.hypot(cosine, sine)))
    return sizes[0], sizes[1]


def runs(records: Sequence[Signal], answering: Answering) -> pd.DataFrame:
    """Compare every two runs of one rig, at three amplitudes that are in the range of all runs.

    The result has a row of `agreement` for each pair. Each run is answered once. Raises Refusal if the runs have no
    common amplitudes, or if a run has no answer.
    """
    ranges = np.array([amplitude_range(signal) for signal in records])
    high, low = ranges[:, 0].min(), ranges[:, 1].max()
    if high < LEAST_RANGE * low:
        raise Refusal(
            f"the runs have no common amplitudes: one run ends at {low:g} rad, another begins at {high:g} rad"
        )
    amplitudes = tuple(float(low * (high / low) ** part) for part in AT)
    answers = [(f"{i} {signal.name}", answering(signal, amplitudes)) for i, signal in enumerate(records, 1)]
    return pd.DataFrame([agreement(*first, *second) for first, second in combinations(answers, 2)])


def halves(signal: Signal, answering: Answering) -> pd.DataFrame:
    """Compare the two halves of a record at the amplitude between them, the only one that both have.

    The result has one row of `agreement`. Each half begins at t = 0. Raises Refusal if a half has no answer.
    """
    t, y = signal.t, signal.y
    cut = int(np.searchsorted(t, 0.5 * (t[0] + t[-1])))
    first = replace(signal, t=t[:cut], y=y[:cut], name=f"{signal.name}, first half")
    second = replace(signal, t=t[cut:] - t[cut], y=y[cut:], name=f"{signal.name}, second half")
    between = (float(np.sqrt(amplitude_range(first)[1] * amplitude_range(second)[0])),)
    return pd.DataFrame([
        agreement(first.name, answering(first, between), second.name, answering(second, between))
    ])  # fmt: skip


def agreement(first: str, answer: Verdict, second: str, other: Verdict) -> dict[str, Any]:
    """Compare the damping ratios and sums of two answers at the same amplitudes; return a row of the table.

    The standard deviation of a damping ratio is the width of its interval over 2 · 1.96.

    Parameters
    ----------
    first, second : str
        Names of the records.
    answer, other : Verdict
        The answers for the first and the second record.

    Returns
    -------
    dict
        Names and sums of both answers; mean z² and largest |z| of the standardised differences z; whether the sum of
        each answer is possible in the other one, and whether it is named outright.
    """
    a, b = (
        np.array([(r.amplitude, r.value, r.high - r.low) for r in v.damping_ratio]) for v in (answer, other)
    )
    np.testing.assert_allclose(a[:, 0], b[:, 0], 1e-6, err_msg=f"amplitudes of {first} and {second}")
    z = (a[:, 1] - b[:, 1]) / np.hypot(a[:, 2], b[:, 2]) * (2 * Z)
    return {
        "first": first, "second": second, "named_first": answer.damping, "named_second": other.damping,
        "mean_square": np.mean(z**2), "largest": np.max(np.abs(z)),
        "first_possible": probability_of(other, answer.damping) >= POSSIBLE,
        "second_possible": probability_of(answer, other.damping) >= POSSIBLE,
        "first_decided": bool(answer.decided), "second_decided": bool(other.decided),
    }  # fmt: skip


def summary(pairs: pd.DataFrame) -> str:
    """Return one line of text on these pairs: mean square of z, and how many sums are possible in the other answer."""
    possible, decided = (
        pairs[[f"first_{what}", f"second_{what}"]].to_numpy() for what in ("possible", "decided")
    )
    return (
        f"{len(pairs)} pairs, mean square {pairs['mean_square'].mean():.2f}, most probable sums that the other answer "
        f"allows {possible.mean():.2f}, of those named outright {possible[decided].sum()} of {decided.sum()}"
    )


def comparisons(part: str) -> Iterator[tuple[str, Callable[[], pd.DataFrame]]]:
    """Yield the name of each record (part "halves") or rig (part "runs"), and a function that compares its answers."""
    if part == "halves":
        for name, records in signals(list(SINGLE)):
            yield name, lambda records=records: halves(records[0], quick_verdict)
    else:
        for name, members in SPECIMENS.items():
            every = [signal for _, records in signals(list(members)) for signal in records]
            yield name, lambda every=every: runs(every, quick_verdict)


def main(file: Path, parts: list[str]) -> None:
    """Run the command line: compare the answers of the parts "halves", "runs" or both, and write the table."""
    tables: list[pd.DataFrame] = []
    for part in parts or ("halves", "runs"):
        for name, compare in comparisons(part):
            try:
                pairs = compare().assign(part=part, record=name)
            except (Refusal, InputError) as why:
                print(f"{part}: {name}: not compared: {why}", flush=True)
                continue
            tables.append(pairs)
            pd.concat(tables).to_csv(file, index=False)
            print(f"{part}: {name}: {summary(pairs)}", flush=True)
        if tables and len(own := where(pd.concat(tables), part=part)):
            print(f"{part}: {summary(own)}", flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
