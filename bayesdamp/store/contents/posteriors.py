"""What is stored of a posterior, and of the average over several."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from bayesdamp.store.contents.content import Content
from bayesdamp.types import Posterior, Ratio

NAN = float("nan")
NO_DRAWS = np.empty((0, 0, 0)), np.empty((0, 0))
"""Draws and log likelihoods of a posterior that has none."""


@dataclass(frozen=True)
class PosteriorContent(Content):
    """One sampler's draws (`posterior/NAME/REPEAT/CANDIDATE/SAMPLER`).

    posterior: without its arrays; the cell has `draws`, (chain, draw, parameter). summary, units: of the parameters and
    of what follows from them, at the reference amplitude (unit of displacement); without: derived quantities that have
    no summary, by how many draws have no such motion. file: whole, in the run's folder. ratios: where laws may hold
    approximately, the damping ratio at the verdict's amplitudes.
    """

    posterior: Posterior = field(default_factory=lambda: Posterior("", (), *NO_DRAWS))
    units: Mapping[str, str] = field(default_factory=dict)
    summary: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    reference_amplitude: float = NAN
    without: Mapping[str, int] = field(default_factory=dict)
    file: str = ""
    ratios: tuple[Ratio, ...] = ()


@dataclass(frozen=True)
class AverageContent(Content):
    """The damping against amplitude averaged over the models (`averaged/NAME/0`).

    probabilities: of the models, by which evidence method; covered: what the averaged ones hold together; weighed: what
    was averaged by the weighted draws of its evidence, having no posterior.
    """

    probabilities: Mapping[str, float]
    method: str
    covered: float = 1.0
    weighed: tuple[str, ...] = ()
