"""Compare the estimators with each other, the truth, the posterior and published errors.

Their errors are also compared along series of signals that differ in noise, sampling or length only.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.report.results.run import (
    Row,
    RunFolder,
    coefficients,
    damping_parameters,
    rows_of,
    summary_rows,
    truth,
)
from bayesdamp.types import OK

STAGES = ("initial", "refined")
"""The stages of an estimator: its own estimate, and the trajectory fit that starts there."""
CATEGORIES = {
    "classical": ("topological", "least_squares", "koopman"),
    "machine learning": ("sindy", "weak_sindy", "pinn", "neural_ode", "rnn", "symbolic_regression"),
    "optimisation": ("envelope", "genetic"),
}
"""Categories of estimators, as in Table 2 of the paper whose methods the package contains: "A Comparative Study of
Machine Learning and Classical Methods for Damping Parameter Estimation in Nonlinear Oscillatory Systems"."""
FACTORS = {
    "noise": "noise / % of the first amplitude",
    "sampling": "samples per period",
    "length": "length / periods",
}
"""Factors that a series of signals may vary, with the labels of their axes."""
LEAST_VALUES = 3
"""Smallest number of values of a factor (noise, sampling or length) that make a series of signals, and smallest number
of repeats from which the interval of an error is computed."""
CONFIDENCE = 0.95
"""Probability of the intervals of errors (conventional)."""


@dataclass(frozen=True)
class EstimatorComparison:
    """Errors of the estimators under the model with which each signal was simulated.

    Attributes
    ----------
    methods
        Names of the estimators, in the order of their categories.
    signals
        Names of the simulated signals that are compared.
    errors
        By (method, signal, stage): root mean square error over the damping coefficients and the repeats, in per cent of
        the true values; without an entry if there is no estimate.
    outcomes
        By (method, signal, stage): the first outcome that is not `ok`, or `ok`.
    seconds
        By (method, stage): computing time in s, summed over signals and repeats.
    published
        By (method, signal): the published error in per cent, as it is printed, such as "~0".
    times
        By method: the published computing time as text, as it is printed.
    """

    methods: list[str]
    signals: list[str]
    errors: dict[tuple[str, str, str], float]
    outcomes: dict[tuple[str, str, str], str]
    seconds: dict[tuple[str, str], float]
    published: dict[tuple[str, str], str]
    times: dict[str, str]

    def mean(self, method: str, stage: str) -> float:
        """Return the mean error in per cent over the signals for which the method has one; nan if it has none.

        `stage` is one of `STAGES`.
        """
        return _mean(self.errors.get((method, s, stage), math.nan) for s in self.signals)

    def mean_published(self, method: str) -> float:
        """Return a method's mean published error in per cent over the signals that have one; nan if none has."""
        return _mean(printed_error(self.published.get((method, s), "")) for s in self.signals)


def _mean(errors: Iterable[float]) -> float:
    """Return the mean of the finite errors; nan if there are none."""
    finite = [e for e in errors if math.isfinite(e)]
    return sum(finite) / len(finite) if finite else math.nan


def printed_error(printed: str) -> float:
    """Return the first number in a printed error, such as 0 for "~0"; nan if there is none."""
    match = re.search(r"\d+(\.\d+)?", printed)
    return float(match[0]) if match else math.nan


def rms(errors: Collection[float]) -> float:
    """Return the root mean square of errors; nan if there are none."""
    return math.sqrt(sum(e * e for e in errors) / len(errors)) if errors else math.nan


def category_of(method: str) -> str:
    """Return the category of an estimator, a key of `CATEGORIES`, or "others" for one that is not in the paper."""
    return next((name for name, members in CATEGORIES.items() if method in members), "others")


def sort_by_category(methods: Iterable[str]) -> list[str]:
    """Return the methods, each once, in the order of `CATEGORIES`; other methods come last."""
    order = [m for members in CATEGORIES.values() for m in members]
    return sorted(dict.fromkeys(methods), key=lambda m: order.index(m) if m in order else len(order))


def true_models(run: RunFolder) -> dict[str, str]:
    """Return the damping sum with which each simulated signal was simulated, by the signal's name.

    The terms of a sum are joined by +. Measured signals are left out.
    """
    simulations = {signal: run.simulation(signal) for signal in run.signals}
    return {signal: "+".join(source["damping"]) for signal, source in simulations.items() if source}


