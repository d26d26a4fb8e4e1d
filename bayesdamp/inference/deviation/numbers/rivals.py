"""Rivals with another form of damping than those that are compared.

Each takes the place of a term that it may pass for: a power of the velocity of a whole sum, dry friction that rises
near rest of plain dry friction, damping that grows with the displacement of one that grows with the velocity. Where a
rival is likelier than every sum, the sum is the nearest law and not the answer.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from bayesdamp.inference.deviation.candidate import (
    Candidate,
    first_values,
    parameters_of,
    searched,
    starts_of,
)
from bayesdamp.inference.deviation.numbers.exponent import power_solver, power_starts
from bayesdamp.inference.deviation.weighing import START, Result, Weighing, result_of
from bayesdamp.machine.threads import at_once
from bayesdamp.physics.damping import PAPER_TERMS, TERMS
from bayesdamp.physics.kernel import Solver
from bayesdamp.types import Reference

PLACES = {"displacement": "quadratic", "stribeck": "coulomb"}
"""The term in whose place a form stands: both grow with the amplitude, or are dry friction."""
ALONE = "power"
"""The form that stands in the place of a whole sum."""
BEHIND = 7.0
"""Nats behind the best sum up to which a sum is one in whose place a rival with parameters of its own is weighed: with
the prior of a rival less than 1 in 1,000 is beyond."""


def place_of(damping: Sequence[str]) -> tuple[str, ...]:
    """The sum in whose place a rival stands and which it comes to in a limit; empty where there is none."""
    if not any(TERMS.get(t).inferred and t in PLACES for t in damping):
        return ()
    like = {PLACES.get(t, t) for t in damping}
    return tuple(t for t in PAPER_TERMS if t in like)


def with_rivals(weighing: Weighing, approximate: bool) -> Weighing:
    """The weighing with its rivals, under the likeliest restoring law."""
    if not weighing.results:
        return weighing
    best = max(weighing.results, key=lambda r: r.log_evidence)
    plain = weighing.solvers[best.candidate.restoring]
    terms = plain.terms
    found: list[Result] = []
    for form, like in PLACES.items():
        if form not in terms and like in terms:
            solver = replace(plain, terms=(*(t for t in terms if t in PAPER_TERMS), form))
            found += _weighed(weighing, best, solver, _sums(weighing, best, form, like), approximate)
    if ALONE not in terms:
        found += _power(weighing, best, approximate)
    return replace(weighing, forms=tuple(found))


def _power(weighing: Weighing, best: Result, approximate: bool) -> list[Result]:
    """The power of the velocity, from where it loses as the likeliest sum does."""
    data, reference = weighing.data, weighing.reference
    middle = Reference(float(np.sqrt(data.amplitude * data.final_amplitude)), data.frequency)
    starts = [
        {**one, "c_power": one["c_power"] * ratio ** (1 - one["exponent"])}
        for one in power_starts(weighing, best, middle)
        for ratio in [middle.peak_velocity / reference.peak_velocity]
    ]
    if not starts:
        return []
    solver = power_solver(weighing, best.candidate.restoring, starts[0]["exponent"])
    return _weighed(weighing, best, solver, [(ALONE,)], approximate, starts)


def _sums(weighing: Weighing, best: Result, form: str, like: str) -> list[tuple[str, ...]]:
    """Sums in which the form stands: all with one that has no parameters, else in the place of its term in the sums
    that count."""
    law, terms = best.candidate.restoring, weighing.solvers[best.candidate.restoring].terms
    paper = [t for t in terms if t in PAPER_TERMS and t != like]
    if not TERMS.get(form).inferred:
        return [(*c, form) for n in range(len(paper) + 1) for c in combinations(paper, n)]
    near = {
        frozenset(r.candidate.damping)
        for r in weighing.results
        if r.candidate.restoring == law and r.log_evidence > best.log_evidence - BEHIND
    }
    sums = [s for s in sorted(near, key=lambda s: (len(s), sorted(s))) if like in s and s <= {*paper, like}]
    return [(*(t for t in paper if t in s), form) for s in sums]


def _weighed(
    weighing: Weighing,
    best: Result,
    solver: Solver,
    sums: Sequence[tuple[str, ...]],
    approximate: bool,
    starts: Sequence[Mapping[str, float]] = (),
) -> list[Result]:
    """Rivals, begun at the likeliest sum's motion. starts: of coefficients and parameters; else from their priors."""
    data, reference = weighing.data, weighing.reference
    law, near = best.candidate.restoring, best.fit.parameters.named(best.fit.z)
    values = best.fit.parameters.values(best.fit.z)[weighing.solvers[law].law_places]
    given = reference.scales(data.rest_under(law, values))
    own = {*solver.names[solver.law_places], *START}
    fixed = {n: v for n, v in best.fit.parameters.known.items() if n in own}
    noise, stated = (weighing.variance, weighing.inflation), weighing.noise_known

    def weighed(c: Candidate) -> Result | None:
        parameters = parameters_of(c, solver, data, reference, {}, {**fixed, **given})
        first = first_values(c, data, fixed)
        begun = {**near, **{n: first[n] for n in (TERMS.get(t).parameter for t in c.damping)}}
        each: list[Mapping[str, float]] = [{**begun, **one} for one in starts or starts_of(c, parameters)]
        found = searched(c, solver, data, parameters, each, windows=False)
        return None if found is None else result_of(c, solver, found, data, noise, approximate, stated)

    assert solver.kernel
    rivals = at_once(weighed, [Candidate(terms, law) for terms in sums])
    return [r for r in rivals if r is not None]
