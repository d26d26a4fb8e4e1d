"""Define the classes of a checked study file and of its tables."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from bayesdamp.estimators import names_for_all, parse_options
from bayesdamp.inference.noise import NOISES
from bayesdamp.physics.damping import TERMS, all_sums
from bayesdamp.physics.symbols import parameter_unit
from bayesdamp.plugins import PluginModule
from bayesdamp.priors import Prior
from bayesdamp.serial import split
from bayesdamp.types import SENSOR, UNITS, InputError, System, candidate_name, candidate_parts

NAME = r"^\w[\w-]*\Z"
"""Regular expression of valid names of studies, signals, specimens and variants of estimators: letters of any alphabet,
digits, _ and -."""


def as_name(text: str) -> str:
    """Return a text in Unicode's composed form (NFC), with _ in place of each character that a name cannot have."""
    return re.sub(r"[^\w-]", "_", unicodedata.normalize("NFC", text))


def _tuple_of(value: object) -> object:
    """Convert a list to a tuple; return any other value as it is."""
    return tuple(value) if isinstance(value, list) else value


Name = Annotated[str, Field(pattern=NAME, max_length=64)]
Names = Annotated[tuple[str, ...], BeforeValidator(_tuple_of)]
SomeNames = Annotated[Names, Field(min_length=1)]
Levels = Annotated[tuple[Annotated[float, Field(gt=0)], ...], BeforeValidator(_tuple_of), Field(min_length=1)]
Deviation = Literal["auto", "none", "law"]
"""Whether the damping and restoring laws hold exactly ("none") or only approximately, with deviations ("law"). "auto"
allows deviations only in the answer on a measured record, not in samplers and evidence methods."""
MOST_SAMPLES = 10_000_000
"""Greatest number of samples of a simulated record, and of draws of a Markov chain, that a study may ask for; a larger
number is an error (conventional)."""
MOST_RECORDS = 1_000_000
"""Greatest number of simulated records, and of repeats of a record, that a study may ask for; a larger number is an
error (conventional)."""
MOST_CHAINS = 1000
"""Greatest number of Markov chains that a study may ask for; a larger number is an error (conventional)."""
MOST_SAMPLED = 100_000
"""Greatest number of models whose posterior a study may ask to sample; a larger number is an error (conventional)."""
MOST_COLUMNS = 100_000
"""Largest number, counted from 1, by which a study may select a column of a file; a larger one is an error
(conventional)."""
ColumnName = Annotated[int, Field(ge=1, le=MOST_COLUMNS)] | Annotated[str, Field(min_length=1)]
RunName = Annotated[int, Field(ge=0, le=MOST_COLUMNS**2)] | Annotated[str, Field(min_length=1)]
UNIT = f"one of {', '.join(UNITS)} (for a velocity or an acceleration the unit of its displacement, such as m for m/s)"
Samples = Annotated[int, Field(ge=10, le=MOST_SAMPLES, description="a whole number from 10 to 10,000,000")]
Count = Annotated[int, Field(ge=1, le=MOST_RECORDS, description="a whole number from 1 to 1,000,000")]
Positive = Annotated[float, Field(gt=0, description="a positive number")]


