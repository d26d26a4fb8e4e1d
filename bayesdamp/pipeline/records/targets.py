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
        followed = {k: v for k, v in self.content.known.items() if k == "epsilon"}
        return _knowing(self.spec.under(law), {**followed, **_of(epsilon)})

    def target(
        self,
        terms: tuple[str, ...],
        law: str,
        noise: str,
        *,
        reference: Reference | None = None,
        epsilon: float | None = None,
    ) -> Target:
        """The target of damping terms under a law. Raises Refusal where the record is not one for this noise.

        reference: that of several records, from which an ε that was not given follows
        too; without one, the record's own. epsilon: in rad/s, the one that suits the record, where it was not given.
        """
        own = reference is None
        system = self.system(law, epsilon) if own else _knowing(self.spec.under(law), _of(epsilon))
        return build_target(
            self.signal,
            terms,
            system,
            self.seen,
            self.reference if reference is None else reference,
            noise=noise,
            term_priors={t: p for t, p in self.study.models.prior.items() if t in terms},
        )


def _of(epsilon: float | None) -> dict[str, float]:
    return {} if epsilon is None else {"epsilon": epsilon}


def _knowing(system: System, more: dict[str, float]) -> System:
    return replace(system, known={**system.known, **more})
