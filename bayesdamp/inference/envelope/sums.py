"""Damping sums on a record, those with parameters beside coefficients too, and their evidence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from bayesdamp.inference.envelope.candidates import Blocks, Candidate, fit_rates, weigh
from bayesdamp.inference.envelope.further import Explored, explore
from bayesdamp.inference.envelope.noise import Noise
from bayesdamp.odds import odds
from bayesdamp.physics.amplitude.laws import POWERS, SUMS, ClosedForm, Law, Shape, Tabled

if TYPE_CHECKING:
    from bayesdamp.physics.amplitude.loss import Scale
    from bayesdamp.physics.damping import DampingTerm

HOPELESS = 25.0
"""Nats behind the best with the first noise at which a sum is not weighed with the others: those are worth few."""
STAND_FOR = 24
"""Points that the posterior of a sum's further parameters is shown by."""
FIRST_ROUNDS = 6
"""Rounds of points among which the fit of a sum with further parameters is sought."""
SMALL = 0.01
"""Of its largest on the record a loss at the reference amplitude at least, where its rate is told there."""
STEEP = 3.0
"""The largest power of the amplitude that a loss goes with among the terms that ship."""
BEYOND = 1.0
"""Of ln A beyond the readings that a law is known for."""


@dataclass(frozen=True)
class Sum:
    """A damping sum on one record.

    start, low: ln(A/A_ref) at the start and of the lowest reading. each: the registered terms, () where the sum is of
    viscous, Coulomb and quadratic damping alone; scale: what the parameters of these are relative to.
    """

    terms: tuple[str, ...]
    start: float = 0.0
    low: float = 0.0
    each: tuple[DampingTerm, ...] = ()
    scale: Scale | None = None

    @property
    def name(self) -> str:
        """Terms joined by +."""
        return "+".join(self.terms)

    @property
    def log_prior(self) -> float:
        """ln of the odds before."""
        return float(np.log(odds(self.terms)))

    @property
    def counts(self) -> tuple[int, ...]:
        """Further parameters of each term."""
        return tuple(len(term.inferred) for term in self.each)

    @property
    def count(self) -> int:
        """Further parameters."""
        return sum(self.counts)

    def own(self, scores: Sequence[float], term: int) -> tuple[float, ...]:
        """A term's scores among those of all."""
        first = sum(self.counts[:term])
        return tuple(float(z) for z in scores[first : first + self.counts[term]])

    def law(self, scores: Sequence[float] = ()) -> Law:
        """At scores of the further parameters."""
        if not self.each:
            return ClosedForm(self.terms)
        shapes = tuple(self._shape(i, self.own(scores, i)) for i in range(len(self.each)))
        return Tabled(self.terms, shapes, self.low - BEYOND, self.start + BEYOND)

    def unit_rate(self, term: int, scores: tuple[float, ...], scale: Scale | None = None) -> float:
        """ln of the rate in 1/s of a coefficient of 1 at the reference amplitude. scale: in place of the sum's."""
        from bayesdamp.physics.amplitude.loss import log_loss

        loss = log_loss(self.each[term], scores, scale or self.scale)  # type: ignore[arg-type]
        along = loss(np.append(np.linspace(self.low, self.start, 33), 0.0) - self.start)
        return float(max(along[-1], along.max() + np.log(SMALL)))

    def _shape(self, term: int, scores: tuple[float, ...]) -> Shape:
        from bayesdamp.physics.amplitude.loss import log_loss

        loss, unit = log_loss(self.each[term], scores, self.scale), self.unit_rate(term, scores)  # type: ignore[arg-type]
        return lambda x: np.exp(loss(x - self.start) - unit)


def sums_on(
    asked: Sequence[tuple[str, ...]], scale: Scale | None, start: float, low: float
) -> tuple[Sum, ...]:
    """Sums of terms by name on a record; see `Sum`."""
    found = []
    for terms in asked:
        if all(term in POWERS for term in terms):
            found.append(Sum(terms, start, low))
        else:
            from bayesdamp.physics.damping import TERMS

            found.append(Sum(terms, start, low, tuple(map(TERMS.get, terms)), scale))
    return tuple(found)


