"""Compute the evidence of one model on one record."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from bayesdamp import types
from bayesdamp.formatting import Table, data_frame
from bayesdamp.inference.evidence import EVIDENCES, Draws
from bayesdamp.interface.fit import Fit
from bayesdamp.interface.posterior import TEMPERED, Array, Posterior, sample
from bayesdamp.interface.result import Result, frame_table, outcome_notes
from bayesdamp.types import OK, InputError, Refusal

if TYPE_CHECKING:
    import pandas as pd

EXACT_METHOD, LINEAR, LAPLACE = "bridge", "linear", "laplace"
"""`EXACT_METHOD` is the default evidence method for a fit that assumes exact laws. If laws may hold approximately,
"linear" and "laplace" are two names of the same method, the linear approximation."""
FROM_DRAWS = "nuts"
"""The only sampler whose draws an evidence method can use; the draws of other samplers are thinned or weighted."""


@dataclass(frozen=True, repr=False)
class Evidence(Result, types.Evidence):
    """The log marginal likelihood of a model on a record, in nats.

    The evidence depends on the priors. Compare the evidence of two models only on the same record in the same unit.

    Attributes
    ----------
    log_evidence, stderr
        The log evidence and its standard error in nats; NaN if the method does not compute it.
    diagnostic
        Diagnostic numbers of the method, in words.
    outcome
        "ok", or a sentence that says why the value is unreliable or missing.
    signal, noise
        Names of the record and of the noise model.
    """

    signal: str = ""
    noise: str = ""

    def summary(self) -> pd.DataFrame:
        """Return a table with one row, whose columns are the fields of this class; log_evidence and stderr in nats.

        Concatenate the rows of several models to compare them.
        """
        return data_frame([vars(self)])

    def _table(self) -> Table:
        title = f"Log evidence in nats of {self.model} on {self.signal} by {self.method}"
        shown = self.summary()[["log_evidence", "stderr", "diagnostic"]].T.set_axis(["value"], axis=1)
        return frame_table(shown, title, outcome_notes(self.outcome))


def evidence(source: Posterior | Fit, method: str | None = None, *, seed: int = 0) -> Evidence:
    """Compute the evidence of the model of a fit or a posterior.

    If laws may hold approximately, the default is "smc" (sequential Monte Carlo), which uses the full equation of
    motion. A posterior by "smc" already contains this evidence. "linear" (or laplace) uses motions that are linear
    about the best motion; it needs no sampling, and has no standard error. importance, bridge and nested use motions
    that are linear in the deviations only, and integrate these out. The noise variance is estimated under the model's
    restoring law. Therefore compare the evidence of models with different restoring laws only if the noise is known;
    otherwise use `compare`.

    Parameters
    ----------
    source
        A fit or a posterior. Only bridge and smc need draws: bridge uses those of a posterior by NUTS, smc those of a
        posterior by smc, and without these they make their own.
    method
        A name in `bayesdamp.inference.evidence.EVIDENCES`: bridge (the default if the fit assumes exact laws),
        importance, nested or laplace. If laws may hold approximately, also smc (the default) or linear.
    seed
        Seed of all random numbers.

    Returns
    -------
    Evidence
        The evidence. If it cannot be computed, its outcome is a sentence with the reason.

    Raises
    ------
    InputError
        If an argument is invalid.

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
            diagnostic=f"{runs.size} runs with at most {runs.max()} temperature{'s' if runs.max() > 1 else ''}",
            evaluations=int(posterior.log_likelihood.size),
            seconds=posterior.seconds,
            outcome=posterior.outcome,
        )
    own = LAPLACE if approximate and method == LINEAR else method
    draws, outcome = None, OK
    if posterior is not None and posterior.sampler == FROM_DRAWS and posterior.names:
        draws, outcome = posterior.draws, posterior.outcome
    try:
        result = run_evidence_method(fit, own, seed, draws, outcome)
    except Refusal as refusal:
        return replace(blank, outcome=str(refusal))
    return Evidence(**{**vars(result), "method": method}, signal=blank.signal, noise=blank.noise)


def run_evidence_method(
    fit: Fit, method: str, seed: int, draws: Array | None = None, outcome: str = OK
) -> types.Evidence:
    """Compute the evidence of a fit by one method. `evidence` and the tasks of a study call this function.

    Parameters
    ----------
    fit
        The fit.
    method
        A name in `EVIDENCES`.
    seed
        Seed of all random numbers.
    draws
        Draws of "nuts" in natural units, shape (chain, draw, parameter), for methods that need draws (bridge); if None,
        these make their own.
    outcome
        Outcome of the sampler that made these draws.

    Raises
    ------
    Refusal
        If there is no fit, or the method cannot work on it.
    """
    plugin, (target, mode) = EVIDENCES.get(method), fit.engine
    given = Draws.of(target, draws, outcome) if plugin.needs_draws and draws is not None else None
    return plugin.timed(fit.model.name, target, mode, seed, given)
