"""Test other forms of damping: their evidence as rivals of the compared sums, and upper limits of their energy loss.

A rival is a sum of damping terms with a form of damping that is not in the comparison. In it, this form replaces a term
with which it may be confused: Stribeck friction replaces Coulomb friction, damping that grows with the displacement
replaces quadratic damping, and a power of the velocity replaces a whole sum. If a rival is more probable than every
compared sum, the true damping is probably none of these sums.

For an upper limit, one form is added to the best sum, and the energy that it may dissipate is inferred. No further fit
is needed: the linear model about the mode of the best sum gets one more column, the derivative of the motion by the
coefficient of the form at 0.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from bayesdamp.inference.deviation.candidate import (
    START,
    MotionCandidate,
    parameters_of,
    search_near,
    solve_at,
    start_values,
)
from bayesdamp.inference.deviation.linear import condense, score_normals, with_priors
from bayesdamp.inference.deviation.model_comparison import REACH, ROUNDS, CandidateResult, ModelComparison
from bayesdamp.inference.deviation.slices import exponent_starts, power_solver
from bayesdamp.machine import at_once
from bayesdamp.physics.damping import PAPER_TERMS, TERMS, TINY, others
from bayesdamp.physics.kernel import Solver
from bayesdamp.physics.kernel.solve import PARAMETERS
from bayesdamp.priors import SCORE_RATIO

REPLACED = {"displacement": "quadratic", "stribeck": "coulomb"}
"""Other forms of damping (keys), each with the term that it replaces in a rival (value). A rival is a sum of damping
terms with a form that is not in the comparison; its evidence is computed after the comparison."""
ALONE = "power"
"""The form of damping (one power of the velocity) that replaces a whole sum in a rival. A rival is a sum of damping
terms with a form that is not in the comparison; its evidence is computed after the comparison."""
BEHIND = 7.0
"""A form of damping with parameters besides its coefficient, such as a Stribeck velocity, replaces a term only in
compared sums whose log evidence is at most this many nats below the best. With any other sum, the posterior probability
would be below 1 in 1,000."""
FEW = 1000
"""Number of posterior draws from which the upper limit of another form of damping is computed."""
SCORES = (-1.0, 1.0)
"""Values of the parameters of a form of damping besides its coefficient (such as an exponent) at which its upper limit
is computed; the largest of these limits is used. They are standard normal scores: the parameters are transformed so
that their priors are N(0, 1), and the values are low and high in the prior."""
LEAST_WORK = 1e-6
"""A form of damping counts as dissipating no energy if the absolute value of its total work is at most this fraction of
|work above the equilibrium| + |work below the equilibrium|, where above and below refer to the position."""


def replaced_sum(damping: Sequence[str]) -> tuple[str, ...]:
    """Return the viscous, Coulomb and quadratic terms that a sum becomes at a limit of its terms' own parameters.

    Own parameters are those that a term has besides its coefficient. Stribeck friction, for example, can become Coulomb
    friction. damping: names of the sum's terms. The result contains names too, in the order of `PAPER_TERMS`; terms of
    other kinds are left out. It is empty if the sum has no term in `REPLACED` with own parameters.
    """
    if not any(TERMS.get(t).inferred and t in REPLACED for t in damping):
        return ()
    like = {REPLACED.get(t, t) for t in damping}
    return tuple(t for t in PAPER_TERMS if t in like)


def add_rivals(comparison: ModelComparison) -> ModelComparison:
    """Return a copy of the comparison whose field `forms` contains the results of the rivals.

    A rival is a sum of damping terms with a form of damping that is not compared. Besides this form, it has only
    viscous, Coulomb and quadratic terms that are compared. Rivals are evaluated under the restoring law of the best
    candidate. These rivals are left out:

    - a rival whose form is compared already, or replaces a term that is not compared;
    - a rival whose fit fails;
    - a sum in which a form that has inferred parameters besides its coefficient replaces a term, if the log evidence of
      the sum before this replacement is more than `BEHIND` nats below the best;
    - a sum with a form without such parameters, if its log evidence is expected to be more than `REACH` nats below the
      best. The sum of this form and all terms that it does not replace is always fitted; if it cannot be fitted and
      linearised with deviations, all its smaller sums are fitted too;
    - the power of the velocity, if no exponent can be estimated at which its fit would start (`exponent_starts`).

    If `comparison.results` is empty, the comparison itself is returned.
    """
    if not comparison.results:
        return comparison
    best = comparison.best
    values = best.fit.parameters.named(best.fit.z)
    plain = comparison.solvers[best.candidate.restoring]
    paper = [t for t in plain.terms if t in PAPER_TERMS]
    close = {
        frozenset(r.candidate.damping): r.fit
        for r in comparison.results
        if r.log_evidence > best.log_evidence - BEHIND and r.candidate.restoring == best.candidate.restoring
    }
    rivals: list[CandidateResult] = []
    for form, like in REPLACED.items():
        if form in plain.terms or like not in plain.terms:
            continue
        rest, solver = [t for t in paper if t != like], replace(plain, terms=(*paper, form))
        if TERMS.get(form).inferred:
            # The form replaces its term in the probable sums. Its fit starts with the force of this term.
            new, old = TERMS.get(form).parameter, TERMS.get(like).parameter
            near = sorted((s for s in close if like in s <= {*paper}), key=lambda s: (len(s), sorted(s)))
            each = {s: close[s].parameters.named(close[s].z) for s in near}
            sums = {
                (*(t for t in rest if t in s), form): {**at, new: at[old], old: 0.0} for s, at in each.items()
            }
        else:
            # The fit of the sum of all terms predicts the evidence of the smaller sums, and their fits start from it.
            largest = _evaluate_rivals(comparison, solver, {(*rest, form): values})
            rivals += largest
            sums = {(*c, form): values for n in range(len(rest)) for c in combinations(rest, n)}
            if largest and largest[0].linearisation is not None:
                fit, at = largest[0].fit, largest[0].linearisation
                smaller = [MotionCandidate(s, best.candidate.restoring) for s in sums]
                expected = comparison.expected_evidences(smaller, at)
                least, near = best.log_evidence - REACH, fit.parameters.named(fit.z)
                sums = {c.damping: near for c, log in expected.items() if log >= least}
        rivals += _evaluate_rivals(comparison, solver, sums)
    exponents = exponent_starts(comparison) if ALONE not in plain.terms else []
    if exponents:
        solver, starts = power_solver(comparison, exponents[0]), [{"exponent": p} for p in exponents]
        rivals += _evaluate_rivals(comparison, solver, {(ALONE,): values}, starts)
    return replace(comparison, forms=tuple(rivals))


def _evaluate_rivals(
    comparison: ModelComparison,
    solver: Solver,
    sums: Mapping[tuple[str, ...], Mapping[str, float]],
    starts: Sequence[Mapping[str, float]] = (),
) -> list[CandidateResult]:
    """Fit rivals (sums with a form of damping that is not compared) and return their results.

    Their priors are those of the candidates. Known initial values and known parameters of the restoring law are those
    of the best candidate. Rivals whose fit fails are left out.

    Parameters
    ----------
    comparison : ModelComparison
        The comparison; the rivals have the restoring law of its best candidate.
    solver : Solver
        Solver with the terms of the rivals.
    sums : mapping
        For each rival (names of its damping terms), the parameters by name near which its fit starts.
    starts : sequence of mapping
        Combinations of values at which the fits may start, by name, for parameters that terms have besides their
        coefficients, such as an exponent; by default those of `start_values`.
    """
    best, data, reference = comparison.best, comparison.data, comparison.reference
    restoring, places = best.candidate.restoring, best.solver.law_places
    scales = reference.scales(data.rest_under(restoring, best.fit.values[places]))
    motion = (*best.solver.names[places], *START)
    known = {n: v for n, v in best.fit.parameters.known.items() if n in motion} | scales

    # If the best law holds exactly, a more accurate motion of a rival would not change the answer.
    deviates = best.log_evidence > best.exact_posterior.log_evidence

    def evaluate(damping: tuple[str, ...]) -> CandidateResult | None:
        c = MotionCandidate(damping, restoring)
        parameters = parameters_of(c, solver, data, reference, comparison.priors, known)
        fit = search_near(solver, data, parameters, sums[damping], starts or start_values(c, parameters))
        if fit is None:
            return None
        result = comparison.evaluate(c, solver, fit)
        for _ in range(ROUNDS if deviates else 0):
            result = comparison.corrected(result, np.inf)
        return result

    assert solver.kernel  # compiled before several threads ask for it
    return [r for r in at_once(evaluate, sums, data.slow) if r is not None]


@dataclass(frozen=True)
class _Form:
    """A damping force per unit of its coefficient, for which an upper limit of the energy loss is computed.

    Attributes
    ----------
    name : str
        Name of the damping term.
    values : mapping of str to float
        Values of the term's parameters besides its coefficient, such as an exponent, and of the references in its force
        (equilibrium, velocity, amplitude).
    less : mapping of str to float, optional
        Values at which the term is equal to a simpler one. If given, the force is the term's at `values` minus the
        term's at `less`.
    signed : bool
        Whether the coefficient may be negative.
    """

    name: str
    values: Mapping[str, float]
    less: Mapping[str, float] | None = None
    signed: bool = False


def bound_other_forms(
    comparison: ModelComparison, result: CandidateResult, rng: np.random.Generator
) -> dict[str, float]:
    """Return, by name, 95 % upper limits of the fraction of the energy loss for each form that a candidate's sum lacks.

    Each form alone is added to the sum. The fraction is the absolute value of the energy that it dissipates over the
    record, divided by this value plus the energy that the sum dissipates. The forms are the shipped terms with
    `DampingTerm.bounded`, except viscous, Coulomb and quadratic damping.

    If a form has parameters besides its coefficient, such as an exponent, the limit is the largest over several of
    their values. If it is equal to a simpler term at some values (Stribeck to Coulomb friction), only the part of its
    force beyond the simpler term counts. The limit is 0 for a form that dissipates no energy. The result is empty if
    there is no such form, or if the motion is unbounded. result: the candidate's result.
    """
    absent = [n for n in others() if n not in result.candidate.damping and TERMS.get(n).bounded]
    forms = [form for name in absent for form in _forms(comparison, result, name)]
    base = columns_of(result)
    more = _tangents(comparison, result, forms) if base is not None and forms else None
    if base is None or more is None:
        return {}
    columns, target = base
    parameters, solver = result.fit.parameters, comparison.solvers[result.candidate.restoring]
    times, x, v = _nodes_and_middles(result)
    weight = v * (np.gradient(times) / (times[-1] - times[0]))
    # Mean power of the sum's terms per unit coefficient, and of the viscous force 2ω θ̇, whose damping ratio is 1.
    works = solver.works(x, v, weight, result.further, result.fit.active)[0]
    viscous = 2 * comparison.data.frequency * float(np.sum(weight * v))
    right = x > comparison.data.rest_under(result.candidate.restoring, result.law)
    halves = [(x[at], v[at], weight[at]) for at in (right, ~right)]
    sizes = np.zeros(len(forms))
    for i, form in enumerate(forms):
        # Mean power of the form at positions on either side of the equilibrium.
        alone = replace(solver, terms=(form.name,))
        states = [form.values, *([form.less] if form.less else [])]
        further = np.array([[values[n] for n in alone.further] for values in states])
        each = [alone.works(*half, further, np.ones(1, bool))[:, 0] for half in halves]
        sides = np.array([part[0] - part[1:].sum() for part in each])
        if abs(sides.sum()) > LEAST_WORK * np.abs(sides).sum():
            sizes[i] = SCORE_RATIO * viscous / abs(sides.sum())
    # Condense the model with all forms once; fixing the other coefficients at 0 gives the model with one form.
    d = result.fit.z.size
    whole = np.concatenate([columns[:, :d], more * sizes, columns[:, d:]], axis=1)
    positive = np.concatenate([parameters.positive, [not form.signed for form in forms]])
    model = condense(whole, target, positive)
    normals = score_normals(model, result.grid(coarse=True), comparison.variance, comparison.samples)
    bounds = dict.fromkeys((form.name for form in forms), 0.0)
    for i in np.flatnonzero(sizes):
        own = np.isin(np.arange(positive.size), np.append(np.arange(d), d + i))
        only = normals.given(~own, np.zeros(own.size))
        u = with_priors(only, positive[own], np.append(parameters.shared, True)).draws(FEW, rng)[0]
        lost = np.abs(u[:, d]) * SCORE_RATIO * viscous
        rest = np.maximum(parameters.values(u[:, :d])[:, : works.size] @ works, 0.0)
        share = float(np.quantile(lost / np.maximum(lost + rest, 1e-300), 0.95))
        bounds[forms[i].name] = max(bounds[forms[i].name], share)
    return bounds


def _forms(comparison: ModelComparison, result: CandidateResult, name: str) -> Iterator[_Form]:
    """Yield the forces of one damping term for which upper limits are computed.

    Without parameters besides its coefficient, such as an exponent, a term has one force. Otherwise it has a force at
    each of the `SCORES`, which is the same for all these parameters. If the term is equal to a simpler one at certain
    values of some parameters (Stribeck to Coulomb friction), it has instead, at each of the `SCORES` of the other
    parameters, a force for each of these: with this one at the score 1 and the rest of these at those values, minus the
    force of the simpler term. name: name of the term.
    """
    term, reference = TERMS.get(name), comparison.reference
    scales = reference.scales(comparison.data.rest_under(result.candidate.restoring, result.law))
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


def columns_of(result: CandidateResult) -> tuple[np.ndarray, np.ndarray] | None:
    """Return Jacobian (n, K) and target (n,) of the linear least-squares problem about a candidate's posterior mode.

    Its unknowns u are the parameters, transformed so that their priors are standard normal (scores), then the
    deviations from the laws at knots in time: g (the damping force is multiplied by exp g) and h (the frequency is
    multiplied by 1 + h). Under exact laws u contains only the scores. The target is the record minus the constant part
    of the linearised motion, so that |Jacobian u − target|² is the sum of squared residuals. Both are in the record's
    unit. None if the motion is unbounded.
    """
    fit, linearisation = result.fit, result.linearisation
    if linearisation is None:
        return fit.tangents, fit.residual + fit.tangents @ fit.z
    solution = solve_at(result.solver, fit, linearisation.u)
    return None if solution is None else (solution[1], linearisation.residual + solution[1] @ linearisation.u)


def _nodes_and_middles(result: CandidateResult) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times, displacements and velocities of a motion at its s nodes and half way between them, (2s − 1,) each.

    Nodes are the times that divide each step of the ODE solver into equal parts (`Motion.refined`). Units are s, rad
    and rad/s (or m and m/s). A velocity of 0 is replaced by a tiny one with the sign of the velocity before it (or
    after it, if that is 0 too), so that friction is not zero there.
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


def _tangents(comparison: ModelComparison, result: CandidateResult, forms: list[_Form]) -> np.ndarray | None:
    """Return the derivatives of the motion by the coefficients of f added forms, at coefficients of 0, (n, f).

    The motion is that at the mode of the candidate's posterior, with its deviations from the laws. The derivatives are
    in the record's unit per unit of the coefficient. None if the motion is unbounded. One solution gives the
    derivatives for all terms, each at one set of its parameters, so the number of solutions is the largest number of
    sets for a term.
    """
    solver = comparison.solvers[result.candidate.restoring]
    wider = replace(solver, terms=tuple(dict.fromkeys([*solver.terms, *(form.name for form in forms)])))
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
        motion = wider.solve(np.array(p), active, *result.deviations, PARAMETERS)
        if motion is None:
            return None
        solved.append(motion.tangents)

    def column(name: str, values: Mapping[str, float]) -> np.ndarray:
        return solved[states[name].index(values)][:, wider.terms.index(name)]

    return np.column_stack([
        column(f.name, f.values) - (0.0 if f.less is None else column(f.name, f.less)) for f in forms
    ])  # fmt: skip
