"""What each cell of a candidate computes; each reads what it needs from the store and writes one result."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import asdict, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from bayesdamp.config import SignalSpec, Study
from bayesdamp.config.checks import plain
from bayesdamp.estimators import run as run_estimator
from bayesdamp.inference import diagnostics
from bayesdamp.inference.checks import check_fit, value_sds
from bayesdamp.inference.derived import Motions, against_amplitude, derive, units
from bayesdamp.inference.mode import Climb, Mode, find_mode, restore_mode
from bayesdamp.inference.samplers import SAMPLERS, Settings
from bayesdamp.inference.seeds import basins, prior_seeds
from bayesdamp.inference.target import Target
from bayesdamp.physics.damping import parse_model
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.units import parameter_unit
from bayesdamp.store import CellResult, Store
from bayesdamp.study.averaging import CURVE, LEVELS, SPREAD
from bayesdamp.study.noise import NoiseCell, noise_cell
from bayesdamp.study.records import NOT_APPLICABLE, SignalCell, cell_seed, digest, plain_seconds
from bayesdamp.study.sensitivity import compute_sensitivity, sensitivity_cells
from bayesdamp.study.targets import Record
from bayesdamp.study.weighing import compute_evidence, evidence_parts
from bayesdamp.types import OK, Posterior, Problem, Refusal, System, candidate_parts

SUMMARIES = {"ensembles": "ensembles", "effective": "effective_draws"}
"""What `summarise` is to know of a sampler's draws, and where its diagnostics say it."""
CURVE_POINTS = 25
PRIOR_SEEDS = 2
"""Draws from the prior that are climbed from beside the estimates."""
CLIMB = ("seed", "same", "start", "end", "evaluations", "volume", "converged")
"""What of a climb is stored as it is; its scores are arrays."""
FAINTEST = 0.02
"""Least amplitude, as a share of the first, at which a damping is given against amplitude."""


