"""A checked study file as a frozen value, with its signals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from bayesdamp.config.sections import (
    CalibrationTable,
    EvidenceTable,
    FileTable,
    PosteriorTable,
    RecoveryTable,
    SimulateTable,
)
from bayesdamp.estimators import parse_options
from bayesdamp.inference.noise import NOISES
from bayesdamp.plugins import PluginModule
from bayesdamp.serial import split
from bayesdamp.types import InputError, System, candidate_name, candidate_parts


@dataclass(frozen=True)
class Published:
    """One published figure, as printed: an estimator's error on a signal (per cent) and its time."""

    estimator: str
    signal: str
    error_pct: str
    time: str = ""


class Simulation(SimulateTable):
    """A record to simulate. Estimators and inference never see it.

    damping: the true model's terms; truth: the parameters' true values by name (`zeta`, `stiffness`, ...).
    """

    damping: tuple[str, ...]
    truth: Mapping[str, float]


class Recording(FileTable):
    """A record to read.

    file: as written; path: where it is. The unit of an envelope is empty where the file states it.
    """

    file: str
    path: Path
    unit: str = "rad"

    def __hash__(self) -> int:
        """Return a hash of its fields."""
        return hash(tuple(self.__dict__.values()))


@dataclass(frozen=True)
class SignalSpec:
    """One record of the study, either simulated or read, and what is known of its system.

    inertia: kg m² (kg for a translation), only to show results in physical units.
    compare: its own damping models, None for the study's. estimate: those under which estimators run, None for all that
    it compares. laws: the restoring laws that it is compared under. alternatives: its system under the laws that are
    not `system`'s own. specimen: name of the specimen, empty where the study names none; records of one specimen are
    fitted jointly, several specimens are summarised.
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
        """Return all settings of the record, as JSON takes it, without paths of this machine."""
        settings = split(self)
        settings["source"].pop("path", None)
        return settings

    @property
    def is_envelope(self) -> bool:
        """Return whether only the amplitude of the motion was recorded."""
        return self.source.quantity == "envelope"

    @property
    def restoring(self) -> tuple[str, ...]:
        """Return the restoring laws that it is compared under; an envelope has none."""
        return () if self.is_envelope else self.laws or (self.system.restoring,)

    def under(self, restoring: str) -> System:
        """Return what is known of the system under one of these laws, by default the system's own."""
        return next((s for s in self.alternatives if s.restoring == restoring), self.system)

    @property
    def repeats(self) -> int:
        """Return how many records are simulated; 1 for a record that is read."""
        return self.source.repeats if isinstance(self.source, Simulation) else 1


@dataclass(frozen=True)
class Estimators:
    """The estimators of a study.

    use: estimators' names. stages: "initial", "refined". options: a method's own table by its name. repeats: on how
    many repeats of a signal a method runs at most, where not on all. variants: the estimator behind a name that the
    study gives to an estimator with other options.
    """

    use: tuple[str, ...]
    stages: tuple[str, ...]
    options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    repeats: Mapping[str, int] = field(default_factory=dict)
    variants: Mapping[str, str] = field(default_factory=dict)

    def method(self, name: str) -> str:
        """Return the estimator that runs under a name of `use`."""
        return self.variants.get(name, name)

    def on(self, repeat: int) -> tuple[str, ...]:
        """Return the methods that run on a repeat, numbered from 0."""
        return tuple(name for name in self.use if repeat < self.repeats.get(name, repeat + 1))


@dataclass(frozen=True)
class Models:
    """The damping sums that a study compares.

    compare: damping sums such as `viscous+coulomb`. prior: a prior by damping term, where one is given. restoring: the
    laws that each sum is combined with, none where a signal's own law is the only one. prune: how many nats behind the
    best, by Laplace's evidence, a candidate is not weighed further, None to weigh all.
    """

    compare: tuple[str, ...]
    prior: Mapping[str, Any] = field(default_factory=dict)
    restoring: tuple[str, ...] = ()
    prune: float | None = None


