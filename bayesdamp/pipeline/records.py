"""Read or simulate, clean and describe the records of a study, and load stored records for other tasks."""

from dataclasses import fields, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from bayesdamp.config import Recording, SignalSpec, Simulation, Study
from bayesdamp.estimators.refine import cramer_rao
from bayesdamp.estimators.shared import has_noise
from bayesdamp.formatting import digits, percentage
from bayesdamp.interface.first_words import no_free_decay
from bayesdamp.interface.signal import Signal as CutSignal, cut
from bayesdamp.interface.simulate import simulate_source
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.oscillator import reference_of
from bayesdamp.physics.restoring import LAWS
from bayesdamp.pipeline.tasks import Product, task_key, task_seed
from bayesdamp.plugins import sources_below
from bayesdamp.records.oscillation.anomalies import find_anomalies
from bayesdamp.records.oscillation.features import Features, features
from bayesdamp.records.oscillation.law_free import sinusoids
from bayesdamp.records.read import read_record
from bayesdamp.records.record import Kind, RawRecord, findings, with_warnings
from bayesdamp.store.results import RecordContent, Store, TaskResult, sha256
from bayesdamp.types import (
    FRICTION_WIDTH,
    OK,
    UNITS,
    FeatureValues,
    InputError,
    Problem,
    Provenance,
    Refusal,
    Signal,
    Status,
    System,
)
from bayesdamp.verdict.units import in_unit
from bayesdamp.verdict.words import describe_motion

NOT_APPLICABLE = Status.NOT_APPLICABLE.because("the record has no noise, so there is no posterior")
RAW_POINTS = 20_000
"""A measured record with at least twice as many raw samples is thinned before it is stored for its plot, but to no
fewer samples than this."""
CACHED_RECORDS = 8
"""Largest number of signals of stored results that are cached in memory."""
MOST_CACHED_SAMPLES = 5_000_000
"""Largest number of samples in free decays that were read from files and not yet stored; 160 MB (conventional)."""
_DECAYS: dict[tuple[Recording, str, tuple[int, ...]], CutSignal] = {}
"""Free decays that were read and not yet stored, by the record, the name of the signal, and the state of the file."""
_SIGNALS: dict[tuple[str, str], Signal] = {}
"""Cache of the last `CACHED_RECORDS` signals, by the name and the key of the stored result."""
_NOT_OF_THE_RECORD = ("compare", "estimate", "laws", "alternatives", "specimen")
"""Settings of a signal that do not affect its record. They are not part of the key (hash) of the task that reads it."""


def read_raw(source: Recording) -> RawRecord:
    """Read a measured record, in the unit of its file.

    Raises InputError if the file cannot be read, or if the user must first state how to read it, such as its unit.
    """
    raw = read_record(
        source.path,
        time=source.time,
        value=source.angle,
        rate=source.rate,
        run=source.run,
        channel=source.channel,
        time_unit=source.time_unit,
    )
    # `given` is left false, because the unit "rad" in a study may be just the default.
    doubts = findings(raw, source.unit, source.quantity)
    return with_warnings(raw, (doubt for doubt in doubts if doubt.kind is not Kind.DEGREES))


def read_free_decay(source: Recording, name: str) -> CutSignal:
    """Read a measured record, and return the free decay in it as a signal named `name`, in the base unit (such as rad).

    Raises InputError, which names the file, if the file contains no free decay, or for the reasons that `read_raw`
    states. The result is kept until it is stored (`compute_signal`) or the file changes, because a run first checks all
    records; but only the last ones if all are too large together.
    """
    if (decay := _DECAYS.get((source, name, _state_of(source.path)))) is not None:
        return decay
    window = {k: getattr(source, k) for k in ("clock", "start", "stop")}
    try:
        decay = cut(read_raw(source), name, source.unit, source.quantity, **window)
    except InputError as error:
        raise InputError(error.what, source.file, error.at, error.arguments) from None
    keep_free_decay(source, name, decay)
    return decay


def keep_free_decay(source: Recording, name: str, decay: CutSignal) -> None:
    """Keep the free decay of a record for `read_free_decay`; discard the oldest ones if they are too large together."""
    _DECAYS[source, name, _state_of(source.path)] = decay
    while sum(kept.t.size + kept.whole_t.size for kept in _DECAYS.values()) > MOST_CACHED_SAMPLES:
        del _DECAYS[next(iter(_DECAYS))]


