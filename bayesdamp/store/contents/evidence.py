"""What is stored of a candidate's evidence, and of what it depends on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from bayesdamp.store.contents.content import Content
from bayesdamp.types import OK, Evidence, Forecast, NestedRatio


@dataclass(frozen=True)
class EvidenceContent(Content):
    """One method's evidence (`evidence/NAME/REPEAT/CANDIDATE/METHOD`), whose arrays are the cell's; None where a
    referee was not called, because the others agree."""

    evidence: Evidence | None = None


@dataclass(frozen=True)
class WidthsContent(Content):
    """Evidence under other prior widths (`sensitivity/.../widths`): varied, the parameters whose priors were scaled."""

    varied: tuple[str, ...] = ()


@dataclass(frozen=True)
class HalfContent(Forecast, Content):
    """What the first half of a record says alone (`sensitivity/.../half`): its evidence, and of the second half what
    `Forecast` explains; start: of the second half, in s."""

    start: float
    log_predictive_stderr: float
    evidence: Evidence


@dataclass(frozen=True)
class UnderNoise:
    """Log evidence by Laplace's approximation (nats) under a noise model; −∞ where it has no fit."""

    log_evidence: float
    outcome: str = OK


@dataclass(frozen=True)
class NoisesContent(Content):
    """Evidence under each noise model in play (`sensitivity/.../noises`), and which was chosen."""

    chosen: str
    evidence: Mapping[str, UnderNoise]


@dataclass(frozen=True)
class RatiosContent(Content):
    """Nested ratios (`sensitivity/.../savage_dickey`), by the smaller model's name."""

    against: Mapping[str, NestedRatio]
