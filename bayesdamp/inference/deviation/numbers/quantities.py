"""Numbers with their intervals, from draws."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Quantity:
    """A number: median, 95 % interval, and the parts of its standard deviation from noise and from the law."""

    value: float
    low: float
    high: float
    sd_noise: float = float("nan")
    sd_law: float = float("nan")


def quantity(values: np.ndarray, noise: float = float("nan")) -> Quantity:
    """Median and 95 % interval of draws, (n,). noise: the part of their standard deviation that noise has."""
    low, middle, high = (float(q) for q in np.quantile(values, (0.025, 0.5, 0.975)))
    law = float(np.sqrt(max(float(np.var(values)) - noise**2, 0.0))) if np.isfinite(noise) else float("nan")
    return Quantity(middle, low, high, noise, law)
