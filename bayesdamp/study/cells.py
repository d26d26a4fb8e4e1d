"""What each kind of cell of a study computes; each reads what it needs from the store and writes one result."""

from __future__ import annotations

import hashlib
import json
import time
import zlib
from collections.abc import Mapping
from dataclasses import asdict, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from bayesdamp import __version__
from bayesdamp.config import Recording, SignalSpec, Simulation, Study
from bayesdamp.config.checks import plain
from bayesdamp.estimators import run as run_estimator
from bayesdamp.estimators.bound import cramer_rao
from bayesdamp.estimators.shared import noise_level
from bayesdamp.inference import diagnostics
from bayesdamp.inference.build import build_target
from bayesdamp.inference.checks import check_fit, value_sds
from bayesdamp.inference.defaults import EPSILON_SHARE, Reference
from bayesdamp.inference.derived import Motions, against_amplitude, derive, units
from bayesdamp.inference.evidence import EVIDENCES
from bayesdamp.inference.mode import Mode, find_mode, restore_mode
from bayesdamp.inference.samplers import SAMPLERS, Settings
from bayesdamp.inference.target import Target
from bayesdamp.physics.damping import parse_model
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS
from bayesdamp.physics.units import parameter_unit
from bayesdamp.signals.clean import clean
from bayesdamp.signals.curves import amplitude_curves
from bayesdamp.signals.features import Features, features
from bayesdamp.signals.read import read_record
from bayesdamp.signals.simulate import simulate_signal
from bayesdamp.store import CellResult, Store, sha256
from bayesdamp.types import OK, InputError, Posterior, Problem, Refusal, Signal, System, candidate_parts

NO_NOISE = 1e-6
"""Noise below this share of the amplitude is none: a likelihood has nothing to weigh by."""
NOT_APPLICABLE = "not applicable: the record has no noise, so there is no posterior"
RAW_POINTS = 20_000
_NOT_OF_THE_RECORD = ("compare", "estimate", "laws", "alternatives")
SUMMARIES = {"ensembles": "ensembles", "effective": "effective_draws"}
"""What `summarise` is to know of a sampler's draws, and where its diagnostics say it."""
CURVE_POINTS = 25
FAINTEST = 0.02
"""Least amplitude, as a share of the first, at which a damping is given against amplitude."""


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
            raw = read_record(source.path, time=source.time, value=source.angle, rate=source.rate)
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
            arrays = _raw(raw.t, raw.y, source)
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


