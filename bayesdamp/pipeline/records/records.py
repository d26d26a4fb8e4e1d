"""The cell of one record: read or simulated, cleaned, with its features and what is known of its system."""

from __future__ import annotations

import zlib
from abc import ABC, abstractmethod
from dataclasses import fields, replace
from functools import lru_cache

import numpy as np

from bayesdamp.config import Recording, SignalSpec, Simulation, Study
from bayesdamp.estimators.bound import cramer_rao
from bayesdamp.estimators.shared import has_noise
from bayesdamp.interface.no_free_decay import no_free_decay
from bayesdamp.interface.simulate import simulated
from bayesdamp.outcomes import Status
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.restoring import LAWS
from bayesdamp.pipeline.keys import task_key
from bayesdamp.pipeline.tasks import Product
from bayesdamp.plugins import sources_below
from bayesdamp.provenance import Provenance
from bayesdamp.records.cleaning.clean import clean
from bayesdamp.records.cleaning.decimate import decimated
from bayesdamp.records.findings import question
from bayesdamp.records.oscillation.anomalies import anomalies
from bayesdamp.records.oscillation.features import features
from bayesdamp.records.oscillation.law_free import law_free
from bayesdamp.records.read import read_record
from bayesdamp.records.record import RawRecord
from bayesdamp.records.reference import reference_of
from bayesdamp.records.wrapped import unwrapped
from bayesdamp.store import CellResult, Store, sha256
from bayesdamp.store.contents import FeaturesSeen, RecordContent
from bayesdamp.types import FRICTION_WIDTH, OK, InputError, Problem, Refusal, Signal
from bayesdamp.units import UNITS
from bayesdamp.verdict.units import in_unit
from bayesdamp.verdict.words import seen_instead


def recorded(source: Recording) -> RawRecord:
    """The record that a study asks for, thinned where it has far more samples than it needs. Raises InputError."""
    raw = read_record(
        source.path,
        time=source.time,
        value=source.angle,
        rate=source.rate,
        run=source.run,
        channel=source.channel,
        time_unit=source.time_unit,
    )
    doubt = question(raw, source.unit, source.quantity, given=False)  # "rad" may be the default
    if doubt is not None:
        raise InputError(doubt.sentence, arguments=doubt.arguments)
    return decimated(unwrapped(raw, source.unit, source.quantity))


def of_file(error: InputError, source: Recording) -> InputError:
    """What is wrong with a record, told by its file as the study has it, and not by a name that was given it."""
    return InputError(error.what, source.file, error.at, error.arguments)


def cleaned(source: Recording, name: str) -> tuple[RawRecord, Signal]:
    """The record and its free decay, under a name. Raises InputError.

    What was made last is kept, until the file changes: a run looks at its inputs before it begins.
    """
    try:
        status = source.path.stat()
    except OSError:
        return _cleaned(source, name, ())
    return _cleaned(source, name, (status.st_mtime_ns, status.st_size, status.st_ino))


@lru_cache(maxsize=1)
def _cleaned(source: Recording, name: str, stamp: tuple[int, ...]) -> tuple[RawRecord, Signal]:
    del stamp
    raw = recorded(source)
    options = {k: getattr(source, k) for k in ("unit", "quantity", "clock", "start", "stop")}
    return raw, clean(raw, name=name, **options)


NOT_APPLICABLE = Status.NOT_APPLICABLE.because("the record has no noise, so there is no posterior")
RAW_POINTS = 20_000
_NOT_OF_THE_RECORD = ("compare", "estimate", "laws", "alternatives", "specimen")


def cell_seed(study: Study, name: str) -> int:
    """The seed of one cell: a function of the study's seed and the cell's name."""
    return int(np.random.SeedSequence([study.seed, zlib.crc32(name.encode())]).generate_state(1)[0])


class RecordCell(ABC):
    """A task of one record, `KIND/SIGNAL/REPEAT`."""

    def __init__(self, kind: str, study: Study, spec: SignalSpec, repeat: int, store: Store) -> None:
        self.kind, self.study, self.spec, self.repeat, self.store = kind, study, spec, repeat, store
        self.name = f"{kind}/{spec.name}/{repeat}"

    @property
    def key(self) -> str:
        """Of all that its product depends on."""
        return self.store.key(self.name, (self.study, self.spec), self._key)

    @abstractmethod
    def _key(self) -> str: ...

    @abstractmethod
    def product(self) -> Product:
        """Compute what it leaves."""


