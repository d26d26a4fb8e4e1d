"""The cell of one record: read or simulated, cleaned, with its features and what is known of its system."""

from __future__ import annotations

import hashlib
import json
import time
import zlib
from dataclasses import asdict
from functools import cached_property
from typing import Any

import numpy as np

from bayesdamp import __version__
from bayesdamp.config import Recording, SignalSpec, Simulation, Study
from bayesdamp.estimators.bound import cramer_rao
from bayesdamp.estimators.shared import noise_level
from bayesdamp.inference.defaults import EPSILON_SHARE, Reference
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS
from bayesdamp.signals.anomalies import anomalies
from bayesdamp.signals.clean import clean
from bayesdamp.signals.curves import amplitude_curves
from bayesdamp.signals.features import Features, features
from bayesdamp.signals.record import RawRecord
from bayesdamp.signals.simulate import simulate_signal
from bayesdamp.store import CellResult, Store, sha256
from bayesdamp.study.recorded import recorded
from bayesdamp.types import OK, InputError, Problem, Refusal, Signal, System
from bayesdamp.units import UNITS

NO_NOISE = 1e-6
"""Noise below this share of the amplitude is none: a likelihood has nothing to weigh by."""
NOT_APPLICABLE = "not applicable: the record has no noise, so there is no posterior"
RAW_POINTS = 20_000
_NOT_OF_THE_RECORD = ("compare", "estimate", "laws", "alternatives", "specimen")


def digest(*parts: object) -> str:
    """A key for what a result depends on."""
    return hashlib.sha256(json.dumps([__version__, *parts], sort_keys=True, default=str).encode()).hexdigest()


def cell_seed(study: Study, name: str) -> int:
    """The seed of one cell: a function of the study's seed and the cell's name."""
    return int(np.random.SeedSequence([study.seed, zlib.crc32(name.encode())]).generate_state(1)[0])


def plain_seconds(began: float) -> float:
    return time.perf_counter() - began