@dataclass(frozen=True)
class Study:
    """A checked study file. `source` is the file; the order of its tables has no effect.

    published: figures from elsewhere that the report shows next to the study's own. plugins: the user's modules with
    their sources. tables: the raw tables of the file.
    """

    source: Path
    name: str
    signals: tuple[SignalSpec, ...]
    estimators: Estimators
    models: Models
    posterior: PosteriorTable
    evidence: EvidenceTable
    calibration: CalibrationTable
    recovery: RecoveryTable
    seed: int = 0
    description: str = ""
    published: tuple[Published, ...] = ()
    plugins: tuple[PluginModule, ...] = ()
    version: int = 1
    tables: Mapping[str, Any] = field(default_factory=dict, repr=False, compare=False)

    def dampings(self, spec: SignalSpec) -> tuple[str, ...]:
        """Return the damping sums that one of the signals is compared under."""
        return self.models.compare if spec.compare is None else spec.compare

    def compare(self, spec: SignalSpec) -> tuple[str, ...]:
        """Return the names of a signal's candidates: its damping sums, each under each of its restoring laws.

        With one law a candidate's name is its damping sum; with several, see `candidate_name`. An envelope has no
        candidates: its damping sums are weighed in its answer alone.
        """
        if spec.is_envelope:
            return ()
        laws = spec.restoring if len(spec.restoring) > 1 else ("",)
        return tuple(candidate_name(m, law) for m in self.dampings(spec) for law in laws)

    def estimate(self, spec: SignalSpec) -> tuple[str, ...]:
        """Return the candidates under which estimators run."""
        wanted = self.dampings(spec) if spec.estimate is None else spec.estimate
        return tuple(name for name in self.compare(spec) if candidate_parts(name)[0] in wanted)

    @property
    def every_specimen(self) -> dict[str, tuple[SignalSpec, ...]]:
        """Return the signals of each specimen that the study names."""
        named = dict.fromkeys(s.specimen for s in self.signals if s.specimen)
        return {name: tuple(s for s in self.signals if s.specimen == name) for name in named}

    @property
    def specimens(self) -> dict[str, tuple[SignalSpec, ...]]:
        """Return the specimens that are fitted jointly: envelopes are not."""
        return {name: specs for name, specs in self.every_specimen.items() if not specs[0].is_envelope}

    @property
    def repeated(self) -> dict[str, tuple[SignalSpec, ...]]:
        """Return the signals of each specimen that has several records."""
        return {n: specs for n, specs in self.specimens.items() if sum(s.repeats for s in specs) > 1}

    @property
    def records(self) -> tuple[tuple[SignalSpec, int], ...]:
        """Return every record: its signal, and which repeat of it, from 0."""
        return tuple((spec, repeat) for spec in self.signals for repeat in range(spec.repeats))

    @property
    def noises(self) -> tuple[str, ...]:
        """Return the noise models of the study; of several, one is chosen for each record."""
        given = self.posterior.noise
        if isinstance(given, str):
            return tuple(NOISES.present()) if given == "auto" else (given,)
        return given

    def resolved(self) -> dict[str, Any]:
        """Return all settings with their defaults, as JSON takes it, without paths of this machine."""
        settings = split(replace(self, signals=(), tables={}))
        del settings["source"], settings["plugins"], settings["tables"]
        if self.plugins:
            settings["plugins"] = [{"file": Path(m.file).name, "sha256": m.digest} for m in self.plugins]
        return {**settings, "signals": [s.resolved() for s in self.signals]}

    def estimator_options(self, name: str) -> BaseModel:
        """Return the options of an estimator with their defaults; imports the estimator.

        Raises InputError for an option that it does not have or that has a wrong value.
        """
        try:
            return parse_options(self.estimators.method(name), self.estimators.options.get(name), name)
        except InputError as error:
            raise InputError(str(error), str(self.source)) from None
