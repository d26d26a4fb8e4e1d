"""Rivals with another form of damping than those that are compared, and the exponent of a power law.

A rival stands for a term that it may be confused with: a power of the velocity for a whole sum, dry friction that rises
near rest for plain dry friction, damping that grows with the displacement for damping that grows with the velocity.
Where a rival is likelier than every sum, the best sum is the nearest law and not the answer.

The exponent is that of a power of the velocity alone. At each exponent the other parameters are inferred and the
evidence is computed; the posterior is interpolated between exponents. A model that is linear in the exponent too would
fail: a deviation can replace an exponent's dependence on the amplitude, and along that line, which may be long, the
coefficient follows a curve.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.inference.deviation.candidate import (
    MotionCandidate,
    exact,
    first_values,
    linearise,
    parameters_of,
    refit,
    relinearise,
    search,
    starts_of,
)
from bayesdamp.inference.deviation.gaussian.hyperparameters import grid_of
from bayesdamp.inference.deviation.gaussian.linear import weigh
from bayesdamp.inference.deviation.least_squares import LeastSquaresFit
from bayesdamp.inference.deviation.numbers.curves import orbit_of, turning_amplitudes, works_on
from bayesdamp.inference.deviation.parameters import Parameters
from bayesdamp.inference.deviation.weighing import START, CandidateResult, Weighing, exact_variance
from bayesdamp.machine.threads import at_once
from bayesdamp.physics.damping import PAPER_TERMS, TERMS
from bayesdamp.physics.kernel import Solver

PLACES = {"displacement": "quadratic", "stribeck": "coulomb"}
"""The term that a form stands for: both grow with the amplitude, or are dry friction."""
ALONE = "power"
"""The form that stands for a whole sum."""
BEHIND = 7.0
"""Nats behind the best sum up to which a rival with parameters of its own is weighed in place of a sum: with the prior
of a rival, less than 1 in 1,000 is beyond."""
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


def place_of(damping: Sequence[str]) -> tuple[str, ...]:
    """Return the sum that a rival stands for and to which it comes in a limit; empty where there is none."""
    if not any(TERMS.get(t).inferred and t in PLACES for t in damping):
        return ()
    like = {PLACES.get(t, t) for t in damping}
    return tuple(t for t in PAPER_TERMS if t in like)


def with_rivals(weighing: Weighing, approximate: bool) -> Weighing:
    """Return the weighing with its rivals, under the likeliest restoring law."""
    if not weighing.results:
        return weighing
    best, reference = weighing.best, weighing.reference
    plain = weighing.solvers[best.candidate.restoring]
    rivals: list[CandidateResult] = []
    for form, like in PLACES.items():
        if form not in plain.terms and like in plain.terms:
            solver = replace(plain, terms=(*(t for t in plain.terms if t in PAPER_TERMS), form))
            rivals += _weigh(weighing, solver, _sums(weighing, form, like), approximate)
    if ALONE not in plain.terms:
        # The power of the velocity, starting where it dissipates as the likeliest sum does.
        ratio = weighing.data.middle.peak_velocity / reference.peak_velocity
        starts = [
            {**start, "c_power": start["c_power"] * ratio ** (1 - start["exponent"])}
            for start in power_starts(weighing)
        ]
        if starts:
            solver = power_solver(weighing, starts[0]["exponent"])
            rivals += _weigh(weighing, solver, [(ALONE,)], approximate, starts)
    return replace(weighing, forms=tuple(rivals))


def _sums(weighing: Weighing, form: str, like: str) -> list[tuple[str, ...]]:
    """Return the sums that contain the form.

    All sums for a form without parameters of its own; else it replaces its term in the sums that count.
    """
    best = weighing.best
    law = best.candidate.restoring
    paper = [t for t in weighing.solvers[law].terms if t in PAPER_TERMS and t != like]
    if not TERMS.get(form).inferred:
        return [(*c, form) for n in range(len(paper) + 1) for c in combinations(paper, n)]
    close = [r.candidate for r in weighing.results if r.log_evidence > best.log_evidence - BEHIND]
    near = {frozenset(c.damping) for c in close if c.restoring == law}
    sums = [s for s in sorted(near, key=lambda s: (len(s), sorted(s))) if like in s and s <= {*paper, like}]
    return [(*(t for t in paper if t in s), form) for s in sums]


def _weigh(
    weighing: Weighing,
    solver: Solver,
    sums: Sequence[tuple[str, ...]],
    approximate: bool,
    starts: Sequence[Mapping[str, float]] = (),
) -> list[CandidateResult]:
    """Fit and weigh rivals, starting from the likeliest sum's motion.

    `starts` are values of coefficients and parameters; by default, starts are taken from their priors.
    """
    data, reference, fit = weighing.data, weighing.reference, weighing.best.fit
    law, near = weighing.best.candidate.restoring, fit.parameters.named(fit.z)
    scales = reference.scales(data.rest_under(law, fit.values[weighing.solvers[law].law_places]))
    own = {*solver.names[solver.law_places], *START}
    fixed = {n: v for n, v in fit.parameters.known.items() if n in own}

    def weigh_one(c: MotionCandidate) -> CandidateResult | None:
        parameters = parameters_of(c, solver, data, reference, {}, {**fixed, **scales})
        first = first_values(c, data, fixed)
        begin = {**near, **{n: first[n] for n in (TERMS.get(t).parameter for t in c.damping)}}
        each = [{**begin, **start} for start in starts or starts_of(c, parameters)]
        rival = search(solver, data, parameters, each, windows=False)
        return None if rival is None else weighing.result_of(c, solver, rival, approximate)

    assert solver.kernel  # compiled before several threads ask for it
    rivals = at_once(weigh_one, [MotionCandidate(terms, law) for terms in sums])
    return [r for r in rivals if r is not None]


@dataclass(frozen=True)
class _At:
    """The log evidence of an exponent in nats, and the mode there: its fit, and scores and (g, h) at the knots."""

    log_evidence: float
    fit: LeastSquaresFit
    u: np.ndarray


def exponents_of(weighing: Weighing, approximate: bool) -> tuple[float, ...]:
    """Return quantiles of the exponent at `LEVELS`; none where no motion under a power law follows the record.

    For the force c |v|^p under the likeliest restoring law. The prior of p is uniform between 0 and 3, that of c the
    same as for any damping of this size at the middle (in the logarithm) of the record's amplitudes.
    """
    problem = _problem(weighing, approximate) if weighing.results else None
    distribution = None if problem is None else _explore(*problem)
    return () if distribution is None else tuple(np.interp(LEVELS, *distribution).tolist())


def _problem(
    weighing: Weighing, approximate: bool
) -> tuple[Callable[[float, _At | None], _At | None], float, float] | None:
    """Return a function for the evidence at an exponent, and the best exponent under exact laws with its sd.

    The function also takes the result at another exponent, from which it starts.
    """
    data, near, samples = weighing.data, weighing.best.fit, weighing.samples
    law = weighing.best.candidate.restoring
    plain = weighing.solvers[law]
    own = {*plain.names[plain.law_places], *START}
    known = {n: v for n, v in near.parameters.known.items() if n in own}
    # At the middle, the record determines the size and the exponent independently.
    scales = data.middle.scales(data.rest_under(law, near.values[plain.law_places]))
    candidate = MotionCandidate(("power",), law)
    starts = [{**near.parameters.named(near.z), **start} for start in power_starts(weighing)]
    solver = power_solver(weighing, starts[0]["exponent"] if starts else 1.0)
    assert solver.kernel  # compiled before several threads ask for it
    parameters = parameters_of(candidate, solver, data, data.middle, {}, {**known, **scales})
    top = search(solver, data, parameters, starts, windows=False)
    if top is None:
        return None
    place = parameters.free_names.index("exponent")
    variance = weighing.variance
    if not (approximate or weighing.noise_known):
        variance = exact_variance(data, top, weighing.inflation)
    weighed = weigh(exact(top), grid_of(0, exact=True), variance, samples)
    sd = float(np.linalg.norm(weighed.factors[0][place])) * abs(float(parameters.rates(top.z)[place]))

    def at(p: float, near: _At | None) -> _At | None:
        priors = {n: prior for n, prior in parameters.priors.items() if n != "exponent"}
        fixed = Parameters(parameters.names, priors, {**parameters.known, "exponent": p})
        solver = power_solver(weighing, p)
        start = replace(
            top, parameters=fixed, z=np.delete(top.z, place) if near is None else near.u[: len(priors)]
        )
        if not approximate:
            best = refit(solver, data, start)
            if best is None:
                return None
            weighed = weigh(exact(best), grid_of(0, exact=True), variance, samples)
            return _At(weighed.log_evidence, best, best.z)
        begin = None if near is None else linearise(solver, data, start, _moved(solver, near, p))
        about = relinearise(solver, data, start, variance, begin, near=begin is not None)
        if about is None:
            return None
        grid = grid_of(solver.knots.size, absorbed=fixed.absorbs)
        weighed = weigh(about[0].model, grid, variance, samples)
        return _At(weighed.log_evidence, replace(start, motion=about[0].motion), about[0].u)

    return at, float(top.values[parameters.names.index("exponent")]), sd


def power_solver(weighing: Weighing, p: float) -> Solver:
    """Return the solver of motions under powers of the velocity near p, under the likeliest restoring law."""
    plain = weighing.solvers[weighing.best.candidate.restoring]
    narrow = min(plain.epsilon, ROUNDED * weighing.reference.peak_velocity)
    # At 1 the width changes nothing; above, a narrow one needs ten times the steps.
    return replace(plain, terms=("power",), epsilon=narrow if p < 1 else plain.epsilon)


def power_starts(weighing: Weighing) -> list[dict[str, float]]:
    """Return coefficients and exponents that dissipate as much as the likeliest sum at the middle amplitude.

    The first depends on the amplitude as the sum does there; the others are less steep and steeper.
    """
    best, middle = weighing.best, weighing.data.middle
    solver = weighing.solvers[best.candidate.restoring]
    ratios = []
    for a in (middle.amplitude * NEAR, middle.amplitude, middle.amplitude / NEAR):
        orbit = orbit_of(best, a)
        if orbit is None:
            return []
        works = works_on(orbit, solver, best.further, best.fit.active)[0]
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


def _moved(solver: Solver, near: _At, p: float) -> np.ndarray:
    """Return where a search starts: the mode at another exponent, with the same damping at each amplitude."""
    d, n = near.fit.z.size, solver.knots.size
    u = near.u.copy()
    times, sizes = turning_amplitudes(near.fit.motion)
    if times.size > 1:
        log = np.interp(solver.knots, times, np.log(sizes))
        u[d : d + n] += (near.fit.parameters.known["exponent"] - p) * (log - log.mean())
    return u


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