class StudySection(BaseModel):
    """Base class of the tables of a study file. Their values cannot be changed, and unknown keys are errors."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, regex_engine="python-re")


class Header(StudySection):
    """The keys at the top of the file, outside all tables.

    version: version of the format, always 1. name: name of the study; by default that of the file. seed: seed of all
    random numbers. description: text that the report shows. published: path of a CSV file with published results, which
    the report compares with those of the study.
    """

    version: int = Field(ge=1, le=1, description="1, the version of this format")
    name: Name | None = Field(None, description="at most 64 letters, digits, - and _")
    seed: int = Field(0, ge=0, lt=2**63, description="a whole number, 0 or more")
    description: str = Field("", description="a line of text in quotes")
    published: str | None = Field(
        None, min_length=1, description="a CSV file's path in quotes: estimator, signal, error_pct, time"
    )


class FileTable(StudySection):
    """The keys of [[signal]] that state how the file of a record is read.

    None means that the file itself states it, or that it is chosen automatically. time, angle: columns of the times and
    of the recorded quantity (also if it is not an angle), by name or number from 1. unit: unit of the displacement;
    only for an envelope it can be left to the file. quantity: the recorded quantity. frequency: frequency of the
    oscillation in Hz, for an envelope. rate: sampling rate in Hz, for a file without times. clock: times of the
    samples: "as_logged" (the time stamps), "uniform" (equal steps, fitted to the stamps), or "auto" to choose. run,
    channel: the record to use of a file with several. time_unit: unit of the file's times. start, stop: limits of the
    free decay in s, in the times of the record; "auto" finds them. least_noise: standard deviation of the noise that is
    added to a record without noise, as a fraction of its amplitude.
    """

    time: ColumnName | None = Field(None, description="a column's name or its number from 1")
    angle: ColumnName | None = Field(
        None, description="the name of the recorded quantity's column or its number from 1"
    )
    unit: str = Field("rad", min_length=1, description=UNIT)
    quantity: Literal["angle", "velocity", "acceleration", "envelope"] = Field(
        "angle", description='"angle", "velocity", "acceleration" or "envelope"'
    )
    frequency: float | None = Field(
        None, gt=0, description="the frequency of an envelope's oscillation in Hz, a positive number"
    )
    rate: float | None = Field(None, gt=0, description="the sampling rate in Hz, a positive number")
    clock: Literal["auto", "as_logged", "uniform"] = Field(
        "auto",
        description='"auto", "as_logged" (the time stamps) or "uniform" (equal steps, fitted to the stamps)',
    )
    run: RunName | None = Field(
        None, description="the number of one of the file's runs, or its label in quotes"
    )
    channel: str | None = Field(None, min_length=1, description="the name of one of the file's channels")
    time_unit: Literal["s", "ms", "us", "ns", "ps", "min", "h", "d"] | None = Field(
        None, description='the unit of the times: "s", "ms", "us", "ns", "ps", "min", "h" or "d"'
    )
    start: float | Literal["auto"] = Field("auto", description='a time in s, or "auto" (after the release)')
    stop: float | Literal["auto"] = Field("auto", description='a time in s, or "auto" (before rest)')
    least_noise: float = Field(
        0.0,
        ge=0,
        lt=1,
        description="the sd of the noise to add to a record without noise, as a fraction of the amplitude",
    )


class SignalTable(FileTable):
    """A table [[signal]]: a record that is simulated or read.

    It has either `simulate` or `file` (a path, relative to the folder of the study). system: known or free parameters
    of the oscillator, which replace or complete those of the table [system]. compare, restoring: damping sums (such as
    viscous+coulomb) and restoring laws to compare instead of those of [models]. estimate: the damping sums whose
    coefficients the estimators estimate; all by default. specimen: name of the tested object, the same for all repeats
    on it; they have a common verdict.
    """

    name: Name = Field(description="a name in quotes: at most 64 letters, digits, - and _")
    simulate: dict[str, Any] | None = Field(None, description="a table such as { viscous = 0.05, ... }")
    system: dict[str, Any] = Field(
        {}, description='a table of what is known, such as { restoring = "pendulum", stiffness = 20.1 }'
    )
    compare: SomeNames | None = Field(
        None, description="a list of one or more models for this signal, in place of [models]'s"
    )
    restoring: SomeNames | None = Field(
        None, description="a list of one or more restoring laws for this signal, in place of [models]'s"
    )
    estimate: Names | None = Field(
        None, description="a list of the models under which estimators run on this signal; all by default"
    )
    specimen: Name | None = Field(
        None, description="a name in quotes, the same for repeats of one specimen: letters, digits, - and _"
    )
    file: str | None = Field(None, min_length=1, description="a file's path in quotes")


class SimulateTable(StudySection):
    """The table `simulate` of a signal, without the true values of the parameters.

    duration: length of the record in s. samples: number of samples before gaps are removed. repeats: number of records,
    which differ only in their random numbers (noise, outliers and gaps). noise: name of the noise model. outliers:
    number of spikes, or their fraction of the samples if it is below 1. gaps: number of time spans from which the
    samples (each time 1/50 of them) are removed. quantum: step to which values are rounded, in their unit (such as
    rad/s); 0 for none. quantity: the simulated quantity. unit: unit of the displacement.
    """

    duration: float = Field(
        ge=1e-12, le=1e9, description="the length of the record in s, a positive number up to 1e9"
    )
    samples: Samples
    repeats: Count = 1
    noise: str = Field("gaussian", description='a noise model such as "student_t"')
    outliers: float = Field(0.0, ge=0, description="a number of samples, or a fraction of them below 1")
    gaps: int = Field(0, ge=0, le=20, description="a whole number from 0 to 20")
    quantum: float = Field(0.0, ge=0, description="the recording step in the record's unit, 0 or more")
    quantity: Literal["angle", "velocity", "acceleration"] = Field(
        "angle", description='"angle", "velocity" or "acceleration"'
    )
    unit: Literal["rad", "m"] = Field("rad", description='"rad", or "m" for a translation')


class SweepTable(StudySection):
    """A table [[sweep]]: the signals of the study are repeated for each of its values.

    key: the key of [[signal]] that gets the values. A key `simulate.*` applies to simulated signals, `system.*` to all,
    any other key to signals that are read from files; other signals are not repeated.
    """

    key: str = Field(min_length=1, description='a key of a signal, such as "simulate.noise_sd"')
    values: Annotated[tuple[Any, ...], BeforeValidator(_tuple_of), Field(min_length=1)] = Field(
        description="a list of one or more values"
    )


class PluginsTable(StudySection):
    """[plugins]: Python files with the user's own plug-ins, such as damping terms; paths start at the study file."""

    modules: SomeNames | None = Field(
        None, description='a list of Python files, such as ["my_terms.py"], whose paths start at this file'
    )


