"""The stored results of a run's tasks: one class for each kind of task."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Self

import numpy as np

from bayesdamp.serial import join, split
from bayesdamp.store.cells import CellResult
from bayesdamp.types import (
    OK,
    Estimate,
    Evidence,
    FeaturesSeen,
    FitCheck,
    Forecast,
    Friction,
    InputError,
    NestedRatio,
    Posterior,
    Ratio,
    Reference,
    Seed,
)


class OtherVersionError(InputError, ValueError):
    """The stored result has another form than this version stores."""


@dataclass(frozen=True)
class Content:
    """The values of one kind of cell, without its arrays. Subclasses are frozen dataclasses that JSON can hold."""

    @classmethod
    def of(cls, cell: CellResult) -> Self:
        """Read the content of a cell. Raises OtherVersionError where it has another form."""
        return cls.of_meta(cell.meta)

    @classmethod
    def maybe(cls, cell: CellResult | None) -> Self | None:
        """Read the content of a cell; None where the cell is missing, or only says why it has no result."""
        return cls.of_meta(cell.meta) if cell is not None and cell.meta else None

    @classmethod
    def of_meta(cls, meta: Mapping[str, Any]) -> Self:
        """Read what `meta` returned, from a file. Raises OtherVersionError."""
        try:
            own = {f.name for f in fields(cls)}
            return join(cls, {name: value for name, value in meta.items() if name in own})
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            what = "was stored by another version of bayesdamp; compute it again with this one"
            raise OtherVersionError(f"{what} ({error})") from None

    def meta(self) -> dict[str, Any]:
        """Return the content as a cell stores it."""
        return split(self)


@dataclass(frozen=True)
class RecordContent(Content):
    """A record (`signal/NAME/REPEAT`).

    provenance: what was done to it. step: recording step, 0 where none shows. bound: the Cramér–Rao bound of a
    simulated record, sd by parameter. The other fields need an oscillation: features; anomalies, in words; reference of
    the priors; known: values of the system, with friction's ε (rad/s) filled in and a note on it; noisy: whether the
    record has noise, without which there is no likelihood.
    """

    name: str = ""
    unit: str = "rad"
    quantity: str = "angle"
    step: float = 0.0
    provenance: Mapping[str, Any] = field(default_factory=dict)
    bound: Mapping[str, float] = field(default_factory=dict)
    features: FeaturesSeen | None = None
    anomalies: tuple[str, ...] = ()
    reference: Reference | None = None
    known: Mapping[str, float] = field(default_factory=dict)
    epsilon_note: str = ""
    noisy: bool = False

    @property
    def scales(self) -> Reference:
        """Return the reference of the priors. Raises ValueError where the record shows no oscillation."""
        if self.reference is None:
            raise ValueError(f"{self.name} shows no oscillation")
        return self.reference


@dataclass(frozen=True)
class EstimateContent(Content):
    """One estimator on one candidate (`estimate/NAME/REPEAT/CANDIDATE/ESTIMATOR`), in the order of its stages.

    Their curves are the cell's arrays, STAGE/NAME.
    """

    stages: tuple[Estimate, ...] = ()


NAN = float("nan")


@dataclass(frozen=True)
class Climb:
    """A search for the mode from one seed.

    same: other seeds that start at the same point. start, end: log posterior there. evaluations: of the likelihood.
    volume: log volume at the end. distance: of the start from the mode, in sds. mode: number of the maximum where it
    ended, 0 for the highest, None for none.
    """

    seed: Seed
    same: tuple[Seed, ...]
    start: float
    end: float
    evaluations: int
    volume: float
    converged: bool
    distance: float = NAN
    mode: int | None = None


@dataclass(frozen=True)
class RefusedSeed:
    """A seed without values to start from, with the outcome of its method."""

    seed: Seed
    outcome: str


@dataclass(frozen=True)
class MaximumContent:
    """A maximum of the posterior: its height (nats), its share of the posterior, its parameters."""

    log_posterior: float
    share: float
    values: Mapping[str, float]


@dataclass(frozen=True)
class ModeContent(FitCheck, Content):
    """A posterior mode (`mode/NAME/REPEAT/CANDIDATE`).

    values, sd: of the inferred parameters; known: the others; priors in words. climbs, modes: the searches and the
    maxima that they found; touching_zero: coefficients within a standard deviation of zero. refused: seeds without
    values. stored: an `inference.mode.StoredMode`, as `bayesdamp.serial` splits it; its arrays are `stored/...`.
    The checks of its fit are those of `FitCheck`.
    """

    values: Mapping[str, float] = field(default_factory=dict)
    sd: Mapping[str, float] = field(default_factory=dict)
    known: Mapping[str, float] = field(default_factory=dict)
    priors: Mapping[str, str] = field(default_factory=dict)
    log_posterior: float = NAN
    error_budget: Mapping[str, float] = field(default_factory=dict)
    climbs: tuple[Climb, ...] = ()
    modes: tuple[MaximumContent, ...] = ()
    touching_zero: tuple[str, ...] = ()
    refused: tuple[RefusedSeed, ...] = ()
    stored: Mapping[str, Any] = field(default_factory=dict)


NO_DRAWS = np.empty((0, 0, 0)), np.empty((0, 0))
"""Draws and log likelihoods of a posterior that has none."""


@dataclass(frozen=True)
class PosteriorContent(Content):
    """One sampler's draws (`posterior/NAME/REPEAT/CANDIDATE/SAMPLER`).

    posterior: without its arrays; the cell has `draws`, (chain, draw, parameter). summary, units: of the parameters and
    of derived quantities, at the reference amplitude (unit of displacement). without: derived quantities that have no
    summary, with the number of draws that have no such motion. file: the whole posterior, in the run's folder. ratios:
    where laws may hold approximately, the damping ratio at the verdict's amplitudes.
    """

    posterior: Posterior = field(default_factory=lambda: Posterior("", (), *NO_DRAWS))
    units: Mapping[str, str] = field(default_factory=dict)
    summary: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    reference_amplitude: float = NAN
    without: Mapping[str, int] = field(default_factory=dict)
    file: str = ""
    ratios: tuple[Ratio, ...] = ()


@dataclass(frozen=True)
class AverageContent(Content):
    """The damping against amplitude averaged over the models (`averaged/NAME/0`).

    probabilities: of the models, by the evidence `method`. covered: total probability of the models in the average.
    weighed: models without a posterior, which are averaged by the weighted draws of their evidence.
    """

    probabilities: Mapping[str, float]
    method: str
    covered: float = 1.0
    weighed: tuple[str, ...] = ()


@dataclass(frozen=True)
class EvidenceContent(Content):
    """One method's evidence (`evidence/NAME/REPEAT/CANDIDATE/METHOD`), whose arrays are the cell's.

    None where the referee was not called, because the other methods agree.
    """

    evidence: Evidence | None = None


@dataclass(frozen=True)
class WidthsContent(Content):
    """Evidence under other prior widths (`sensitivity/.../widths`); varied: parameters whose priors were scaled."""

    varied: tuple[str, ...] = ()


@dataclass(frozen=True)
class HalfContent(Forecast, Content):
    """The evidence of a record's first half alone, and its forecast of the second half (`sensitivity/.../half`).

    start: of the second half, in s.
    """

    start: float
    log_predictive_stderr: float
    evidence: Evidence


@dataclass(frozen=True)
class UnderNoise:
    """Log evidence by Laplace's approximation (nats) under a noise model; −∞ where it has no fit."""

    log_evidence: float
    outcome: str = OK


