"""Infer the exponent p of a damping force c |v|^p against the velocity v.

At each of several exponents the other parameters are fitted and the evidence is computed; the posterior of p is
interpolated between them. A model that is linear in p would fail, because p and the log deviation of the damping, g,
are nearly degenerate: a g that changes with the amplitude has the same effect as another p, and along this degeneracy
the coefficient c follows a curve.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.inference.deviation.candidate import (
    MotionCandidate,
    exact_model,
    linearise,
    linearise_at_mode,
    refit,
)
from bayesdamp.inference.deviation.draws import orbit_of, turning_amplitudes, unit_works
from bayesdamp.inference.deviation.least_squares import LeastSquaresFit
from bayesdamp.inference.deviation.linear import NO_DEVIATIONS, linear_posterior
from bayesdamp.inference.deviation.model_comparison import ModelComparison
from bayesdamp.machine import at_once
from bayesdamp.physics.kernel import Solver

LEAST_EXPONENT, MOST_EXPONENT = 0.0, 3.0
"""Ends of the uniform prior of the exponent p of a damping force c |v|^p."""
ROUNDED = 0.002
"""Width of the smoothing of a power p < 1 near zero velocity, at most this fraction of the peak velocity. A larger
width would change the power at small amplitudes."""
ASIDE = (0.0, -0.4, 0.4)
"""Exponents at which fits of a power law start, minus the local exponent of the best candidate (that of its damping
against velocity) at the middle amplitude."""
NEAR = 1.5
"""The local exponent (that of the damping force against velocity) at the middle amplitude is computed from the damping
at two amplitudes: the middle one times and divided by this factor."""
FIRST = 1.0
"""Distance of the second and third exponent that are tried from the best one, in sds of the exponent in the linear
model about the mode. With 1, the resulting sd of the exponent differs by 2 % from that with four times as many
exponents; with 2, by up to 10 % (measured)."""
FEW = 1000
"""Number of draws, from the posterior of the linear model about the mode, from which the sd of the exponent is
computed."""
NARROWEST, WIDEST = 0.003, 0.5
"""Smallest and largest distance of the second and third exponent that are tried from the best one; they limit the
distance from `FIRST`."""
FURTHER = 3.0
"""Exponents are added outwards from the best one; this is the factor by which the distance from the best grows from one
exponent to the next."""
NEGLIGIBLE = 7.0
"""Exponents are tried farther and farther from the best one until the log evidence at the last is this many nats below
the largest."""
ALIKE = 0.25
"""Another exponent is tried between two neighbouring ones if the posterior probability between them is larger than
this."""
ENOUGH = 20
"""No more exponents are tried once this number of them has been fitted; the posterior is interpolated between them."""
LEVELS = (np.arange(400) + 0.5) / 400
"""Equidistant probabilities at which quantiles of the exponent of a power law are returned; the 400 quantiles serve as
draws."""
POINTS = 3001
"""Number of exponents at which the posterior, interpolated between the exponents that were tried, is computed."""


@dataclass(frozen=True)
class _At:
    """The fit at one exponent: log evidence in nats, least-squares fit, and all unknowns u at the mode.

    u contains the parameters as standard normal scores, then the deviations from the laws, g (log damping) and h
    (relative frequency), at knots in time. Under exact laws it contains only the scores. With deviations, the motion in
    `fit` is that at the mode, but its scores and residual are those from which the search of the mode started.
    """

    log_evidence: float
    fit: LeastSquaresFit
    u: np.ndarray


def exponent_quantiles(comparison: ModelComparison) -> tuple[float, ...]:
    """Return quantiles of the exponent p of a damping force c |v|^p at the probabilities `LEVELS`.

    The coefficient and all other unknowns are integrated out. An empty tuple is returned if no motion under a power law
    fits the record, or there is no candidate from which a fit could start. The restoring law is that of the best
    candidate. The prior of the exponent is uniform (from `LEAST_EXPONENT` to `MOST_EXPONENT`); that of the coefficient
    is the default prior of a damping ratio, at the geometric mean of the record's first and last amplitude.
    """
    if not comparison.results:
        return ()
    alone = MotionCandidate(("power",), comparison.best.candidate.restoring)
    rival = next((r.fit for r in comparison.forms if r.candidate == alone), None)
    starts = exponent_starts(comparison) if rival is None else [rival.parameters.named(rival.z)["exponent"]]
    if not starts:
        return ()
    solver, data = power_solver(comparison, starts[0]), comparison.data
    samples, variance = comparison.samples, comparison.variance
    assert solver.kernel  # compiled before several threads ask for it
    # At the middle, the record determines the size and the exponent independently.
    near = comparison.best.fit
    begin = near.parameters.named(near.z)
    top = comparison.fit_rival(alone, solver, data.middle, begin, [{"exponent": p} for p in starts])
    if top is None:
        return ()
    parameters = top.parameters
    place = parameters.free_names.index("exponent")
    if comparison.approximate:
        linear = linearise(solver, data, top)
        if linear is None:
            return ()
        model, grid = linear.model, linear.grid(coarse=True)
    else:
        model, grid, variance = exact_model(top), NO_DEVIATIONS, comparison.exact_variance(top)
    posterior = linear_posterior(model, grid, variance, samples)
    draws = posterior.draws(FEW, np.random.default_rng(0))[0]
    sd = float(np.std(draws[:, place])) * abs(float(parameters.rates(top.z)[place]))

    def at(p: float, near: _At | None) -> _At | None:
        """Fit at exponent p, starting at the mode `near` of another exponent; None if this fails.

        Without `near`, start at the fit in which the exponent is free.
        """
        fixed, solver = parameters.with_fixed("exponent", p), power_solver(comparison, p)
        z = np.delete(top.z, place) if near is None else near.u[: fixed.free.size]
        start = replace(top, parameters=fixed, z=z)
        if not comparison.approximate:
            best = refit(solver, data, start)
            if best is None:
                return None
            posterior = linear_posterior(exact_model(best), NO_DEVIATIONS, variance, samples)
            return _At(posterior.log_evidence, best, best.z)
        begin = None
        if near is not None:
            # Start with the mode at the other exponent, g changed so that the damping at each amplitude is the same.
            (times, sizes), u, d = turning_amplitudes(near.fit.motion), near.u.copy(), near.fit.z.size
            if times.size > 1:
                log = np.interp(solver.knots, times, np.log(sizes))
                other = near.fit.parameters.known["exponent"]
                u[d : d + log.size] += (other - p) * (log - log.mean())
            begin = linearise(solver, data, start, u)
        result = linearise_at_mode(solver, data, start, variance, begin)
        if result is None:
            return None
        mode = result[0]
        posterior = linear_posterior(mode.model, mode.grid(coarse=False), variance, samples)
        return _At(posterior.log_evidence, replace(start, motion=mode.motion), mode.u)

    distribution = _explore(at, float(top.values[parameters.names.index("exponent")]), sd)
    return () if distribution is None else tuple(np.interp(LEVELS, *distribution).tolist())


def power_solver(comparison: ModelComparison, p: float) -> Solver:
    """Return a solver with the terms of the best candidate's solver and a power |v|^p, under the best restoring law.

    The exponent remains a parameter of the solver; p only decides a width: for p < 1 the width of the velocity range in
    which forces are smoothed at v = 0 is at most `ROUNDED` of the peak velocity, else it is that of the candidate's
    solver.
    """
    plain = comparison.solvers[comparison.best.candidate.restoring]
    narrow = min(plain.epsilon, ROUNDED * comparison.reference.peak_velocity)
    # From p = 1 the usual width has no effect on the power, and a narrow one would need ten times as many steps.
    terms = tuple(dict.fromkeys([*plain.terms, "power"]))
    return replace(plain, terms=terms, epsilon=narrow if p < 1 else plain.epsilon)


def exponent_starts(comparison: ModelComparison) -> list[float]:
    """Return three exponents at which fits may start, limited to the prior.

    They are the local exponent 1 + d log ζ / d log A of the best candidate at the middle amplitude, with its damping
    ratio ζ at an amplitude A, then a smaller and a larger one (`ASIDE`). The list is empty if the best candidate has no
    orbit there or loses no energy.
    """
    best, middle = comparison.best, comparison.data.middle
    solver = comparison.solvers[best.candidate.restoring]
    ratios = []
    for a in (middle.amplitude * NEAR, middle.amplitude / NEAR):
        orbit = orbit_of(best, a)
        if orbit is None:
            return []
        works = unit_works(orbit, solver, best.further, best.fit.active)[0]
        ratios.append(float(works @ best.values[: works.size]) / orbit.energy)
    if min(ratios) <= 0:
        return []
    steep = 1 + float(np.log(ratios[0] / ratios[1])) / (2 * np.log(NEAR))
    return np.clip(steep + np.array(ASIDE), LEAST_EXPONENT, MOST_EXPONENT).tolist()


def _explore(
    at: Callable[[float, _At | None], _At | None], best: float, sd: float
) -> tuple[np.ndarray, np.ndarray] | None:
    """Compute the posterior of the exponent; return cumulative probabilities and their exponents, (n,) each.

    None if fewer than two exponents can be fitted. at: function that fits at an exponent, starting from the fit at
    another one. best, sd: the most probable exponent and its sd under the linear model, where the search starts.
    Exponents are added outwards until both ends are negligible, and then between neighbours that contain much
    probability.
    """
    best = float(np.clip(best, LEAST_EXPONENT, MOST_EXPONENT))
    middle = at(best, None)
    if middle is None:
        return None
    known = {best: middle}
    ends = [LEAST_EXPONENT, MOST_EXPONENT]

    def add(wanted: list[float]) -> bool:
        new = [p for p in dict.fromkeys(wanted) if LEAST_EXPONENT <= p <= MOST_EXPONENT and p not in known]
        nearest = [known[min(known, key=lambda q: abs(q - p))] for p in new]
        for p, result in zip(new, at_once(lambda pair: at(*pair), list(zip(new, nearest))), strict=True):
            if result is not None:
                known[p] = result
        return any(p in known for p in new)

    def log_evidences() -> tuple[np.ndarray, np.ndarray]:
        p = np.array(sorted(known))
        return p, np.array([known[exponent].log_evidence for exponent in p])

    step = float(np.clip(FIRST * sd, NARROWEST, WIDEST))
    add([max(best - step, LEAST_EXPONENT), min(best + step, MOST_EXPONENT)])
    reach = [step, step]
    while len(known) < ENOUGH:
        p, log = log_evidences()
        open_sides = [
            side for side in (0, 1) if log[-side] > log.max() - NEGLIGIBLE and p[-side] != ends[side]
        ]
        if open_sides:
            wanted = []
            for side in open_sides:
                reach[side] *= FURTHER
                wanted.append(float(np.clip(best + (2 * side - 1) * reach[side], ends[0], ends[1])))
            add(wanted)
            for side, exponent in zip(open_sides, wanted, strict=True):
                if exponent not in known:  # it cannot be fitted: extend no further
                    ends[side], reach[side] = p[-side], 0.0
            continue
        grid, cumulated = _distribution(p, log)
        between = np.diff(np.interp(p, grid, cumulated))
        if not add([float(0.5 * (p[i] + p[i + 1])) for i in np.flatnonzero(between > ALIKE)]):
            break
    p, log = log_evidences()
    if p.size < 2:
        return None
    grid, cumulated = _distribution(p, log)
    return cumulated, grid


def _distribution(p: np.ndarray, log: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Interpolate log evidences `log` (nats) at increasing exponents p, (m,) each.

    Return a grid of exponents from p[0] to p[-1] and the cumulative posterior probability there under a uniform prior,
    (POINTS,) each.
    """
    grid = np.linspace(p[0], p[-1], POINTS)
    values = scipy.interpolate.PchipInterpolator(p, log)(grid)
    if p.size > 2:
        smooth = scipy.interpolate.Akima1DInterpolator(p, log, method="makima")(grid)
        # Next to a drop of thousands of nats this interpolation may overshoot; PCHIP is monotonic.
        values = smooth if smooth.max() < log.max() + NEGLIGIBLE else values
    density = np.exp(values - log.max())
    total = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
    # Add a slope, so that the cumulative probability can be inverted everywhere.
    return grid, total / total[-1] + 1e-12 * np.arange(POINTS)
