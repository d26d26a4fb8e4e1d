"""Draws over candidates, how probable candidates are, and numbers with intervals from draws."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from bayesdamp.inference.deviation.candidate import Candidate
from bayesdamp.inference.deviation.weighing import Result, Weighing
from bayesdamp.odds import odds

POINTS = 4000
"""Times over a motion at which the power is taken."""


def shares_of(weighing: Weighing, drawn: Sequence[Drawn]) -> np.ndarray:
    """Share of the dissipated energy by term, (draws, m)."""
    found = []
    for d in drawn:
        each = d.coefficients * _works(weighing, d)
        found.append(each / np.maximum(each.sum(axis=1, keepdims=True), 1e-300))
    return np.concatenate(found)


def _works(weighing: Weighing, d: Drawn) -> np.ndarray:
    """Mean power per unit of each coefficient over the record's own motion, (n, m) or (1, m)."""
    from bayesdamp.physics.kernel.dense import at_times

    solver, motion = weighing.solvers[d.result.candidate.restoring], d.result.motion
    at = np.linspace(motion.times[0], motion.times[-1], POINTS)
    x, v = (at_times(motion.times, motion.states, at, order) for order in (0, 1))
    return d.by_further(lambda rows: solver.works(x, v, v / POINTS, rows, d.result.fit.active))


@dataclass(frozen=True)
class Quantity:
    """A number: median, 95 % interval, and the parts of its standard deviation from noise and from the law."""

    value: float
    low: float
    high: float
    sd_noise: float = float("nan")
    sd_law: float = float("nan")


def quantity(values: np.ndarray, noise: float = float("nan")) -> Quantity:
    """Median and 95 % interval of draws, (n,). noise: the part of their standard deviation that noise has."""
    low, middle, high = (float(q) for q in np.quantile(values, (0.025, 0.5, 0.975)))
    law = float(np.sqrt(max(float(np.var(values)) - noise**2, 0.0))) if np.isfinite(noise) else float("nan")
    return Quantity(middle, low, high, noise, law)


DRAWS = 4000
SHOWN = 0.99
"""Probability of the candidates together from which the others are not drawn from."""
DISTINCT = 200
"""Draws of a candidate whose work must be found by quadrature for each of them."""


@dataclass(frozen=True)
class Drawn:
    """Draws of one candidate: coefficients (n, m), the terms' further parameters (n, e), the law's (n, r), log g and h
    at the knots (n, k)."""

    result: Result
    coefficients: np.ndarray
    further: np.ndarray
    law: np.ndarray
    g: np.ndarray
    h: np.ndarray

    @classmethod
    def of(cls, result: Result, u: np.ndarray) -> Self:
        """Draws of u = (scores, log g, h), (n, K), of a candidate."""
        d, solver = result.fit.z.size, result.solver
        values, m, law = result.fit.parameters.values(u[:, :d]), len(solver.terms), solver.law_places
        g, h = np.split(u[:, d:], 2, axis=1)
        return cls(result, values[:, :m], values[:, m : law.start], values[:, law], g, h)

    def by_further(self, function: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """Return a function of rows of further parameters, (d, e), for each draw, (n, m); (1, m) where all have the
        same."""
        rows, place = np.unique(self.further, axis=0, return_inverse=True)
        found = function(rows)
        return found[place.ravel()] if len(rows) > 1 else found


def probabilities(weighing: Weighing, exact: bool, forms: bool = True) -> dict[Candidate, float]:
    """Posterior probability of each candidate, with the prior `odds`; laws alike. forms: whether other forms of damping
    are among the candidates."""
    logs: dict[Candidate, float] = {}
    others = len({r.candidate.damping for r in weighing.forms})
    for r in (*weighing.results, *(weighing.forms if forms else ())):
        weighed = r.exact_weighed if exact else r.weighed
        if weighed is None:
            continue
        prior = odds(r.candidate.damping, others if r in weighing.forms else 0)
        sampled = r.sampled is not None and exact == (r.weighed is None)
        logs[r.candidate] = (r.log_evidence if sampled else weighed.log_evidence) + np.log(prior)
    if not logs:  # none could be linearised: exact laws are all that is known
        return probabilities(weighing, True, forms)
    top = max(logs.values())
    total = sum(np.exp(v - top) for v in logs.values())
    return {c: float(np.exp(v - top) / total) for c, v in logs.items()}


def drawn_from(
    weighing: Weighing, chosen: Mapping[Candidate, float], approximate: bool, rng: np.random.Generator
) -> list[Drawn]:
    """Draws of the candidates that count, each as often as it is probable."""
    order = sorted(chosen.items(), key=lambda item: -item[1])
    kept, total = [], 0.0
    for c, p in order:
        kept.append((c, p))
        total += p
        if total > SHOWN:
            break
    found = []
    for c, p in kept:
        result = next(r for r in (*weighing.results, *weighing.forms) if r.candidate == c)
        count = round(DRAWS * p / total)
        if count:
            found.append(draws_of(weighing, result, count, approximate, rng))
    return found


def draws_of(
    weighing: Weighing, result: Result, count: int, approximate: bool, rng: np.random.Generator
) -> Drawn:
    """Draws of one candidate; where it has further parameters that are inferred, `DISTINCT` ones, repeated."""
    weighed = result.weighed if approximate else result.exact_weighed
    assert weighed is not None
    d, parameters = result.fit.z.size, result.fit.parameters
    solver = result.solver
    few = min(count, DISTINCT) if set(solver.inferred) & set(parameters.free_names) else count
    if result.sampled is None or not result.sampled.trusted:
        u = weighed.draws(parameters.positive, few, rng)[0]
    else:
        own = result.sampled.draws
        u = own[rng.choice(len(own), few, replace=few > len(own))]
    u = u[np.arange(count) * few // count]
    return Drawn.of(result, u if approximate else np.pad(u[:, :d], ((0, 0), (0, 2 * solver.knots.size))))
