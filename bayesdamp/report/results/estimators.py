"""Compare the estimates of damping coefficients with true values, posteriors and published errors.

The errors of the estimators are also compared on series of simulated signals that differ only in noise, sampling or
length.
"""

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.formatting import data_frame
from bayesdamp.report.results.run import (
    RunFolder,
    coefficients,
    damping_parameters,
    rows_of,
    summary_rows,
    truth,
)
from bayesdamp.store.files import TABLES
from bayesdamp.types import OK

Frame = Any
"""A pandas data frame or series. It is not annotated as such, because type checkers infer wrong types for it."""

STAGES = ("initial", "refined")
"""The stages of an estimator: its own estimate, and the trajectory fit that starts from this estimate."""
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


@dataclass(frozen=True, eq=False)
class EstimatorComparison:
    """Errors of the estimators under the model with which each signal was simulated, next to published errors.

    A stage is one of `STAGES`: "initial" is the estimator's own estimate, "refined" the trajectory fit that starts
    there. The published errors and times are those that the study file states. Each data frame has a row for each
    estimator; they are ordered by their categories (`CATEGORIES`).

    Attributes
    ----------
    errors
        By signal and stage (columns): root mean square error over the damping coefficients and the repeats, in per cent
        of the true values; nan if there is no estimate.
    doubted
        (estimator, signal, stage) of the estimates whose outcome is not `ok`.
    seconds
        By stage (columns): computing time in s, summed over signals and repeats; nan if there is none.
    published
        By signal (columns): the published error in per cent, as text in the form in which it was printed, such as "~0";
        "" if there is none. There are no columns if the study states no published errors.
    times
        By estimator: the published computing time, as text.
    """

    errors: Frame
    doubted: set[tuple[str, str, str]]
    seconds: Frame
    published: Frame
    times: dict[str, str]

    @property
    def methods(self) -> list[str]:
        """Names of the estimators."""
        return self.errors.index.tolist()

    @property
    def signals(self) -> list[str]:
        """Names of the simulated signals that are compared."""
        return self.errors.columns.unique("signal").tolist()

    def at_stage(self, stage: str) -> Frame:
        """Return the errors at one of `STAGES` by signal (columns)."""
        return self.errors.xs(stage, axis=1, level="stage")


def printed_error(printed: str) -> float:
    """Return the first number in a published error as it is printed, such as 0 for "~0"; nan if there is none."""
    match = re.search(r"\d+(\.\d+)?", printed)
    return float(match[0]) if match else np.nan


def rms(errors: Frame) -> float:
    """Return the root mean square of the finite errors; nan if none is finite."""
    return float(np.sqrt(np.square(errors[np.isfinite(errors)]).mean()))


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


def true_estimates(run: RunFolder) -> Frame:
    """Return the rows of estimates.csv whose model has the damping with which the signal was simulated.

    Signals that are compared under several restoring laws have no rows here. Rows of parameters other than damping
    coefficients have no `error_pct` (nan).
    """
    truths = true_models(run)
    rows = [r for r in run.estimates if r["model"] == truths.get(r["signal"])]
    table = data_frame(rows, TABLES["estimates.csv"])
    coefficients = list(damping_parameters(run).values())
    table["error_pct"] = table["error_pct"].where(table["parameter"].isin(coefficients))
    return table