class SignalCell(RecordCell):
    """One record: read or simulated, cleaned, with its features and what is known of its system.

    Its key is of the signal's table, its repeat, the file's content, and the source of what makes or reads it.
    """

    def __init__(self, study: Study, spec: SignalSpec, repeat: int, store: Store) -> None:
        super().__init__("signal", study, spec, repeat, store)

    def _key(self) -> str:
        source = self.spec.source
        content = sha256(source.path) if isinstance(source, Recording) else ""
        shown = {k: v for k, v in self.spec.resolved().items() if k not in _NOT_OF_THE_RECORD}
        return task_key("signal", self.study.seed, shown, self.repeat, content, self._plugins)

    @property
    def _plugins(self) -> list[str]:
        """The source of what is found by name to make the record, or to read it."""
        source, law = self.spec.source, LAWS.source(self.spec.system.restoring)
        if isinstance(source, Recording):
            return [law, *sources_below("bayesdamp.records")]
        return [law, *(TERMS.source(term) for term in source.damping)]

    def product(self) -> Product:
        """The record, cleaned, with its features. Raises InputError where a measured one shows no oscillation."""
        source, arrays = self.spec.source, {}
        if isinstance(source, Simulation):
            rng = np.random.default_rng(cell_seed(self.study, self.name))
            signal = simulated(source, self.spec.system.restoring, source.truth, self.spec.name, rng)
        else:
            try:
                raw, signal = cleaned(source, self.spec.name)
            except InputError as error:
                raise of_file(error, source) from None
            signal = self._with_noise(signal, source.least_noise)
            times = np.arange(raw.y.size) / raw.rate if raw.t is None and raw.rate else raw.t
            every = max(1, raw.y.size // RAW_POINTS)
            if times is not None:
                scale = UNITS[source.unit].factor
                arrays = {"raw_t": np.asarray(times)[::every], "raw_y": raw.y[::every] * scale}
        content = RecordContent(
            name=signal.name,
            unit=signal.unit,
            quantity=signal.quantity,
            step=signal.step,
            provenance=signal.provenance.to_dict(),
            bound=self._bound(signal),
        )
        arrays |= {"t": signal.t, "y": signal.y}
        try:
            content, outcome = self._known(signal, content), OK
            law_free(signal, features(signal))  # refuses a record of too few cycles
        except Refusal as refusal:
            if isinstance(source, Recording):
                raise InputError(f"signal {self.spec.name}: {refusal}") from None
            outcome = str(refusal)  # of one simulated record in a series; the others go on
        return Product(content, arrays, outcome)

    def _with_noise(self, signal: Signal, share: float) -> Signal:
        """A record that has no noise with some, this share of its amplitude, and a note on it; others as they are."""
        if share == 0:
            return signal
        try:
            seen = features(signal)
        except Refusal:
            return signal
        if has_noise(signal, seen):
            return signal
        size = float(np.abs(seen.turning_amplitudes).max())
        rng = np.random.default_rng(cell_seed(self.study, f"noise/{self.name}"))
        y = signal.y + share * size * rng.standard_normal(signal.y.size)
        warning = (
            f"the record has no noise from sample to sample (it was filtered, smoothed or simulated), and without any "
            f"nothing can be weighed. Noise of {100 * share:g} % of its amplitude was added: what is said is of that "
            "record. Give a record with its noise, or fit this one with a study's estimators, which need none."
        )
        before = signal.provenance
        return replace(signal, y=y, provenance=replace(before, warnings=(*before.warnings, warning)))

    def _known(self, signal: Signal, content: RecordContent) -> RecordContent:
        """The content with features, the reference of the priors, ε where it was not given, and whether there is noise.

        Raises Refusal where the record shows no oscillation.
        """
        seen = features(signal)
        reference = reference_of(self.spec.system, seen)
        known, note = dict(self.spec.system.known), ""
        if "epsilon" not in known and "epsilon" not in self.spec.system.free:
            known["epsilon"] = reference.friction_width
            share = f"{100 * FRICTION_WIDTH:g} % of the peak velocity"
            note = f"ε was not given: {share}, {known['epsilon']:.3g} {signal.unit}/s."
        other = no_free_decay(signal) if isinstance(self.spec.source, Recording) else None
        instead = []
        if other is not None and other.motion is not None:
            instead = [seen_instead(in_unit(other, UNITS[self.spec.source.unit]), other.motion)]
        return replace(
            content,
            features=FeaturesSeen(**{f.name: getattr(seen, f.name) for f in fields(FeaturesSeen)}),
            anomalies=(*anomalies(signal, seen), *instead),
            reference=reference,
            known=known,
            epsilon_note=note,
            noisy=has_noise(signal, seen),
        )

    def _bound(self, signal: Signal) -> dict[str, float]:
        """The Cramér–Rao bound of a simulated record with white noise: sd by parameter; else nothing.
        Repeats share it: it stands with the first."""
        source = self.spec.source
        if self.repeat or not isinstance(source, Simulation) or source.noise != "gaussian":
            return {}
        if any(TERMS.get(term).further for term in source.damping):
            return {}
        truth = {**self.spec.system.known, **source.truth}
        exact = truth.get("epsilon") == 0.0 and any(TERMS.get(term).switches for term in source.damping)
        if not truth.get("noise_sd") or exact:
            return {}
        problem = Problem(source.damping, self.spec.system)
        return cramer_rao(problem, truth, signal.t, truth["noise_sd"], signal.quantity)


def signal_of(record: CellResult) -> Signal:
    """The record that a SignalCell stored."""
    m = RecordContent.of(record)
    t, y = record.arrays["t"], record.arrays["y"]
    return Signal(t, y, m.quantity, m.unit, m.name, m.step, Provenance.of(m.provenance))
