"""Normal noise on samples that are rounded to multiples of the recording step."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import erfcx, log_ndtr

from bayesdamp.inference.noise import IndependentNoise, by_sample
from bayesdamp.types import Refusal, Signal


class QuantisedNoise(IndependentNoise):
    """Independent normal noise of standard deviation noise_sd, on samples that are rounded to multiples of noise_step.

    The likelihood of a sample is the probability of the interval of length noise_step around it. It is divided by
    noise_step, so that it is a density and can be compared with those of the other models.
    """

    constants = ("noise_step",)

    def read(self, signal: Signal) -> dict[str, float]:
        """Return the recording step of the signal, in its unit, under the key `noise_step`.

        The values of the signal are multiples of this step. Raises Refusal if they are not rounded to such a step.
        """
        if not signal.step > 0:
            raise Refusal(
                "the record's values are not rounded to multiples of a recording step; use noise gaussian instead of "
                "quantised"
            )
        return {"noise_step": signal.step}

    def log_density(self, r: np.ndarray, p: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the log density of each residual, log{[Φ((step/2 − r)/σ) − Φ((−step/2 − r)/σ)]/step}, (..., n).

        r: residuals, (..., n), in the unit of the record. σ is noise_sd and step is noise_step in p; Φ is the standard
        normal distribution function.
        """
        top, log_fraction = _log_probability(r, p["noise_sd"], p["noise_step"])
        return top + log_fraction - np.log(p["noise_step"])

    def slope(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the derivative of the log density by each residual, (..., n).

        It is the normal density at the upper end of the interval of length noise_step around the residual, minus that
        at the lower end, divided by the probability of the interval. gaps has no effect.
        """
        p = by_sample(p)
        sd, step = p["noise_sd"], p["noise_step"]
        _, log_fraction = _log_probability(r, sd, step)
        # φ(x)/Φ(x) from the scaled error function and φ(far)/φ(near) from its exponent do not underflow in the tails.
        hazard = np.sqrt(2 / np.pi) / erfcx((np.abs(r) - 0.5 * step) / sd / np.sqrt(2))
        return np.sign(r) * hazard * np.expm1(-step * np.abs(r) / sd**2) * np.exp(-log_fraction) / sd

    def information_root(self, v: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return v/√(noise_sd² + step²/12), (..., n), for a shift v of the record; step is noise_step.

        Rounding adds the variance step²/12 (Sheppard, 1898). Its sum of squares is the approximate Fisher information
        about the shift. v: change of each sample in the unit of the record, (..., n). gaps has no effect.
        """
        p = by_sample(p)
        return v / np.sqrt(p["noise_sd"] ** 2 + p["noise_step"] ** 2 / 12)

    def whiten(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return residuals r, (..., n), divided by their standard deviation √(noise_sd² + noise_step²/12).

        p: noise_sd and noise_step by name. gaps has no effect.
        """
        return self.information_root(r, gaps, p)

    def draw(self, rng: np.random.Generator, gaps: np.ndarray, p: Mapping[str, float]) -> np.ndarray:
        """Draw the errors of rounded samples, (n,): normal noise plus the error of rounding to multiples of noise_step.

        The exact values before rounding are drawn uniformly within a step, whatever the motion is, so that motion plus
        draws are not multiples of noise_step. p: noise_sd and noise_step by name. Only the size of gaps, (n − 1,), has
        an effect.
        """
        n, step = gaps.size + 1, p["noise_step"]
        motion, normal = rng.uniform(-0.5, 0.5, n) * step, p["noise_sd"] * rng.standard_normal(n)
        return step * np.round((motion + normal) / step) - motion


def _log_probability(r: np.ndarray, sd: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return log Φ(near) and log (1 − Φ(far)/Φ(near)), where near = (step/2 − |r|)/sd and far = (−step/2 − |r|)/sd.

    Φ is the standard normal distribution function. The sum of both is the log probability of the interval around |r|,
    log [Φ(near) − Φ(far)]. It is computed in the lower tail, where differences of probabilities are accurate.
    """
    top = log_ndtr((0.5 * step - np.abs(r)) / sd)
    bottom = log_ndtr((-0.5 * step - np.abs(r)) / sd)
    return top, np.log(-np.expm1(bottom - top))


PLUGIN = QuantisedNoise()
