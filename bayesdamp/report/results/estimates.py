"""Each estimator's values of a damping coefficient, with the posterior and what was published."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from bayesdamp.report.results.comparing import STAGES, compared, true_models
from bayesdamp.report.results.comparing import value as printed
from bayesdamp.report.results.reading import coefficients, summary_rows, truth
from bayesdamp.report.results.run import Row, Run, rows_of


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
        for row in rows_of(summary_rows(run, name, run.repeats(name)[0], model), parameter=parameter):
            if math.isfinite(row["q2.5"]) and math.isfinite(row["q97.5"]):
                return row
    return None


def estimates_of(run: Run, signal: str, model: str) -> list[CoefficientEstimates]:
    """Return the estimates of each damping coefficient of a model on a signal, with what was published of them.

    A signal without noise has no posterior; it gets that of a signal made with the same damping.
    """
    compare = compared(run)
    errors = {m: printed(text) for (m, s), text in compare.published.items() if s == signal}
    published = {m: e for m, e in errors.items() if math.isfinite(e)}
    found = []
    for parameter in coefficients(run, model):
        rows = rows_of(run.estimates, signal=signal, model=model, parameter=parameter)
        rows = [r for r in rows if r["repeat"] == run.repeats(signal)[0] and math.isfinite(r["value"])]
        methods = dict.fromkeys([*compare.methods, *(r["estimator"] for r in rows)])
        values = ({r["estimator"]: r["value"] for r in rows if r["stage"] == stage} for stage in STAGES)
        own, refined = ({m: each[m] for m in methods if m in each} for each in values)
        row = posterior_of(run, signal, model, parameter)
        found.append(
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
    return found
