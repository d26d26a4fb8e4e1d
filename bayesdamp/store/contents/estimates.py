"""What is stored of an estimator's answers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Self

from bayesdamp.store.contents.content import Content
from bayesdamp.types import OK, Estimate


@dataclass(frozen=True)
class StageFound:
    """An estimate at one stage, as `types.Estimate` explains it; its curves are arrays of the cell."""

    stage: str
    values: Mapping[str, float] = field(default_factory=dict)
    stderr: Mapping[str, float] = field(default_factory=dict)
    details: Mapping[str, Any] = field(default_factory=dict)
    evaluations: int = 0
    seconds: float = 0.0
    outcome: str = OK

    @classmethod
    def holding(cls, found: Estimate) -> Self:
        """Of an estimate, without its curves."""
        return cls(**{k: v for k, v in asdict(found).items() if k not in ("trace", "estimator")})


@dataclass(frozen=True)
class EstimateContent(Content):
    """One estimator on one candidate (`estimate/NAME/REPEAT/CANDIDATE/ESTIMATOR`), in the order of its stages.

    The cell's arrays are curves, STAGE/NAME.
    """

    stages: tuple[StageFound, ...] = ()
