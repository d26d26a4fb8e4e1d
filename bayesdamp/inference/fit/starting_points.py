"""Where searches and chains start, and which modes the searches found."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bayesdamp.inference.fit.mode import LocalSearch, Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.types import Seed

SAME_MODE = 1.0
"""Posterior sds within which two ends are one mode."""


def prior_starts(target: Target, count: int, seed: int) -> dict[Seed, Mapping[str, float]]:
    """Draws from the prior: parameter values in natural units."""
    draws = target.prior_draws(count, np.random.default_rng(seed))
    return {
        Seed(f"prior {i + 1}", drawn=True): {n: float(v) for n, v in target.values(z).items()}
        for i, z in enumerate(draws)
    }


def reached(climb: LocalSearch) -> bool:
    """Whether a climb ended at a maximum of finite height."""
    return climb.converged and bool(np.isfinite(climb.end))


def basins(mode: Mode) -> tuple[list[tuple[LocalSearch, float]], list[int | None]]:
    """Tell the modes that the seeds reached, the highest first, and which of them each climb ended in (None: in none).

    Of each mode: the climb to it, and its share of the posterior's mass by Laplace's approximation.
    """
    order = sorted(
        (i for i, c in enumerate(mode.searches) if reached(c)), key=lambda i: -mode.searches[i].end
    )
    tops: list[int] = []
    where: list[int | None] = [None] * len(mode.searches)
    for i in order:
        for number, top in enumerate(tops):
            away = mode.searches[i].z - mode.searches[top].z
            if away @ mode.information @ away < SAME_MODE**2:
                where[i] = number
                break
        else:
            where[i] = len(tops)
            tops.append(i)
    heights = np.array([mode.searches[i].end + mode.searches[i].volume for i in tops])
    # An end without curvature has no volume, and no share.
    heights = np.where(np.isfinite(heights), heights, -np.inf)
    mass = np.exp(heights - max(heights.max(initial=-np.inf), -1e300))
    shares = mass / max(mass.sum(), 1e-300)
    return [(mode.searches[i], float(share)) for i, share in zip(tops, shares, strict=True)], where
