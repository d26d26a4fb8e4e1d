"""What each cell of a candidate computes; each reads what it needs from the store and writes one result."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property

import numpy as np

from bayesdamp.config import SignalSpec, Study
from bayesdamp.config.checks import plain
from bayesdamp.estimators import ESTIMATORS
from bayesdamp.estimators import run as run_estimator
from bayesdamp.inference.checks.checks import check_fit
from bayesdamp.inference.evidence import EVIDENCES
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.fit.search import find_mode
from bayesdamp.inference.fit.starting_points import prior_starts
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.noise import NOISES
from bayesdamp.inference.samplers import SAMPLERS
from bayesdamp.outcomes import following
from bayesdamp.physics.damping import PAPER_TERMS, TERMS, parse_model
from bayesdamp.physics.restoring import LAWS
from bayesdamp.pipeline.candidates.backbones import compute_curve
from bayesdamp.pipeline.candidates.posteriors import compute_posterior
from bayesdamp.pipeline.candidates.sensitivity import compute_sensitivity, sensitivity_cells
from bayesdamp.pipeline.candidates.weighing import compute_evidence, evidence_parts
from bayesdamp.pipeline.keys import task_key, uses_library
from bayesdamp.pipeline.records.noise import NoiseCell, noise_cell
from bayesdamp.pipeline.records.records import NOT_APPLICABLE, SignalCell, cell_seed, plain_seconds
from bayesdamp.pipeline.records.starts import REGRESSION, observed, of_all, regression
from bayesdamp.pipeline.records.stored_modes import alone, packed, unpacked
from bayesdamp.pipeline.records.targets import Record
from bayesdamp.store import CellResult, Store
from bayesdamp.store.contents.candidates import BesideIt, Part, SecondHalf
from bayesdamp.store.contents.estimates import EstimateContent, StageFound
from bayesdamp.store.contents.records import NoiseContent
from bayesdamp.types import OK, Problem, Refusal, System, candidate_parts

PRIOR_SEEDS = 2
"""Draws from the prior that are climbed from beside the estimates."""
CHECKS = ("fit", "residual", "whitened", "autocorrelation")
"""What of the checks of a fit is stored as arrays."""


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
            method = use.method(name)
            library = PAPER_TERMS if uses_library(method) else ()
            own = [ESTIMATORS.source(method), *map(TERMS.source, library), *self._forces]
            key = task_key(
                "estimate", self.parent.key, self.model, method, use.stages, options, own, *self._other
            )
            found[f"estimate/{self.path}/{name}"] = key
        if not (self.study.posterior.samplers or self.study.evidence.methods):
            return found
        priors = {t: str(self.study.models.prior.get(t)) for t in self.terms}
        noise = self.noise_cell.key if self.noise_cell else self.study.noises[0]
        shared = ("shared", self.beside) if self.beside else ()
        named = [*self._forces, *map(NOISES.source, self.study.noises), ESTIMATORS.source(REGRESSION)]
        parts = (self.model, noise, priors, use.stages, chosen, *self._other, *shared)
        mode_key = task_key("mode", self.parent.key, list(found.values()), named, *parts)
        found[f"mode/{self.path}"] = mode_key
        settings = self.study.posterior
        for name in settings.samplers:
            length = (settings.chains, settings.warmup, settings.draws)
            key = task_key("posterior", mode_key, name, *length, SAMPLERS.source(name))
            found[f"posterior/{self.path}/{name}"] = key
        for name, parts in evidence_parts(self.study, self.path, found).items():
            own = [EVIDENCES.source(name.rpartition("/")[2]), SAMPLERS.source("nuts")]
            found[name] = task_key("evidence", mode_key, *parts, own)
        terms, noises = len(self.terms), len(self.study.noises)
        together = sum(s.repeats for s in self.study.specimens.get(self.spec.specimen, ())) > 1
        joined = together and not settings.samplers
        for name, source in sensitivity_cells(self.path, found, self.repeat, terms, noises, joined).items():
            found[name] = task_key("sensitivity", mode_key, source, name)
        if self.study.models.prune is not None:
            found[f"curve/{self.path}"] = task_key("curve", mode_key)
        return found

    def compute(self, name: str, key: str) -> None:
        """Compute one cell; where its record shows no oscillation, the cell says so."""
        if self.record.cell.outcome != OK:
            outcome = following(self.parent.name, self.record.cell.outcome)
            self.store.write(CellResult(name, key, outcome=outcome))
            return
        kinds = {"estimate": self.estimate, "mode": self.mode, "posterior": self.posterior}
        kinds |= {"evidence": self.evidence, "sensitivity": self.sensitivity, "curve": self.curve}
        kinds[name.partition("/")[0]](name, key)

    @property
    def _forces(self) -> list[str]:
        """The source of the damping terms and of the law, which are found by name."""
        terms = dict.fromkeys((*self.terms, *self.beside))
        return [*map(TERMS.source, terms), LAWS.source(self.restoring)]

    @cached_property
    def record(self) -> Record:
        """The record as its cell holds it."""
        return Record(self.study, self.spec, self.store.read(self.parent.name))

    @cached_property
    def system(self) -> System:
        """What is known of the system under the candidate's law."""
        return self.record.system(self.restoring)

    @cached_property
    def noise_cell(self) -> NoiseCell | None:
        """What chooses the noise, where the study does not."""
        return noise_cell(self.study, self.spec, self.repeat, self.store)

    @cached_property
    def _chosen(self) -> NoiseContent:
        """What was chosen for the record. Raises Refusal where nothing could be."""
        assert self.noise_cell is not None
        found = self.store.read(self.noise_cell.name)
        if found.outcome != OK:
            raise Refusal(following(found.name, found.outcome))
        return NoiseContent.of(found)

    @property
    def noise(self) -> str:
        """The noise model. Raises Refusal where none could be chosen."""
        return self._chosen.chosen if self.noise_cell else self.study.noises[0]

    @property
    def epsilon(self) -> float | None:
        """The friction's ε (rad/s) that suits the record better than the usual one, where nobody gave one."""
        return self._chosen.epsilon if self.noise_cell else None

    @cached_property
    def target(self) -> Target:
        """The target of this candidate alone."""
        return self.record.target(self.terms, self.restoring, self.noise, epsilon=self.epsilon)

    @cached_property
    def shared(self) -> Target:
        """The target in the program of all dampings that are compared under the law, where candidates are many."""
        return self.record.target(
            self.terms, self.restoring, self.noise, beside=self.beside, epsilon=self.epsilon
        )

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
        """The mode in the scores of `shared`. Raises Refusal where there is none."""
        found = self.store.read(f"mode/{self.path}")
        if found.outcome != OK:
            raise Refusal(following(found.name, found.outcome))
        return unpacked(found, self.shared)

    @cached_property
    def own_mode(self) -> Mode:
        """The mode in the scores of this candidate alone."""
        mode = self.restored_mode
        return alone(mode, self.shared, self.target) if self.beside else mode

    def estimate(self, name: str, key: str) -> None:
        """Store both stages of one estimator, and its curves."""
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
        content = EstimateContent(tuple(map(StageFound.holding, found)))
        trace = {f"{e.stage}/{n}": np.asarray(v) for e in found for n, v in e.trace.items()}
        self.store.write(CellResult(name, key, content.meta(), trace, OK, plain_seconds(began)))

    @property
    def _many(self) -> bool:
        """Whether there are so many candidates that one good start of each has to do."""
        return self.study.models.prune is not None

    def _seeds(self) -> tuple[dict[str, Mapping[str, float]], dict[str, str]]:
        """Every estimator's values at each of its stages, and what those said that have none; what the record's
        frequency and decay say; draws from the prior.

        With no estimator in the study, least squares'. Raises Refusal where there is nothing to start from.
        """
        seeds: dict[str, Mapping[str, float]] = {}
        refused: dict[str, str] = {}
        for method in self._methods:
            cell = self.store.read(f"estimate/{self.path}/{method}")
            for stage in EstimateContent.of(cell).stages:
                label = f"{method}, {stage.stage}"
                if stage.values and np.all(np.isfinite(list(stage.values.values()))):
                    seeds[label] = stage.values
                else:
                    refused[label] = stage.outcome
            if cell.outcome != OK:
                refused[method] = cell.outcome
        problem = Problem(self.terms, self.system)
        if not seeds:
            seeds |= regression(self.record, problem)[0]
        decays = observed(self.record, problem)
        seeds = decays | seeds
        fit = self._chosen.fits.get(self.restoring) if self._many and self.noise_cell else None
        if fit:
            seeds = of_all(fit, list(self._chosen.damping), problem, decays) | seeds
        if not seeds:
            raise Refusal("no estimator found a place to start from")
        count = 0 if self._many else PRIOR_SEEDS
        from_prior = prior_starts(self.target, count, cell_seed(self.study, f"seeds/{self.path}"))
        return seeds | from_prior, refused

    def mode(self, name: str, key: str) -> None:
        """Store the highest mode with what was checked of its fit, or why there is none."""
        began = time.perf_counter()
        if not self.record.content.noisy:
            self.store.write(CellResult(name, key, outcome=NOT_APPLICABLE))
            return
        try:
            (seeds, refused), seen = self._seeds(), self.record.seen
            mode = find_mode(
                self.shared, seeds, noise_level=seen.roughness, period=seen.period, thrifty=self._many
            )
        except Refusal as refusal:
            self.store.write(CellResult(name, key, outcome=str(refusal), seconds=plain_seconds(began)))
            return
        seed = cell_seed(self.study, f"checks/{self.spec.name}/{self.repeat}")
        fit = check_fit(self.shared, mode, self.record.seen.period, seed)
        found, scores = packed(mode, self.shared, self.target)
        later = fit.forecast
        checked = replace(
            found,
            refused=refused,
            windows=tuple(Part(**vars(w)) for w in fit.windows),
            forecast=None if later is None else SecondHalf(**vars(later)),
            rivals=tuple(BesideIt(r.words, r.log_bayes) for r in fit.rivals),
            **{k: v for k, v in vars(fit).items() if k not in (*CHECKS, "windows", "forecast", "rivals")},
        )
        arrays = {"t": self.record.signal.t, **scores, **{k: getattr(fit, k) for k in CHECKS}}
        # What comes next reads the mode from its cell, as a run that was cut off in between does: the solver's plan is
        # made anew there, and evidence on the plan that found the mode is some 1e-8 nats apart.
        self.store.write(CellResult(name, key, checked.meta(), arrays, OK, plain_seconds(began)))

    def posterior(self, name: str, key: str) -> None:
        """Store one sampler's draws and their summaries."""
        compute_posterior(self, name, key, cell_seed(self.study, name))

    def curve(self, name: str, key: str) -> None:
        """Store the damping ratio and frequency of the mode against amplitude."""
        compute_curve(self, name, key)

    def evidence(self, name: str, key: str) -> None:
        """Store one method's evidence, or why there is none."""
        compute_evidence(self, name, key, cell_seed(self.study, name))

    def sensitivity(self, name: str, key: str) -> None:
        """Store what one change of the assumptions does."""
        compute_sensitivity(self, name, key, cell_seed(self.study, name))