def _raw(t: np.ndarray | None, y: np.ndarray, source: Recording) -> dict[str, np.ndarray]:
    """The record as it was, thinned for the picture: times of the file, values in SI."""
    times = np.arange(y.size) / source.rate if t is None and source.rate else t
    every = max(1, y.size // RAW_POINTS)
    scale = {"deg": np.pi / 180, "mm": 1e-3}.get(source.unit, 1.0)
    return {} if times is None else {"raw_t": np.asarray(times)[::every], "raw_y": y[::every] * scale}


def signal_of(cell: CellResult) -> Signal:
    """The record that a signal's cell holds."""
    m = cell.meta
    return Signal(
        cell.arrays["t"], cell.arrays["y"], m["quantity"], m["unit"], m["name"], m["step"], m["provenance"]
    )


def features_of(cell: CellResult) -> Features:
    """Its features."""
    return features(signal_of(cell))


def noise_path(spec: SignalSpec, repeat: int) -> str:
    """The name of the cell that holds the choice of a record's noise model."""
    return f"noise/{spec.name}/{repeat}"


def _noise(study: Study, spec: SignalSpec, repeat: int, store: Store) -> str:
    if study.posterior.noise != "auto":
        return study.posterior.noise
    try:
        return store.read(noise_path(spec, repeat)).meta["noise"]
    except KeyError:
        return "correlated"


class Branch:
    """One candidate on one record: its estimates, mode, posteriors and evidence, each a cell.

    model: the candidate's name, of which terms and restoring are the two parts. noise: the noise model, by default
    the study's or that chosen for the record.
    """

    def __init__(
        self,
        study: Study,
        spec: SignalSpec,
        repeat: int,
        model: str,
        store: Store,
        noise: str | None = None,
    ) -> None:
        self.noise = noise or _noise(study, spec, repeat, store)
        self.study, self.spec, self.repeat, self.model, self.store = study, spec, repeat, model, store
        damping, law = candidate_parts(model)
        self.terms, self.restoring = parse_model(damping), law or spec.restoring[0]
        self.parent = SignalCell(study, spec, repeat, store)
        self.path = f"{spec.name}/{repeat}/{model}"
        system = spec.under(self.restoring)
        self._other = () if system is spec.system else (plain(system),)

    @property
    def _methods(self) -> tuple[str, ...]:
        on = self.study.estimators.on(self.repeat)
        return on if self.model in self.study.estimate(self.spec) else ()

    def cells(self) -> dict[str, str]:
        """Name of each cell to its key, in an order in which they can run."""
        found: dict[str, str] = {}
        use = self.study.estimators
        chosen = {n: dict(use.options.get(n, {})) for n in self._methods}
        for name, options in chosen.items():
            key = digest(
                "estimate", self.parent.key, self.model, use.method(name), use.stages, options, *self._other
            )
            found[f"estimate/{self.path}/{name}"] = key
        if not (self.study.posterior.samplers or self.study.evidence.methods):
            return found
        priors = {t: str(self.study.models.prior.get(t)) for t in self.terms}
        noise = self.noise
        shared = ("shared", self.beside) if self.beside else ()
        parts = (self.model, noise, priors, use.stages, chosen, *self._other, *shared)
        mode_key = digest("mode", self.parent.key, *parts)
        found[f"mode/{self.path}"] = mode_key
        settings = self.study.posterior
        for name in settings.samplers:
            key = digest("posterior", mode_key, name, settings.chains, settings.warmup, settings.draws)
            found[f"posterior/{self.path}/{name}"] = key
        if self.study.models.prune is not None:
            found[f"curve/{self.path}"] = digest("curve", mode_key)
        for name in self.study.evidence.methods:
            found[f"evidence/{self.path}/{name}"] = digest("evidence", mode_key, name)
        return found

    def compute(self, name: str, key: str) -> None:
        """Compute one cell; where its record shows no oscillation, the cell says so."""
        if self._parent_result.outcome != OK:
            self.store.write(CellResult(name, key, outcome=self._parent_result.outcome))
            return
        kinds = {
            "estimate": self.estimate,
            "mode": self.mode,
            "posterior": self.posterior,
            "curve": self.curve,
        }
        {**kinds, "evidence": self.evidence}[name.partition("/")[0]](name, key)

    @cached_property
    def _parent_result(self) -> CellResult:
        return self.store.read(self.parent.name)

    @cached_property
    def signal(self) -> Signal:
        return signal_of(self._parent_result)

    @cached_property
    def seen(self) -> Features:
        return features(self.signal)

    @cached_property
    def system(self) -> System:
        system, seen = self.spec.under(self.restoring), self._parent_result.meta["known"]
        epsilon = {k: v for k, v in seen.items() if k == "epsilon"}
        return replace(system, known={**system.known, **epsilon})

    @cached_property
    def target(self) -> Target:
        """The target of this candidate alone."""
        return self._target(())

    @cached_property
    def shared(self) -> Target:
        """The target in the program of all dampings that are compared under the law, where candidates are many."""
        return self._target(self.beside)

    @cached_property
    def beside(self) -> tuple[str, ...]:
        """The terms of all dampings compared, where the candidates share a program; none where each has its own."""
        if self.study.models.prune is None:
            return ()
        every = [parse_model(m) for m in self.study.dampings(self.spec)]
        whole = max(every, key=len)
        return whole if all(set(terms) <= set(whole) for terms in every) else ()

    def _target(self, beside: tuple[str, ...]) -> Target:
        priors = {t: p for t, p in self.study.models.prior.items() if t in self.terms}
        return build_target(
            self.signal,
            self.terms,
            self.system,
            self.seen,
            Reference(**self._parent_result.meta["reference"]),
            noise=self.noise,
            term_priors=priors,
            beside=beside,
        )

    @cached_property
    def _mode(self) -> Mode:
        found = self.store.read(f"mode/{self.path}")
        if found.outcome != OK:
            raise Refusal(found.outcome)
        m, z, information = found.meta, found.arrays["z"], found.arrays["information"]
        return restore_mode(self.shared, z, m["log_posterior"], information, m["tolerance"])

    @cached_property
    def _own_mode(self) -> Mode:
        """The mode in the scores of this candidate alone."""
        if not self.beside:
            return self._mode
        mode = self._mode
        live = [i for i, n in enumerate(self.shared.names) if n in self.target.names]
        return restore_mode(
            self.target,
            mode.z[live],
            mode.log_posterior,
            mode.information[np.ix_(live, live)],
            mode.tolerance,
        )

    def estimate(self, name: str, key: str) -> None:
        began = time.perf_counter()
        method, use = name.rsplit("/", 1)[1], self.study.estimators
        found = run_estimator(
            use.method(method),
            self.signal,
            Problem(self.terms, self.system),
            options=use.options.get(method),
            stages=use.stages,
            seed=cell_seed(self.study, name),
        )
        stages = [{k: v for k, v in asdict(e).items() if k not in ("trace", "estimator")} for e in found]
        trace = {f"{e.stage}/{n}": np.asarray(v) for e in found for n, v in e.trace.items()}
        self.store.write(CellResult(name, key, {"stages": stages}, trace, OK, plain_seconds(began)))

    def _seeds(self) -> dict[str, Mapping[str, float]]:
        """The last stage of every estimator that has values; with none in the study, least squares'."""
        seeds: dict[str, Mapping[str, float]] = {}
        for method in self._methods:
            for stage in self.store.read(f"estimate/{self.path}/{method}").meta.get("stages", []):
                if stage["values"]:
                    seeds[method] = stage["values"]
        if not seeds:
            for e in run_estimator("least_squares", self.signal, Problem(self.terms, self.system), seed=0):
                if e.values:
                    seeds["least_squares"] = e.values
        if not seeds:
            raise Refusal("no estimator found a place to start from")
        return seeds

    def mode(self, name: str, key: str) -> None:
        began = time.perf_counter()
        if not self._parent_result.meta["noisy"]:
            self.store.write(CellResult(name, key, outcome=NOT_APPLICABLE))
            return
        try:
            mode = find_mode(self.shared, self._seeds(), noise_level=self.seen.roughness)
        except Refusal as refusal:
            self.store.write(CellResult(name, key, outcome=str(refusal), seconds=plain_seconds(began)))
            return
        target, own = self.shared, self.target.priors
        fit = check_fit(target, mode, self.seen.period, cell_seed(self.study, name))
        checks = ("fit", "residual", "whitened", "autocorrelation")
        meta = {
            "values": {n: float(v) for n, v in target.values(mode.z).items() if n in own},
            "sd": {
                n: s
                for n, s in value_sds(target, mode.z, np.linalg.inv(mode.information)).items()
                if n in own
            },
            "known": dict(self.target.known),
            "priors": {n: p.describe() for n, p in self.target.priors.items()},
            "log_posterior": mode.log_posterior,
            "tolerance": mode.tolerance,
            "error_budget": {
                "step_error": mode.step_error,
                "log_likelihood_change": mode.likelihood_error,
            },
            "climbs": [{k: v for k, v in asdict(c).items() if k != "z"} for c in mode.climbs],
            "windows": [asdict(w) for w in fit.windows],
            **{k: v for k, v in asdict(fit).items() if k not in (*checks, "windows")},
        }
        arrays = {"t": self.signal.t, "z": mode.z, "information": mode.information}
        arrays |= {k: getattr(fit, k) for k in checks}
        self._mode = mode
        self.store.write(CellResult(name, key, meta, arrays, OK, plain_seconds(began)))

    def posterior(self, name: str, key: str) -> None:
        sampler, s = name.rsplit("/", 1)[1], self.study.posterior
        try:
            mode = self._own_mode
        except Refusal as refusal:
            self.store.write(CellResult(name, key, outcome=str(refusal)))
            return
        settings = Settings(s.chains, s.warmup, s.draws, cell_seed(self.study, name) % 2**31)
        try:
            found = SAMPLERS.get(sampler).sample(self.target, mode, settings)
        except Refusal as refusal:
            self.store.write(CellResult(name, key, outcome=str(refusal)))
            return
        file = self.store.folder / "posterior" / f"{self.path.replace('/', '.')}.{sampler}.nc"
        _save_whole(found, file)
        summary: dict[str, Any] = dict(found.diagnostics["summary"])  # type: ignore[call-overload]
        draws, names = found.draws, [str(n) for n in found.names]
        motions = self._motions(found)
        derived = derive(motions)
        # A draw without such a motion (no stable equilibrium, an escape) leaves no honest mean of the others.
        partial = {n: int(np.sum(~np.isfinite(v))) for n, v in derived.items() if not np.all(np.isfinite(v))}
        how = {k: found.diagnostics.get(v) for k, v in SUMMARIES.items()}
        for n, v in derived.items():
            if n not in partial:
                summary[n] = diagnostics.summarise(v, **how)  # type: ignore[arg-type]
        sig = self.signal
        unit = units(sig.unit)
        meta = {
            "names": names,
            "units": {
                n: unit.get(n) or parameter_unit(n, self.system.restoring, sig.unit, sig.quantity)
                for n in summary
            },
            "summary": summary,
            "reference_amplitude": motions.amplitude,
            "without": partial,
            "diagnostics": {k: v for k, v in found.diagnostics.items() if k not in ("summary", "arrays")},
            "file": file.relative_to(self.store.folder).as_posix(),
        }
        own: Mapping[str, np.ndarray] = found.diagnostics.get("arrays", {})  # type: ignore[assignment]
        arrays = {"draws": draws, **self._curves(motions), **own}
        self.store.write(CellResult(name, key, meta, arrays, found.outcome, found.seconds))

    def _motions(self, found: Posterior) -> Motions:
        inferred = {n: found.draws[..., i] for i, n in enumerate(found.names)}
        values = {**self.target.known, **inferred}
        amplitude = self._parent_result.meta["reference"]["amplitude"]
        return Motions(self.target.oscillator, values, self.seen.rest, amplitude, self.spec.inertia)

    def _grid(self) -> np.ndarray:
        """Amplitudes from the record's last to its first, shape (m,)."""
        first, last = self.seen.amplitude, self.seen.final_amplitude
        return np.geomspace(max(min(first, last), FAINTEST * first), first, CURVE_POINTS)

    def _curves(self, motions: Motions) -> dict[str, np.ndarray]:
        """Decrement and equivalent ratio over the amplitudes of the record; those that have no motion are left out."""
        grid = self._grid()
        curves = against_amplitude(motions, grid)
        whole = np.all([np.all(np.isfinite(c), axis=0) for c in curves.values()], axis=0)
        return {"amplitudes": grid[whole], **{f"curve/{n}": c[:, whole] for n, c in curves.items()}}

    def curve(self, name: str, key: str) -> None:
        """The fall of the log amplitude over 2π and the frequency (rad/s) of the mode, over the record's amplitudes."""
        began = time.perf_counter()
        found = self.store.read(f"mode/{self.path}")
        if found.outcome != OK:
            self.store.write(CellResult(name, key, outcome=found.outcome))
            return
        grid = self._grid()
        values = {
            n: np.full(grid.shape, v) for n, v in {**found.meta["known"], **found.meta["values"]}.items()
        }
        oscillator = Oscillator(self.terms, self.restoring)
        at = Motions(oscillator, values, self.seen.rest, self.seen.amplitude).at(grid)
        ratio = np.asarray(at.lost / (grid * at.slope)) / (2 * np.pi)
        arrays = {"amplitude": grid, "ratio": ratio, "frequency": 2 * np.pi / np.asarray(at.period)}
        self.store.write(CellResult(name, key, {}, arrays, OK, plain_seconds(began)))

    def evidence(self, name: str, key: str) -> None:
        try:
            mode = self._mode
        except Refusal as refusal:
            self.store.write(CellResult(name, key, outcome=str(refusal)))
            return
        method = EVIDENCES.get(name.rsplit("/", 1)[1])
        found = method.evidence(self.model, self.shared, mode, cell_seed(self.study, name))
        self.store.write(CellResult(name, key, asdict(found), {}, found.outcome, found.seconds))


def _save_whole(posterior: Any, file: Path) -> None:
    """Write the netCDF beside its place and move it there, so that a kill leaves no part of it."""
    file.parent.mkdir(parents=True, exist_ok=True)
    partial = file.with_name(f".{file.name}.tmp")
    diagnostics.save(posterior, partial)
    partial.replace(file)
