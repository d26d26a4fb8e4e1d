"""The answer for one record, within seconds: candidates fitted and weighed, on averages where these are close."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from threadpoolctl import threadpool_limits

from bayesdamp.inference.deviation.averaged import Averaging
from bayesdamp.inference.deviation.candidate import START, MotionCandidate, refit
from bayesdamp.inference.deviation.data import prepared
from bayesdamp.inference.deviation.exponent import exponents_of
from bayesdamp.inference.deviation.forms import columns_of, with_rivals
from bayesdamp.inference.deviation.sample_noise import AUTOMATIC, prepared_for
from bayesdamp.inference.deviation.weighing import CandidateResult, Known, Weighing, weigh_all
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


def weighing_of(
    signal: Signal,
    *,
    damping: Sequence[str] = (),
    restoring: Sequence[str] = (),
    known: Known | None = None,
    priors: Mapping[str, Prior] | None = None,
    reference: Reference | None = None,
    approximate: bool = True,
    noises: Sequence[str] = AUTOMATIC,
) -> Weighing:
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
        As of `weigh_all`.
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
        weigh_all,
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
        data = prepared_for(signal, noises, known_under[0], priors or {}, average=not start_known)
        weighing = weigh(data)
        if data.averaged is not None and weighing.results:
            weighing = _corrected(weighing)
            averaging = averaging_of(weighing)
            if averaging is None or averaging.close or data.cycles > MOST_CYCLES:
                weighing = replace(weighing, averaging=averaging)
            else:
                weighing = weigh(prepared(signal, average=False))
        weighing = with_rivals(weighing)
        return replace(weighing, exponents=exponents_of(weighing))


def _corrected(weighing: Weighing) -> Weighing:
    """Return the weighing with the candidates that count corrected by the ODE at their modes, deviations included."""
    top = weighing.best.log_evidence

    def correct(r: CandidateResult) -> CandidateResult:
        if top - r.log_evidence > NEAR:
            return r
        assert isinstance(r.solver, AveragedSolver)
        solver = r.solver.corrected(r.values, r.fit.active, *r.deviations)
        fit = None if solver is None else refit(solver, weighing.data, r.fit)
        if solver is None or fit is None:
            return r
        return weighing.weigh(r.candidate, solver, fit)

    weighing = replace(weighing, results=tuple(at_once(correct, weighing.results)))
    best = weighing.best
    return replace(weighing, solvers={**weighing.solvers, best.candidate.restoring: best.solver})


def averaging_of(weighing: Weighing) -> Averaging | None:
    """Return how far a weighing is from one by the ODE; None where it is by the ODE."""
    if weighing.data.averaged is None or not weighing.results:
        return None
    result, cycles = weighing.best, weighing.data.cycles
    assert isinstance(result.solver, AveragedSolver)
    off = result.solver.error(result.values, result.fit.active, *result.deviations)
    base = columns_of(result)
    if off is None or base is None:
        return Averaging(cycles, float("inf"))
    weighed = result.posterior
    moved, spread = np.zeros(weighed.means.shape[1]), np.zeros(weighed.means.shape[1])
    # Over the hyperparameters: a parameter that some of them determine well may be loose under others.
    for weight, factor in zip(weighed.weights, weighed.factors, strict=True):
        shift, sd = factor @ (factor.T @ (base[0].T @ off)) / result.variance, np.linalg.norm(factor, axis=1)
        moved, spread = moved + weight * shift, spread + weight * sd**2
    rows = [i for i, name in enumerate(result.fit.parameters.free_names) if name not in START]
    error = float(np.max(np.abs(moved[rows]) / np.sqrt(spread[rows]), initial=0.0))
    return Averaging(cycles, error)
