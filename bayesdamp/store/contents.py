"""The content of stored results: one class for each kind of task."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Self

import numpy as np

from bayesdamp.serial import join, split
from bayesdamp.store.results import TaskResult
from bayesdamp.types import (
    OK,
    Estimate,
    Evidence,
    FeatureValues,
    FitCheck,
    InputError,
    Posterior,
    Ratio,
    Reference,
)


class OtherVersionError(InputError, ValueError):
    """Error: a stored result has other fields than expected, because another version of the package wrote it."""


@dataclass(frozen=True)
class Content:
    """The values in a stored result, without its arrays. Subclasses are frozen dataclasses that JSON can represent."""

    @classmethod
    def of(cls, result: TaskResult) -> Self:
        """Read the content of a result. Raises OtherVersionError if it was stored by another version."""
        return cls.of_meta(result.meta)

    @classmethod
    def maybe(cls, result: TaskResult | None) -> Self | None:
        """Read the content of a result; None if there is no result, or it has an outcome but no values.

        Raises OtherVersionError if it was stored by another version.
        """
        return cls.of_meta(result.meta) if result is not None and result.meta else None

    @classmethod
    def of_meta(cls, meta: Mapping[str, Any]) -> Self:
        """Read the content from its JSON form, as `meta` returns it. Raises OtherVersionError."""
        try:
            known = {f.name for f in fields(cls)}
            return join(cls, {name: value for name, value in meta.items() if name in known})
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            what = "a stored result was written by another version of bayesdamp; compute it again with this version"
            raise OtherVersionError(f"{what} ({error})") from None

    def meta(self) -> dict[str, Any]:
        """Return the content in its JSON form, a dictionary by field; nan and infinities stay floats."""
        return split(self)


@dataclass(frozen=True)
class RecordContent(Content):
    """A record (`signal/NAME/REPEAT`).

    The samples are arrays of the result: `t` in s, and `y` in the base unit `unit` (per s or s² for a velocity or an
    acceleration). step: step to which values are rounded, in the unit of `y`; 0 if they are not rounded. provenance:
    source of the record, and how it was cleaned. bound: Cramér–Rao bound of a simulated record, standard deviation by
    parameter. The other fields exist only if the record oscillates. features: period, amplitudes and other features.
    anomalies: remarks for the user. reference: amplitude (rad or m) and frequency (rad/s) to which default priors are
    scaled. known: values of known parameters, and ε, the velocity (rad/s or m/s) within which Coulomb friction changes
    its sign. epsilon_note: a sentence if ε was assumed. noisy: whether the record has noise, without which there is no
    likelihood.
    """

    name: str = ""
    unit: str = "rad"
    quantity: str = "angle"
    step: float = 0.0
    provenance: Mapping[str, Any] = field(default_factory=dict)
    bound: Mapping[str, float] = field(default_factory=dict)
    features: FeatureValues | None = None
    anomalies: tuple[str, ...] = ()
    reference: Reference | None = None
    known: Mapping[str, float] = field(default_factory=dict)
    epsilon_note: str = ""
    noisy: bool = False

    @property
    def scales(self) -> Reference:
        """The reference of the priors. Raises ValueError if the record does not oscillate."""
        if self.reference is None:
            raise ValueError(f"{self.name} shows no oscillation")
        return self.reference


@dataclass(frozen=True)
class EstimateContent(Content):
    """The estimates of one estimator for one candidate (`estimate/NAME/REPEAT/CANDIDATE/ESTIMATOR`), by stage.

    stages: the initial estimate and the trajectory fit that starts there, as far as the study asks for them.
    """

    stages: tuple[Estimate, ...] = ()


NAN = float("nan")


@dataclass(frozen=True)
class ModeContent(FitCheck, Content):
    """A posterior mode (`mode/NAME/REPEAT/CANDIDATE`) with the checks of its fit (`FitCheck`).

    values, sd: inferred parameters and their standard deviations, by name and in their units. known: the values of the
    other parameters. priors: descriptions in words. log_posterior: log density at the mode (nats, not normalised).
    shares: fractions of the posterior probability of the mode and of the other maxima that were found, the mode first.
    stored: an `inference.mode.StoredMode`, as `bayesdamp.serial` splits it, with arrays `stored/...`.
    """

    values: Mapping[str, float] = field(default_factory=dict)
    sd: Mapping[str, float] = field(default_factory=dict)
    known: Mapping[str, float] = field(default_factory=dict)
    priors: Mapping[str, str] = field(default_factory=dict)
    log_posterior: float = NAN
    shares: tuple[float, ...] = ()
    stored: Mapping[str, Any] = field(default_factory=dict)


NO_DRAWS = np.empty((0, 0, 0)), np.empty((0, 0))
"""Empty arrays of draws and log likelihoods."""


@dataclass(frozen=True)
class PosteriorContent(Content):
    """The draws of one sampler (`posterior/NAME/REPEAT/CANDIDATE/SAMPLER`).

    posterior: names, diagnostics and settings of the draws without their arrays; the result has `draws`, (chain, draw,
    parameter). summary, units: of parameters and derived quantities. without: derived quantities without a summary,
    with the number of draws for which they are not defined. file: path of the netCDF file with all draws, in the run's
    folder. ratios: damping ratios at the verdict's amplitudes.
    """

    posterior: Posterior = field(default_factory=lambda: Posterior("", (), *NO_DRAWS))
    units: Mapping[str, str] = field(default_factory=dict)
    summary: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    without: Mapping[str, int] = field(default_factory=dict)
    file: str = ""
    ratios: tuple[Ratio, ...] = ()


@dataclass(frozen=True)
class EvidenceContent(Content):
    """The evidence by one method (`evidence/NAME/REPEAT/CANDIDATE/METHOD`).

    evidence: None if the referee (nested sampling) was not needed, because the other methods agree.
    """

    evidence: Evidence | None = None


@dataclass(frozen=True)
class ComparedCandidate:
    """The result of an answer for one candidate: a damping sum under a restoring law.

    log_evidence: in nats, with deviations from the laws; None under exact laws only. log_evidence_exact: under exact
    laws; None if it was not computed. outcome: "ok", or why there is no result. rms: root mean square residual of the
    fit under exact laws, in the record's unit. place: for a form of damping that the study does not compare, the
    compared sum that is its limiting case, if any. parameters: names of the inferred damping parameters.
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
        """The log evidence under exact laws; −∞ if it was not computed."""
        return float("-inf") if self.log_evidence_exact is None else self.log_evidence_exact