@dataclass(frozen=True)
class NoisesContent(Content):
    """Evidence under each noise model of the study (`sensitivity/.../noises`), and which model was chosen."""

    chosen: str
    evidence: Mapping[str, UnderNoise]


@dataclass(frozen=True)
class RatiosContent(Content):
    """Nested ratios (`sensitivity/.../savage_dickey`), by the smaller model's name."""

    against: Mapping[str, NestedRatio]


@dataclass(frozen=True)
class WeighedCandidate:
    """A damping sum under a restoring law, as the answer weighed it.

    log_evidence: in nats under approximate laws, None where laws hold exactly; log_evidence_exact: under exact laws.
    rms: of the plain fit, in the record's unit. place: for a form of damping that the study does not compare, the sum
    that it becomes in a limit, if there is one. parameters: the inferred ones of the damping.
    """

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
        """Return the log evidence under exact laws; −∞ where it was not weighed."""
        return float("-inf") if self.log_evidence_exact is None else self.log_evidence_exact


@dataclass(frozen=True)
class SampledPosterior:
    """A candidate with its motions sampled.

    parameters: summaries by name. deviation: of the damping law, (2.5 %, median, 97.5 %). unexplained: share of the
    amplitude. log_evidence: in nats.
    """

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
    """The end of the search for a candidate with deviations.

    found: an `inference.deviation.single.FitState`, as `bayesdamp.serial` splits it; its arrays are
    `found/DAMPING@RESTORING/...`.
    """

    damping: str
    restoring: str
    found: Mapping[str, Any]