def compare_estimators(run: RunFolder) -> EstimatorComparison:
    """Return the errors of the estimators on the simulated signals that have published errors.

    If the study contains no published errors, all simulated signals are compared. Only estimates under the model with
    which a signal was simulated are used.
    """
    printed = run.study.get("published") or []
    truths, with_figures = true_models(run), {p["signal"] for p in printed}
    signals = [s for s in run.signals if s in truths and (s in with_figures or not with_figures)]
    rows: dict[tuple[str, str, str], list[Row]] = {}
    seconds: dict[tuple[str, str, str, int], float] = {}
    for row in run.estimates:
        signal, stage = row["signal"], row["stage"]
        if signal not in signals or row["model"] != truths[signal] or stage not in STAGES:
            continue
        rows.setdefault((row["estimator"], signal, stage), []).append(row)
        # The row of every parameter contains the time of the whole estimate.
        if math.isfinite(row["seconds"]):
            seconds.setdefault((row["estimator"], stage, signal, row["repeat"]), row["seconds"])
    totals: dict[tuple[str, str], float] = {}
    for (method, stage, *_), time in seconds.items():
        totals[method, stage] = totals.get((method, stage), 0.0) + time
    damping = set(damping_parameters(run).values())
    sizes = {
        key: [r["error_pct"] for r in own if r["parameter"] in damping and math.isfinite(r["error_pct"])]
        for key, own in rows.items()
    }
    return EstimatorComparison(
        sort_by_category(method for method, _, _ in rows),
        signals,
        {key: rms(errors) for key, errors in sizes.items() if errors},
        {key: next((r["outcome"] for r in own if r["outcome"] != OK), OK) for key, own in rows.items()},
        totals,
        {(p["estimator"], p["signal"]): p["error_pct"] for p in printed},
        {p["estimator"]: p["time"] for p in printed if p["time"]},
    )


@dataclass(frozen=True)
class CoefficientEstimates:
    """The estimates of one damping coefficient of one signal.

    Attributes
    ----------
    signal, model, parameter, unit
        Names of the signal, the model and the coefficient, and the coefficient's unit.
    truth
        True value; nan if it is not known.
    own, refined
        By method: its own estimate, and the result of the trajectory fit, in the first repeat; in `unit`.
    posterior
        Low and high end of the 95 % interval of the posterior, in `unit`; None if there is no posterior.
    """

    signal: str
    model: str
    parameter: str
    unit: str
    truth: float
    own: dict[str, float]
    refined: dict[str, float]
    posterior: tuple[float, float] | None

    @property
    def methods(self) -> list[str]:
        """Names of the methods that have an estimate at either stage, in the order of their categories."""
        return sort_by_category([*self.own, *self.refined])


def estimates_of(run: RunFolder, signal: str, model: str) -> list[CoefficientEstimates]:
    """Return the estimates of each damping coefficient of a model, from the first repeat of a signal."""
    repeat, estimates = run.repeats(signal)[0], []
    summaries = {r["parameter"]: r for r in summary_rows(run, signal, repeat, model)}
    for parameter in coefficients(run, model):
        rows = rows_of(run.estimates, signal=signal, repeat=repeat, model=model, parameter=parameter)
        rows = [r for r in rows if math.isfinite(r["value"])]
        own, refined = ({r["estimator"]: r["value"] for r in rows if r["stage"] == stage} for stage in STAGES)
        unit = str(rows[0]["unit"]) if rows else ""
        row = summaries.get(parameter)
        interval = (row["q2.5"], row["q97.5"]) if row and math.isfinite(row["q2.5"] + row["q97.5"]) else None
        estimates.append(
            CoefficientEstimates(
                signal, model, parameter, unit, truth(run, signal, parameter), own, refined, interval
            )
        )
    return estimates


@dataclass(frozen=True)
class ErrorSeries:
    """Absolute errors of the estimated damping coefficient on simulated signals that differ in one factor only.

    Attributes
    ----------
    model, factor
        The damping of the signals, and the factor in which they differ: a key of `FACTORS`.
    values
        Values of the factor, ascending, in the unit that `FACTORS` gives.
    errors
        By (method, stage), where the stage is one of `STAGES`: the root mean square error over repeats at each value,
        in per cent of the true coefficient; nan at a value without estimates.
    answers
        By (method, stage): at each value, the number of repeats with an estimate and the number of all repeats.
    bounds
        The Cramér–Rao bound on the sd of an unbiased estimate at each value, in per cent of the true coefficient; nan
        if there is none.
    each
        By (method, stage): for each value, a dictionary from the number of a repeat with an estimate to its error, in
        per cent of the true coefficient.
    """

    model: str
    factor: str
    values: list[float]
    errors: dict[tuple[str, str], list[float]]
    answers: dict[tuple[str, str], list[tuple[int, int]]]
    bounds: list[float]
    each: dict[tuple[str, str], list[dict[int, float]]]