def loosest_fit(b: Blocks, sums: Sequence[Sum], inverse: np.ndarray) -> tuple[Law, float, np.ndarray]:
    """A law that leaves as little of a record as any of these sums does, ln A at its start, and its rates.

    It has viscous, Coulomb and quadratic damping with it, so that what it may leave is none of theirs; where the loss
    is steeper than all of these, the third power of the amplitude too.
    """
    steep = Tabled(("steep",), (_power(STEEP),), float(b.x.min()) - BEYOND, b.ends[0] + BEYOND)
    found = [_squares(b, law, inverse) for law in (ClosedForm(SUMS[-1]), steep)]
    found += [_fitted(b, one, inverse) for one in sums if one.each]
    law, x0, rates, _ = min(found, key=lambda one: one[3])
    if law.terms == SUMS[-1]:
        return law, x0, rates
    assert isinstance(law, Tabled)
    more = tuple(term for term in SUMS[-1] if term not in law.terms)
    shapes = tuple(_power(POWERS[term]) for term in more)
    return (
        replace(law, terms=law.terms + more, each=law.each + shapes),
        x0,
        np.append(rates, np.zeros(len(more))),
    )


def _fitted(b: Blocks, one: Sum, inverse: np.ndarray) -> tuple[Law, float, np.ndarray, float]:
    """As `_squares`, a sum's further parameters sought too."""

    @cache
    def at(scores: tuple[float, ...]) -> tuple[Law, float, np.ndarray, float]:
        return _squares(b, one.law(scores), inverse)

    if not one.count:
        return at(())
    explored = explore(lambda z: -0.5 * at(z)[3], one.count, FIRST_ROUNDS)
    return min((at(tuple(z)) for z in explored.points.tolist()), key=lambda fit: fit[3])


def _squares(b: Blocks, law: Law, inverse: np.ndarray) -> tuple[Law, float, np.ndarray, float]:
    """A law, its start and rates at the least squares, and these squares."""
    found = fit_rates(b, law, inverse)
    return law, float(found.values[-1]), found.values[:-1], found.squares


def _power(power: float) -> Shape:
    return lambda x: np.exp((power - 1.0) * x)


def weighed(
    b: Blocks, sums: Sequence[Sum], noises: Sequence[tuple[Noise, np.ndarray]], inverse: np.ndarray
) -> list[Candidate]:
    """Every sum, with the first noise; with all of them those that it does not rule out. A sum with further parameters
    is as many candidates as points stand for these."""
    first = [
        explore(_evidence(b, one, noises, inverse), one.count)
        if one.count
        else weigh(b, one.law(), noises[:1], inverse)
        for one in sums
    ]
    totals = [one.log_integral if isinstance(one, Explored) else one.total for one in first]
    most = max(totals)
    found = []
    for one, known, total in zip(sums, first, totals, strict=True):
        tried = noises if total > most - HOPELESS else noises[:1]
        if isinstance(known, Candidate):
            found.append(weigh(b, known.law, tried, inverse, known, log_share=one.log_prior))
            continue
        points, times = np.unique(known.resampled(STAND_FOR), axis=0, return_counts=True)
        for scores, count in zip(map(tuple, points.tolist()), times, strict=True):
            law = one.law(scores)
            alone = weigh(b, law, noises[:1], inverse)
            # Each stands for its share of the integral; its evidence says how much more it is with the other noises.
            share = total - alone.total + np.log(count / STAND_FOR) + one.log_prior
            found.append(weigh(b, law, tried, inverse, alone, scores, float(share)))
    return found


def _evidence(
    b: Blocks, one: Sum, noises: Sequence[tuple[Noise, np.ndarray]], inverse: np.ndarray
) -> Callable[[tuple[float, ...]], float]:
    """ln of a sum's evidence with the first noise, of its further parameters' scores."""
    rates: np.ndarray | None = None

    def at(scores: tuple[float, ...]) -> float:
        nonlocal rates
        found = weigh(b, one.law(scores), noises[:1], inverse, begin=rates)
        rates = np.maximum(found.rates, 1e-3 * b.mean_rate)  # from where the next fit is near
        return found.total

    return at
