"""Compare the estimators with each other, the truth, the posterior and published figures, and along one factor."""

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
CATEGORIES = {
    "classical": ("topological", "least_squares", "koopman"),
    "machine learning": ("sindy", "weak_sindy", "pinn", "neural_ode", "rnn", "symbolic_regression"),
    "optimisation": ("envelope", "genetic"),
}
"""The paper's three categories (Table 2)."""
FACTORS = {
    "noise": "noise / % of the first amplitude",
    "sampling": "samples a period",
    "length": "periods",
}
LEAST = 3
"""Number of values of a factor that make a series, and of repeats that an interval needs."""
SURE = 0.95


@dataclass(frozen=True)
class EstimatorComparison:
    """Errors of the estimators under the model of the truth.

    Attributes
    ----------
    methods
        In the order of their categories.
    signals
        The simulated ones that are compared.
    errors
        (method, signal, stage) to the root mean square error over repeats, in per cent of the truth.
    outcomes
        (method, signal, stage) to the first outcome that is not `ok`, or `ok`.
    seconds
        (method, stage) to the sum over signals.
    published
        (method, signal) to the printed error.
    times
        Method to the printed time.
    """

    methods: list[str]
    signals: list[str]
    errors: dict[tuple[str, str, str], float]
    outcomes: dict[tuple[str, str, str], str]
    seconds: dict[tuple[str, str], float]
    published: dict[tuple[str, str], str]
    times: dict[str, str]

    def mean(self, method: str, stage: str) -> float:
        """Return the mean error over the signals for which the method has one; nan if it has none."""
        return _mean(self.errors.get((method, s, stage), math.nan) for s in self.signals)

    def mean_published(self, method: str) -> float:
        """Return the mean of the published errors; nan if there are none."""
        return _mean(printed_error(self.published.get((method, s), "")) for s in self.signals)


def _mean(errors: Iterable[float]) -> float:
    finite = [e for e in errors if math.isfinite(e)]
    return sum(finite) / len(finite) if finite else math.nan


def printed_error(printed: str) -> float:
    """Return a printed error as a number: `~0` is 0, an empty text is nan."""
    match = re.search(r"\d+(\.\d+)?", printed)
    return float(match[0]) if match else math.nan


def rms(errors: Collection[float]) -> float:
    """Return the root mean square; nan for an empty collection."""
    return math.sqrt(sum(e * e for e in errors) / len(errors)) if errors else math.nan


def category_of(method: str) -> str:
    """Return the paper's category of a method; "others" for a method that the paper does not contain."""
    return next((name for name, members in CATEGORIES.items() if method in members), "others")


def sort_by_category(methods: Iterable[str]) -> list[str]:
    """Return the methods in the order of their categories; other methods come last."""
    order = [m for members in CATEGORIES.values() for m in members]
    return sorted(dict.fromkeys(methods), key=lambda m: order.index(m) if m in order else len(order))


def true_models(run: RunFolder) -> dict[str, str]:
    """Return the simulated signals, each with the damping that it was simulated with."""
    simulations = {signal: run.simulation(signal) for signal in run.signals}
    return {signal: "+".join(source["damping"]) for signal, source in simulations.items() if source}


def compare_estimators(run: RunFolder) -> EstimatorComparison:
    """Compare the estimators on the signals with published figures; without such figures on all simulated signals."""
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
        if math.isfinite(row["seconds"]):  # every parameter's row has the time of the whole estimate
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
        What was estimated.
    truth
        nan if it is not known.
    own, refined
        Method to its estimate at each stage, in the first repeat.
    published
        Method to the printed error in per cent, without a sign.
    posterior
        Its 95 % interval; None if there is no posterior.
    source
        The signal to which the posterior belongs.
    """

    signal: str
    model: str
    parameter: str
    unit: str
    truth: float
    own: dict[str, float]
    refined: dict[str, float]
    published: dict[str, float]
    posterior: tuple[float, float] | None
    source: str

    @property
    def methods(self) -> list[str]:
        """Names of the methods that have an estimate at either stage."""
        return list(dict.fromkeys([*self.own, *self.refined]))


def posterior_of(run: RunFolder, signal: str, model: str, parameter: str) -> Row | None:
    """Return the row of a coefficient's posterior, or None.

    If the signal has none, it is that of the first signal that was simulated with the same damping and has one.
    """
    models = true_models(run)
    others = [s for s in run.signals if s != signal and signal in models and models.get(s) == models[signal]]
    for name in (signal, *others):
        if name != signal and truth(run, name, parameter) != truth(run, signal, parameter):
            continue
        for row in rows_of(summary_rows(run, name, run.repeats(name)[0], model), parameter=parameter):
            if math.isfinite(row["q2.5"]) and math.isfinite(row["q97.5"]):
                return row
    return None


def estimates_of(run: RunFolder, signal: str, model: str) -> list[CoefficientEstimates]:
    """Return the estimates of each damping coefficient of a model on a signal, with the published errors.

    A signal without noise has no posterior; it gets that of a signal simulated with the same damping.
    """
    comparison = compare_estimators(run)
    errors = {m: printed_error(text) for (m, s), text in comparison.published.items() if s == signal}
    published = {m: e for m, e in errors.items() if math.isfinite(e)}
    estimates = []
    for parameter in coefficients(run, model):
        rows = rows_of(run.estimates, signal=signal, model=model, parameter=parameter)
        rows = [r for r in rows if r["repeat"] == run.repeats(signal)[0] and math.isfinite(r["value"])]
        methods = dict.fromkeys([*comparison.methods, *(r["estimator"] for r in rows)])
        values = ({r["estimator"]: r["value"] for r in rows if r["stage"] == stage} for stage in STAGES)
        own, refined = ({m: each[m] for m in methods if m in each} for each in values)
        row = posterior_of(run, signal, model, parameter)
        estimates.append(
            CoefficientEstimates(
                signal,
                model,
                parameter,
                str(rows[0]["unit"]) if rows else "",
                truth(run, signal, parameter),
                own,
                refined,
                published,
                (row["q2.5"], row["q97.5"]) if row else None,
                str(row["signal"]) if row else "",
            )
        )
    return estimates


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
        if len(own) < LEAST:
            continue
        base = [Counter(values).most_common(1)[0][0] for values in zip(*own.values())]
        for i, factor in enumerate(FACTORS):
            rest = base[:i] + base[i + 1 :]
            along = {s: design[i] for s, design in own.items() if design[:i] + design[i + 1 :] == rest}
            if len(set(along.values())) >= LEAST:
                signals = sorted(along, key=lambda s: along[s])
                runs.append(_series(run, model, factor, signals, [along[s] for s in signals]))
    return runs


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
    n = left.size
    sd = math.sqrt((n - 1) * float(np.mean((left - left.mean()) ** 2)))
    return float(scipy.stats.t.ppf((1 + SURE) / 2, n - 1)) * sd