class Branch:
    """One candidate on one record: its estimates, mode, posteriors and evidence, each a cell.

    model: the candidate's name, of which terms and restoring are the two parts.
    """

    def __init__(self, study: Study, spec: SignalSpec, repeat: int, model: str, store: Store) -> None:
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
        noise = self.noise_cell.key if self.noise_cell else self.study.noises[0]
        shared = ("shared", self.beside) if self.beside else ()
        parts = (self.model, noise, priors, use.stages, chosen, *self._other, *shared)
        mode_key = digest("mode", self.parent.key, *parts)
        found[f"mode/{self.path}"] = mode_key
        settings = self.study.posterior
        for name in settings.samplers:
            key = digest("posterior", mode_key, name, settings.chains, settings.warmup, settings.draws)
            found[f"posterior/{self.path}/{name}"] = key
        for name, parts in evidence_parts(self.study, self.path, found).items():
            found[name] = digest("evidence", mode_key, *parts)
        for name, source in sensitivity_cells(self.path, found, self.repeat, len(self.terms)).items():
            found[name] = digest("sensitivity", source, name)
        if self.study.models.prune is not None:
            found[f"curve/{self.path}"] = digest("curve", mode_key)
        return found

    def compute(self, name: str, key: str) -> None:
        """Compute one cell; where its record shows no oscillation, the cell says so."""
        if self.record.cell.outcome != OK:
            self.store.write(CellResult(name, key, outcome=self.record.cell.outcome))
            return
        kinds = {"estimate": self.estimate, "mode": self.mode, "posterior": self.posterior}
        kinds |= {"evidence": self.evidence, "sensitivity": self.sensitivity, "curve": self.curve}
        kinds[name.partition("/")[0]](name, key)

    @cached_property
    def record(self) -> Record:
        return Record(self.study, self.spec, self.store.read(self.parent.name))

    @cached_property
    def system(self) -> System:
        return self.record.system(self.restoring)

    @cached_property
    def noise_cell(self) -> NoiseCell | None:
        """What chooses the noise, where the study does not."""
        return noise_cell(self.study, self.spec, self.repeat, self.store)

    @cached_property
    def noise(self) -> str:
        """The noise model. Raises Refusal where none could be chosen."""
        if self.noise_cell is None:
            return self.study.noises[0]
        found = self.store.read(self.noise_cell.name)
        if found.outcome != OK:
            raise Refusal(found.outcome)
        return found.meta["chosen"]

    @cached_property
    def target(self) -> Target:
        """The target of this candidate alone."""
        return self.record.target(self.terms, self.restoring, self.noise)

    @cached_property
    def shared(self) -> Target:
        """The target in the program of all dampings that are compared under the law, where candidates are many."""
        return self.record.target(self.terms, self.restoring, self.noise, beside=self.beside)

    @cached_property
    def beside(self) -> tuple[str, ...]:
        """The terms of all dampings compared, where the candidates share a program.

        None where each has its own: without a known ε, or with an exact switch, of which a candidate without friction
        need not know.
        """
        system = self.spec.under(self.restoring)
        if "epsilon" in system.free or system.known.get("epsilon") == 0.0:
            return ()
        every = [parse_model(m) for m in self.study.dampings(self.spec)]
        whole = max(every, key=len)
        return whole if all(set(terms) <= set(whole) for terms in every) else ()

    @cached_property
    def restored_mode(self) -> Mode:
        found = self.store.read(f"mode/{self.path}")
        if found.outcome != OK:
            raise Refusal(found.outcome)
        m, a = found.meta, found.arrays
        own = [{k: v for k, v in c.items() if k in CLIMB} for c in m["climbs"]]
        climbs = tuple(
            Climb(**c, origin=origin, z=z)
            for c, origin, z in zip(own, a["climbs/origin"], a["climbs/z"], strict=True)
        )
        return restore_mode(self.shared, a["z"], m["log_posterior"], a["information"], m["tolerance"], climbs)

    @cached_property
    def own_mode(self) -> Mode:
        """The mode in the scores of this candidate alone."""
        mode = self.restored_mode
        if not self.beside:
            return mode
        live = [i for i, n in enumerate(self.shared.names) if n in self.target.names]
        return restore_mode(
            self.target,
            mode.z[live],
            mode.log_posterior,
            mode.information[np.ix_(live, live)],
            mode.tolerance,
            tuple(replace(c, origin=c.origin[live], z=c.z[live]) for c in mode.climbs),
        )

    def estimate(self, name: str, key: str) -> None:
        began = time.perf_counter()
        method, use = name.rsplit("/", 1)[1], self.study.estimators
        found = run_estimator(
            use.method(method),
            self.record.signal,
            Problem(self.terms, self.system),
            options=use.options.get(method),
            stages=use.stages,
            seed=cell_seed(self.study, name),
        )
        stages = [{k: v for k, v in asdict(e).items() if k not in ("trace", "estimator")} for e in found]
        trace = {f"{e.stage}/{n}": np.asarray(v) for e in found for n, v in e.trace.items()}
        self.store.write(CellResult(name, key, {"stages": stages}, trace, OK, plain_seconds(began)))

    def _seeds(self) -> tuple[dict[str, Mapping[str, float]], dict[str, str]]:
        """Every estimator's values at each of its stages, and what those said that have none; draws from the prior too.

        With no estimator in the study, least squares'. Raises Refusal where no estimator has values.
        """
        seeds: dict[str, Mapping[str, float]] = {}
        refused: dict[str, str] = {}
        for method in self._methods:
            cell = self.store.read(f"estimate/{self.path}/{method}")
            for stage in cell.meta.get("stages", []):
                label = f"{method}, {stage['stage']}"
                if stage["values"] and np.all(np.isfinite(list(stage["values"].values()))):
                    seeds[label] = stage["values"]
                else:
                    refused[label] = stage["outcome"]
            if cell.outcome != OK:
                refused[method] = cell.outcome
        if not seeds:
            for e in run_estimator(
                "least_squares", self.record.signal, Problem(self.terms, self.system), seed=0
            ):
                if e.values:
                    seeds[f"least_squares, {e.stage}"] = e.values
        if not seeds:
            raise Refusal("no estimator found a place to start from")
        # Of many candidates the estimates alone are climbed from.
        count = PRIOR_SEEDS if self.study.models.prune is None else 0
        from_prior = prior_seeds(self.target, count, cell_seed(self.study, f"seeds/{self.path}"))
        return seeds | from_prior, refused

    def mode(self, name: str, key: str) -> None:
        began = time.perf_counter()
        if not self.record.cell.meta["noisy"]:
            self.store.write(CellResult(name, key, outcome=NOT_APPLICABLE))
            return
        try:
            seeds, refused = self._seeds()
            mode = find_mode(self.shared, seeds, noise_level=self.record.seen.roughness)
        except Refusal as refusal:
            self.store.write(CellResult(name, key, outcome=str(refusal), seconds=plain_seconds(began)))
            return
        target, own = self.shared, self.target.priors
        fit = check_fit(target, mode, self.record.seen.period, cell_seed(self.study, name))
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
            **_climbs(self.shared, mode, self.target.names),
            "refused": refused,
            "windows": [asdict(w) for w in fit.windows],
            **{k: v for k, v in asdict(fit).items() if k not in (*checks, "windows")},
        }
        arrays = {"t": self.record.signal.t, "z": mode.z, "information": mode.information}
        arrays |= {f"climbs/{k}": np.array([getattr(c, k) for c in mode.climbs]) for k in ("origin", "z")}
        arrays |= {k: getattr(fit, k) for k in checks}
        self.restored_mode = mode
        self.store.write(CellResult(name, key, meta, arrays, OK, plain_seconds(began)))

    def posterior(self, name: str, key: str) -> None:
        sampler, s = name.rsplit("/", 1)[1], self.study.posterior
        plugin = SAMPLERS.get(sampler)
        settings = Settings(s.chains, s.warmup, s.draws, cell_seed(self.study, name) % 2**31)
        try:
            # An approximation is one of the candidate's own parameters.
            alone = plugin.approximate
            target, mode = (self.target, self.own_mode) if alone else (self.shared, self.restored_mode)
            found = plugin.sample(target, mode, settings)
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
        sig = self.record.signal
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
        amplitude = self.record.cell.meta["reference"]["amplitude"]
        return Motions(self.target.oscillator, values, self.record.seen.rest, amplitude, self.spec.inertia)

    def _grid(self) -> np.ndarray:
        """Amplitudes from the record's last to its first, shape (m,)."""
        first, last = self.record.seen.amplitude, self.record.seen.final_amplitude
        return np.geomspace(max(min(first, last), FAINTEST * first), first, CURVE_POINTS)

    def _curves(self, motions: Motions) -> dict[str, np.ndarray]:
        """Decrement and equivalent ratio over the amplitudes of the record; those that have no motion are left out."""
        grid = self._grid()
        curves = against_amplitude(motions, grid, (*LEVELS, *SPREAD))
        whole = np.all([np.all(np.isfinite(c), axis=0) for c in curves.values()], axis=0)
        band = {f"curve/{n}": c[: len(LEVELS), whole] for n, c in curves.items()}
        return {"amplitudes": grid[whole], **band, f"spread/{CURVE}": curves[CURVE][len(LEVELS) :, whole]}

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
        at = Motions(oscillator, values, self.record.seen.rest, self.record.seen.amplitude).at(grid)
        ratio = np.asarray(at.lost / (grid * at.slope)) / (2 * np.pi)
        arrays = {"amplitude": grid, "ratio": ratio, "frequency": 2 * np.pi / np.asarray(at.period)}
        self.store.write(CellResult(name, key, {}, arrays, OK, plain_seconds(began)))

    def evidence(self, name: str, key: str) -> None:
        compute_evidence(self, name, key, cell_seed(self.study, name))

    def sensitivity(self, name: str, key: str) -> None:
        compute_sensitivity(self, name, key, cell_seed(self.study, name))