class EstimatorsTable(StudySection):
    """[estimators]: which estimators of damping coefficients run.

    The tables with options of single estimators are not included. use: names of estimators and of their variants; "all"
    becomes the names of the eleven methods of the paper (`names_for_all`), without the user's own estimators. stages:
    "initial" (the estimate of the method itself), "refined" (a least-squares fit of the motion that starts from this
    estimate). repeats: for a name, on how many repeats of a signal (the first ones) this estimator runs; all by
    default.
    """

    use: Annotated[Names, BeforeValidator(lambda use: names_for_all() if use == "all" else use)] = Field(
        "all", validate_default=True, description='"all" or a list of names'
    )
    stages: Annotated[tuple[Literal["initial", "refined"], ...], BeforeValidator(_tuple_of)] = Field(
        ("initial", "refined"), description='a list of "initial" and "refined"'
    )
    repeats: dict[str, Annotated[int, Field(ge=1)]] = Field(
        {}, description="a table that gives, for a method, the greatest number of repeats on which it runs"
    )


class ModelsTable(StudySection):
    """[models]: the sums of damping terms and restoring laws to compare, and priors of damping terms.

    compare: damping sums (sums of damping terms, such as viscous+coulomb); "all" stands for the seven sums of viscous,
    Coulomb and quadratic damping. restoring: restoring laws that each sum is combined with; if it is empty, each signal
    has only the law of its system. prior: priors by damping term (for its coefficient) or by name of a term's further
    parameter; tables of the file or, in a checked `Study`, prior objects. prune: a model with a log evidence at least
    this many nats below the best is left out of everything after the answer (estimators, fits, samplers, evidence);
    None keeps all. The test uses the log evidences of the answer on the record, which are linear approximations.
    """

    compare: Annotated[SomeNames, BeforeValidator(lambda sums: all_sums() if sums == "all" else sums)] = (
        Field(("viscous", "coulomb", "quadratic"), description='"all" or a list of one or more models')
    )
    restoring: SomeNames = Field(
        (), description="a list of one or more restoring laws, instead of that in [system]"
    )
    prior: dict[str, Any] = Field({}, description="a table of priors by damping term")
    prune: float | None = Field(
        None,
        gt=0,
        description="a positive number: models at least this many nats of log evidence below the best are left out",
    )


