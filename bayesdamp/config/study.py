"""What a study file comes to: a frozen value, its signals in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from bayesdamp.config.published import Published
from bayesdamp.config.sections import (
    CalibrationTable,
    EvidenceTable,
    FileTable,
    PosteriorTable,
    RecoveryTable,
    SimulateTable,
)
from bayesdamp.plugins import PluginModule
from bayesdamp.serial import split
from bayesdamp.types import InputError, System, candidate_name, candidate_parts


class Simulation(SimulateTable):
    """A record to make. Estimators and inference never see it.

    damping: the true model's terms; truth: the parameters' true values by name (`zeta`, `stiffness`, ...).
    """

    damping: tuple[str, ...]
    truth: Mapping[str, float]


class Recording(FileTable):
    """A record to read. file: as written; path: where it is. The unit of an envelope is empty where the file is to say
    it."""

    file: str
    path: Path
    unit: str = "rad"

    def __hash__(self) -> int:
        """Return a hash of what it says."""
        return hash(tuple(self.__dict__.values()))


@dataclass(frozen=True)
class SignalSpec:
    """One record of the study, either simulated or read, and what is known of its system.

    inertia: kg m² (kg for a translation), only for showing results in physical units.
    compare: its own damping models, None for the study's; estimate: those under which estimators run, None for
    all that it compares. laws: the restoring laws that it is compared under; alternatives: what is known of its
    system under those that are not `system`'s own. specimen: what it is a record of; records of one specimen are fitted
    jointly, several specimens summarised. Empty where the study does not say.
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
        """All that the study says of the record, as JSON takes it; no path of this machine."""
        found = split(self)
        found["source"].pop("path", None)
        return found

    @property
    def is_envelope(self) -> bool:
        """Whether only the amplitude of the motion was recorded."""
        return self.source.quantity == "envelope"

    @property
    def restoring(self) -> tuple[str, ...]:
        """The restoring laws that it is compared under; none of an envelope."""
        return () if self.is_envelope else self.laws or (self.system.restoring,)

    def under(self, restoring: str) -> System:
        """What is known of the system under one of these laws, by default the system's own."""
        return next((s for s in self.alternatives if s.restoring == restoring), self.system)

    @property
    def repeats(self) -> int:
        """How many records are made of it; one where it is read."""
        return self.source.repeats if isinstance(self.source, Simulation) else 1


@dataclass(frozen=True)
class Estimators:
    """use: estimators' names; stages: "initial", "refined"; options: a method's own table by its name; repeats: on
    how many repeats of a signal a method runs at most, where not on all; variants: the estimator behind a name
    that the study gives to one with other options."""

    use: tuple[str, ...]
    stages: tuple[str, ...]
    options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    repeats: Mapping[str, int] = field(default_factory=dict)
    variants: Mapping[str, str] = field(default_factory=dict)

    def method(self, name: str) -> str:
        """The estimator that runs under a name of `use`."""
        return self.variants.get(name, name)

    def on(self, repeat: int) -> tuple[str, ...]:
        """The methods that run on a repeat, numbered from 0."""
        return tuple(name for name in self.use if repeat < self.repeats.get(name, repeat + 1))


@dataclass(frozen=True)
class Models:
    """compare: damping sums such as `viscous+coulomb`; prior: a prior by damping term, where one is given;
    restoring: the laws that each of them is combined with, none where a signal's own law is the only one; prune:
    how many nats behind the best, by Laplace's evidence, a candidate is not weighed further, None to weigh all."""

    compare: tuple[str, ...]
    prior: Mapping[str, Any] = field(default_factory=dict)
    restoring: tuple[str, ...] = ()
    prune: float | None = None


@dataclass(frozen=True)
class Study:
    """A checked study file. `source` is the file; nothing of it depends on the order of its tables.

    published: figures from elsewhere that the report shows beside the study's own. plugins: the user's modules with
    their sources. tables: those of the file, as it says them.
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
        """The damping sums that one of the signals is compared under."""
        return self.models.compare if spec.compare is None else spec.compare

    def compare(self, spec: SignalSpec) -> tuple[str, ...]:
        """Names of the candidates for one of the signals: its damping sums, each under each of its restoring laws.

        With one law a candidate's name is its damping sum; with several, see `candidate_name`. An envelope has none:
        its damping sums are weighed in its answer alone.
        """
        if spec.is_envelope:
            return ()
        laws = spec.restoring if len(spec.restoring) > 1 else ("",)
        return tuple(candidate_name(m, law) for m in self.dampings(spec) for law in laws)

    def estimate(self, spec: SignalSpec) -> tuple[str, ...]:
        """Those of them under which estimators run."""
        wanted = self.dampings(spec) if spec.estimate is None else spec.estimate
        return tuple(name for name in self.compare(spec) if candidate_parts(name)[0] in wanted)

    @property
    def every_specimen(self) -> dict[str, tuple[SignalSpec, ...]]:
        """The signals of each specimen that the study names."""
        named = dict.fromkeys(s.specimen for s in self.signals if s.specimen)
        return {name: tuple(s for s in self.signals if s.specimen == name) for name in named}

    @property
    def specimens(self) -> dict[str, tuple[SignalSpec, ...]]:
        """Those of them that are fitted jointly: envelopes are not."""
        return {name: specs for name, specs in self.every_specimen.items() if not specs[0].is_envelope}

    @property
    def repeated(self) -> dict[str, tuple[SignalSpec, ...]]:
        """The signals of each specimen that has several records."""
        return {n: specs for n, specs in self.specimens.items() if sum(s.repeats for s in specs) > 1}

    @property
    def records(self) -> tuple[tuple[SignalSpec, int], ...]:
        """Every record: its signal, and which repeat of it, from 0."""
        return tuple((spec, repeat) for spec in self.signals for repeat in range(spec.repeats))

    @property
    def noises(self) -> tuple[str, ...]:
        """The noise models in play; of several, one is chosen for each record."""
        from bayesdamp.inference.noise import NOISES

        given = self.posterior.noise
        if isinstance(given, str):
            return tuple(NOISES.present()) if given == "auto" else (given,)
        return given

    def resolved(self) -> dict[str, Any]:
        """All that the study says, defaults written out, as JSON takes it; no path of this machine."""
        found = split(replace(self, signals=(), tables={}))
        del found["source"], found["plugins"], found["tables"]
        if self.plugins:
            found["plugins"] = [{"file": Path(m.file).name, "sha256": m.digest} for m in self.plugins]
        return {**found, "signals": [s.resolved() for s in self.signals]}

    def estimator_options(self, name: str) -> BaseModel:
        """The options of an estimator, defaults filled in; imports the estimator.

        Raises InputError for an option that it does not have or that has a wrong value.
        """
        from bayesdamp.estimators import parse_options

        try:
            return parse_options(self.estimators.method(name), self.estimators.options.get(name), name)
        except InputError as error:
            raise InputError(str(error), str(self.source)) from None
