"""Bounds of the forms of damping that are not in the answer, each by itself beside the likeliest sum.

The record's model is linear about the likeliest candidate's mode. A form that is not there is one column more in it:
the tangent by its coefficient at 0, which solves the candidate's own variational equation with the form's force as a
source. No motion is solved anew and nothing is searched.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from bayesdamp.inference.deviation.candidate import columns_at
from bayesdamp.inference.deviation.gaussian.hyperparameters import grid_of
from bayesdamp.inference.deviation.gaussian.linear import condensed, weigh
from bayesdamp.inference.deviation.numbers.curves import values_of
from bayesdamp.inference.deviation.weighing import Result, Weighing
from bayesdamp.physics.damping import TERMS, TINY, others
from bayesdamp.physics.restoring import LAWS
from bayesdamp.priors import SCORE_RATIO

FEW = 1000
"""Draws of a bound."""
SCORES = (-1.0, 1.0)
"""Scores of a form's parameters at which it is bounded; the larger bound counts."""
LEAST_WORK = 1e-6
"""Share of what a form moves to and fro below which it takes no energy by itself."""
Shape = Callable[[float, float, float], float]


@dataclass(frozen=True)
class _Form:
    """A force per unit of its coefficient, and whether the coefficient may have either sign."""

    name: str
    shape: Shape
    signed: bool = False


def bounds_of_others(
    weighing: Weighing, result: Result, approximate: bool, rng: np.random.Generator
) -> dict[str, float]:
    """95 % upper limits of the share of the energy that each form which ships beside the paper's terms, and is not in
    the result's sum, may take, by name; of friction with a further parameter, of what it has beyond dry friction."""
    forms = [
        form
        for name in others()
        if name not in result.candidate.damping and TERMS.get(name).bounded
        for form in _forms(weighing, result, name)
    ]
    base = columns_of(weighing, result, approximate)
    if base is None or not forms:
        return {}
    columns, target = base
    sources, work, moved, own = _sources(weighing, result, forms)
    more = _tangents(weighing, result, sources)
    absorbs = result.fit.parameters.absorbs
    knots = weighing.solvers[result.candidate.restoring].knots.size if approximate else 0
    grid = grid_of(knots, exact=not approximate, coarse=True, absorbed=absorbs)
    found: dict[str, float] = {}
    at, positive, shared = result.fit.z.size, result.fit.parameters.positive, result.fit.parameters.shared
    for i, form in enumerate(forms):
        if abs(work[i]) <= LEAST_WORK * moved[i]:
            found.setdefault(form.name, 0.0)
            continue
        size = SCORE_RATIO * own.viscous / abs(work[i])
        whole = np.insert(columns, at, more[:, i] * size, axis=1)
        model = condensed(whole, target, np.append(positive, not form.signed), np.append(shared, True))
        weighed = weigh(model, grid, weighing.variance, weighing.samples)
        u = weighed.draws(model.positive, FEW, rng)[0]
        taken = np.abs(u[:, at]) * size * abs(work[i])
        rest = np.maximum(own.power(u[:, :at]), 0.0)
        share = float(np.quantile(taken / np.maximum(taken + rest, 1e-300), 0.95))
        found[form.name] = max(found.get(form.name, 0.0), share)
    return found


@dataclass(frozen=True)
class _Own:
    """What the sum's own terms do along the motion: mean power of a viscous force 2ω θ̇, whose ratio is 1; works of the
    terms per unit of their coefficients (m,), whose scores are at `places` of all scores, and the prior scales."""

    viscous: float
    works: np.ndarray
    places: np.ndarray
    scales: np.ndarray

    def power(self, scores: np.ndarray) -> np.ndarray:
        """Mean power at scores, (n, d): (n,)."""
        return scores[:, self.places] @ (self.works * self.scales)


def _forms(weighing: Weighing, result: Result, name: str) -> Iterator[_Form]:
    """A term as what is bounded of it: at low and high values of its parameters; where it reduces to a simpler term,
    what it has beyond that."""
    term, reference = TERMS.get(name), weighing.reference
    given = reference.scales(_rest(weighing, result))
    priors = {p.name: p.prior(reference.amplitude, reference.frequency) for p in term.inferred}

    def value(parameter: str, score: float) -> float:
        return float(
            priors[parameter].value(np.asarray(abs(score) if priors[parameter].reflected else score))
        )

    simple = dict(term.reduces)
    free = [p for p in priors if p not in simple]
    for score in SCORES if free else (0.0,):
        known = {**given, **simple, **{p: value(p, score) for p in free}}
        if not simple:
            yield _Form(name, term.at(known))
        for parameter in simple:
            changed = {**known, parameter: value(parameter, 1.0)}
            yield _Form(name, _beyond(term.at(changed), term.at(known)), not priors[parameter].reflected)


def _beyond(more: Shape, less: Shape) -> Shape:
    return lambda x, v, epsilon: more(x, v, epsilon) - less(x, v, epsilon)


def _rest(weighing: Weighing, result: Result) -> float:
    name = result.candidate.restoring
    law = values_of(result)[weighing.solvers[name].law_places]
    return weighing.data.rest_under(name, law)


def columns_of(weighing: Weighing, result: Result, approximate: bool) -> tuple[np.ndarray, np.ndarray] | None:
    """The linear model's columns (n, K) and what they are fitted to, (n,)."""
    fit, data, about = result.fit, weighing.data, result.about
    if not approximate or about is None:
        return fit.tangents, fit.residual + fit.tangents @ fit.z
    columns = columns_at(result.solver, fit, about.u)
    return None if columns is None else (columns, data.y - about.motion.y + columns @ about.u)


