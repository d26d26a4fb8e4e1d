"""Errors along one factor, and which methods' errors differ significantly.

A series is a set of simulated signals that differ only in their noise, sampling or length. Intervals and comparisons
are jackknife estimates over the repeats (Tukey 1958).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bayesdamp.report.results.estimators import STAGES, rms, true_models
from bayesdamp.report.results.reading import damping_parameters
from bayesdamp.report.results.run import RunFolder

FACTORS = {
    "noise": "noise / % of the first amplitude",
    "sampling": "samples a period",
    "length": "periods",
}
LEAST = 3
"""Number of values of a factor that make a series, and of repeats that an interval needs."""
SURE = 0.95


@dataclass(frozen=True)
class ErrorSeries:
    """Errors along one factor under one damping.

    Attributes
    ----------
    model, factor
        The damping and the factor.
    values
        Of the factor, ascending.
    errors
        (method, stage) to the root mean square error at each value, in per cent of the truth.
    answers
        (method, stage) to the number of repeats with an answer and of all repeats, at each value.
    bounds
        The Cramér–Rao bound at each value in per cent, nan if there is none.
    each
        (method, stage) to the errors of the repeats with an answer, by the repeat's number, at each value.
    """

    model: str
    factor: str
    values: list[float]
    errors: dict[tuple[str, str], list[float]]
    answers: dict[tuple[str, str], list[tuple[int, int]]]
    bounds: list[float]
    each: dict[tuple[str, str], list[dict[int, float]]]


def series(run: RunFolder) -> list[ErrorSeries]:
    """Return every series of at least three values in the run, by damping and factor."""
    models = true_models(run)
    designs = {signal: _design(run, signal) for signal in models}
    runs = []
    for model in dict.fromkeys(models.values()):
        own = {s: design for s, design in designs.items() if design is not None and models[s] == model}
        if len(own) < LEAST:
            continue
        base = [
            Counter(design[i] for design in own.values()).most_common(1)[0][0] for i in range(len(FACTORS))
        ]
        for i, factor in enumerate(FACTORS):
            along = {
                s: design[i]
                for s, design in own.items()
                if all(design[j] == base[j] for j in range(len(base)) if j != i)
            }
            if len(set(along.values())) >= LEAST:
                signals = sorted(along, key=lambda s: along[s])
                runs.append(_series(run, model, factor, signals, [along[s] for s in signals]))
    return runs


def _design(run: RunFolder, signal: str) -> tuple[float, float, float] | None:
    """Return noise in per cent of the first amplitude, samples per period and periods, rounded to two digits."""
    source = run.simulation(signal)
    rate = ((run.info.get("equilibrium") or {}).get(signal) or {}).get("natural_frequency")
    amplitude = (run.about(signal).get("reference") or {}).get("amplitude")
    if not rate or not amplitude or not source.get("duration"):
        return None
    truth, periods = source.get("truth") or {}, source["duration"] * rate / (2 * math.pi)
    start = abs(truth.get("theta0") or amplitude)
    numbers = (100 * truth.get("noise_sd", 0.0) / start, (source["samples"] - 1) / periods, periods)
    return tuple(float(f"{x:.2g}") for x in numbers)  # type: ignore[return-value]


def _series(run: RunFolder, model: str, factor: str, signals: list[str], values: list[float]) -> ErrorSeries:
    damping = set(damping_parameters(run).values())
    each: dict[tuple[str, str], list[dict[int, float]]] = {}
    tried: Counter[tuple[str, str, str]] = Counter()
    for row in run.estimates:
        if row["model"] != model or row["signal"] not in signals or row["stage"] not in STAGES:
            continue
        key = (row["estimator"], row["stage"])
        if row["parameter"] in damping or not row["parameter"]:
            tried[(*key, row["signal"])] += 1
        if row["parameter"] in damping and math.isfinite(row["error_pct"]):
            errors = each.setdefault(key, [{} for _ in signals])
            errors[signals.index(row["signal"])][int(row["repeat"])] = row["error_pct"]

    def bound(signal: str) -> float:
        """Return the bound on the damping coefficient in per cent of its true value."""
        bounds = run.about(signal).get("bound") or {}
        for row in run.estimates:
            if row["signal"] == signal and row["parameter"] in bounds and row["parameter"] in damping:
                size, truth = bounds[row["parameter"]], row["truth"]
                if truth and isinstance(size, (int, float)) and math.isfinite(size):
                    return 100 * size / abs(truth)
        return math.nan

    return ErrorSeries(
        model,
        factor,
        values,
        {key: [rms(own.values()) for own in errors] for key, errors in each.items()},
        {
            key: [(len(own), tried[(*key, s)]) for own, s in zip(errors, signals)]
            for key, errors in each.items()
        },
        [bound(s) for s in signals],
        each,
    )


def interval(errors: Mapping[int, float]) -> tuple[float, float]:
    """Return the 95 % interval of the root mean square of errors by repeat; nan for fewer than three repeats.

    Jackknife of the log of the mean square with Student's t (Tukey 1958). It is exact for no distribution of the
    errors, and close for all that have a fourth moment.
    """
    squares = np.array([e * e for e in errors.values()])
    if squares.size < LEAST or not squares.any():
        return (math.nan, math.nan)
    centre, half = float(np.log(squares.mean())), _half_width(np.log(_leave_out(squares)))
    return (float(np.exp((centre - half) / 2)), float(np.exp((centre + half) / 2)))


def ahead(own: Mapping[int, float], other: Mapping[int, float]) -> bool:
    """Return whether a method's errors are significantly smaller than another's, on the repeats that both answered.

    Jackknife of the log ratio of the two mean squares. Both methods used the same records, so what is common to their
    errors cancels. The false-alarm rate is 2.5 %.
    """
    common = sorted(set(own) & set(other))
    if len(common) < LEAST:
        return False
    a, b = (np.array([errors[i] ** 2 for i in common]) for errors in (own, other))
    if not b.any():
        return False
    if not a.any():
        return True
    half = _half_width(np.log(_leave_out(a)) - np.log(_leave_out(b)))
    return float(np.log(a.mean() / b.mean())) + half < 0


def places(along: ErrorSeries, stage: str, level: int) -> dict[str, tuple[int, int]]:
    """Return the best and the worst place of each method by its errors at one value of the factor.

    A method's best place is behind all methods that are significantly better, its worst is before all that are
    significantly worse.

    Parameters
    ----------
    along
        The series.
    stage
        Of the estimates.
    level
        Index of the factor's value.
    """
    errors = {m: each[level] for (m, s), each in along.each.items() if s == stage and each[level]}
    return {
        m: (
            1 + sum(ahead(other, own) for n, other in errors.items() if n != m),
            len(errors) - sum(ahead(own, other) for n, other in errors.items() if n != m),
        )
        for m, own in errors.items()
    }


def _leave_out(squares: np.ndarray) -> np.ndarray:
    """Return the mean squares, (n,), with each repeat left out in turn; at least a tiny positive number."""
    left = (squares.sum() - squares) / (squares.size - 1)
    return np.maximum(left, 1e-12 * squares.mean())


def _half_width(left: np.ndarray) -> float:
    """Return the half width of a statistic's interval, from its values with each of n repeats left out, (n,)."""
    from scipy import stats  # imports slowly

    n = left.size
    sd = math.sqrt((n - 1) * float(np.mean((left - left.mean()) ** 2)))
    return float(stats.t.ppf((1 + SURE) / 2, n - 1)) * sd
