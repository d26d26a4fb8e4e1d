"""What is stored of a chunk of calibration's records."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from bayesdamp.store.contents.content import Content


@dataclass(frozen=True)
class ChunkContent(Content):
    """A chunk of records that were drawn and fitted, or refused: each one's outcome, and whether it counts; first:
    number of the first of them."""

    outcomes: tuple[str, ...] = ()
    accepted: tuple[bool, ...] = ()
    first: int = 0


@dataclass(frozen=True)
class RanksContent(ChunkContent):
    """Of one model (`ranks/MODEL/FIRST`): names of what is ranked, outcomes of each sampler by record, and seconds by
    sampler and under "record"."""

    model: str = ""
    names: tuple[str, ...] = ()
    sampler_outcomes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class RecoveryContent(ChunkContent):
    """Of model recovery (`recovery/FIRST`, `single/FIRST`): models, and what the evidence of each says, by record."""

    models: tuple[str, ...] = ()
    evidence_outcomes: tuple[tuple[str, ...], ...] = ()