def error_series(run: RunFolder) -> list[ErrorSeries]:
    """Return all series of simulated signals that differ in one factor only and have at least three values of it.

    The factors are those of `FACTORS`, rounded to two significant digits. The other factors have their most common
    values among the signals of the same damping.
    """
    # By damping and signal: the values of noise, sampling and length, to two digits.
    designs: dict[str, dict[str, list[float]]] = {}
    for signal, model in true_models(run).items():
        source, own = run.simulation(signal), designs.setdefault(model, {})
        rate = ((run.info.get("equilibrium") or {}).get(signal) or {}).get("natural_frequency")
        amplitude = (run.about(signal).get("reference") or {}).get("amplitude")
        if rate and amplitude and source.get("duration"):
            truth, periods = source.get("truth") or {}, source["duration"] * rate / (2 * math.pi)
            start = abs(truth.get("theta0") or amplitude)
            factors = (100 * truth.get("noise_sd", 0.0) / start, (source["samples"] - 1) / periods, periods)
            own[signal] = [float(f"{x:.2g}") for x in factors]  # in the order of FACTORS
    runs = []
    for model, own in designs.items():
        if len(own) < LEAST_VALUES:
            continue
        base = [Counter(values).most_common(1)[0][0] for values in zip(*own.values())]
        # A series along a factor has the most common values of the two other factors.
        for i, factor in enumerate(FACTORS):
            rest = base[:i] + base[i + 1 :]
            along = {s: design[i] for s, design in own.items() if design[:i] + design[i + 1 :] == rest}
            if len(set(along.values())) >= LEAST_VALUES:
                signals = sorted(along, key=lambda s: along[s])
                runs.append(_series(run, model, factor, signals, [along[s] for s in signals]))
    return runs


def _series(run: RunFolder, model: str, factor: str, signals: list[str], values: list[float]) -> ErrorSeries:
    """Return the errors on the signals of a series, from the rows of estimates.csv.

    `values` are those of the factor for each of `signals`, ascending.
    """
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
        """Return the Cramér–Rao bound on the damping coefficient in per cent of its true value, or nan."""
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


def error_interval(errors: Mapping[int, float]) -> tuple[float, float]:
    """Return the 95 % interval (low, high) of the root mean square of errors, which are given by number of the repeat.

    It has the unit of the errors. It is the jackknife interval of the log of the mean square, with Student's t (Tukey
    1958), which is approximate; the errors need a finite fourth moment. (nan, nan) for fewer than three repeats, or if
    all errors are 0.
    """
    squares = np.array([e * e for e in errors.values()])
    if squares.size < LEAST_VALUES or not squares.any():
        return (math.nan, math.nan)
    centre, half = float(np.log(squares.mean())), _half_width(np.log(_leave_out(squares)))
    return (float(np.exp((centre - half) / 2)), float(np.exp((centre + half) / 2)))


def is_significantly_better(own: Mapping[int, float], other: Mapping[int, float]) -> bool:
    """Return whether a method's errors are significantly smaller than another's, on the repeats with both estimates.

    The test is a jackknife of the log ratio of the two mean squares, with a false-alarm rate of 2.5 %. Both methods
    used the same records, so the common part of their errors cancels. False for fewer than three such repeats; errors
    that are all 0 are better than any others.
    """
    common = sorted(set(own) & set(other))
    if len(common) < LEAST_VALUES:
        return False
    a, b = (np.array([errors[i] ** 2 for i in common]) for errors in (own, other))
    if not b.any():
        return False
    if not a.any():
        return True
    half = _half_width(np.log(_leave_out(a)) - np.log(_leave_out(b)))
    return float(np.log(a.mean() / b.mean())) + half < 0


def rank_ranges(along: ErrorSeries, stage: str, level: int) -> dict[str, tuple[int, int]]:
    """Return the best and the worst rank of each method that the repeats allow, at one value of the factor.

    Best rank: 1 + the number of methods that are significantly better. Worst rank: the number of methods minus that of
    those that are significantly worse. Methods without an estimate at this value are left out.

    Parameters
    ----------
    along
        The series.
    stage
        Stage of the estimates, of `STAGES`.
    level
        Index of the factor's value.
    """
    errors = {m: each[level] for (m, s), each in along.each.items() if s == stage and each[level]}
    return {
        m: (
            1 + sum(is_significantly_better(other, own) for n, other in errors.items() if n != m),
            len(errors) - sum(is_significantly_better(own, other) for n, other in errors.items() if n != m),
        )
        for m, own in errors.items()
    }


def _leave_out(squares: np.ndarray) -> np.ndarray:
    """Return the mean of the squares with each repeat left out in turn, (n,); always positive, so that it has a log."""
    left = (squares.sum() - squares) / (squares.size - 1)
    return np.maximum(left, 1e-12 * squares.mean())


def _half_width(left: np.ndarray) -> float:
    """Return the half width of a statistic's jackknife interval (with probability `CONFIDENCE`, Student's t).

    left: the statistic, recomputed with each of the n repeats left out in turn, (n,). The result is in its unit.
    """
    n = left.size
    sd = math.sqrt((n - 1) * float(np.mean((left - left.mean()) ** 2)))
    return float(scipy.stats.t.ppf((1 + CONFIDENCE) / 2, n - 1)) * sd