def _climbs(target: Target, mode: Mode, own: tuple[str, ...]) -> dict[str, Any]:
    """What the seeds came to, as the mode's cell keeps it, and the modes that they found.

    own: names of the candidate's own parameters.
    """
    found, where = basins(mode)
    rows = []
    for c, number in zip(mode.climbs, where, strict=True):
        away = c.origin - mode.z
        distance = float(np.sqrt(max(away @ mode.information @ away, 0.0)))
        rows.append({**{k: getattr(c, k) for k in CLIMB}, "distance": distance, "mode": number})
    modes = [
        {
            "log_posterior": b.log_posterior,
            "share": b.share,
            "values": {n: float(v) for n, v in target.values(b.z).items() if n in own},
        }
        for b in found
    ]
    sd = mode.sd()
    touching = [
        n
        for n, z, s, f in zip(target.names, mode.z, sd, target.layout.folded, strict=True)
        if f and n in own and abs(z) < s
    ]
    return {"climbs": rows, "modes": modes, "touching_zero": touching}


def _save_whole(posterior: Any, file: Path) -> None:
    """Write the netCDF beside its place and move it there, so that a kill leaves no part of it."""
    file.parent.mkdir(parents=True, exist_ok=True)
    partial = file.with_name(f".{file.name}.tmp")
    diagnostics.save(posterior, partial)
    partial.replace(file)
