"""What is stored of an estimator's answers."""

from __future__ import annotations

from dataclasses import dataclass

from bayesdamp.store.contents.content import Content
from bayesdamp.types import Estimate


@dataclass(frozen=True)
class EstimateContent(Content):
    """One estimator on one candidate (`estimate/NAME/REPEAT/CANDIDATE/ESTIMATOR`), in the order of its stages, without
    their curves: these are the cell's arrays, STAGE/NAME."""

    stages: tuple[Estimate, ...] = ()
