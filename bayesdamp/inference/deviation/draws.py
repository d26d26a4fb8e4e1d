"""Draws over candidates, how probable candidates are, and numbers with intervals from draws."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import accumulate
from typing import Self

import numpy as np

from bayesdamp.inference.deviation.candidate import MotionCandidate
from bayesdamp.inference.deviation.weighing import CandidateResult, Weighing
from bayesdamp.odds import odds
from bayesdamp.physics.kernel.dense import at_times

POINTS = 4000
"""Times over a motion at which the power is taken."""
DRAWS = 4000
SHOWN = 0.99
"""Total probability of the candidates that are drawn from."""
DISTINCT = 200
"""Draws of a candidate where each draw needs a quadrature of its work."""


@dataclass(frozen=True)
class Quantity:
    """A number: median, 95 % interval, and the parts of its standard deviation from noise and from the law."""

    value: float
    low: float
    high: float
    sd_noise: float = float("nan")
    sd_law: float = float("nan")


def quantity(values: np.ndarray, noise: float = float("nan")) -> Quantity:
    """Return median and 95 % interval of draws, (n,); `noise` is the part of their sd that noise causes."""
    low, middle, high = (float(q) for q in np.quantile(values, (0.025, 0.5, 0.975)))
    law = float(np.sqrt(max(float(np.var(values)) - noise**2, 0.0))) if np.isfinite(noise) else float("nan")
    return Quantity(middle, low, high, noise, law)


@dataclass(frozen=True)
class CandidateDraws:
    """Draws of one candidate.

    Attributes
    ----------
    result : Result
        Of the candidate.
    coefficients : ndarray, shape (n, m)
        Of the solver's terms.
    further : ndarray, shape (n, e)
        The terms' own parameters.
    law : ndarray, shape (n, r)
        Parameters of the restoring law.
    g, h : ndarray, shape (n, k)
        Log deviation of the damping and deviation of the frequency at the knots.
    """

    result: CandidateResult
    coefficients: np.ndarray
    further: np.ndarray
    law: np.ndarray
    g: np.ndarray
    h: np.ndarray

    @classmethod
    def of(cls, result: CandidateResult, u: np.ndarray) -> Self:
        """Return draws of u = (scores, log g, h), (n, K), of a candidate."""
        d, solver = result.fit.z.size, result.solver
        values, m, law = result.fit.parameters.values(u[:, :d]), len(solver.terms), solver.law_places
        g, h = np.split(u[:, d:], 2, axis=1)
        return cls(result, values[:, :m], values[:, m : law.start], values[:, law], g, h)

    def by_further(self, function: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """Return a function of rows of the terms' own parameters, (d, e), for each draw, (n, m).

        It has shape (1, m) where all draws have the same parameters.
        """
        rows, place = np.unique(self.further, axis=0, return_inverse=True)
        values = function(rows)
        return values[place.ravel()] if len(rows) > 1 else values


def probabilities(weighing: Weighing, exact: bool, forms: bool = True) -> dict[MotionCandidate, float]:
    """Return the posterior probability of each candidate.

    The prior is `odds`, the same for all laws.

    Parameters
    ----------
    weighing : Weighing
        Of the candidates.
    exact : bool
        Under laws that hold exactly, else approximately.
    forms : bool
        Whether other forms of damping are among the candidates.
    """
    logs: dict[MotionCandidate, float] = {}
    others = len({r.candidate.damping for r in weighing.forms})
    for r in (*weighing.results, *(weighing.forms if forms else ())):
        if exact or r.weighed is not None:
            log = r.log_evidence if r.weighed is None or not exact else r.exact_weighed.log_evidence
            logs[r.candidate] = log + np.log(odds(r.candidate.damping, others if r in weighing.forms else 0))
    if not logs:  # none could be linearised: only exact laws are left
        return probabilities(weighing, True, forms)
    top = max(logs.values())
    total = sum(np.exp(v - top) for v in logs.values())
    return {c: float(np.exp(v - top) / total) for c, v in logs.items()}


def drawn_from(
    weighing: Weighing, chosen: Mapping[MotionCandidate, float], rng: np.random.Generator
) -> list[CandidateDraws]:
    """Draw from the candidates that count, from each in proportion to its probability."""
    order = sorted(chosen.items(), key=lambda item: -item[1])
    totals = list(accumulate(p for _, p in order))
    last = next((i for i, total in enumerate(totals) if total > SHOWN), len(order) - 1)
    counts = {c: round(DRAWS * p / totals[last]) for c, p in order[: last + 1]}
    return [draws_of(weighing.result(c), count, rng) for c, count in counts.items() if count]


def draws_of(result: CandidateResult, count: int, rng: np.random.Generator) -> CandidateDraws:
    """Draw from one candidate; only `DISTINCT` draws, repeated, where it has inferred parameters of its terms."""
    d, parameters, solver = result.fit.z.size, result.fit.parameters, result.solver
    few = min(count, DISTINCT) if set(solver.inferred) & set(parameters.free_names) else count
    if result.sampled is None or not result.sampled.trusted:
        u = result.posterior.draws(parameters.positive, few, rng)[0]
    else:
        own = result.sampled.draws
        u = own[rng.choice(len(own), few, replace=few > len(own))]
    u = u[np.arange(count) * few // count]
    if result.about is None:
        u = np.pad(u[:, :d], ((0, 0), (0, 2 * solver.knots.size)))
    return CandidateDraws.of(result, u)


def shares_of(weighing: Weighing, drawn: Sequence[CandidateDraws]) -> np.ndarray:
    """Return the share of the dissipated energy by term over the record's own motion, (draws, m)."""
    shares = []
    for d in drawn:
        solver, motion = weighing.solvers[d.result.candidate.restoring], d.result.motion
        times = np.linspace(motion.times[0], motion.times[-1], POINTS)
        x, v = (at_times(motion.times, motion.states, times, order) for order in (0, 1))
        power = partial(solver.works, x, v, v / POINTS, active=d.result.fit.active)
        lost = d.coefficients * d.by_further(power)
        shares.append(lost / np.maximum(lost.sum(axis=1, keepdims=True), 1e-300))
    return np.concatenate(shares)


def noise_sds(weighing: Weighing, result: CandidateResult) -> dict[str, float]:
    """Return the sd that noise alone would cause in each inferred parameter, by name, if the laws were exact."""
    parameters = result.fit.parameters
    sds = np.linalg.norm(result.exact_weighed.factors[0], axis=1) * np.abs(parameters.rates(result.fit.z))
    sds *= np.sqrt(weighing.variance / result.exact_variance)
    return dict(zip(parameters.free_names, sds.tolist(), strict=True))