def _middle(result: Result) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (2s − 1,), displacements and velocities at a motion's refined points and half way between them. A velocity
    of 0 at a turning point has the sign of its own side, which exact friction has."""
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
    weighing: Weighing, result: Result, forms: list[_Form]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, _Own]:
    """Forces of the forms at `_middle`'s points, (2s − 1, f), their mean power along the motion, (f,), the mean of its
    magnitude, (f,), and what the sum's own terms do."""
    solver = weighing.solvers[result.candidate.restoring]
    epsilon, parameters = solver.epsilon, result.fit.parameters
    times, x, v = _middle(result)
    forces = np.array([
        [form.shape(a, b, epsilon) for form in forms]
        for a, b in zip(x.tolist(), v.tolist(), strict=True)
    ])  # fmt: skip
    width = np.gradient(times) / (times[-1] - times[0])
    z = result.fit.z if result.about is None else result.about.u[: result.fit.z.size]
    further = values_of(result)[None, len(solver.terms) : solver.law_places.start]
    works = solver.works(x, v, v * width, further, result.fit.active)[0]
    places = [i for i, place in enumerate(parameters.free) if place < len(solver.terms)]
    columns = parameters.free[places]
    own = _Own(
        viscous=2 * weighing.data.frequency * float(np.sum(width * v * v)),
        works=works[columns], places=np.array(places, int), scales=parameters.rates(z)[places],
    )  # fmt: skip
    return forces, (width * v) @ forces, (width * np.abs(v)) @ np.abs(forces), own


def _tangents(weighing: Weighing, result: Result, sources: np.ndarray) -> np.ndarray:
    """Tangents of the record by the forms' coefficients, (n, f): the variational equation by Runge and Kutta's method
    of order 4 on the motion's own steps. Exact friction changes them at turning points as it does in
    `physics.kernel.march`."""
    solver = weighing.solvers[result.candidate.restoring]
    times, x, v = _middle(result)
    by_x, by_v, scale = _slopes(weighing, result, times, x, v)
    force = -scale[:, None] * sources * solver.slowness
    t, n = times[::2], sources.shape[1]
    found = np.zeros((t.size, n, 3))
    found[0, :, 2] = force[0]
    d, w = np.zeros(n), np.zeros(n)
    velocity, acceleration = result.motion.refined[1][:, 1:].T
    still = (velocity == 0) & (acceleration == 0)
    for i in range(t.size - 1):
        a, m, b, step = 2 * i, 2 * i + 1, 2 * i + 2, t[i + 1] - t[i]
        if still[i + 1]:
            w = np.zeros(n)
            found[i + 1, :, 0] = d
            continue
        if step == 0:
            w = w if still[i] else w * (acceleration[i + 1] / acceleration[i])
            found[i + 1] = np.column_stack([d, w, force[b] - by_x[b] * d - by_v[b] * w])
            continue
        w1 = force[a] - by_x[a] * d - by_v[a] * w
        d2, v2 = d + 0.5 * step * w, w + 0.5 * step * w1
        w2 = force[m] - by_x[m] * d2 - by_v[m] * v2
        d3, v3 = d + 0.5 * step * v2, w + 0.5 * step * w2
        w3 = force[m] - by_x[m] * d3 - by_v[m] * v3
        d4, v4 = d + step * v3, w + step * w3
        w4 = force[b] - by_x[b] * d4 - by_v[b] * v4
        d = d + step / 6 * (w + 2 * v2 + 2 * v3 + v4)
        w = w + step / 6 * (w1 + 2 * w2 + 2 * w3 + w4)
        found[i + 1, :, 0], found[i + 1, :, 1] = d, w
        found[i + 1, :, 2] = force[b] - by_x[b] * d - by_v[b] * w
    return solver.read_slopes(t, result.motion.refined[1], found)


def _slopes(
    weighing: Weighing, result: Result, times: np.ndarray, x: np.ndarray, v: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Slopes of the whole force by displacement and velocity along the motion, and the factor of its damping, (p,)."""
    solver, data = weighing.solvers[result.candidate.restoring], weighing.data
    values = values_of(result)
    law, force = values[solver.law_places], LAWS.get(result.candidate.restoring).kernel
    further = dict(zip(solver.further, values[len(solver.terms) : solver.law_places.start], strict=True))
    own = values[: len(solver.terms)] * solver.slowness
    coefficients: Mapping[str, float] = dict(zip(solver.terms, own, strict=True))
    shapes = [(coefficients[n], TERMS.get(n).at(further)) for n in result.candidate.damping]
    dx, dv, epsilon = 1e-6 * data.amplitude, 1e-6 * data.amplitude * data.frequency, solver.epsilon
    if epsilon == 0:  # the sign of the velocity is that of the point
        v = np.where(np.abs(v) < 2 * dv, np.copysign(2 * dv, v), v)
    points = list(zip(x.tolist(), v.tolist(), strict=True))
    spring = np.array([(force(a + dx, law) - force(a - dx, law)) / (2 * dx) for a, _ in points])
    by_x, by_v = np.zeros(x.size), np.zeros(x.size)
    for c, f in shapes:
        by_x += c * np.array([f(a + dx, b, epsilon) - f(a - dx, b, epsilon) for a, b in points]) / (2 * dx)
        by_v += c * np.array([f(a, b + dv, epsilon) - f(a, b - dv, epsilon) for a, b in points]) / (2 * dv)
    scale, spring_scale = np.ones(x.size), np.ones(x.size)
    if result.about is not None:
        d, n = result.fit.z.size, solver.knots.size
        g, h = result.about.u[d : d + n], result.about.u[d + n :]
        scale = 1 + np.interp(times, solver.knots, np.expm1(g))
        spring_scale = 1 + 2 * np.interp(times, solver.knots, h)
    return scale * by_x + spring_scale * spring, scale * by_v, scale
