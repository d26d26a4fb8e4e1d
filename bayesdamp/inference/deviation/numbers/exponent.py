"""The posterior of the exponent of a power law, under a law that holds exactly or approximately.

At each exponent the rest is inferred and the evidence of that one taken; along these the posterior is interpolated. A
model that is linear in the exponent too would not do: a deviation takes over what an exponent has of the amplitude, and
along that line, which may be long, the coefficient follows a curve.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from bayesdamp.inference.deviation.candidate import (
    Candidate,
    exact,
    linearised,
    parameters_of,
    refit,
    relinearised,
    searched,
)
from bayesdamp.inference.deviation.gaussian.hyperparameters import grid_of
from bayesdamp.inference.deviation.gaussian.linear import weigh
from bayesdamp.inference.deviation.least_squares import Fit
from bayesdamp.inference.deviation.numbers.curves import (
    further_of,
    orbit_of,
    turning_amplitudes,
    values_of,
    works_on,
)
from bayesdamp.inference.deviation.parameters import Parameters
from bayesdamp.inference.deviation.weighing import START, Result, Weighing
from bayesdamp.machine.threads import at_once
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.kernel import Solver
from bayesdamp.types import Reference

LEAST, MOST = 0.0, 3.0
"""Between which the exponent is uniform beforehand."""
ROUNDED = 0.002
"""Share of the peak velocity within which a power below 1 is rounded at rest: with more, small amplitudes of a record
would have another power than large ones."""
ASIDE = (0.0, -0.4, 0.4)
"""Beside the likeliest sum's own exponent, those from which the best one is searched for."""
NEAR = 1.5
"""Factor of the amplitude over which that is taken."""
FIRST = 2.0
"""Standard deviations about the best exponent between which the first others are."""
NARROWEST, WIDEST = 0.003, 0.5
"""The least and the most of that distance."""
FURTHER = 3.0
"""How much further from the best exponent than the last one the next is."""
NEGLIGIBLE = 7.0
"""Nats behind the likeliest exponent from which those beyond are left out."""
ALIKE = 0.25
"""Probability between two neighbouring exponents from which one is put between them."""
ENOUGH = 20
"""Exponents at most."""
LEVELS = (np.arange(400) + 0.5) / 400
"""Of the quantiles that are kept: draws that intervals and a picture are made of."""
POINTS = 3001


@dataclass(frozen=True)
class _At:
    """An exponent's log evidence in nats, and where the motion and its deviations were: scores and (g, h) at the
    knots."""

    log_evidence: float
    fit: Fit
    u: np.ndarray


def exponents_of(weighing: Weighing, approximate: bool) -> tuple[float, ...]:
    """Quantiles of the exponent at `LEVELS`; none where no motion under a power law follows the record.

    Of the force c |v|^p under the likeliest restoring law, p uniform between 0 and 3, c as any damping of the size that
    it has at the middle (in the logarithm) of the record's amplitudes.
    """
    if not weighing.results:
        return ()
    problem = _problem(weighing, approximate)
    found = None if problem is None else _along(*problem)
    return () if found is None else tuple(np.interp(LEVELS, *found).tolist())


def _problem(
    weighing: Weighing, approximate: bool
) -> tuple[Callable[[float, _At | None], _At | None], float, float] | None:
    """The evidence at an exponent, from what was found at another; the best exponent under exact laws and its sd."""
    data = weighing.data
    best = max(weighing.results, key=lambda r: r.log_evidence)
    law, near = best.candidate.restoring, best.fit.parameters.named(best.fit.z)
    plain = weighing.solvers[law]
    rest = data.rest_under(law, best.fit.parameters.values(best.fit.z)[plain.law_places])
    known = {
        n: v for n, v in best.fit.parameters.known.items() if n in plain.names[plain.law_places] or n in START
    }
    # About there the size and the exponent are told by themselves.
    middle = Reference(float(np.sqrt(data.amplitude * data.final_amplitude)), data.frequency)
    given = {**known, **middle.scales(rest)}
    c = Candidate(("power",), law)

    def solver_of(p: float) -> Solver:
        return power_solver(weighing, law, p)

    starts: list[Mapping[str, float]] = [{**near, **one} for one in power_starts(weighing, best, middle)]
    solver = solver_of(starts[0]["exponent"] if starts else 1.0)
    assert solver.kernel
    parameters = parameters_of(c, solver, data, middle, {}, given)
    top = searched(c, solver, data, parameters, starts, windows=False)
    if top is None:
        return None
    place = parameters.free_names.index("exponent")
    samples, variance = weighing.samples, weighing.variance
    if not (approximate or weighing.noise_known):
        variance = data.least_variance + weighing.inflation * top.squares / max(data.y.size - top.z.size, 1)
    own = weigh(exact(top), grid_of(0, exact=True), variance, samples)
    slope = float(parameters.rates(top.z)[place])
    sd = float(np.linalg.norm(own.factors[0][place])) * abs(slope)

    def at(p: float, near: _At | None) -> _At | None:
        fixed = Parameters(
            parameters.names,
            {n: prior for n, prior in parameters.priors.items() if n != "exponent"},
            {**parameters.known, "exponent": p},
        )
        solver = solver_of(p)
        z = np.delete(top.z, place) if near is None else near.u[: len(fixed.priors)]
        if not approximate:
            found = refit(solver, data, replace(top, parameters=fixed, z=z))
            if found is None:
                return None
            over = weigh(exact(found), grid_of(0, exact=True), variance, samples)
            return _At(over.log_evidence, found, found.z)
        found = replace(top, parameters=fixed, z=z)
        begun = None if near is None else linearised(c, solver, data, found, _moved(solver, near, p))
        about = relinearised(c, solver, data, found, variance, begun, near=begun is not None)
        if about is None:
            return None
        grid = grid_of(solver.knots.size, absorbed=fixed.absorbs)
        over = weigh(about[0].model, grid, variance, samples)
        return _At(over.log_evidence, replace(found, motion=about[0].motion), about[0].u)

    return at, float(parameters.values(top.z)[parameters.names.index("exponent")]), sd


