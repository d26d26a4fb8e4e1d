"""The exponent of a power law in the velocity.

At each exponent the other parameters are inferred and the evidence is computed; the posterior is interpolated between
exponents. A model that is linear in the exponent too would fail: a deviation can replace an exponent's dependence on
the amplitude, and along that line, which may be long, the coefficient follows a curve.
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
    parameters_of,
    refit,
    search,
)
from bayesdamp.inference.deviation.draws import orbit_of, turning_amplitudes, unit_works
from bayesdamp.inference.deviation.least_squares import LeastSquaresFit
from bayesdamp.inference.deviation.linear import NO_DEVIATIONS, linear_posterior
from bayesdamp.inference.deviation.model_comparison import ModelComparison
from bayesdamp.inference.deviation.parameters import Parameters
from bayesdamp.machine import at_once
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.kernel import Solver

LEAST_EXPONENT, MOST_EXPONENT = 0.0, 3.0
"""Between which the exponent is uniform a priori."""
ROUNDED = 0.002
"""Share of the peak velocity within which a power below 1 is rounded at rest: with more, small amplitudes of a record
would have another power than large ones."""
ASIDE = (0.0, -0.4, 0.4)
"""Exponents from which the best one is searched, relative to the likeliest sum's own exponent."""
NEAR = 1.5
"""Factor of the amplitude over which that is taken."""
FIRST = 2.0
"""Distance of the first other exponents from the best one, in standard deviations."""
NARROWEST, WIDEST = 0.003, 0.5
"""The least and the most of that distance."""
FURTHER = 3.0
"""How much further from the best exponent than the last one the next one is."""
NEGLIGIBLE = 7.0
"""Nats behind the likeliest exponent from which those beyond are left out."""
ALIKE = 0.25
"""Probability between two neighbouring exponents from which another is put between them."""
ENOUGH = 20
"""Exponents at most."""
LEVELS = (np.arange(400) + 0.5) / 400
"""Levels of the quantiles that are returned, as draws for intervals and a picture."""
POINTS = 3001


@dataclass(frozen=True)
class _At:
    """The log evidence of an exponent in nats, and the mode there: its fit, and scores and (g, h) at the knots."""

    log_evidence: float
    fit: LeastSquaresFit
    u: np.ndarray


def exponent_quantiles(comparison: ModelComparison) -> tuple[float, ...]:
    """Return quantiles of the exponent at `LEVELS`; none where no motion under a power law follows the record.

    For the force c |v|^p under the likeliest restoring law. The prior of p is uniform between 0 and 3, that of c the
    same as for any damping of this size at the middle (in the logarithm) of the record's amplitudes.
    """
    begins = _starts(comparison) if comparison.results else []
    if not begins:
        return ()
    solver = power_solver(comparison, begins[0]["exponent"])
    data, near = comparison.data, comparison.best.fit
    samples, variance = comparison.samples, comparison.variance
    law = comparison.best.candidate.restoring
    # At the middle, the record determines the size and the exponent independently.
    scales = data.middle.scales(data.rest_under(law, near.values[comparison.solvers[law].law_places]))
    known = {**comparison.known_motion(), **scales}
    parameters = parameters_of(MotionCandidate(("power",), law), solver, data, data.middle, {}, known)
    assert solver.kernel  # compiled before several threads ask for it
    top = search(solver, data, parameters, begins, windows=False)
    if top is None:
        return ()
    place = parameters.free_names.index("exponent")
    if not comparison.approximate:
        variance = comparison.exact_variance(top)
    posterior = linear_posterior(exact_model(top), NO_DEVIATIONS, variance, samples)
    sd = float(np.linalg.norm(posterior.factors[0][place])) * abs(float(parameters.rates(top.z)[place]))

    def at(p: float, near: _At | None) -> _At | None:
        """Return the result at an exponent, starting from that at another."""
        priors = {n: prior for n, prior in parameters.priors.items() if n != "exponent"}
        fixed = Parameters(parameters.names, priors, {**parameters.known, "exponent": p})
        solver = power_solver(comparison, p)
        z = np.delete(top.z, place) if near is None else near.u[: len(priors)]
        start = replace(top, parameters=fixed, z=z)
        if not comparison.approximate:
            best = refit(solver, data, start)
            if best is None:
                return None
            posterior = linear_posterior(exact_model(best), NO_DEVIATIONS, variance, samples)
            return _At(posterior.log_evidence, best, best.z)
        begin = None
        if near is not None:
            # The mode at the other exponent, with the same damping at each amplitude.
            (times, sizes), u, d = turning_amplitudes(near.fit.motion), near.u.copy(), near.fit.z.size
            if times.size > 1:
                log = np.interp(solver.knots, times, np.log(sizes))
                other = near.fit.parameters.known["exponent"]
                u[d : d + log.size] += (other - p) * (log - log.mean())
            begin = linearise(solver, data, start, u)
        result = linearise_at_mode(solver, data, start, variance, begin, near=begin is not None)
        if result is None:
            return None
        mode = result[0]
        posterior = linear_posterior(mode.model, mode.grid(coarse=False), variance, samples)
        return _At(posterior.log_evidence, replace(start, motion=mode.motion), mode.u)

    distribution = _explore(at, float(top.values[parameters.names.index("exponent")]), sd)
    return () if distribution is None else tuple(np.interp(LEVELS, *distribution).tolist())


