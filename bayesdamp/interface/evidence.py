"""The evidence of one model on one record."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from bayesdamp import types
from bayesdamp.formatting import compact
from bayesdamp.inference.evidence import EVIDENCES, Draws
from bayesdamp.interface.fit import Fit
from bayesdamp.interface.parts.result import Result, outcome_notes
from bayesdamp.interface.posterior import Posterior
from bayesdamp.interface.sampling import TEMPERED, sample
from bayesdamp.table import Table
from bayesdamp.types import OK, InputError, Refusal

if TYPE_CHECKING:
    import pandas as pd

EXACT_METHOD, LINEAR, LAPLACE = "bridge", "linear", "laplace"
"""The method by default where laws hold exactly; and what the last is also called where they may hold approximately."""
FROM_DRAWS = "nuts"
"""The sampler whose draws a method starts from; others leave thinned or weighted ones."""


@dataclass(frozen=True, repr=False)
class Evidence(Result, types.Evidence):
    """The log marginal likelihood of a model on a record, in nats.

    stderr: its standard error, nan where the method gives none. diagnostic: by what it may be trusted, in words.
    outcome: "ok", or a sentence why it is not to be trusted, or why there is none. noise: the noise model it is under.
    Evidence of two models may be compared on one record, in one unit; priors count.
    """

    signal: str = ""
    noise: str = ""

    def summary(self) -> pd.DataFrame:
        """One row; log_evidence and stderr in nats. Those of several models, one below the other, are a comparison."""
        import pandas as pd

        return pd.DataFrame([{n: v for n, v in vars(self).items() if n != "arrays"}])

    def _table(self) -> Table:
        rows = (
            ("log evidence", f"{compact(self.log_evidence, 8)} nat"),
            ("standard error", f"{compact(self.stderr, 2)} nat"),
            ("diagnostic", self.diagnostic or "–"),
        )
        title = f"Evidence of {self.model} on {self.signal} by {self.method}"
        return Table(("", "value"), rows, caption=title, notes=outcome_notes(self.outcome))


def evidence(source: Posterior | Fit, method: str | None = None, *, seed: int = 0) -> Evidence:
    """The evidence of the model of a fit, or of a posterior, of which a method takes the draws where it needs some.

    method: a name in `bayesdamp.inference.evidence.EVIDENCES`: bridge, by default, importance, nested, laplace. Where
    it cannot be computed the result's outcome is a sentence. Raises InputError for misuse.

    Where laws may hold approximately it is "smc", by default, that of the motions themselves, a posterior's own, or
    "linear" (or laplace), that of the model which is linear about the best motion, without sampling and without an
    error; or importance, bridge and nested, whose motions are linear in the deviations alone, which are integrated out.
    The noise
    is the record's under one restoring law: evidence of dampings under one law may be compared, under two laws where
    the noise is known; else `compare` weighs both under one.

    >>> import bayesdamp as bd
    >>> signal = bd.simulate({"viscous": 0.05}, stiffness=20.0, duration=6.0, samples=150, noise_sd=0.003)
    >>> model = bd.Model("viscous", noise="gaussian", known={"rest_angle": 0.0})
    >>> fit = bd.fit(signal, model)
    >>> found = bd.evidence(fit, "laplace")
    >>> found.outcome
    'ok'
    """
    if not isinstance(source, Posterior | Fit):
        raise InputError(
            f"evidence: the first argument is {type(source).__name__}; it must be a Posterior or a Fit"
        )
    fit = source.fit if isinstance(source, Posterior) else source
    approximate = fit.model.approximate
    method = method or (TEMPERED if approximate else EXACT_METHOD)
    blank = Evidence(fit.model.name, method, signal=fit.signal.name, noise=fit.noise)
    if fit.outcome != OK:
        return replace(blank, outcome=fit.outcome)
    if approximate and method == TEMPERED:
        return _tempered(blank, source, seed)
    plugin = EVIDENCES.get(LAPLACE if approximate and method == LINEAR else method)
    draws: Draws | None = None
    try:
        target, mode = fit.engine
        if (
            isinstance(source, Posterior)
            and plugin.needs_draws
            and source.sampler == FROM_DRAWS
            and source.names
        ):
            draws = Draws.of(target, source.draws, source.outcome)
        found = plugin.timed(fit.model.name, target, mode, seed, draws)
    except Refusal as refusal:
        return replace(blank, outcome=str(refusal))
    return Evidence(**{**vars(found), "method": method, "arrays": {}}, signal=blank.signal, noise=blank.noise)


def _tempered(blank: Evidence, source: Posterior | Fit, seed: int) -> Evidence:
    tempered = isinstance(source, Posterior) and source.sampler == TEMPERED
    found = source if tempered else sample(source.fit if isinstance(source, Posterior) else source, seed=seed)
    assert isinstance(found, Posterior)
    runs = found.stats["temperatures"][:, 0]
    return replace(
        blank,
        log_evidence=found.log_evidence,
        stderr=found.stderr,
        diagnostic=f"{runs.size} runs of at most {runs.max()} temperature{'s' if runs.max() > 1 else ''}",
        evaluations=int(found.log_likelihood.size),
        seconds=found.seconds,
        outcome=found.outcome,
    )