class PosteriorTable(StudySection):
    """[posterior]: samplers, noise models, deviations and numbers of draws.

    samplers: names of the MCMC samplers. noise: name of a noise model, or several names; "auto" means all. If there are
    several, one is chosen on each record by its evidence (see `Study.noises`). best: number of the most probable models
    of a record that the samplers sample; None for all. deviation: see `Deviation`. sensor: relative linearity error of
    the sensor (standard deviation), which widens the intervals of damping ratios where deviations are allowed. chains:
    number of Markov chains. warmup: number of first draws of each chain that are discarded (emcee: half of it; with
    deviations, at most 50). draws: number of stored draws of each chain; `nuts` adds draws if these are too few, and
    `emcee` ignores it and runs until its chains have converged.
    """

    samplers: Names = Field(("nuts", "emcee"), description="a list of samplers' names")
    noise: str | SomeNames = Field(
        "gaussian", description='"auto", a noise model such as "student_t", or a list of noise models'
    )
    best: int | None = Field(
        None, ge=1, le=MOST_SAMPLED, description="a whole number: how many models of a signal are sampled"
    )
    deviation: Deviation = Field(
        "auto", description='"auto", "none" or "law": whether deviations from the laws are allowed'
    )
    sensor: float = Field(
        SENSOR,
        ge=0,
        lt=0.5,
        description="the sensor's relative linearity error (sd), a number from 0 to below 0.5",
    )
    chains: int = Field(4, ge=2, le=MOST_CHAINS, description="a whole number from 2 to 1000")
    warmup: Samples = 500
    draws: Samples = 1000


class EvidenceTable(StudySection):
    """[evidence]: methods of computing the evidence, and when nested sampling (the referee) checks them.

    methods: names, such as "laplace" and "importance". referee: "auto" (if the methods disagree, one is unreliable, or
    there is none besides Laplace's), "always" or "never". If `methods` contains nested sampling, it is computed
    whatever `referee` is.
    """

    methods: Names = Field(("importance", "bridge"), description="a list of methods' names")
    referee: Literal["auto", "always", "never"] = Field(
        "auto", description='"auto" (nested sampling if the methods disagree), "always" or "never"'
    )


class CalibrationTable(StudySection):
    """[calibration]: settings of `calibrate`, which checks credible intervals by simulation-based calibration.

    records: number of simulated records for each model. samplers: samplers whose intervals are checked. draws: number
    of thinned posterior draws among which a true value is ranked. bins: number of bins of the histograms of ranks.
    """

    records: Count = 500
    samplers: Names = Field(("nuts", "emcee"), description="a list of samplers' names")
    draws: int = Field(255, ge=15, le=MOST_SAMPLES, description="a whole number from 15 to 10,000,000")
    bins: int = Field(16, ge=2, le=MOST_SAMPLES, description="a whole number that divides draws + 1")

    @model_validator(mode="after")
    def _check_bins(self) -> CalibrationTable:
        if (self.draws + 1) % self.bins:
            raise ValueError(f"bins ({self.bins}) must divide draws + 1 ({self.draws + 1})")
        return self


class RecoveryTable(StudySection):
    """[recovery]: settings of `calibrate --models`, which checks the probabilities of models on simulated records.

    records: number of simulated records. noise, noise_sigma: the standard deviation of a record's noise is drawn from a
    log-normal distribution. Its median is one of the values in `noise`, as fractions of the reference amplitude;
    `noise_sigma` is the standard deviation of its logarithm. cycles: lengths of records, in cycles of the reference
    frequency. All combinations of the values in `noise` and `cycles` are used in turn. samples: number of samples of a
    record.
    """

    records: Count = 1000
    noise: Levels = Field((0.003, 0.01, 0.03, 0.1), description="a list of positive numbers")
    noise_sigma: Positive = 0.3
    cycles: Levels = Field((5.0, 10.0, 20.0, 50.0), description="a list of positive numbers")
    samples: Samples = 600


class Simulation(SimulateTable):
    """A record that is simulated. Estimators and inference get only the simulated samples.

    damping: true damping terms. truth: true values of the parameters by name (`zeta`, `stiffness`, ...), in units
    of rad (or m) and s.
    """

    damping: tuple[str, ...]
    truth: Mapping[str, float]


class Recording(FileTable):
    """A record that is read from a file.

    file: the path as written in the study. path: the absolute path. unit: unit of the displacement, or a unit of
    velocity or acceleration such as rpm; for an envelope that of its readings, or empty if the file states it.
    """

    file: str
    path: Path

    def __hash__(self) -> int:
        """Return a hash of all fields."""
        return hash(tuple(self.__dict__.values()))

    unit: str = "rad"


