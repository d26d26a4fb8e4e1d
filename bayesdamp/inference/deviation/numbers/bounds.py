"""Bounds of the forms of damping that are not in the answer, each added by itself to the likeliest sum.

The record's model is linear about the likeliest candidate's mode. A form that is not in it is one more column: the
tangent by its coefficient at 0, which solves the candidate's own variational equation with the form's force as a
source. No motion is solved again and nothing is searched.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from bayesdamp.inference.deviation.candidate import tangents_at
from bayesdamp.inference.deviation.gaussian.hyperparameters import grid_of
from bayesdamp.inference.deviation.gaussian.linear import condensed, weigh
from bayesdamp.inference.deviation.weighing import CandidateResult, Weighing
from bayesdamp.physics.damping import TERMS, TINY, others
from bayesdamp.physics.restoring import LAWS
from bayesdamp.priors import SCORE_RATIO

FEW = 1000
"""Draws of a bound."""
SCORES = (-1.0, 1.0)
"""Scores of a form's parameters at which it is bounded; the larger bound counts."""
LEAST_WORK = 1e-6
"""Net work, relative to the sum of its absolute parts, below which a form dissipates no energy."""
Shape = Callable[[float, float, float], float]


@dataclass(frozen=True)
class _Form:
    """A force per unit of its coefficient, and whether the coefficient may have either sign."""

    name: str
    shape: Shape
    signed: bool = False


@dataclass(frozen=True)
class _Own:
    """The work of the sum's own terms along the motion.

    viscous: mean power of a viscous force 2ω θ̇, whose ratio is 1; works: of the terms per unit of their coefficients,
    (m,); places: of the coefficients' scores among all scores; scales: of their priors.
    """

    viscous: float
    works: np.ndarray
    places: np.ndarray
    scales: np.ndarray

    def power(self, scores: np.ndarray) -> np.ndarray:
        """Return the mean power at scores, (n, d): (n,)."""
        return scores[:, self.places] @ (self.works * self.scales)


def bounds_of_others(
    weighing: Weighing, result: CandidateResult, approximate: bool, rng: np.random.Generator
) -> dict[str, float]:
    """Return 95 % upper limits of the share of the energy of each form that is not in the result's sum, by name.

    Of friction with a parameter of its own, only what it adds to dry friction is bounded.
    """
    absent = [n for n in others() if n not in result.candidate.damping and TERMS.get(n).bounded]
    forms = [form for name in absent for form in _forms(weighing, result, name)]
    base = columns_of(result, approximate)
    if base is None or not forms:
        return {}
    columns, target = base
    sources, work, moved, own = _sources(weighing, result, forms)
    more = _tangents(weighing, result, sources)
    parameters = result.fit.parameters
    knots = weighing.solvers[result.candidate.restoring].knots.size if approximate else 0
    grid = grid_of(knots, exact=not approximate, coarse=True, absorbed=parameters.absorbs)
    bounds: dict[str, float] = {}
    d, shared = result.fit.z.size, np.append(parameters.shared, True)
    for i, form in enumerate(forms):
        if abs(work[i]) <= LEAST_WORK * moved[i]:
            bounds.setdefault(form.name, 0.0)
            continue
        size = SCORE_RATIO * own.viscous / abs(work[i])
        whole = np.insert(columns, d, more[:, i] * size, axis=1)
        model = condensed(whole, target, np.append(parameters.positive, not form.signed), shared)
        weighed = weigh(model, grid, weighing.variance, weighing.samples)
        u = weighed.draws(model.positive, FEW, rng)[0]
        lost = np.abs(u[:, d]) * size * abs(work[i])
        rest = np.maximum(own.power(u[:, :d]), 0.0)
        share = float(np.quantile(lost / np.maximum(lost + rest, 1e-300), 0.95))
        bounds[form.name] = max(bounds.get(form.name, 0.0), share)
    return bounds


def _forms(weighing: Weighing, result: CandidateResult, name: str) -> Iterator[_Form]:
    """Yield the parts of a term that are bounded: at low and high values of its parameters.

    Of a term that reduces to a simpler one, what it adds to that.
    """
    term, reference = TERMS.get(name), weighing.reference
    scales = reference.scales(weighing.data.rest_under(result.candidate.restoring, result.law))
    priors = {p.name: p.prior(reference.amplitude, reference.frequency) for p in term.inferred}

    def value(parameter: str, score: float) -> float:
        prior = priors[parameter]
        return float(prior.value(np.asarray(abs(score) if prior.reflected else score)))

    simple = dict(term.reduces)
    free = [p for p in priors if p not in simple]
    for score in SCORES if free else (0.0,):
        known = {**scales, **simple, **{p: value(p, score) for p in free}}
        if not simple:
            yield _Form(name, term.at(known))
        for parameter in simple:
            changed = {**known, parameter: value(parameter, 1.0)}
            yield _Form(name, _difference(term.at(changed), term.at(known)), not priors[parameter].reflected)


def _difference(more: Shape, less: Shape) -> Shape:
    return lambda x, v, epsilon: more(x, v, epsilon) - less(x, v, epsilon)


def columns_of(result: CandidateResult, approximate: bool) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the linear model's columns (n, K) and what they are fitted to, (n,)."""
    fit, about = result.fit, result.about
    if not approximate or about is None:
        return fit.tangents, fit.residual + fit.tangents @ fit.z
    columns = tangents_at(result.solver, fit, about.u)
    return None if columns is None else (columns, about.residual + columns @ about.u)


