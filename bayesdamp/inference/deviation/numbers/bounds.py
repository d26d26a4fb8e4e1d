"""Bounds of the forms of damping that are not in the answer, each added by itself to the likeliest sum.

The record's model is linear about the likeliest candidate's mode. A form that is not in it is one more column: the
tangent of the motion by its coefficient at 0. No motion is solved again and nothing is searched.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from bayesdamp.inference.deviation.candidate import tangents_at
from bayesdamp.inference.deviation.gaussian.hyperparameters import grid_of
from bayesdamp.inference.deviation.gaussian.linear import condensed, weigh
from bayesdamp.inference.deviation.weighing import CandidateResult, Weighing
from bayesdamp.physics.damping import TERMS, TINY, others
from bayesdamp.physics.kernel.solve import PARAMETERS
from bayesdamp.priors import SCORE_RATIO

FEW = 1000
"""Draws of a bound."""
SCORES = (-1.0, 1.0)
"""Scores of a form's parameters at which it is bounded; the larger bound counts."""
LEAST_WORK = 1e-6
"""Net work, relative to the sum of its absolute parts, below which a form dissipates no energy."""


@dataclass(frozen=True)
class _Form:
    """A force per unit of its coefficient.

    Attributes
    ----------
    name : str
        The damping term.
    values : mapping of str to float
        Values of the term's further parameters.
    less : mapping of str to float, optional
        Values at which the term is a simpler one, whose force is subtracted.
    signed : bool
        Whether the coefficient may have either sign.
    """

    name: str
    values: Mapping[str, float]
    less: Mapping[str, float] | None = None
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
    more = _tangents(weighing, result, forms, approximate)
    if more is None:
        return {}
    work, moved, own = _works(weighing, result, forms)
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
            yield _Form(name, known)
        for parameter in simple:
            changed = {**known, parameter: value(parameter, 1.0)}
            yield _Form(name, changed, known, not priors[parameter].reflected)


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


def _works(
    weighing: Weighing, result: CandidateResult, forms: list[_Form]
) -> tuple[np.ndarray, np.ndarray, _Own]:
    """Return the work of the forms along the motion.

    Their mean power, (f,), the sum of its magnitudes on either side of rest, (f,), and the work of the sum's own terms.
    """
    solver, parameters = weighing.solvers[result.candidate.restoring], result.fit.parameters
    times, x, v = _middle(result)
    width = np.gradient(times) / (times[-1] - times[0])
    works = solver.works(x, v, v * width, result.further, result.fit.active)[0]
    places = np.flatnonzero(parameters.free < len(solver.terms))
    viscous = 2 * weighing.data.frequency * float(np.sum(width * v * v))
    own = _Own(viscous, works[parameters.free[places]], places, parameters.rates(result.z)[places])
    right = x > weighing.data.rest_under(result.candidate.restoring, result.law)
    parts = np.zeros((2, len(forms)))
    for i, form in enumerate(forms):
        alone = replace(solver, terms=(form.name,))
        states = [form.values, *([form.less] if form.less else [])]
        further = np.array([[values[n] for n in alone.further] for values in states])
        for part, side in zip(parts, (right, ~right), strict=True):
            each = alone.works(x, v, v * width * side, further, np.ones(1, bool))[:, 0]
            part[i] = each[0] - each[1:].sum()
    return parts.sum(axis=0), np.abs(parts).sum(axis=0), own


def _tangents(
    weighing: Weighing, result: CandidateResult, forms: list[_Form], approximate: bool
) -> np.ndarray | None:
    """Return the tangents of the record by the forms' coefficients at 0, (n, f); None where the motion escapes.

    The motion is solved with all forms at once, and again for the terms that have further forms.
    """
    solver, about = weighing.solvers[result.candidate.restoring], result.about
    wider = replace(solver, terms=tuple(dict.fromkeys([*solver.terms, *(form.name for form in forms)])))
    g, h = about.deviations if approximate and about is not None else (None, None)
    known = dict(zip(solver.names, result.values.tolist(), strict=True))
    added = {form.name for form in forms}
    active = np.array([
        name in added or (name in solver.terms and bool(result.fit.active[solver.terms.index(name)]))
        for name in wider.terms
    ])  # fmt: skip
    states: dict[str, list[Mapping[str, float]]] = {name: [] for name in added}
    for form in forms:
        states[form.name] += [
            v for v in (form.values, form.less) if v is not None and v not in states[form.name]
        ]
    solved: list[np.ndarray] = []
    for number in range(max(map(len, states.values()))):
        own = {name: each[min(number, len(each) - 1)] for name, each in states.items()}
        p = [0.0 if name in added else known[TERMS.get(name).parameter] for name in wider.terms]
        p += [own.get(name, known)[n] for name in wider.terms for n in TERMS.get(name).further]
        p += [known[n] for n in wider.names[len(p) :]]
        motion = wider.solve(np.array(p), active, g, h, PARAMETERS)
        if motion is None:
            return None
        solved.append(motion.tangents)

    def column(name: str, values: Mapping[str, float]) -> np.ndarray:
        return solved[states[name].index(values)][:, wider.terms.index(name)]

    return np.column_stack([
        column(f.name, f.values) - (0.0 if f.less is None else column(f.name, f.less)) for f in forms
    ])  # fmt: skip
