"""What is stored of the answer on a record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from bayesdamp.store.contents.content import Content
from bayesdamp.types import OK, Friction


@dataclass(frozen=True)
class WeighedCandidate:
    """A damping sum under a restoring law: log evidence (nats) under approximate laws, None where they were taken to
    hold exactly, and under exact ones; rms of the plain fit, in the record's unit. place: of another form of damping
    than those that are compared, the sum that it comes to in a limit, if there is one. parameters: those of the damping
    that are inferred."""

    damping: str
    restoring: str
    log_evidence: float | None = None
    log_evidence_exact: float | None = None
    rms: float | None = None
    outcome: str = OK
    place: str = ""
    parameters: tuple[str, ...] = ()

    @property
    def exact(self) -> float:
        """Log evidence under exact laws; −∞ where it was not weighed."""
        return float("-inf") if self.log_evidence_exact is None else self.log_evidence_exact


@dataclass(frozen=True)
class SampledPosterior:
    """A candidate with its motions sampled. parameters: summaries by name; deviation: of the damping law, (2.5 %,
    median, 97.5 %); unexplained: share of the amplitude; evidence in nats."""

    damping: str
    restoring: str
    parameters: Mapping[str, Mapping[str, float]]
    deviation: tuple[float, float, float]
    unexplained: float
    log_evidence: float
    stderr: float
    acceptance: float
    temperatures: int


@dataclass(frozen=True)
class CandidatePriors:
    """Priors of a candidate in words, by parameter."""

    damping: str
    restoring: str
    priors: Mapping[str, str]


@dataclass(frozen=True)
class WeighedNoise:
    """A noise model on the residuals of the fit of all terms: log evidence in nats, and its parameters."""

    name: str
    log_evidence: float
    values: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class FoundLaw:
    """Where the search for a candidate with deviations ended, as `bayesdamp.serial` splits an
    `inference.deviation.single.Found`; its arrays are `found/DAMPING@RESTORING/...`."""

    damping: str
    restoring: str
    found: Mapping[str, Any]


@dataclass(frozen=True)
class EnvelopeContent:
    """What an answer on an envelope has beside its verdict: the unit of its readings, how many were used; numbers of
    the likelihood of the rates by damping sum, whose arrays are `likelihood/DAMPING/...`; what was assumed, a sentence
    each."""

    unit: str
    samples: int = 0
    likelihoods: Mapping[str, Mapping[str, float | str | None]] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()


@dataclass(frozen=True)
class AnswerContent(Content):
    """The answer on a record (`answer/NAME/REPEAT`, `sampled/NAME/REPEAT`).

    verdict: as `Verdict.to_dict` gives it. rivals: other forms of damping that were weighed. fits: parameters of the
    fit of all terms, by restoring law. posteriors: of the candidates that were sampled; laws: of those that were
    weighed with deviations. noise: the noise model that the answer is under; noises: all that were weighed. terms:
    all damping terms that were weighed. epsilon: the width (rad/s or m/s) within which friction changes its sign, where
    it was not known; frictions: the widths that were tried, with the coefficients of all terms.
    envelope: of an envelope, of which nothing else is stored but the verdict.
    """

    verdict: Mapping[str, Any]
    candidates: tuple[WeighedCandidate, ...] = ()
    fits: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    priors: tuple[CandidatePriors, ...] = ()
    posteriors: tuple[SampledPosterior, ...] = ()
    laws: tuple[FoundLaw, ...] = ()
    rivals: tuple[WeighedCandidate, ...] = ()
    noise: str = ""
    noises: tuple[WeighedNoise, ...] = ()
    terms: tuple[str, ...] = ()
    epsilon: float | None = None
    frictions: tuple[Friction, ...] = ()
    envelope: EnvelopeContent | None = None