def _middle(result: CandidateResult) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times (2s − 1,), displacements and velocities at a motion's refined points and half way between them.

    A velocity of 0 at a turning point has the sign of its own side, as exact friction has.
    """
    t, states = result.motion.refined
    step = np.diff(t)
    between = 0.5 * (states[1:] + states[:-1])
    between[:, :2] -= step[:, None] / 8 * np.diff(states[:, 1:], axis=0)
    every = np.empty((2 * t.size - 1, 2))
    every[::2], every[1::2] = states[:, :2], between[:, :2]
    times = np.empty(2 * t.size - 1)
    times[::2], times[1::2] = t, t[:-1] + 0.5 * step
    v = every[:, 1]
    still = np.flatnonzero(v == 0)
    before, after = v[np.maximum(still - 1, 0)], v[np.minimum(still + 1, v.size - 1)]
    v[still] = TINY * np.sign(np.where(before != 0, before, after))
    return times, every[:, 0], v


def _sources(
    weighing: Weighing, result: CandidateResult, forms: list[_Form]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, _Own]:
    """Return the forces of the forms and their work along the motion.

    Forces at `_middle`'s points, (2s − 1, f), their mean power, (f,), the mean of its magnitude, (f,), and the work of
    the sum's own terms.
    """
    solver, parameters = weighing.solvers[result.candidate.restoring], result.fit.parameters
    times, x, v = _middle(result)
    forces = np.array([
        [form.shape(a, b, solver.epsilon) for form in forms]
        for a, b in zip(x.tolist(), v.tolist(), strict=True)
    ])  # fmt: skip
    width = np.gradient(times) / (times[-1] - times[0])
    works = solver.works(x, v, v * width, result.further, result.fit.active)[0]
    places = np.flatnonzero(parameters.free < len(solver.terms))
    viscous = 2 * weighing.data.frequency * float(np.sum(width * v * v))
    own = _Own(viscous, works[parameters.free[places]], places, parameters.rates(result.z)[places])
    return forces, (width * v) @ forces, (width * np.abs(v)) @ np.abs(forces), own


def _tangents(weighing: Weighing, result: CandidateResult, sources: np.ndarray) -> np.ndarray:
    """Return the tangents of the record by the forms' coefficients, (n, f).

    They solve the variational equation, by Runge and Kutta's method of order 4 on the motion's own steps. Exact
    friction changes them at turning points as it does in `physics.kernel.march`.
    """
    solver = weighing.solvers[result.candidate.restoring]
    times, x, v = _middle(result)
    by_x, by_v, scale = _slopes(weighing, result, times, x, v)
    force = -scale[:, None] * sources * solver.slowness
    t, n = times[::2], sources.shape[1]
    tangents = np.zeros((t.size, n, 3))
    tangents[0, :, 2] = force[0]
    d, w = np.zeros(n), np.zeros(n)
    velocity, acceleration = result.motion.refined[1][:, 1:].T
    still = (velocity == 0) & (acceleration == 0)

    def slope(at: int, d: np.ndarray, w: np.ndarray) -> np.ndarray:
        return force[at] - by_x[at] * d - by_v[at] * w

    for i in range(t.size - 1):
        a, m, b, step = 2 * i, 2 * i + 1, 2 * i + 2, t[i + 1] - t[i]
        if still[i + 1]:
            w = np.zeros(n)
            tangents[i + 1, :, 0] = d
            continue
        if step == 0:
            w = w if still[i] else w * (acceleration[i + 1] / acceleration[i])
        else:
            w1 = slope(a, d, w)
            v2 = w + 0.5 * step * w1
            w2 = slope(m, d + 0.5 * step * w, v2)
            v3 = w + 0.5 * step * w2
            w3 = slope(m, d + 0.5 * step * v2, v3)
            v4 = w + step * w3
            w4 = slope(b, d + step * v3, v4)
            d = d + step / 6 * (w + 2 * v2 + 2 * v3 + v4)
            w = w + step / 6 * (w1 + 2 * w2 + 2 * w3 + w4)
        tangents[i + 1] = np.column_stack([d, w, slope(b, d, w)])
    return solver.read_slopes(t, result.motion.refined[1], tangents)


def _slopes(
    weighing: Weighing, result: CandidateResult, times: np.ndarray, x: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return slopes of the force by displacement and velocity along the motion, and the damping's factor, (p,) each."""
    solver, data = weighing.solvers[result.candidate.restoring], weighing.data
    law, force = result.law, LAWS.get(result.candidate.restoring).kernel
    further = dict(zip(solver.further, result.further[0], strict=True))
    coefficients = dict(zip(solver.terms, result.values * solver.slowness))
    dx, dv, epsilon = 1e-6 * data.amplitude, 1e-6 * data.amplitude * data.frequency, solver.epsilon
    if epsilon == 0:  # the sign of the velocity is that of the point
        v = np.where(np.abs(v) < 2 * dv, np.copysign(2 * dv, v), v)
    points = list(zip(x.tolist(), v.tolist(), strict=True))
    spring = np.array([(force(a + dx, law) - force(a - dx, law)) / (2 * dx) for a, _ in points])
    by_x, by_v = np.zeros(x.size), np.zeros(x.size)
    for name in result.candidate.damping:
        c, f = coefficients[name], TERMS.get(name).at(further)
        by_x += c * np.array([f(a + dx, b, epsilon) - f(a - dx, b, epsilon) for a, b in points]) / (2 * dx)
        by_v += c * np.array([f(a, b + dv, epsilon) - f(a, b - dv, epsilon) for a, b in points]) / (2 * dv)
    scale, spring_scale = np.ones(x.size), np.ones(x.size)
    if result.about is not None:
        g, h = result.about.deviations
        scale = 1 + np.interp(times, solver.knots, g)
        spring_scale = 1 + 2 * np.interp(times, solver.knots, h)
    return scale * by_x + spring_scale * spring, scale * by_v, scale
