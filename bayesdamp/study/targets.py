"""A record as its cell holds it, and the targets on it."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

from bayesdamp.config import SignalSpec, Study
from bayesdamp.inference.build import build_target
from bayesdamp.inference.defaults import Reference
from bayesdamp.inference.target import Target
from bayesdamp.signals.features import Features, features
from bayesdamp.store import CellResult
from bayesdamp.study.records import signal_of
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
    def seen(self) -> Features:
        return features(self.signal)

    def system(self, law: str) -> System:
        """The system under a law; a friction's ε that was not given is the one that follows from the record."""
        system = self.spec.under(law)
        epsilon = {k: v for k, v in self.cell.meta["known"].items() if k == "epsilon"}
        return replace(system, known={**system.known, **epsilon})

    def target(
        self,
        terms: tuple[str, ...],
        law: str,
        noise: str,
        *,
        beside: tuple[str, ...] = (),
        reference: Reference | None = None,
    ) -> Target:
        """The target of damping terms under a law. Raises Refusal where the record is not one for this noise.

        beside: as in `build_target`. reference: that of several records, from which an ε that was not given follows
        too; without one, the record's own.
        """
        own = reference is None
        return build_target(
            self.signal,
            terms,
            self.system(law) if own else self.spec.under(law),
            self.seen,
            Reference(**self.cell.meta["reference"]) if own else reference,
            noise=noise,
            term_priors={t: p for t, p in self.study.models.prior.items() if t in terms},
            beside=beside,
        )