def compare_estimators(run: RunFolder) -> EstimatorComparison:
    """Return the errors of the estimators on all simulated signals.

    If the study states published errors, only the signals that have a published error are compared.
    """
    import pandas as pd

    printed = run.study.get("published") or []
    chosen = {p["signal"] for p in printed} or set(run.signals)
    signals = [signal for signal in true_models(run) if signal in chosen]
    rows = true_estimates(run)
    rows = rows[rows["signal"].isin(signals)]
    methods, key = sort_by_category(rows["estimator"]), ["estimator", "signal", "stage"]
    errors = rows.groupby(key)["error_pct"].agg(rms).unstack(["signal", "stage"])
    columns = pd.MultiIndex.from_product((signals, STAGES), names=("signal", "stage"))
    # The row of every parameter contains the time of the whole estimate.
    times = rows.dropna(subset="seconds").drop_duplicates([*key, "repeat"])
    seconds = times.groupby(["estimator", "stage"])["seconds"].sum().unstack()
    published = cast(Frame, data_frame(printed, ("estimator", "signal", "error_pct")))
    published = published.drop_duplicates(["estimator", "signal"], keep="last")
    published = published.pivot(index="estimator", columns="signal", values="error_pct").fillna("")
    return EstimatorComparison(
        errors.reindex(methods, columns=columns),
        set(rows.loc[rows["outcome"] != OK, key].itertuples(index=False, name=None)),
        seconds.reindex(methods, columns=STAGES),
        published.reindex(methods, columns=signals if printed else (), fill_value=""),
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
        rows = [r for r in rows if np.isfinite(r["value"])]
        own, refined = ({r["estimator"]: r["value"] for r in rows if r["stage"] == stage} for stage in STAGES)
        unit = str(rows[0]["unit"]) if rows else ""
        row, true = summaries.get(parameter), truth(run, signal, parameter)
        interval = (row["q2.5"], row["q97.5"]) if row and np.isfinite(row["q2.5"] + row["q97.5"]) else None
        estimates.append(CoefficientEstimates(signal, model, parameter, unit, true, own, refined, interval))
    return estimates


@dataclass(frozen=True, eq=False)
class ErrorSeries:
    """Absolute errors of the estimated damping coefficients on simulated signals that differ in one factor only.

    Attributes
    ----------
    model, factor
        The damping of the signals, and the factor in which they differ: a key of `FACTORS`.
    values
        Values of the factor, one for each signal, ascending, in the unit that `FACTORS` gives.
    bounds
        The Cramér–Rao bound on the sd of an unbiased estimate of the first coefficient at each value, in per cent of
        its true value; nan if there is none.
    each
        Errors in per cent of the true coefficient, the root mean square of several coefficients; nan if there is no
        estimate. The levels of the index are estimator, stage, the index of the value, and repeat.
    """

    model: str
    factor: str
    values: list[float]
    bounds: list[float]
    each: Frame

    @cached_property
    def errors(self) -> Frame:
        """Root mean square error over repeats; nan if there is no estimate.

        There is a row for each estimator and stage with an error, and a column for each index of a value.
        """
        table = self.each.groupby(level=[0, 1, 2]).agg(rms).unstack().dropna(how="all")
        return table.reindex(columns=range(len(self.values)))

    @cached_property
    def repeats(self) -> Frame:
        """Number of repeats, with and without an estimate, by estimator, stage and index of the value."""
        return self.each.groupby(level=[0, 1, 2]).size()

    def of(self, method: str, stage: str, at: int) -> dict[int, float]:
        """Return the errors of a method at a stage and at the index of a value, by number of the repeat.

        Repeats without an estimate are left out.
        """
        own = self.each.get((method, stage, at))
        return {} if own is None else own.dropna().to_dict()


def error_series(run: RunFolder) -> list[ErrorSeries]:
    """Return all series of simulated signals that differ only in noise, sampling or length, with their errors.

    One of these three factors varies in a series and has at least three different values, rounded to two significant
    digits. The two other factors, and the true values of all parameters besides the noise, have their most common
    values among the signals with the same damping sum. Other settings, such as outliers, are not compared. Signals
    whose natural frequency does not follow from known parameters are left out.
    """
    # By damping and signal: the values of noise, sampling and length, to two digits, and the true parameters.
    designs: dict[str, dict[str, list[Any]]] = {}
    for signal, model in true_models(run).items():
        source, own = run.simulation(signal), designs.setdefault(model, {})
        rate = ((run.info.get("equilibrium") or {}).get(signal) or {}).get("natural_frequency")
        amplitude = (run.about(signal).get("reference") or {}).get("amplitude")
        if rate and amplitude and source.get("duration"):
            simulated, periods = source.get("truth") or {}, source["duration"] * rate / (2 * np.pi)
            start = abs(simulated.get("theta0") or amplitude)
            noise, sampling = 100 * simulated.get("noise_sd", 0.0) / start, (source["samples"] - 1) / periods
            constant = frozenset({**simulated, "noise_sd": 0.0}.items())
            rounded = (float(f"{x:.2g}") for x in (noise, sampling, periods))  # in the order of FACTORS
            own[signal] = [*rounded, constant]
    runs, rows = [], true_estimates(run)
    for model, own in designs.items():
        base = [Counter(values).most_common(1)[0][0] for values in zip(*own.values())]
        # A series along a factor has the most common values of the two other factors and of the parameters.
        for i, factor in enumerate(FACTORS):
            rest = base[:i] + base[i + 1 :]
            along = {s: design[i] for s, design in own.items() if design[:i] + design[i + 1 :] == rest}
            if len(set(along.values())) >= LEAST_VALUES:
                along = dict(sorted(along.items(), key=lambda item: item[1]))
                places = rows["signal"].map({s: at for at, s in enumerate(along)}).rename("value")
                each = rows.groupby(["estimator", "stage", places, "repeat"])["error_pct"].agg(rms)
                parameter = next(iter(coefficients(run, model)), "")
                sizes = [float((run.about(s).get("bound") or {}).get(parameter) or np.nan) for s in along]
                true = [abs(truth(run, s, parameter)) or np.nan for s in along]
                bounds = [100 * size / value for size, value in zip(sizes, true)]
                runs.append(ErrorSeries(model, factor, list(along.values()), bounds, each))
    return runs


def error_interval(errors: Mapping[int, float]) -> tuple[float, float]:
    """Return the 95 % interval (low, high) of the root mean square of errors, in the unit of the errors.

    errors: by number of the repeat. The interval is approximate: it is the jackknife interval of the log of the mean
    square, with Student's t (Tukey 1958). The errors must have a finite fourth moment. Returns (nan, nan) for fewer
    than three repeats, or if all errors are 0.
    """
    squares = np.array([e * e for e in errors.values()])
    if squares.size < LEAST_VALUES or not squares.any():
        return (np.nan, np.nan)
    centre, half = float(np.log(squares.mean())), _half_width(np.log(_leave_out(squares)))
    return (float(np.exp((centre - half) / 2)), float(np.exp((centre + half) / 2)))


def is_significantly_better(own: Mapping[int, float], other: Mapping[int, float]) -> bool:
    """Return whether the errors `own` of one method are significantly smaller than the errors `other` of another.

    Errors are by number of the repeat; only repeats with both errors are used. The test is a jackknife of the log ratio
    of the two mean squares, with a false-alarm rate of 2.5 %. Both methods used the same records, so the common part of
    their errors cancels. Returns False for fewer than three such repeats. Errors that are all 0 are significantly
    smaller than errors that are not.
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
    """Return the range of ranks of each method that its errors in the repeats allow, at one value of the factor.

    The result contains the best and the worst rank, by name of the method; 1 is the method with the smallest errors.

    Best rank: 1 + the number of methods that are significantly better. Worst rank: the number of methods minus the
    number of methods that are significantly worse. Methods without an estimate at this value are left out.

    Parameters
    ----------
    along
        The series.
    stage
        Stage of the estimates, of `STAGES`.
    level
        Index of the factor's value.
    """
    methods = dict.fromkeys(along.each.index.get_level_values(0))
    errors = {m: own for m in methods if (own := along.of(m, stage, level))}
    return {
        m: (
            1 + sum(is_significantly_better(other, own) for n, other in errors.items() if n != m),
            len(errors) - sum(is_significantly_better(own, other) for n, other in errors.items() if n != m),
        )
        for m, own in errors.items()
    }


def _leave_out(squares: np.ndarray) -> np.ndarray:
    """Return the mean of the squares with each repeat left out in turn, (n,); always positive, so that it has a log."""
    return np.maximum((squares.sum() - squares) / (squares.size - 1), 1e-12 * squares.mean())


def _half_width(left: np.ndarray) -> float:
    """Return the half width of a statistic's jackknife interval (with probability `CONFIDENCE`, Student's t).

    left: the statistic, recomputed with each of the n repeats left out in turn, (n,). The result is in its unit.
    """
    n = left.size
    sd = np.sqrt((n - 1) * float(np.mean((left - left.mean()) ** 2)))
    return float(scipy.stats.t.ppf((1 + CONFIDENCE) / 2, n - 1)) * sd