@dataclass(frozen=True)
class SignalSpec:
    """A signal of the study: a record that is simulated or read, and what is known about its oscillator.

    name: name of the signal. system: what is known about the oscillator, under the restoring law that a table `system`
    names or else the first of `laws`. source: how the record is simulated or read. inertia: in kg m² (kg for a
    translation), used only for results in physical units. compare: damping sums that are compared on this signal; None
    for those of the study. estimate: damping sums whose coefficients the estimators estimate; None for all. laws: the
    restoring laws that are compared; empty if it is only the law of `system`. alternatives: what is known about the
    oscillator under each other law in `laws`. specimen: name of the tested object, or "". All records of one specimen
    have a common verdict.
    """

    name: str
    system: System
    source: Simulation | Recording
    inertia: float | None = None
    compare: tuple[str, ...] | None = None
    estimate: tuple[str, ...] | None = None
    laws: tuple[str, ...] = ()
    alternatives: tuple[System, ...] = ()
    specimen: str = ""

    def resolved(self) -> dict[str, Any]:
        """Return all settings of the signal as values for JSON, without absolute paths."""
        settings = split(self)
        settings["source"].pop("path", None)
        return settings

    @property
    def is_envelope(self) -> bool:
        """Whether only the amplitude of the motion was recorded."""
        return self.source.quantity == "envelope"

    @property
    def restoring(self) -> tuple[str, ...]:
        """The restoring laws that are compared; an envelope has none."""
        return () if self.is_envelope else self.laws or (self.system.restoring,)

    def under(self, restoring: str) -> System:
        """Return what is known about the oscillator under a restoring law; `system` for a law that is not compared."""
        return next((s for s in self.alternatives if s.restoring == restoring), self.system)

    @property
    def repeats(self) -> int:
        """The number of simulated records, which differ in their random numbers; 1 for a record that is read."""
        return self.source.repeats if isinstance(self.source, Simulation) else 1

    def candidate(self, damping: str, restoring: str) -> str:
        """Return the name of a candidate (a sum of damping terms under a restoring law).

        It contains the law only if several laws are compared on this signal.
        """
        return candidate_name(damping, restoring if len(self.restoring) > 1 else "")

    def parts(self, candidate: str) -> tuple[str, str]:
        """Return the damping sum (such as viscous+coulomb) and the restoring law of a candidate, from its name.

        If the name contains no law, the law is the first one of the signal, which must not be an envelope.
        """
        damping, law = candidate_parts(candidate)
        return damping, law or self.restoring[0]

    def unit_of(self, parameter: str, restoring: str) -> str:
        """Return the unit of a parameter under a restoring law, for the base unit of the record (rad, m, V, ...)."""
        return parameter_unit(parameter, restoring, UNITS[self.source.unit].base, self.source.quantity)


class Estimators(EstimatorsTable):
    """The estimators of a study; "all" in `use` is already replaced by names.

    options: options of each estimator or variant, by its name. A variant is an estimator with other options, to which
    the study gives a name. variants: for each variant the name of its estimator.
    """

    options: Mapping[str, Mapping[str, Any]]
    variants: Mapping[str, str]

    def method(self, name: str) -> str:
        """Return the estimator for a name in `use`: for a variant its estimator, otherwise the name itself."""
        return self.variants.get(name, name)

    def on(self, repeat: int) -> tuple[str, ...]:
        """Return the names in `use` of the estimators that run on a repeat, numbered from 0."""
        return tuple(name for name in self.use if repeat < self.repeats.get(name, repeat + 1))


