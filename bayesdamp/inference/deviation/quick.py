"""The answer for one record, within seconds: candidates fitted and weighed, on averages where these are close."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from threadpoolctl import threadpool_limits

from bayesdamp.inference.deviation.averaged import Averaging
from bayesdamp.inference.deviation.candidate import START, MotionCandidate, refit
from bayesdamp.inference.deviation.data import prepare_data
from bayesdamp.inference.deviation.exponent import exponent_quantiles
from bayesdamp.inference.deviation.forms import add_rivals, columns_of
from bayesdamp.inference.deviation.model_comparison import (
    CandidateResult,
    Known,
    ModelComparison,
    compare_candidates,
)
from bayesdamp.inference.deviation.sample_noise import AUTOMATIC, prepare_for_noises
from bayesdamp.machine import at_once
from bayesdamp.physics.damping import all_sums, parse_model
from bayesdamp.physics.kernel.averaged import AveragedSolver
from bayesdamp.physics.restoring import LAWS
from bayesdamp.priors import Prior
from bayesdamp.types import Reference, Signal

NEAR = 10.0
"""Nats behind the best up to which a candidate is corrected with the equation of motion."""
MOST_CYCLES = 1200.0
"""Cycles up to which the ODE is fitted where amplitudes and phases are not close to it: the tangents then take 1 GB
(measured)."""


def compare_signal(
    signal: Signal,
    *,
    damping: Sequence[str] = (),
    restoring: Sequence[str] = (),
    known: Known | None = None,
    priors: Mapping[str, Prior] | None = None,
    reference: Reference | None = None,
    approximate: bool = True,
    noises: Sequence[str] = AUTOMATIC,
) -> ModelComparison:
    """Weigh damping sums under restoring laws.

    A record of hundreds of cycles is taken as amplitudes and phases, where that moves no parameter by more than a tenth
    of its sd, or where the record has more cycles than the ODE is solved for.

    Parameters
    ----------
    signal : Signal
        The record.
    damping, restoring : sequence of str
        Damping sums and restoring laws; by default all of them, for a record in metres the laws that translate.
    known, priors, reference, approximate
        As of `compare_candidates`.
    noises : sequence of str
        Noise models, of which the likeliest is used.

    Raises
    ------
    Refusal
        Where the record shows no oscillation, or no motion stays in phase with it.
    """
    laws = list(restoring) or [n for n in LAWS.names() if signal.unit == "rad" or LAWS.get(n).translates]
    sums = list(damping) or all_sums()
    weigh = partial(
        compare_candidates,
        candidates=[MotionCandidate(parse_model(s), law) for law in laws for s in sums],
        known=known,
        priors=priors,
        reference=reference,
        approximate=approximate,
        noises=noises,
    )
    known_under = [known(law) if callable(known) else known or {} for law in laws]
    # The averaged motion's phase only agrees approximately with a start that is given.
    start_known = any(name in values for values in known_under for name in START)
    # Matrices of a few dozen rows: threads of a linear algebra library would only wait for each other.
    with threadpool_limits(1, "blas"):
        data = prepare_for_noises(signal, noises, known_under[0], priors or {}, average=not start_known)
        comparison = weigh(data)
        if data.averaged is not None and comparison.results:
            comparison = _corrected(comparison)
            averaging = averaging_of(comparison)
            if averaging is None or averaging.close or data.cycles > MOST_CYCLES:
                comparison = replace(comparison, averaging=averaging)
            else:
                comparison = weigh(prepare_data(signal, average=False))
        comparison = add_rivals(comparison)
        return replace(comparison, exponents=exponent_quantiles(comparison))


def _corrected(comparison: ModelComparison) -> ModelComparison:
    """Return the weighing with the candidates that count corrected by the ODE at their modes, deviations included."""
    top = comparison.best.log_evidence

    def correct(r: CandidateResult) -> CandidateResult:
        if top - r.log_evidence > NEAR:
            return r
        assert isinstance(r.solver, AveragedSolver)
        solver = r.solver.corrected(r.values, r.fit.active, *r.deviations)
        fit = None if solver is None else refit(solver, comparison.data, r.fit)
        if solver is None or fit is None:
            return r
        return comparison.evaluate(r.candidate, solver, fit)

    comparison = replace(comparison, results=tuple(at_once(correct, comparison.results)))
    best = comparison.best
    return replace(comparison, solvers={**comparison.solvers, best.candidate.restoring: best.solver})


def averaging_of(comparison: ModelComparison) -> Averaging | None:
    """Return how far a weighing is from one by the ODE; None where it is by the ODE."""
    if comparison.data.averaged is None or not comparison.results:
        return None
    result, cycles = comparison.best, comparison.data.cycles
    assert isinstance(result.solver, AveragedSolver)
    off = result.solver.error(result.values, result.fit.active, *result.deviations)
    base = columns_of(result)
    if off is None or base is None:
        return Averaging(cycles, float("inf"))
    posterior = result.posterior
    moved, spread = np.zeros(posterior.means.shape[1]), np.zeros(posterior.means.shape[1])
    # Over the hyperparameters: a parameter that some of them determine well may be loose under others.
    for weight, factor in zip(posterior.weights, posterior.factors, strict=True):
        shift, sd = factor @ (factor.T @ (base[0].T @ off)) / result.variance, np.linalg.norm(factor, axis=1)
        moved, spread = moved + weight * shift, spread + weight * sd**2
    rows = [i for i, name in enumerate(result.fit.parameters.free_names) if name not in START]
    error = float(np.max(np.abs(moved[rows]) / np.sqrt(spread[rows]), initial=0.0))
    return Averaging(cycles, error)
