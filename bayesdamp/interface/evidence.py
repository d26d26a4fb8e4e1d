"""Compute the evidence of one model on one record."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from bayesdamp import types
from bayesdamp.formatting import Table, compact
from bayesdamp.inference.evidence import EVIDENCES, Draws
from bayesdamp.interface.fit import Fit
from bayesdamp.interface.posterior import TEMPERED, Array, Posterior, sample
from bayesdamp.interface.result import Result, outcome_notes
from bayesdamp.types import OK, InputError, Refusal

if TYPE_CHECKING:
    import pandas as pd

EXACT_METHOD, LINEAR, LAPLACE = "bridge", "linear", "laplace"
"""The default method where laws hold exactly, and the other name of `laplace` where they may hold approximately."""
FROM_DRAWS = "nuts"
"""The sampler whose draws a method can start from; others leave thinned or weighted ones."""


@dataclass(frozen=True, repr=False)
class Evidence(Result, types.Evidence):
    """The log marginal likelihood of a model on a record, in nats.

    The evidence of two models may be compared on one record in one unit; it depends on the priors.

    Attributes
    ----------
    log_evidence, stderr
        In nats, with its standard error; NaN where the method gives none.
    diagnostic
        What shows whether it can be trusted, in words.
    outcome
        "ok", or a sentence why it cannot be trusted, or why there is none.
    signal, noise
        Names of the record and of the noise model.
    """

    signal: str = ""
    noise: str = ""

    def summary(self) -> pd.DataFrame:
        """Return one row, with log_evidence and stderr in nats; the rows of several models are a comparison."""
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
    """Compute the evidence of the model of a fit or a posterior.

    Where laws may hold approximately the default is "smc", the evidence of the motions themselves, which a posterior of
    "smc" already has. "linear" (or laplace) is that of the model which is linear about the best motion, without
    sampling and without an error. In importance, bridge and nested motions are linear in the deviations alone, which
    are integrated out. The noise is that of the record under one restoring law: evidence of dampings may be compared
    under one law, under two laws only where the noise is known; otherwise use `compare`.

    Parameters
    ----------
    source
        A fit, or a posterior, whose draws are used where a method needs some.
    method
        A name in `bayesdamp.inference.evidence.EVIDENCES`: bridge, by default, importance, nested or laplace.
    seed
        Seed of all random numbers.

    Returns
    -------
    Evidence
        Where it cannot be computed, its outcome is a sentence.

    Raises
    ------
    InputError
        For a wrong argument.

    Examples
    --------
    >>> import bayesdamp as bd
    >>> signal = bd.simulate({"viscous": 0.05}, stiffness=20.0, duration=6.0, samples=150, noise_sd=0.003)
    >>> model = bd.Model("viscous", noise="gaussian", known={"rest_angle": 0.0})
    >>> fit = bd.fit(signal, model)
    >>> bd.evidence(fit, "laplace").outcome
    'ok'
    """
    if not isinstance(source, Posterior | Fit):
        raise InputError(
            f"evidence: the first argument is {type(source).__name__}; it must be a Posterior or a Fit"
        )
    posterior = source if isinstance(source, Posterior) else None
    fit = source.fit if isinstance(source, Posterior) else source
    approximate = fit.model.approximate
    method = method or (TEMPERED if approximate else EXACT_METHOD)
    blank = Evidence(fit.model.name, method, signal=fit.signal.name, noise=fit.noise)
    if fit.outcome != OK:
        return replace(blank, outcome=fit.outcome)
    if approximate and method == TEMPERED:
        if posterior is None or posterior.sampler != TEMPERED:
            posterior = sample(fit, seed=seed)
        runs = posterior.stats["temperatures"][:, 0]
        return replace(
            blank,
            log_evidence=posterior.log_evidence,
            stderr=posterior.stderr,
            diagnostic=f"{runs.size} runs of at most {runs.max()} temperature{'s' if runs.max() > 1 else ''}",
            evaluations=int(posterior.log_likelihood.size),
            seconds=posterior.seconds,
            outcome=posterior.outcome,
        )
    own = LAPLACE if approximate and method == LINEAR else method
    draws, outcome = None, OK
    if posterior is not None and posterior.sampler == FROM_DRAWS and posterior.names:
        draws, outcome = posterior.draws, posterior.outcome
    try:
        result = weigh(fit, own, seed, draws, outcome)
    except Refusal as refusal:
        return replace(blank, outcome=str(refusal))
    return Evidence(
        **{**vars(result), "method": method, "arrays": {}}, signal=blank.signal, noise=blank.noise
    )


def weigh(fit: Fit, method: str, seed: int, draws: Array | None = None, outcome: str = OK) -> types.Evidence:
    """Compute the evidence of a fit by one method: what `evidence` and the tasks of a study call.

    Parameters
    ----------
    fit
        The fit.
    method
        A name in `EVIDENCES`.
    seed
        Seed of all random numbers.
    draws
        Draws of "nuts" in natural units, shape (chain, draw, parameter), which a method that needs some starts from.
    outcome
        Outcome of these draws.

    Raises
    ------
    Refusal
        Without a fit, or where the method cannot work on it.
    """
    plugin, (target, mode) = EVIDENCES.get(method), fit.engine
    given = Draws.of(target, draws, outcome) if plugin.needs_draws and draws is not None else None
    return plugin.timed(fit.model.name, target, mode, seed, given)
