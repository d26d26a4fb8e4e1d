"""Normal noise, rounded to the recording step."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import erfcx, log_ndtr

from bayesdamp.inference.noise._noise import IndependentNoise, by_sample
from bayesdamp.types import Refusal, Signal


class Quantised(IndependentNoise):
    """r_i is normal noise of noise_sd, independent, rounded to a multiple of noise_step.

    The likelihood of a value is the probability of the step around it. Divided by the step it is a density, and can be
    compared with those of the other models.
    """

    name = "quantised"
    constants = ("noise_step",)

    def read(self, signal: Signal) -> dict[str, float]:
        """Return the recording step of the signal. Raises Refusal where it has none."""
        if not signal.step > 0:
            raise Refusal("the record shows no recording step: quantised noise is gaussian noise there")
        return {"noise_step": signal.step}

    def log_density(self, r: np.ndarray, p: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return log [Φ((step/2 − r)/σ) − Φ((−step/2 − r)/σ)]/step."""
        top, log_share = _log_probability(r, p["noise_sd"], p["noise_step"])
        return top + log_share - np.log(p["noise_step"])

    def slope(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the difference of the normal densities at both ends of the step over the probability between them."""
        p = by_sample(p)
        sd, step = p["noise_sd"], p["noise_step"]
        _, log_share = _log_probability(r, sd, step)
        # φ(x)/Φ(x) by the scaled error function, and φ(far)/φ(near) by its exponent: neither underflows in the tail.
        hazard = np.sqrt(2 / np.pi) / erfcx((np.abs(r) - 0.5 * step) / sd / np.sqrt(2))
        return np.sign(r) * hazard * np.expm1(-step * np.abs(r) / sd**2) * np.exp(-log_share) / sd

    def information_root(self, v: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Divide by √(σ² + step²/12), with Sheppard's correction (1898) for the information that rounding takes."""
        p = by_sample(p)
        return v / np.sqrt(p["noise_sd"] ** 2 + p["noise_step"] ** 2 / 12)

    def whiten(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Divide by √(σ² + step²/12) too."""
        return self.information_root(r, gaps, p)

    def draw(self, rng: np.random.Generator, gaps: np.ndarray, p: Mapping[str, float]) -> np.ndarray:
        """Draw normal noise, rounded where the motion is anywhere within a step."""
        n, step = gaps.size + 1, p["noise_step"]
        where, normal = rng.uniform(-0.5, 0.5, n) * step, p["noise_sd"] * rng.standard_normal(n)
        return step * np.round((where + normal) / step) - where


def _log_probability(r: np.ndarray, sd: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return log Φ(near) and log (1 − Φ(far)/Φ(near)), where near and far are the ends of the step around |r| in sds.

    The sum is the log probability of the step. By symmetry it is computed in the lower tail, where differences of
    probabilities keep their digits.
    """
    top = log_ndtr((0.5 * step - np.abs(r)) / sd)
    bottom = log_ndtr((-0.5 * step - np.abs(r)) / sd)
    return top, np.log(-np.expm1(bottom - top))


PLUGIN = Quantised()