class SignalCell:
    """One record: read or simulated, cleaned, with its features and what is known of its system."""

    def __init__(self, study: Study, spec: SignalSpec, repeat: int, store: Store) -> None:
        self.study, self.spec, self.repeat, self.store = study, spec, repeat, store
        self.name = f"signal/{spec.name}/{repeat}"

    @cached_property
    def key(self) -> str:
        source = self.spec.source
        content = sha256(source.path) if isinstance(source, Recording) else ""
        shown = {k: v for k, v in self.spec.resolved().items() if k not in _NOT_OF_THE_RECORD}
        return digest("signal", self.study.seed, shown, self.repeat, content)

    def compute(self) -> None:
        began = time.perf_counter()
        source, arrays = self.spec.source, {}
        if isinstance(source, Simulation):
            signal = self._simulated(source)
        else:
            raw = recorded(source)
            try:
                signal = clean(
                    raw,
                    name=self.spec.name,
                    unit=source.unit,
                    quantity=source.quantity,
                    clock=source.clock,
                    start=source.start,
                    stop=source.stop,
                )
            except InputError as error:
                raise InputError(f"{source.file}: {error}") from None
            arrays = _raw(raw, source)
        meta = {
            "provenance": dict(signal.provenance),
            "unit": signal.unit,
            "quantity": signal.quantity,
            "step": signal.step,
            "name": signal.name,
            "bound": self._bound(signal),
        }
        arrays |= {"t": signal.t, "y": signal.y}
        try:
            meta, outcome = meta | self._known(signal), OK
            curves = asdict(amplitude_curves(signal, features(signal)))
            arrays |= {f"against_amplitude/{name}": v for name, v in curves.items()}
        except Refusal as refusal:
            if isinstance(source, Recording):
                raise InputError(f"signal {self.spec.name}: {refusal}") from None
            outcome = str(refusal)  # of one simulated record in a series; the others go on
        self.store.write(CellResult(self.name, self.key, meta, arrays, outcome, plain_seconds(began)))

    def _simulated(self, source: Simulation) -> Signal:
        truth = dict(source.truth)
        law = self.spec.system.restoring
        quiet = {k: truth.get(k) for k in ("noise_time", "noise_dof") if k in truth}
        return simulate_signal(
            Oscillator(source.damping, law),
            truth,
            duration=source.duration,
            samples=source.samples,
            noise_sd=truth.get("noise_sd", 0.0),
            noise=source.noise,
            outliers=source.outliers,
            gaps=source.gaps,
            quantum=source.quantum,
            quantity=source.quantity,
            unit=source.unit,
            name=self.spec.name,
            rng=np.random.default_rng(cell_seed(self.study, self.name)),
            **quiet,
        )

    def _known(self, signal: Signal) -> dict[str, Any]:
        """Features, the reference of the priors, ε where it was not given, and whether there is noise.

        Raises Refusal where the record shows no oscillation.
        """
        seen = features(signal)
        reference = _reference(self.spec.system, seen)
        known, note = dict(self.spec.system.known), ""
        if "epsilon" not in known and "epsilon" not in self.spec.system.free:
            known["epsilon"] = EPSILON_SHARE * reference.peak_velocity
            note = f"ε was not given: 2 % of the peak velocity, {known['epsilon']:.3g} {signal.unit}/s."
        shown = {k: v for k, v in asdict(seen).items() if not isinstance(v, np.ndarray)}
        size = float(np.abs(seen.turning_amplitudes).max())
        return {
            "features": shown,
            "anomalies": list(anomalies(signal, seen)),
            "reference": asdict(reference),
            "known": known,
            "epsilon_note": note,
            "noisy": bool(noise_level(signal) > NO_NOISE * size),
        }

    def _bound(self, signal: Signal) -> dict[str, float]:
        """The Cramér–Rao bound of a simulated record with white noise: sd by parameter; else nothing.
        Repeats share it: it stands with the first."""
        source = self.spec.source
        if self.repeat or not isinstance(source, Simulation) or source.noise != "gaussian":
            return {}
        truth = {**self.spec.system.known, **source.truth}
        if not truth.get("noise_sd") or (truth.get("epsilon") == 0.0 and "coulomb" in source.damping):
            return {}
        problem = Problem(source.damping, self.spec.system)
        return cramer_rao(problem, truth, signal.t, truth["noise_sd"], signal.quantity)


def _reference(system: System, seen: Features) -> Reference:
    """Amplitude and frequency that prior widths scale with: given, else from the system, else the record's."""
    amplitude, frequency = system.amplitude, system.frequency
    law = LAWS.get(system.restoring)
    if all(n in system.known for n in law.parameters):
        osc = Oscillator(("viscous",), system.restoring)
        if frequency is None:
            frequency = osc.natural_frequency(system.known, seen.rest)
        if amplitude is None and "theta0" in system.known:
            amplitude = abs(system.known["theta0"] - osc.equilibrium(system.known, seen.rest)) or None
    rounded = {"amplitude": float(f"{seen.amplitude:.1e}"), "frequency": float(f"{seen.frequency:.1e}")}
    return Reference(amplitude or rounded["amplitude"], frequency or rounded["frequency"])


def _raw(raw: RawRecord, source: Recording) -> dict[str, np.ndarray]:
    """The record as it was, thinned for the picture: times of the file, values in SI."""
    times = np.arange(raw.y.size) / raw.rate if raw.t is None and raw.rate else raw.t
    every = max(1, raw.y.size // RAW_POINTS)
    scale = UNITS[source.unit].factor
    return {} if times is None else {"raw_t": np.asarray(times)[::every], "raw_y": raw.y[::every] * scale}


def signal_of(record: CellResult) -> Signal:
    """The record that a SignalCell stored."""
    m = record.meta
    return Signal(
        record.arrays["t"],
        record.arrays["y"],
        m["quantity"],
        m["unit"],
        m["name"],
        m["step"],
        m["provenance"],
    )
