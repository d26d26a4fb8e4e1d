"""One candidate on one record under laws that hold approximately: what a fit, draws and evidence of it rest on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from bayesdamp.inference.deviation.candidate import Candidate, active_of, exact, linearised
from bayesdamp.inference.deviation.data import Data
from bayesdamp.inference.deviation.gaussian.hyperparameters import grid_of, knots_of
from bayesdamp.inference.deviation.gaussian.linear import weigh
from bayesdamp.inference.deviation.least_squares import SEARCHED, Fit
from bayesdamp.inference.deviation.parameters import Parameters
from bayesdamp.inference.deviation.weighing import Friction, Result, Weighing, weigh_all
from bayesdamp.inference.model.defaults import Reference
from bayesdamp.physics.damping import PAPER_TERMS
from bayesdamp.physics.kernel.averaged import AveragedSolver
from bayesdamp.physics.kernel.solve import NONE, PARAMETERS
from bayesdamp.priors import Prior
from bayesdamp.types import Refusal

ESCAPED = "no motion near the fit can be followed with deviations from its law"


@dataclass(frozen=True)
class Found:
    """Where the search on a record ended: all that the rest follows from, without a search.

    terms: of the solver, those of the candidate among them. z: scores of the best motion under exact laws, (d,); u:
    scores, log g and h of the best under approximate ones, (K,). variance, inflation: of the noise that counts, κ in
    it; exact_variance: of what exact laws leave; epsilon: the width of friction's turning over, rad/s or m/s; averaged:
    whether the record was taken as amplitudes and phases.
    """

    terms: tuple[str, ...]
    reference: Reference
    priors: Mapping[str, Prior]
    known: Mapping[str, float]
    z: np.ndarray
    u: np.ndarray
    variance: float
    inflation: float
    exact_variance: float
    epsilon: float
    frictions: tuple[Friction, ...] = ()
    averaged: bool = False


@dataclass(frozen=True)
class Single:
    """A candidate, weighed by itself, with what it was made from."""

    weighing: Weighing
    result: Result
    found: Found


def single(
    data: Data,
    damping: Sequence[str],
    restoring: str,
    *,
    known: Mapping[str, float],
    priors: Mapping[str, Prior],
    reference: Reference,
) -> Single:
    """Fit and weigh one candidate. The noise, and friction's width, are those under the sum of all terms, as where
    candidates are compared: so evidence of two dampings under one law is of one noise.

    Raises Refusal where no motion stays in phase with the record, or none can be followed with deviations.
    """
    asked = Candidate(tuple(damping), restoring)
    whole = Candidate((*PAPER_TERMS, *(t for t in damping if t not in PAPER_TERMS)), restoring)
    with threadpool_limits(1, "blas"):
        weighing = weigh_all(
            data,
            dict.fromkeys([whole, asked]),
            known=known,
            priors=priors,
            reference=reference,
        )
    result = next((r for r in weighing.results if set(r.candidate.damping) == set(damping)), None)
    if result is None:
        raise Refusal(weighing.refused.get(asked, ESCAPED))
    if result.about is None:
        raise Refusal(ESCAPED)
    return again(data, result.candidate, found_of(weighing, result))


def found_of(weighing: Weighing, result: Result) -> Found:
    """Where the search for one of the candidates that were weighed ended. Raises Refusal where none with deviations
    did."""
    if result.about is None:
        raise Refusal(ESCAPED)
    parameters, solver = result.fit.parameters, result.solver
    return Found(
        terms=solver.terms,
        reference=weighing.reference,
        priors=parameters.priors,
        known=parameters.known,
        z=result.fit.z,
        u=result.about.u,
        variance=weighing.variance,
        inflation=weighing.inflation,
        exact_variance=result.exact_variance,
        epsilon=solver.epsilon,
        frictions=weighing.frictions,
        averaged=weighing.data.averaged is not None,
    )


def under(one: Single, priors: Mapping[str, Prior]) -> Single:
    """A candidate about the same motion under other priors of what it infers. Raises Refusal where it cannot be
    followed there."""
    parameters, found = one.result.fit.parameters, one.found
    other, d = replace(parameters, priors=priors), found.z.size
    z, start = (other.scores(parameters.named(scores)) for scores in (found.z, found.u[:d]))
    moved = replace(found, priors=priors, z=z, u=np.concatenate([start, found.u[d:]]))
    return again(one.weighing.data, one.result.candidate, moved)


def first_half(one: Single) -> Single:
    """A candidate on the first half of its record, with the knots, the noise and the motion of the whole, so that its
    evidence is a factor of the whole's. Raises Refusal where the record is not taken as samples, or has too few."""
    data, knots = one.weighing.data, one.result.solver.knots
    if data.averaged is not None:
        raise Refusal("not applicable: a record that is taken as amplitudes and phases is not cut in halves")
    count, inferred = data.t.size // 2, one.found.u.size
    if count <= inferred:
        raise Refusal(f"half the record has {count} samples for {inferred} parameters and deviations")
    half = data.first(count)
    return again(half, one.result.candidate, one.found, knots)


def again(data: Data, candidate: Candidate, found: Found, knots: np.ndarray | None = None) -> Single:
    """What a search found, put together without it. knots: in s, where they are not the record's own. Raises Refusal
    where it was on another record."""
    knots = knots_of(data.end, data.cycles) if knots is None else knots
    solver = data.solver(found.terms, candidate.restoring, found.epsilon, knots)
    parameters = Parameters(solver.names, found.priors, found.known)
    active, p = active_of(candidate, solver), parameters.values(found.z)
    if isinstance(solver, AveragedSolver):
        z, g, h = np.split(found.u, [found.z.size, found.z.size + knots.size])
        solver = solver.corrected(parameters.values(z), active, np.expm1(g), h) or solver
    motion = solver.solve(p, active, tangents=NONE)
    moved = solver.solve(p, active, tangents=PARAMETERS, tolerance=SEARCHED)
    if motion is None or moved is None:
        raise Refusal(ESCAPED)
    tangents = parameters.by_scores(moved.tangents, found.z)
    best = Fit(parameters, active, found.z, data.y - motion.y, tangents, motion, 0)
    about = linearised(candidate, solver, data, best, found.u)
    if about is None:
        raise Refusal(ESCAPED)
    samples, linear = data.y.size / found.inflation, exact(best)
    result = Result(
        candidate,
        solver,
        best,
        linear,
        weigh(linear, grid_of(0, exact=True), found.exact_variance, samples),
        found.exact_variance,
        about,
        weigh(about.model, grid_of(knots.size, absorbed=parameters.absorbs), found.variance, samples),
    )
    weighing = Weighing(
        data,
        found.reference,
        found.epsilon,
        found.frictions,
        {candidate.restoring: solver},
        (result,),
        found.variance,
        found.inflation,
    )
    return Single(weighing, result, found)
