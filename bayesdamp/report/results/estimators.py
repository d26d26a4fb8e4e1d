"""Compare the estimators with each other, with the truth, with the posterior and with published figures."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable
from dataclasses import dataclass

from bayesdamp.report.results.reading import coefficients, damping_parameters, summary_rows, truth
from bayesdamp.report.results.run import Row, RunFolder, rows_of
from bayesdamp.types import OK

STAGES = ("initial", "refined")
CATEGORIES = {
    "classical": ("topological", "least_squares", "koopman"),
    "machine learning": ("sindy", "weak_sindy", "pinn", "neural_ode", "rnn", "symbolic_regression"),
    "optimisation": ("envelope", "genetic"),
}
"""The paper's three categories (Table 2)."""


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
