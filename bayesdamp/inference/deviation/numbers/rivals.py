"""Rivals with another form of damping than those that are compared.

Each stands for a term that it may be confused with: a power of the velocity for a whole sum, dry friction that rises
near rest for plain dry friction, damping that grows with the displacement for damping that grows with the velocity.
Where a rival is likelier than every sum, the best sum is the nearest law and not the answer.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations

from bayesdamp.inference.deviation.candidate import Candidate, first_values, parameters_of, search, starts_of
from bayesdamp.inference.deviation.numbers.exponent import power_solver, power_starts
from bayesdamp.inference.deviation.weighing import START, Result, Weighing
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
    rivals: list[Result] = []
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
    near = {
        frozenset(r.candidate.damping)
        for r in weighing.results
        if r.candidate.restoring == law and r.log_evidence > best.log_evidence - BEHIND
    }
    sums = [s for s in sorted(near, key=lambda s: (len(s), sorted(s))) if like in s and s <= {*paper, like}]
    return [(*(t for t in paper if t in s), form) for s in sums]


def _weigh(
    weighing: Weighing,
    solver: Solver,
    sums: Sequence[tuple[str, ...]],
    approximate: bool,
    starts: Sequence[Mapping[str, float]] = (),
) -> list[Result]:
    """Fit and weigh rivals, starting from the likeliest sum's motion.

    `starts` are values of coefficients and parameters; by default, starts are taken from their priors.
    """
    data, reference, fit = weighing.data, weighing.reference, weighing.best.fit
    law, near = weighing.best.candidate.restoring, fit.parameters.named(fit.z)
    scales = reference.scales(data.rest_under(law, fit.values[weighing.solvers[law].law_places]))
    own = {*solver.names[solver.law_places], *START}
    fixed = {n: v for n, v in fit.parameters.known.items() if n in own}

    def weigh_one(c: Candidate) -> Result | None:
        parameters = parameters_of(c, solver, data, reference, {}, {**fixed, **scales})
        first = first_values(c, data, fixed)
        begin = {**near, **{n: first[n] for n in (TERMS.get(t).parameter for t in c.damping)}}
        each = [{**begin, **start} for start in starts or starts_of(c, parameters)]
        rival = search(solver, data, parameters, each, windows=False)
        return None if rival is None else weighing.result_of(c, solver, rival, approximate)

    assert solver.kernel  # compiled before several threads ask for it
    rivals = at_once(weigh_one, [Candidate(terms, law) for terms in sums])
    return [r for r in rivals if r is not None]
