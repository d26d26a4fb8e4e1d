"""What is stored of several records together: joint fits of a specimen's repeats, and populations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from bayesdamp.store.contents.content import Content
from bayesdamp.types import OK, Reference

CLEAR = 3.0
"""Nats of a log Bayes factor from which something is said to be so: odds of twenty."""
APART = 0.05
"""Lower end of the spread's 95 % interval above which records are said to differ (half the scale of its prior)."""
Summary = Mapping[str, float]
"""mean, sd, median, q2.5 and q97.5 of a parameter."""


@dataclass(frozen=True)
class Weighing:
    """A candidate's log evidence with the summaries of its damping parameters, and their units.

    log_evidence: nats, relative to the best evidence that each record has by itself; None where it was not weighed, as
    the outcome says.
    """

    outcome: str = OK
    log_evidence: float | None = None
    summary: Mapping[str, Summary] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class JointCandidate(Weighing):
    """A candidate on all records of a specimen, with its posterior probability."""

    probability: float = 0.0


@dataclass(frozen=True)
class PopulationFound:
    """Mean and spread of a coefficient over what the labels of `shrunk` name, each one's own value given all, and its
    effective draws then; scale: of the half-normal prior of the population's location."""

    scale: float
    mean: Summary
    spread: Summary
    shrunk: Mapping[str, Summary]
    effective: Mapping[str, float]
    outcome: str = OK


@dataclass(frozen=True)
class JointContent(Content):
    """The joint fit of a specimen's records (`joint/SPECIMEN`): the weighing that the verdict on it rests on.

    The cell's arrays are draws of equal weight: of each candidate's coefficients (`CANDIDATE/NAME`), the log density of
    their priors (`CANDIDATE/NAME/log_prior`) and the spread (`CANDIDATE/spread`).

    records: labels; members: signal and repeat of each; reference: of the priors; deviation: "law" where laws hold
    approximately in every record's answer, else "none". best: the likeliest candidate; others: probabilities of forms
    of damping that the study does not compare. spread: how much the damping differs from record to record (standard
    deviation of its logarithm), over all models. no_spread: log Bayes factor of one damping for all records against an
    inferred spread, under the best candidate; NaN where that has no summary. alone: each record by itself under it.
    """

    records: tuple[str, ...]
    members: tuple[tuple[str, int], ...]
    reference: Reference
    best: str
    candidates: Mapping[str, JointCandidate]
    spread: Summary
    no_spread: float
    alone: Mapping[str, Weighing]
    others: Mapping[str, float] = field(default_factory=dict)
    deviation: str = "none"

    @property
    def differ(self) -> bool:
        """Whether the records have dampings of different size."""
        return self.spread["q2.5"] > APART or self.no_spread < -CLEAR

    @property
    def agree(self) -> bool:
        """Whether the evidence is clearly for one size in all records."""
        return not self.differ and self.no_spread >= CLEAR


@dataclass(frozen=True)
class PopulationContent(Content):
    """The population over specimens (`population/specimens`), under the candidate that is best for all.

    log_evidence: of each candidate over all; behind: nats by which another is ahead, by specimen; specimens: each one's
    own coefficients; units, populations: by coefficient; deviation: as in `JointContent`.
    """

    best: str
    log_evidence: Mapping[str, float]
    behind: Mapping[str, float]
    specimens: Mapping[str, JointCandidate]
    units: Mapping[str, str]
    populations: Mapping[str, PopulationFound]
    deviation: str = "none"