def power_solver(weighing: Weighing, law: str, p: float) -> Solver:
    """Of motions under powers of the velocity near p."""
    plain = weighing.solvers[law]
    narrow = min(plain.epsilon, ROUNDED * weighing.reference.peak_velocity)
    # At 1 the width changes nothing; above, a narrow one costs ten times the steps.
    return replace(plain, terms=("power",), epsilon=narrow if p < 1 else plain.epsilon)


def power_starts(weighing: Weighing, best: Result, middle: Reference) -> list[dict[str, float]]:
    """Coefficients and exponents that lose as much as the likeliest sum at the middle amplitude: at first as that
    depends on the amplitude there, then steeper and less steep."""
    law, values, active = best.candidate.restoring, values_of(best), best.fit.active
    solver = weighing.solvers[law]
    amplitudes = (middle.amplitude * NEAR, middle.amplitude, middle.amplitude / NEAR)
    ratios = []
    for a in amplitudes:
        orbit = orbit_of(weighing, best, a)
        if orbit is None:
            return []
        works = works_on(orbit, solver, further_of(best, values), active)[0]
        ratios.append(float(works @ values[: works.size]) / (4 * np.pi * orbit.energy))
    if min(ratios) <= 0:
        return []
    steep = 1 + float(np.log(ratios[0] / ratios[2])) / (2 * np.log(NEAR))
    found = []
    for p in np.clip(steep + np.array(ASIDE), LEAST, MOST):
        given = {"exponent": float(p), "reference_velocity": middle.peak_velocity}
        work = TERMS.get("power").work(middle.amplitude, middle.frequency, given)
        unit = work / (2 * np.pi * middle.peak_velocity**2)
        found.append({"exponent": float(p), "c_power": ratios[1] / unit})
    return found


def _moved(solver: Solver, near: _At, p: float) -> np.ndarray:
    """Where the search begins: what was found at another exponent, with the same damping at each amplitude."""
    d, n = near.fit.z.size, solver.knots.size
    u = near.u.copy()
    times, sizes = turning_amplitudes(near.fit.motion)
    if times.size > 1:
        log = np.interp(solver.knots, times, np.log(sizes))
        u[d : d + n] += (near.fit.parameters.known["exponent"] - p) * (log - log.mean())
    return u


def _along(
    at: Callable[[float, _At | None], _At | None], best: float, sd: float
) -> tuple[np.ndarray, np.ndarray] | None:
    """The posterior's distribution function and the exponents that it is at, (n,) each."""
    best = float(np.clip(best, LEAST, MOST))
    middle = at(best, None)
    if middle is None:
        return None
    found = {best: middle}
    ends = [LEAST, MOST]

    def add(wanted: list[float]) -> bool:
        new = [p for p in dict.fromkeys(wanted) if LEAST <= p <= MOST and p not in found]
        nearest = [found[min(found, key=lambda q: abs(q - p))] for p in new]
        for p, one in zip(new, at_once(lambda pair: at(*pair), list(zip(new, nearest))), strict=True):
            if one is not None:
                found[p] = one
        return any(p in found for p in new)

    step = float(np.clip(FIRST * sd, NARROWEST, WIDEST))
    add([max(best - step, LEAST), min(best + step, MOST)])
    reach = [step, step]
    while len(found) < ENOUGH:
        p = np.array(sorted(found))
        log = np.array([found[one].log_evidence for one in p])
        open_ends = [
            side for side in (0, 1) if log[-side] > log.max() - NEGLIGIBLE and p[-side] != ends[side]
        ]
        if open_ends:
            wanted = []
            for side in open_ends:
                reach[side] *= FURTHER
                wanted.append(float(np.clip(best + (2 * side - 1) * reach[side], ends[0], ends[1])))
            add(wanted)
            for side, one in zip(open_ends, wanted, strict=True):
                if one not in found:  # no motion is found that far
                    ends[side], reach[side] = p[-side], 0.0
            continue
        grid, cumulated = _distribution(p, log)
        between = np.diff(np.interp(p, grid, cumulated))
        if not add([float(0.5 * (p[i] + p[i + 1])) for i in np.flatnonzero(between > ALIKE)]):
            break
    p = np.array(sorted(found))
    if p.size < 2:
        return None
    grid, cumulated = _distribution(p, np.array([found[one].log_evidence for one in p]))
    return cumulated, grid


def _distribution(p: np.ndarray, log: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Exponents between those at hand, (n,), and the probability up to each, rising."""
    from scipy.interpolate import Akima1DInterpolator, PchipInterpolator

    grid = np.linspace(p[0], p[-1], POINTS)
    values = PchipInterpolator(p, log)(grid)
    if p.size > 2:
        smooth = Akima1DInterpolator(p, log, method="makima")(grid)
        # Beside a fall of thousands of nats it swings far above all that is known.
        values = smooth if smooth.max() < log.max() + NEGLIGIBLE else values
    density = np.exp(values - log.max())
    total = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
    # Rising everywhere, so that it can be read the other way.
    return grid, total / total[-1] + 1e-12 * np.arange(POINTS)
