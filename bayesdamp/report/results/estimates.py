"""Each estimator's values of a damping coefficient, with the posterior and what was published."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from bayesdamp.report.results.comparing import STAGES, Comparison, compared, true_models
from bayesdamp.report.results.comparing import value as printed
from bayesdamp.report.results.reading import (
    coefficients,
    damping_parameters,
    models_by_rank,
    summary_rows,
    truth,
)
from bayesdamp.report.results.run import Row, Run, rows_of

MOST = 8
"""Coefficients that one picture has room for."""


@dataclass(frozen=True)
class CoefficientEstimates:
    """One coefficient of one signal.

    own, refined: method to the estimate at each stage, first repeat; published: method to the printed error in per
    cent, without a sign. posterior: its 95 % interval, None where there is none; source: the signal whose
    posterior it is; truth: nan where it is not known.
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
        """Names of the methods that have an estimate, at either stage."""
        return list(dict.fromkeys([*self.own, *self.refined]))


def coefficient_estimates(run: Run) -> list[CoefficientEstimates]:
    """The coefficients of each signal under the damping that made it, else under the most probable one, in the order
    of the signals; empty where that are more than one picture takes.

    A signal without noise has no posterior; it gets that of a signal made with the same damping, and both are there.
    """
    found = compared(run)
    known = true_models(run)
    wanted = [*found.signals, *_alike(run, found, known)] if found.published else run.signals
    made = []
    for signal in wanted:
        ranked = models_by_rank(run, signal, run.repeats(signal)[0])
        model = known.get(signal) or (ranked[0] if ranked else "")
        for parameter in coefficients(run, model) if model else ():
            one = estimates_of(run, found, signal, model, parameter)
            if len(one.methods) > 1:
                made.append(one)
    return made if len(made) <= MOST else []


def covered(run: Run, signal: str, model: str) -> bool:
    """Whether the picture shows a signal's estimates under a model."""
    return any((one.signal, one.model) == (signal, model) for one in coefficient_estimates(run))


def posterior_of(run: Run, signal: str, model: str, parameter: str) -> Row | None:
    """The posterior of a coefficient: the signal's own, else that of the first signal that was simulated with the same
    damping and has one."""
    known = true_models(run)
    alike: Sequence[str] = [
        signal,
        *(s for s in run.signals if s != signal and signal in known and known.get(s) == known[signal]),
    ]
    for name in alike:
        if name != signal and truth(run, name, parameter) != truth(run, signal, parameter):
            continue
        for row in rows_of(summary_rows(run, name, run.repeats(name)[0], model)[1], parameter=parameter):
            if math.isfinite(row["q2.5"]) and math.isfinite(row["q97.5"]):
                return row
    return None


def _alike(run: Run, found: Comparison, known: dict[str, str]) -> list[str]:
    """Signals made with the damping of a published one, that have a posterior and estimates of their own."""
    own = damping_parameters(run)
    names = []
    for signal in found.signals:
        row = posterior_of(run, signal, known[signal], own.get(known[signal], ""))
        estimated = row is not None and any(r["signal"] == row["signal"] for r in run.estimates)
        if row is not None and estimated and row["signal"] not in (*found.signals, *names):
            names.append(str(row["signal"]))
    return names


def estimates_of(
    run: Run, found: Comparison, signal: str, model: str, parameter: str
) -> CoefficientEstimates:
    """Return the estimates of one coefficient. found: the comparison with what was published."""
    rows = rows_of(
        run.estimates, signal=signal, model=model, parameter=parameter, repeat=run.repeats(signal)[0]
    )
    values = {
        stage: {r["estimator"]: r["value"] for r in rows if r["stage"] == stage and math.isfinite(r["value"])}
        for stage in STAGES
    }
    order = [*found.methods, *(m for stage in STAGES for m in values[stage])]
    own, refined = ({m: values[s][m] for m in dict.fromkeys(order) if m in values[s]} for s in STAGES)
    row = posterior_of(run, signal, model, parameter)
    errors = {m: printed(text) for (m, s), text in found.published.items() if s == signal}
    return CoefficientEstimates(
        signal,
        model,
        parameter,
        str(rows[0]["unit"]) if rows else "",
        truth(run, signal, parameter),
        own,
        refined,
        {m: e for m, e in errors.items() if math.isfinite(e)},
        (row["q2.5"], row["q97.5"]) if row else None,
        str(row["signal"]) if row else "",
    )
