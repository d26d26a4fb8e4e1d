"""Which damping sum the evidence names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bayesdamp.inference.envelope.candidates import Candidate
from bayesdamp.inference.envelope.sums import Sum
from bayesdamp.physics.amplitude.laws import POWERS


@dataclass(frozen=True, eq=False)
class Ranking:
    """Damping sums on a record and what weighs them.

    log_evidence, log_exact: of each sum with its odds before, (sums,), the law's deviation integrated out, and given
    that it holds exactly times that prior.
    """

    sums: tuple[Sum, ...]
    candidates: tuple[Candidate, ...]
    log_evidence: np.ndarray
    log_exact: np.ndarray

    @property
    def probability(self) -> np.ndarray:
        """Of each sum."""
        found = np.exp(self.log_evidence - self.log_evidence.max())
        return found / found.sum()

    @property
    def best(self) -> Sum:
        """The most probable sum."""
        return self.sums[int(np.argmax(self.log_evidence))]

    @property
    def best_exact(self) -> Sum:
        """The most probable sum of those that hold exactly."""
        return self.sums[int(np.argmax(self.log_exact))]

    @property
    def fitted(self) -> Candidate:
        """Its most probable candidate."""
        own = (c for c in self.candidates if c.name == self.best.name)
        return max(own, key=lambda c: c.total + c.log_share)

    @property
    def exact(self) -> float:
        """Probability that the law holds exactly."""
        return float(np.exp(np.logaddexp.reduce(self.log_exact) - np.logaddexp.reduce(self.log_evidence)))

    @property
    def terms(self) -> tuple[str, ...]:
        """Of all sums, the paper's first."""
        there = dict.fromkeys(term for one in self.sums for term in one.terms)
        return tuple(sorted(there, key=lambda term: (*POWERS, *there).index(term)))

    @property
    def by_sum(self) -> dict[str, float]:
        """Probability of each sum by name."""
        return {one.name: float(p) for one, p in zip(self.sums, self.probability, strict=True)}

    @property
    def by_term(self) -> dict[str, float]:
        """Probability of each term, over all sums that have it."""
        each = list(zip(self.sums, self.probability, strict=True))
        return {term: float(sum(p for one, p in each if term in one.terms)) for term in self.terms}


def ranked(sums: Sequence[Sum], candidates: Sequence[Candidate]) -> Ranking:
    """Of sums by all of their candidates."""
    names = [one.name for one in sums]
    return Ranking(
        tuple(sums),
        tuple(candidates),
        _by_sum(names, candidates, [c.total + c.log_share for c in candidates]),
        _by_sum(names, candidates, [c.total_exact + c.log_share for c in candidates]),
    )


def _by_sum(names: Sequence[str], candidates: Sequence[Candidate], logs: Sequence[float]) -> np.ndarray:
    """ln of the sum over each sum's candidates."""
    return np.array(
        [
            np.logaddexp.reduce([one for one, c in zip(logs, candidates, strict=True) if c.name == name])
            for name in names
        ]
    )