def _starts(comparison: ModelComparison) -> list[dict[str, float]]:
    """Return values of all parameters from which the best exponent is searched, with c at the middle velocity."""
    rival, near = (
        next((r for r in comparison.forms if r.candidate.damping == ("power",)), None),
        comparison.best.fit,
    )
    if rival is None:
        return [{**near.parameters.named(near.z), **start} for start in power_starts(comparison)]
    fit = rival.fit.parameters.named(rival.fit.z)
    ratio = fit["reference_velocity"] / comparison.data.middle.peak_velocity
    return [{**fit, "c_power": fit["c_power"] * ratio ** (1 - fit["exponent"])}]


def power_solver(comparison: ModelComparison, p: float) -> Solver:
    """Return the solver of motions under powers of the velocity near p, under the likeliest restoring law."""
    plain = comparison.solvers[comparison.best.candidate.restoring]
    narrow = min(plain.epsilon, ROUNDED * comparison.reference.peak_velocity)
    # At 1 the width changes nothing; above, a narrow one needs ten times the steps.
    return replace(plain, terms=("power",), epsilon=narrow if p < 1 else plain.epsilon)


def power_starts(comparison: ModelComparison) -> list[dict[str, float]]:
    """Return coefficients and exponents that dissipate as much as the likeliest sum at the middle amplitude.

    The first depends on the amplitude as the sum does there; the others are less steep and steeper.
    """
    best, middle = comparison.best, comparison.data.middle
    solver = comparison.solvers[best.candidate.restoring]
    ratios = []
    for a in (middle.amplitude * NEAR, middle.amplitude, middle.amplitude / NEAR):
        orbit = orbit_of(best, a)
        if orbit is None:
            return []
        works = unit_works(orbit, solver, best.further, best.fit.active)[0]
        ratios.append(float(works @ best.values[: works.size]) / (4 * np.pi * orbit.energy))
    if min(ratios) <= 0:
        return []
    steep = 1 + float(np.log(ratios[0] / ratios[2])) / (2 * np.log(NEAR))
    starts = []
    for p in np.clip(steep + np.array(ASIDE), LEAST_EXPONENT, MOST_EXPONENT):
        given = {"exponent": float(p), "reference_velocity": middle.peak_velocity}
        work = TERMS.get("power").work(middle.amplitude, middle.frequency, given)
        unit = work / (2 * np.pi * middle.peak_velocity**2)
        starts.append({"exponent": float(p), "c_power": ratios[1] / unit})
    return starts


def _explore(
    at: Callable[[float, _At | None], _At | None], best: float, sd: float
) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the posterior's distribution function and the exponents that it is at, (n,) each."""
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
                if exponent not in known:  # no motion can be followed that far
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
    """Return exponents between the known ones, (n,), and the probability up to each, rising."""
    grid = np.linspace(p[0], p[-1], POINTS)
    values = scipy.interpolate.PchipInterpolator(p, log)(grid)
    if p.size > 2:
        smooth = scipy.interpolate.Akima1DInterpolator(p, log, method="makima")(grid)
        # Next to a fall of thousands of nats it overshoots far above all known values.
        values = smooth if smooth.max() < log.max() + NEGLIGIBLE else values
    density = np.exp(values - log.max())
    total = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
    # Rising everywhere, so that it can be inverted.
    return grid, total / total[-1] + 1e-12 * np.arange(POINTS)
