"""What is stored of several records together: joint fits of a specimen's repeats, and populations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from bayesdamp.store.contents.content import Content
from bayesdamp.store.contents.records import Scales
from bayesdamp.types import OK

NAN = float("nan")
CLEAR = 3.0
"""Nats of a log Bayes factor from which something is said to be so: odds of twenty."""
UNLIKELY = 0.01
"""Probability, if records had one damping, below which they are said to differ (conventional)."""
Summary = Mapping[str, float]
"""mean, sd, median, q2.5 and q97.5 of a parameter."""


@dataclass(frozen=True)
class SharedEvidence:
    """Log evidence (nats) of one way of sharing parameters, or of one damping, with its standard error; None where it
    has none, as the outcome says."""

    log_evidence: float | None = None
    stderr: float = NAN
    outcome: str = OK


@dataclass(frozen=True)
class WeighedContent(Content):
    """A joint posterior's evidence (`weighed/SPECIMEN/CANDIDATE`); the cell's arrays are its draws.

    pareto_k, effective: of the importance weights; effective: how many equal draws they are worth.
    """

    log_evidence: float
    stderr: float
    pareto_k: float
    effective: float
    evaluations: int
    outcome: str = OK


@dataclass(frozen=True)
class Weighing:
    """A candidate's evidence with the summaries of what it infers, and their units; its numbers are None where it was
    not weighed, as the outcome says."""

    outcome: str = OK
    log_evidence: float | None = None
    stderr: float | None = None
    pareto_k: float | None = None
    effective: float | None = None
    evaluations: int | None = None
    summary: Mapping[str, Summary] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class JointCandidate(Weighing):
    """A candidate on all records of a specimen: its probability among them, Laplace's log evidence (`look`), and
    whether its mode converged."""

    probability: float = 0.0
    look: float = NAN
    converged: bool = False


@dataclass(frozen=True)
class BayesFactor:
    """Log Bayes factor (nats) with its standard error, and whether it may be trusted. chance: the probability, if the
    first holds, of a likelihood that is so much higher under the second; NaN where it was not asked for."""

    log_bayes_factor: float
    stderr: float = NAN
    outcome: str = OK
    chance: float = NAN

    @property
    def clear(self) -> bool:
        """Whether it speaks for the first of the two, and the fit not against it."""
        return self.log_bayes_factor >= CLEAR and not self.chance < UNLIKELY


@dataclass(frozen=True)
class PopulationFound:
    """Mean and spread of a coefficient over what the labels of `shrunk` name, each one's own value given all, and its
    effective draws then; scale: of the coefficient's own prior."""

    scale: float
    mean: Summary
    spread: Summary
    shrunk: Mapping[str, Summary]
    effective: Mapping[str, float]
    outcome: str = OK


@dataclass(frozen=True)
class JointContent(Content):
    """A joint fit of a specimen's records (`joint/SPECIMEN`).

    records: their labels; members: signal and repeat of each; reference: of their priors. deviation: "law" where laws
    hold approximately, each record with deviations of its own, "none" where they hold exactly. sharing: what the
    records share; best: the likeliest candidate. Of the best: sharings, the evidence of each way of sharing; agreement,
    of one damping (and law) against one for each record; said, the same in words, and what stands as the fit's outcome;
    alone: each record by itself; repeats: the population of each coefficient over the records.
    """

    records: tuple[str, ...]
    members: tuple[tuple[str, int], ...]
    reference: Scales
    sharing: str
    best: str
    candidates: Mapping[str, JointCandidate]
    sharings: Mapping[str, SharedEvidence]
    agreement: Mapping[str, BayesFactor]
    said: Mapping[str, str]
    alone: Mapping[str, Weighing]
    repeats: Mapping[str, PopulationFound]
    deviation: str = "none"


@dataclass(frozen=True)
class PopulationContent(Content):
    """The population over specimens (`population/specimens`), under the candidate that is best for all.

    log_evidence: of each candidate over all; behind: nats by which another is ahead, by specimen; torn: specimens whose
    records disagree; specimens: each one's own coefficients; units, populations: by coefficient; deviation: as in
    `JointContent`.
    """

    best: str
    log_evidence: Mapping[str, float]
    behind: Mapping[str, float]
    specimens: Mapping[str, Weighing]
    torn: tuple[str, ...]
    units: Mapping[str, str]
    populations: Mapping[str, PopulationFound]
    deviation: str = "none"