@dataclass(frozen=True)
class Study:
    """A checked study: all settings of a study file, with defaults for those that it does not state.

    source: path of the file; other paths are relative to its folder. published: published results that the report
    shows next to those of the study, each with the columns estimator, signal, error_pct and time as text. plugins: the
    user's modules with their source code. tables: the raw tables of the file.
    """

    source: Path
    name: str
    signals: tuple[SignalSpec, ...]
    estimators: Estimators
    models: ModelsTable
    posterior: PosteriorTable
    evidence: EvidenceTable
    calibration: CalibrationTable
    recovery: RecoveryTable
    seed: int = 0
    description: str = ""
    published: tuple[Mapping[str, str], ...] = ()
    plugins: tuple[PluginModule, ...] = ()
    version: int = 1
    tables: Mapping[str, Any] = field(default_factory=dict, repr=False, compare=False)

    def dampings(self, spec: SignalSpec) -> tuple[str, ...]:
        """Return the names of the damping sums that are compared on a signal.

        A damping sum is a sum of damping terms joined by +, such as "viscous+coulomb". The signal's own sums replace
        those of the study.
        """
        return self.models.compare if spec.compare is None else spec.compare

    def compare(self, spec: SignalSpec) -> tuple[str, ...]:
        """Return the names of a signal's candidates: each sum of damping terms under each restoring law.

        An envelope (recorded amplitudes) has no restoring law, and therefore no candidates.
        """
        return tuple(spec.candidate(m, law) for m in self.dampings(spec) for law in spec.restoring)

    def estimate(self, spec: SignalSpec) -> tuple[str, ...]:
        """Return the names of those candidates of a signal whose coefficients the estimators estimate."""
        wanted = self.dampings(spec) if spec.estimate is None else spec.estimate
        return tuple(name for name in self.compare(spec) if candidate_parts(name)[0] in wanted)

    @property
    def has_answers(self) -> bool:
        """Whether the study compares damping models, that is, names samplers or evidence methods."""
        return bool(self.posterior.samplers or self.evidence.methods)

    def deviation_of(self, spec: SignalSpec) -> str:
        """Return "law" if the answer on a signal allows deviations from the damping and restoring laws, else "none".

        With the setting "auto" (the default), it allows them only for a measured record.
        """
        auto = "law" if isinstance(spec.source, Recording) else "none"
        return auto if self.posterior.deviation == "auto" else self.posterior.deviation

    @property
    def likelihood(self) -> str:
        """Whether samplers and evidence methods allow deviations from the damping and restoring laws: "law" or "none".

        "law" if the study sets deviation = "law"; "none" if it sets "none" or "auto" (which concerns only the answer).
        """
        return "law" if self.posterior.deviation == "law" else "none"

    @property
    def priors(self) -> dict[str, Prior]:
        """The priors that [models] states for parameters of damping terms, by name of the parameter, such as "zeta"."""
        return {TERMS.get(t).parameter if t in TERMS.names() else t: p for t, p in self.models.prior.items()}

    @property
    def specimens(self) -> dict[str, tuple[SignalSpec, ...]]:
        """The signals of each specimen (tested object), by its name; signals that name no specimen are not included."""
        specimens: dict[str, tuple[SignalSpec, ...]] = {}
        for spec in self.signals:
            if spec.specimen:
                specimens[spec.specimen] = (*specimens.get(spec.specimen, ()), spec)
        return specimens

    @property
    def records(self) -> tuple[tuple[SignalSpec, int], ...]:
        """All records of the study, each as a pair: the signal, and the number of the repeat (from 0)."""
        return tuple((spec, repeat) for spec in self.signals for repeat in range(spec.repeats))

    @property
    def noises(self) -> tuple[str, ...]:
        """The names of the noise models of the study; "auto" means all that are available, with the user's plug-ins.

        If there are several, samplers and evidence methods use the one with the largest evidence on the record. The
        answer prefers Gaussian noise, unless another one except correlated noise has a clearly larger evidence (5 nats
        or more).
        """
        given = self.posterior.noise
        if isinstance(given, str):
            return tuple(NOISES.present()) if given == "auto" else (given,)
        return given

    def resolved(self) -> dict[str, Any]:
        """Return all settings of the study, including defaults, as values for JSON.

        Files are named as the study names them, and plug-in modules by their file name and a hash of their content.
        """
        settings = split(replace(self, signals=(), tables={}))
        del settings["source"], settings["plugins"], settings["tables"]
        if self.plugins:
            settings["plugins"] = [{"file": Path(m.file).name, "sha256": m.digest} for m in self.plugins]
        return {**settings, "signals": [s.resolved() for s in self.signals]}

    def estimator_options(self, name: str) -> BaseModel:
        """Return the options of an estimator with their defaults. Raises InputError if an option is wrong.

        name: an estimator, or a variant that the study defines.
        """
        try:
            return parse_options(self.estimators.method(name), self.estimators.options.get(name), name)
        except InputError as error:
            raise InputError(str(error), str(self.source)) from None
