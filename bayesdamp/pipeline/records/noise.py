"""The noise of a record, and how sharply its friction turns over, chosen once for all candidates on it."""

from __future__ import annotations

import time

from bayesdamp.config import SignalSpec, Study
from bayesdamp.config.checks import plain
from bayesdamp.estimators import ESTIMATORS
from bayesdamp.inference.fit.friction_choice import SHARES, WORTH, epsilon_note, weigh_epsilons
from bayesdamp.inference.fit.noise_choice import Fitted, chosen_noise, first_noise, weigh_noises
from bayesdamp.inference.noise import NOISES
from bayesdamp.outcomes import following
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS
from bayesdamp.pipeline.keys import task_key
from bayesdamp.pipeline.records.law_fits import LawFit, all_terms
from bayesdamp.pipeline.records.records import NOT_APPLICABLE, SignalCell
from bayesdamp.pipeline.records.starts import REGRESSION
from bayesdamp.pipeline.records.targets import Record
from bayesdamp.store import CellResult, Store
from bayesdamp.store.contents.candidates import ModeContent
from bayesdamp.store.contents.records import NoiseContent, NoiseTried, RecordContent, WidthTried
from bayesdamp.types import OK, Refusal


class NoiseCell:
    """The evidence of each noise model in play on one record, under all damping terms in play."""

    def __init__(self, study: Study, spec: SignalSpec, repeat: int, store: Store) -> None:
        self.study, self.spec, self.repeat, self.store = study, spec, repeat, store
        self.parent = SignalCell(study, spec, repeat, store)
        self.name = f"noise/{spec.name}/{repeat}"
        self.terms = all_terms(study, spec)
        self.fits = {law: LawFit(study, spec, repeat, law, store) for law in spec.restoring}

    @property
    def key(self) -> str:
        """Of the record, the noise models and terms in play, and the fits under each law."""
        return self.store.key(self.name, (self.study, self.spec), self._key)

    def _key(self) -> str:
        priors = {t: str(self.study.models.prior.get(t)) for t in self.terms}
        laws = [plain(self.spec.under(law)) for law in self.spec.restoring]
        named = [*map(TERMS.source, self.terms), *map(LAWS.source, self.spec.restoring)]
        named += [*map(NOISES.source, self.study.noises), ESTIMATORS.source(REGRESSION)]
        parts = (
            self.study.noises,
            self.terms,
            priors,
            laws,
            SHARES,
            WORTH,
            [one.key for one in self.fits.values()],
        )
        return task_key("noise", self.parent.key, *parts, named)

    def compute(self) -> None:
        """Store what was chosen, or why nothing could be."""
        began = time.perf_counter()
        cell = self.store.read(self.parent.name)
        outcome, meta = following(cell.name, cell.outcome), {}
        if outcome == OK and not RecordContent.of(cell).noisy:
            outcome = NOT_APPLICABLE
        if outcome == OK:
            try:
                meta = self._weigh(Record(self.study, self.spec, cell)).meta()
            except Refusal as refusal:
                outcome = str(refusal)
        self.store.write(CellResult(self.name, self.key, meta, {}, outcome, time.perf_counter() - began))

    def _weigh(self, record: Record) -> NoiseContent:
        """Under the restoring law that fits best with all damping terms, so that no noise makes up for a term that is
        missing or for a wrong law."""
        names = self.study.noises
        first = first_noise(names, record.signal)
        found: dict[str, ModeContent] = {}
        refused: list[str] = []
        for law, one in self.fits.items():
            try:
                found[law] = one.found()
            except Refusal as refusal:
                refused.append(f"{law}: {refusal}")
        if not found:
            raise Refusal("; ".join(refused))
        best = max(found, key=lambda law: found[law].log_evidence)
        fit = usual_fit = self.fits[best].restored()
        tried, usual = [], None
        if self._open_friction(record, best):
            peak = record.reference.peak_velocity
            usual = fit.target.known["epsilon"]
            fit, tried = weigh_epsilons(
                lambda epsilon: record.target(self.terms, best, first, epsilon=epsilon),
                fit,
                peak,
                record.seen,
            )
        epsilon = None if fit is usual_fit else fit.target.known["epsilon"]
        weighed = weigh_noises(
            lambda name: record.target(self.terms, best, name, epsilon=epsilon), fit, record.seen, names
        )
        return NoiseContent(
            chosen=chosen_noise(weighed),
            damping=self.terms,
            restoring=best,
            fits={law: one.values for law, one in found.items()} | {best: _values(fit)},
            weighed=tuple(NoiseTried(**vars(w)) for w in weighed),
            epsilon=epsilon,
            usual_epsilon=usual,
            epsilon_unit=f"{record.signal.unit}/s",
            epsilons=tuple(WidthTried(**vars(t)) for t in tried),
            friction=tuple(t.parameter for t in Oscillator(self.terms, best).terms if t.switches),
            epsilon_note=epsilon_note(tried, epsilon, record.signal.unit),
        )

    def _open_friction(self, record: Record, law: str) -> bool:
        """Whether friction is among the dampings and nobody said, or asked, how sharply it turns over."""
        system = self.spec.under(law)
        return Oscillator(self.terms, law).switches and not {"epsilon"} & {*system.known, *system.free}


def _values(fit: Fitted) -> dict[str, float]:
    """A fit's inferred parameters by name."""
    return {name: float(v) for name, v in fit.target.values(fit.mode.z).items()}


def has_noise_cell(study: Study) -> bool:
    """Whether the noise of a study's records is to be chosen: not where the study has chosen, or nothing needs it."""
    return bool(study.posterior.samplers or study.evidence.methods) and len(study.noises) > 1


def noise_cell(study: Study, spec: SignalSpec, repeat: int, store: Store) -> NoiseCell | None:
    """The cell that chooses a record's noise; None where there is no choice."""
    return NoiseCell(study, spec, repeat, store) if has_noise_cell(study) else None