def take_free_decay(source: Recording, name: str) -> CutSignal | None:
    """Return the free decay of a record and stop keeping it; None if it is not kept or if the file has changed."""
    return _DECAYS.pop((source, name, _state_of(source.path)), None)


def _state_of(path: Path) -> tuple[int, ...]:
    """Return numbers that change if a file is changed or replaced: time of change, size and inode. Empty if missing."""
    try:
        status = path.stat()
    except OSError:
        return ()
    return status.st_mtime_ns, status.st_size, status.st_ino


class StudyRecord:
    """One record of a study, with its stored result: a measured signal, or one repeat of a simulated signal.

    Repeats of a signal differ only in their random numbers (noise, outliers and gaps). repeat: number of the repeat,
    from 0. name: `SIGNAL/REPEAT`, which is part of the names of all tasks on this record.
    """

    def __init__(self, study: Study, spec: SignalSpec, repeat: int, store: Store) -> None:
        self.study, self.spec, self.repeat, self.store = study, spec, repeat, store
        self.name = f"{spec.name}/{repeat}"

    @property
    def key(self) -> str:
        """The key (hash of all inputs) of the task `signal/NAME/REPEAT`, which simulates or reads this record.

        It depends on the study's seed, the signal's settings, the repeat, the content of the file, and the source code
        that simulates or reads the record.
        """

        def compute() -> str:
            source, content = self.spec.source, ""
            plugins = [LAWS.source(self.spec.system.restoring)]
            if isinstance(source, Recording):
                plugins += sources_below("bayesdamp.records")
                content = sha256(source.path)
            else:
                plugins += [TERMS.source(term) for term in source.damping]
            settings = {k: v for k, v in self.spec.resolved().items() if k not in _NOT_OF_THE_RECORD}
            return task_key("signal", self.study.seed, settings, self.repeat, content, plugins)

        return self.store.key(f"signal/{self.name}", (self.study, self.spec), compute)

    def find(self, kind: str, *, arrays: bool = True) -> TaskResult | None:
        """Return the stored result of the task of this kind, such as "answer", on the record.

        None if it is missing, damaged or hidden by the store. arrays: whether to read its arrays too.
        """
        return self.store.find(f"{kind}/{self.name}", arrays=arrays)

    @cached_property
    def result(self) -> TaskResult:
        """The stored result of the task `signal/NAME/REPEAT` of this record. Raises KeyError if there is none."""
        return self.store.read(f"signal/{self.name}")

    @cached_property
    def signal(self) -> Signal:
        """The samples of this record in base units, from its stored result. Raises KeyError if they are not stored.

        The last few signals are cached, because each object also keeps its features, so that they are computed once.
        """
        m, arrays = self.content, self.result.arrays
        about = m.quantity, m.unit, m.name, m.step, Provenance.of(m.provenance)
        signal = Signal(arrays["t"], arrays["y"], *about)
        signal = _SIGNALS.setdefault((self.result.name, self.result.key), signal)
        while len(_SIGNALS) > CACHED_RECORDS:
            del _SIGNALS[next(iter(_SIGNALS))]
        return signal

    @cached_property
    def content(self) -> RecordContent:
        """The values in the stored result of this record (features, provenance and so on), without the samples."""
        return RecordContent.of(self.result)

    @property
    def features(self) -> Features:
        """The features of the signal, such as its period and amplitudes."""
        return features(self.signal)

    def system(self, law: str) -> System:
        """Return the known values and the priors of the oscillator's parameters under a restoring law.

        They include ε, the velocity within which Coulomb friction changes its sign. If the study states neither its
        value nor that it is unknown, ε is a fixed fraction of the record's peak velocity.
        """
        system, epsilon = self.spec.under(law), self.content.known.get("epsilon")
        return system if epsilon is None else replace(system, known={**system.known, "epsilon": epsilon})