@dataclass(frozen=True)
class EnvelopeContent:
    """The answer on an envelope, without its verdict.

    unit: of the readings. samples: how many were used. likelihoods: numbers of the likelihood of the rates by damping
    sum, whose arrays are `likelihood/DAMPING/...`. assumed: a sentence for each assumption.
    """

    unit: str
    samples: int = 0
    likelihoods: Mapping[str, Mapping[str, float | str | None]] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()


@dataclass(frozen=True)
class AnswerContent(Content):
    """The answer on a record (`answer/NAME/REPEAT`, `sampled/NAME/REPEAT`).

    verdict: as `Verdict.to_dict` returns it. rivals: other forms of damping that were weighed. fits: parameters of the
    fit of all terms, by restoring law. posteriors: of the candidates that were sampled; laws: of those that were
    weighed with deviations. noise: the noise model of the answer; noises: all that were weighed. terms: all damping
    terms that were weighed. epsilon: the width (rad/s or m/s) within which friction changes its sign, where it was not
    known; frictions: the widths that were tried, with the coefficients of all terms. envelope: of an envelope, which
    has only this and the verdict.
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


CLEAR = 3.0
"""Log Bayes factor in nats from which a statement is made: odds of twenty."""
APART = 0.05
"""Lower end of the spread's 95 % interval above which the records differ (half the scale of its prior)."""
Summary = Mapping[str, float]
"""mean, sd, median, q2.5 and q97.5 of a parameter."""


@dataclass(frozen=True)
class WeighingContent:
    """A candidate's log evidence with the summaries of its damping parameters, and their units.

    log_evidence: nats, relative to the best evidence that each record has by itself; None where it was not weighed, for
    the reason in the outcome.
    """

    outcome: str = OK
    log_evidence: float | None = None
    summary: Mapping[str, Summary] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class JointCandidate(WeighingContent):
    """A candidate on all records of a specimen, with its posterior probability."""

    probability: float = 0.0


@dataclass(frozen=True)
class PopulationFound:
    """Mean and spread of a coefficient over a population of specimens.

    scale: of the half-normal prior of the population's location. shrunk: each specimen's own value given all;
    effective: its effective draws then.
    """

    scale: float
    mean: Summary
    spread: Summary
    shrunk: Mapping[str, Summary]
    effective: Mapping[str, float]
    outcome: str = OK


@dataclass(frozen=True)
class JointContent(Content):
    """The joint fit of a specimen's records (`joint/SPECIMEN`), on which its verdict is based.

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
    alone: Mapping[str, WeighingContent]
    others: Mapping[str, float] = field(default_factory=dict)
    deviation: str = "none"

    @property
    def differ(self) -> bool:
        """Return whether the records have dampings of different size."""
        return self.spread["q2.5"] > APART or self.no_spread < -CLEAR

    @property
    def agree(self) -> bool:
        """Return whether the evidence is clearly for one size in all records."""
        return not self.differ and self.no_spread >= CLEAR


@dataclass(frozen=True)
class PopulationContent(Content):
    """The population over specimens (`population/specimens`), under the candidate that is best for all.

    log_evidence: of each candidate over all specimens. behind: nats by which another candidate is ahead, by specimen.
    specimens: each one's own coefficients. units, populations: by coefficient. deviation: as in `JointContent`.
    """

    best: str
    log_evidence: Mapping[str, float]
    behind: Mapping[str, float]
    specimens: Mapping[str, JointCandidate]
    units: Mapping[str, str]
    populations: Mapping[str, PopulationFound]
    deviation: str = "none"


@dataclass(frozen=True)
class ChunkContent(Content):
    """A chunk of records that were drawn and fitted, or refused: the outcome of each, and whether it counts.

    first: number of the first record.
    """

    outcomes: tuple[str, ...] = ()
    accepted: tuple[bool, ...] = ()
    first: int = 0


@dataclass(frozen=True)
class RanksContent(ChunkContent):
    """A chunk of one model's ranks (`ranks/MODEL/FIRST`).

    names: of what is ranked. sampler_outcomes: of each sampler, by record. seconds: by sampler and under "record".
    """

    model: str = ""
    names: tuple[str, ...] = ()
    sampler_outcomes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class RecoveryContent(ChunkContent):
    """A chunk of model recovery (`recovery/FIRST`, `single/FIRST`): models, outcomes of their evidence by record."""

    models: tuple[str, ...] = ()
    evidence_outcomes: tuple[tuple[str, ...], ...] = ()
