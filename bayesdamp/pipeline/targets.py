"""A stored record of a study, and what is known of its system."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

from bayesdamp.config import SignalSpec, Study
from bayesdamp.pipeline.records import signal_of
from bayesdamp.records.oscillation.features import Features, features
from bayesdamp.store import CellResult
from bayesdamp.store.contents import RecordContent
from bayesdamp.types import Reference, Signal, System

KEPT = 8
_SIGNALS: dict[tuple[str, str], Signal] = {}


class StudyRecord:
    """A record and what is known of its system."""

    def __init__(self, study: Study, spec: SignalSpec, cell: CellResult) -> None:
        self.study, self.spec, self.cell = study, spec, cell

    @cached_property
    def signal(self) -> Signal:
        """The signal, cached for the last few records together with the quantities that are derived of it."""
        name = self.cell.name, self.cell.key
        signal = _SIGNALS.setdefault(name, signal_of(self.cell))
        while len(_SIGNALS) > KEPT:
            del _SIGNALS[next(iter(_SIGNALS))]
        return signal

    @cached_property
    def content(self) -> RecordContent:
        """The values of its cell, without the samples."""
        return RecordContent.of(self.cell)

    @property
    def reference(self) -> Reference:
        """The scale of default priors. Raises ValueError where the record shows no oscillation."""
        return self.content.scales

    @cached_property
    def features(self) -> Features:
        """Features of the signal."""
        return features(self.signal)

    def system(self, law: str) -> System:
        """Return the system under a law; a friction's ε (rad/s) that was not given follows from the record."""
        system, epsilon = self.spec.under(law), self.content.known.get("epsilon")
        return system if epsilon is None else replace(system, known={**system.known, "epsilon": epsilon})