def compute_signal(record: StudyRecord) -> Product:
    """Read or simulate a record, clean it, and compute its features.

    The content of the result is a `RecordContent`. The arrays are the samples: `t` in s and `y` in the base unit (such
    as rad). A measured record also has `raw_t` and `raw_y`: the whole record in the same units, thinned if it is long.
    If the record shows no oscillation or too few cycles, the outcome says so for a simulated record; for a measured one
    InputError is raised.
    """
    study, spec, name, arrays = record.study, record.spec, f"signal/{record.name}", {}
    source = spec.source
    if isinstance(source, Simulation):
        rng = np.random.default_rng(task_seed(study, name))
        signal = simulate_source(source, spec.system.restoring, source.truth, spec.name, rng)
    else:
        decay = read_free_decay(source, spec.name)
        take_free_decay(source, spec.name)
        signal = decay
        if source.least_noise > 0:
            signal = _add_noise(decay, source.least_noise, task_seed(study, f"noise/{name}"))
        every = max(1, decay.whole_t.size // RAW_POINTS)
        arrays = {"raw_t": decay.whole_t[::every], "raw_y": decay.whole_y[::every]}
    content = RecordContent(
        name=signal.name,
        unit=signal.unit,
        quantity=signal.quantity,
        step=signal.step,
        provenance=signal.provenance.to_dict(),
        bound=_bound(spec, signal) if record.repeat == 0 else {},  # the same for all repeats
    )
    arrays |= {"t": signal.t, "y": signal.y}
    try:
        content, outcome = _describe(spec, signal, content), OK
        sinusoids(signal)  # raises Refusal if the record has too few cycles
    except Refusal as refusal:
        if isinstance(source, Recording):
            raise InputError(f"signal {spec.name}: {refusal}") from None
        outcome = str(refusal)  # a simulated record: the others of its series are still evaluated
    return Product(content, arrays, outcome)


def _add_noise(signal: Signal, share: float, seed: int) -> Signal:
    """Add white normal noise to a record that has no noise, and a warning that says so to its provenance.

    A record that has noise, or that shows no oscillation, is returned unchanged. share: standard deviation of the noise
    as a fraction of the largest amplitude. seed: seed of the noise.
    """
    try:
        measured = features(signal)
    except Refusal:
        return signal
    if has_noise(signal, measured):
        return signal
    size = float(np.abs(measured.turning_amplitudes).max())
    y = signal.y + share * size * np.random.default_rng(seed).standard_normal(signal.y.size)
    warning = (
        f"the record has no noise from sample to sample (it was filtered, smoothed or simulated), and without noise "
        f"damping models cannot be compared. Noise of {percentage(share)} % of its amplitude was added, and the "
        "results are for the record with this noise. Give the unfiltered record, or use only a study's estimators, "
        "which need no noise."
    )
    before = signal.provenance
    return replace(signal, y=y, provenance=replace(before, warnings=(*before.warnings, warning)))


def _describe(spec: SignalSpec, signal: Signal, content: RecordContent) -> RecordContent:
    """Complete the content of a record: features, scales of default priors, a default for ε if necessary, remarks.

    ε is the velocity within which Coulomb friction changes its sign. Raises Refusal if the record shows no oscillation.
    """
    measured = features(signal)
    reference = reference_of(spec.system, measured)
    known, note = dict(spec.system.known), ""
    if "epsilon" not in known and "epsilon" not in spec.system.free:
        known["epsilon"] = reference.friction_width
        width, share = digits(known["epsilon"], n=3), percentage(FRICTION_WIDTH)
        note = (
            "The velocity ε, within which friction changes its sign, was not given; it is assumed to be "
            f"{share} % of the peak velocity: {width} {signal.unit}/s."
        )
    remarks = list(find_anomalies(signal, measured))
    other = no_free_decay(signal) if isinstance(spec.source, Recording) else None
    if other is not None and other.motion is not None:
        clause = describe_motion(in_unit(other, UNITS[spec.source.unit]), other.motion)
        remarks.append(f"{clause[0].upper()}{clause[1:]}.")
    return replace(
        content,
        features=FeatureValues(**{f.name: getattr(measured, f.name) for f in fields(FeatureValues)}),
        anomalies=tuple(remarks),
        reference=reference,
        known=known,
        epsilon_note=note,
        noisy=has_noise(signal, measured),
    )


def _bound(spec: SignalSpec, signal: Signal) -> dict[str, float]:
    """Return the Cramér–Rao bound of a simulated record: the smallest standard deviation of each unknown parameter.

    The result is by name of the parameter, in the parameter's unit. It is {} in these cases: a measured record, no
    noise, noise that is not white and normal, a damping term with parameters besides its coefficient, or friction that
    changes its sign abruptly (ε = 0).
    """
    source = spec.source
    if not isinstance(source, Simulation) or source.noise != "gaussian":
        return {}
    terms = [TERMS.get(term) for term in source.damping]
    truth = {**spec.system.known, **source.truth}
    is_exact = truth.get("epsilon") == 0.0 and any(term.switches for term in terms)
    if any(term.further for term in terms) or is_exact or not truth.get("noise_sd"):
        return {}
    problem = Problem(source.damping, spec.system)
    return cramer_rao(problem, truth, signal.t, truth["noise_sd"], signal.quantity)
