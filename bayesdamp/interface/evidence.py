"""The evidence of one model on one record."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

from bayesdamp.inference.evidence import EVIDENCES, Draws
from bayesdamp.interface.fit import Fit, refuse_deviation
from bayesdamp.interface.parts.result import Packed, Result
from bayesdamp.interface.parts.table import Table, number, said
from bayesdamp.interface.posterior import Posterior
from bayesdamp.types import OK, InputError, Refusal

FROM_DRAWS = "nuts"
"""The sampler whose draws a method starts from; others leave thinned or weighted ones."""


@dataclass(frozen=True, repr=False)
class Evidence(Result):
    """The log marginal likelihood of a model on a record, in nats.

    stderr: its standard error, nan where the method gives none. diagnostic: by what it may be trusted, in words.
    outcome: "ok", or a sentence why it is not to be trusted, or why there is none. noise: the noise model it is under.
    Evidence of two models may be compared on one record, in one unit; priors count.
    """

    model: str
    signal: str
    method: str
    log_evidence: float = float("nan")
    stderr: float = float("nan")
    diagnostic: str = ""
    noise: str = ""
    evaluations: int = 0
    seconds: float = 0.0
    outcome: str = OK

    def _table(self) -> Table:
        rows = (
            ("log evidence", f"{number(self.log_evidence, 8)} nat"),
            ("standard error", f"{number(self.stderr, 2)} nat"),
            ("diagnostic", self.diagnostic or "–"),
        )
        title = f"Evidence of {self.model} on {self.signal} by {self.method}"
        return Table(title, ("", "value"), rows, said(self.outcome))

    def _packed(self) -> Packed:
        return Packed("Evidence", dict(vars(self)))

    @classmethod
    def _unpacked(cls, packed: Packed) -> Self:
        return cls(**packed.meta)


def evidence(source: Posterior | Fit, method: str = "bridge", *, seed: int = 0) -> Evidence:
    """The evidence of the model of a fit, or of a posterior, of which a method takes the draws where it needs some.

    method: a name in `bayesdamp.inference.evidence.EVIDENCES`: bridge, importance, nested, laplace. Where it cannot be
    computed the result's outcome is a sentence. Raises InputError for misuse.

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
    plugin = EVIDENCES.get(method)
    fit = source.fit if isinstance(source, Posterior) else source
    refuse_deviation(fit.model)
    blank = Evidence(fit.model.name, fit.signal.name, method, noise=fit.noise)
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
        found = plugin.evidence(fit.model.name, target, mode, seed, draws)
    except Refusal as refusal:
        return replace(blank, outcome=str(refusal))
    return replace(
        blank,
        log_evidence=found.log_evidence,
        stderr=found.stderr,
        diagnostic=found.diagnostic,
        evaluations=found.evaluations,
        seconds=found.seconds,
        outcome=found.outcome,
    )
