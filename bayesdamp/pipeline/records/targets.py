"""A record as its cell holds it, and the targets on it."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

from bayesdamp.config import SignalSpec, Study
from bayesdamp.inference.model.build import build_target
from bayesdamp.inference.model.defaults import Reference
from bayesdamp.inference.model.target import Target
from bayesdamp.pipeline.records.records import signal_of
from bayesdamp.records.oscillation.features import Features, features
from bayesdamp.store import CellResult
from bayesdamp.store.contents.records import RecordContent
from bayesdamp.types import Signal, System

KEPT = 8
_SIGNALS: dict[tuple[str, str], Signal] = {}


class Record:
    """A record, what is known of its system, and the target of any candidate on it."""

    def __init__(self, study: Study, spec: SignalSpec, cell: CellResult) -> None:
        self.study, self.spec, self.cell = study, spec, cell

    @cached_property
    def signal(self) -> Signal:
        """Kept for the last few records: what is derived of a signal is kept with it."""
        name = self.cell.name, self.cell.key
        kept = _SIGNALS.setdefault(name, signal_of(self.cell))
        while len(_SIGNALS) > KEPT:
            del _SIGNALS[next(iter(_SIGNALS))]
        return kept

    @cached_property
    def content(self) -> RecordContent:
        """What its cell holds beside the samples."""
        return RecordContent.of(self.cell)

    @property
    def reference(self) -> Reference:
        """What default priors scale with. Raises ValueError where it shows no oscillation."""
        scales = self.content.scales
        return Reference(scales.amplitude, scales.frequency)

    @cached_property
    def seen(self) -> Features:
        """Features of the signal."""
        return features(self.signal)

    def system(self, law: str, epsilon: float | None = None) -> System:
        """The system under a law; a friction's ε (rad/s) that was not given is this, or follows from the record."""
        system, own = self.spec.under(law), self.content.known.get("epsilon")
        epsilon = own if epsilon is None else epsilon
        return system if epsilon is None else replace(system, known={**system.known, "epsilon": epsilon})

    def target(self, terms: tuple[str, ...], law: str, noise: str, *, epsilon: float | None = None) -> Target:
        """The target of damping terms under a law. Raises Refusal where the record is not one for this noise.

        epsilon: in rad/s, the one that suits the record, where it was not given.
        """
        return build_target(
            self.signal,
            terms,
            self.system(law, epsilon),
            self.seen,
            self.reference,
            noise=noise,
            term_priors={t: p for t, p in self.study.models.prior.items() if t in terms},
        )