@dataclass(frozen=True)
class SampledPosterior:
    """The posterior of a candidate in a sampled answer.

    parameters: by name, mean, sd, quantiles and other summaries, in the parameter's unit. deviation: size of the
    relative deviation from the damping law, (2.5 %, median, 97.5 %); 0.1 is 10 %. unexplained: root mean square
    residual under exact laws beyond the noise, as a fraction of the first amplitude. log_evidence, stderr: in nats.
    acceptance, temperatures: acceptance rate of the last moves of sequential Monte Carlo, and number of increases of
    the inverse temperature.
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
    """Descriptions (in words) of the priors of a candidate's inferred parameters, by parameter."""

    damping: str
    restoring: str
    priors: Mapping[str, str]


@dataclass(frozen=True)
class NoiseEvidence:
    """A noise model fitted to the residuals of the sum of all terms, with its log evidence in nats."""

    name: str
    log_evidence: float


@dataclass(frozen=True)
class StoredFit:
    """The fit of a candidate with deviations from its laws.

    found: the scalar fields of the fit, an `inference.deviation.single.FitState`. Its array fields are the arrays
    `found/DAMPING@RESTORING/...` of the result.
    """

    damping: str
    restoring: str
    found: Mapping[str, Any]


@dataclass(frozen=True)
class EnvelopeContent:
    """The answer on an envelope, without its verdict.

    unit: of the readings. samples: number of readings that were used. likelihoods: for each damping sum, the scalar
    fields of its likelihood as a function of the decay rates; the array fields are the arrays `likelihood/DAMPING/...`
    of the result. assumed: a sentence for each assumption.
    """

    unit: str
    samples: int = 0
    likelihoods: Mapping[str, Mapping[str, float | str | None]] = field(default_factory=dict)
    assumed: tuple[str, ...] = ()


@dataclass(frozen=True)
class AnswerContent(Content):
    """The answer on a record (`answer/NAME/REPEAT`, `sampled/NAME/REPEAT`).

    verdict: as `Verdict.to_dict` returns it. candidates: results of the compared damping sums. rivals: results of other
    forms of damping, which the study does not compare. priors: descriptions of the priors. posteriors: of the sampled
    candidates. laws: fits of the candidates with deviations from their laws. noise: the noise model of the answer.
    noises: all fitted noise models. epsilon: velocity (rad/s or m/s) within which Coulomb friction changes its sign,
    if it was not known. envelope: further values for an envelope, whose answer has only these and the verdict.
    """

    verdict: Mapping[str, Any]
    candidates: tuple[ComparedCandidate, ...] = ()
    priors: tuple[CandidatePriors, ...] = ()
    posteriors: tuple[SampledPosterior, ...] = ()
    laws: tuple[StoredFit, ...] = ()
    rivals: tuple[ComparedCandidate, ...] = ()
    noise: str = ""
    noises: tuple[NoiseEvidence, ...] = ()
    epsilon: float | None = None
    envelope: EnvelopeContent | None = None


@dataclass(frozen=True)
class ChunkContent(Content):
    """The simulated records of one calibration task.

    outcomes: of each record, "ok" or why it is not used. accepted: whether each record is usable. first: number of the
    first record, from 0; the others follow.
    """

    outcomes: tuple[str, ...] = ()
    accepted: tuple[bool, ...] = ()
    first: int = 0


@dataclass(frozen=True)
class RanksContent(ChunkContent):
    """Ranks of true parameters for the records of one task (`ranks/MODEL/FIRST`).

    The ranks are arrays of the result (`ranks.compute_chunk`). names: names of the ranked quantities. sampler_outcomes:
    by sampler, its outcome for each record; empty if the record has no mode. seconds: by sampler, and under "record"
    for simulation and fit.
    """

    model: str = ""
    names: tuple[str, ...] = ()
    sampler_outcomes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class RecoveryContent(ChunkContent):
    """Model recovery for the records of a task (`recovery/FIRST`): which model has the most evidence.

    The log evidence itself is in the arrays of the result. models: names of the models. evidence_outcomes: for each
    record, the outcome of the evidence of each model ("ok", or why it is unreliable or missing).
    """

    models: tuple[str, ...] = ()
    evidence_outcomes: tuple[tuple[str, ...], ...] = ()
