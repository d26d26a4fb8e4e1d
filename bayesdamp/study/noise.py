"""The noise of a record, and how sharply its friction turns over, chosen once for all candidates on it."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import asdict
from functools import cached_property
from typing import Any

from bayesdamp.config import SignalSpec, Study
from bayesdamp.config.checks import plain
from bayesdamp.config.signals import damping_order
from bayesdamp.estimators import ESTIMATORS
from bayesdamp.inference.defaults import Reference
from bayesdamp.inference.friction_choice import SHARES, WORTH, epsilon_note, weigh_epsilons
from bayesdamp.inference.noise import NOISES
from bayesdamp.inference.noise_choice import Fitted, chosen_noise, first_noise, fit_with, weigh_noises
from bayesdamp.physics.damping import TERMS, parse_model
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS
from bayesdamp.store import CellResult, Store
from bayesdamp.study.answering import AnswerCell, fits_of
from bayesdamp.study.keys import task_key
from bayesdamp.study.records import NOT_APPLICABLE, SignalCell
from bayesdamp.study.starts import REGRESSION, observed, regression
from bayesdamp.study.targets import Record
from bayesdamp.types import OK, Problem, Refusal, following


class NoiseCell:
    """The evidence of each noise model in play on one record, under all damping terms in play."""

    def __init__(self, study: Study, spec: SignalSpec, repeat: int, store: Store) -> None:
        self.study, self.spec, self.repeat, self.store = study, spec, repeat, store
        self.parent = SignalCell(study, spec, repeat, store)
        self.name = f"noise/{spec.name}/{repeat}"
        terms = {t for model in study.dampings(spec) for t in parse_model(model)}
        self.terms = tuple(t for t in damping_order() if t in terms)

    @cached_property
    def key(self) -> str:
        priors = {t: str(self.study.models.prior.get(t)) for t in self.terms}
        laws = [plain(self.spec.under(law)) for law in self.spec.restoring]
        named = [*map(TERMS.source, self.terms), *map(LAWS.source, self.spec.restoring)]
        named += [*map(NOISES.source, self.study.noises), ESTIMATORS.source(REGRESSION)]
        answer = AnswerCell(self.study, self.spec, self.repeat, self.store).key
        parts = (self.study.noises, self.terms, priors, laws, SHARES, WORTH, answer)
        return task_key("noise", self.parent.key, *parts, named)

    def compute(self) -> None:
        began = time.perf_counter()
        cell = self.store.read(self.parent.name)
        outcome, meta = following(cell.name, cell.outcome), {}
        if outcome == OK and not cell.meta["noisy"]:
            outcome = NOT_APPLICABLE
        if outcome == OK:
            try:
                meta = self._weigh(Record(self.study, self.spec, cell))
            except Refusal as refusal:
                outcome = str(refusal)
        self.store.write(CellResult(self.name, self.key, meta, {}, outcome, time.perf_counter() - began))

    def _weigh(self, record: Record) -> dict[str, Any]:
        """Under the restoring law that fits best with all damping terms, so that no noise makes up for a term that is
        missing or for a wrong law."""
        names = self.study.noises
        first = first_noise(names, record.signal)
        fits: dict[str, Fitted] = {}
        refused: list[str] = []
        begun = fits_of(self.store, self.spec.name, self.repeat)
        for law in [law for law in self.spec.restoring if law in begun] or self.spec.restoring:
            try:
                fits[law] = self._fit(record, law, first, begun.get(law))
            except Refusal as refusal:
                refused.append(f"{law}: {refusal}")
        if not fits:
            raise Refusal("; ".join(refused))
        best = max(fits, key=lambda law: fits[law].log_evidence)
        fit, tried, usual = fits[best], [], None
        if self._open_friction(record, best):
            peak = Reference(**record.cell.meta["reference"]).peak_velocity
            usual = fit.target.known["epsilon"]
            fit, tried = weigh_epsilons(
                lambda epsilon: record.target(self.terms, best, first, epsilon=epsilon),
                fit,
                peak,
                record.seen,
            )
        epsilon = None if fit is fits[best] else fit.target.known["epsilon"]
        weighed = weigh_noises(
            lambda name: record.target(self.terms, best, name, epsilon=epsilon), fit, record.seen, names
        )
        return {
            "chosen": chosen_noise(weighed),
            "damping": list(self.terms),
            "restoring": best,
            "fits": {law: _values(f) for law, f in (fits | {best: fit}).items()},
            "weighed": [asdict(w) for w in weighed],
            "epsilon": epsilon,
            "usual_epsilon": usual,
            "epsilon_unit": f"{record.signal.unit}/s",
            "epsilons": [asdict(t) for t in tried],
            "friction": [t.parameter for t in Oscillator(self.terms, best).terms if t.switches],
            "epsilon_note": epsilon_note(tried, epsilon, record.signal.unit),
        }

    def _open_friction(self, record: Record, law: str) -> bool:
        """Whether friction is among the dampings and nobody said, or asked, how sharply it turns over."""
        system = self.spec.under(law)
        return Oscillator(self.terms, law).switches and not {"epsilon"} & {*system.known, *system.free}

    def _fit(self, record: Record, law: str, noise: str, begun: Mapping[str, float] | None) -> Fitted:
        """From where the first weighing ended, if there was one; else from regression and the record's decay."""
        problem, said = Problem(self.terms, record.system(law)), ""
        seeds: dict[str, Mapping[str, float]] = {} if begun is None else {"first weighing": begun}
        if begun is None:
            # The climb is a refinement of its own.
            found, said = regression(record, problem)
            seeds = observed(record, problem) | found
        if not seeds:
            raise Refusal(said)
        return fit_with(record.target(self.terms, law, noise), seeds, record.seen)


def _values(fit: Fitted) -> dict[str, float]:
    """A fit's inferred parameters by name."""
    return {name: float(v) for name, v in fit.target.values(fit.mode.z).items()}


def noise_cell(study: Study, spec: SignalSpec, repeat: int, store: Store) -> NoiseCell | None:
    """The cell that chooses a record's noise; None where the study has chosen, or nothing needs it."""
    needed = study.posterior.samplers or study.evidence.methods
    return NoiseCell(study, spec, repeat, store) if needed and len(study.noises) > 1 else None
