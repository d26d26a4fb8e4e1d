"""Independent heavy-tailed noise."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import betainc, betaln, ndtri

from bayesdamp.inference.noise import IndependentNoise, by_sample
from bayesdamp.priors import LogNormal, Prior
from bayesdamp.records.oscillation.features import Features


class StudentT(IndependentNoise):
    """Independent residuals; r_i / noise_sd has Student's t distribution with noise_dof degrees of freedom.

    noise_sd is a scale; the standard deviation of the residuals is larger, or infinite for noise_dof ≤ 2.
    """

    parameters = ("noise_sd", "noise_dof")
    heavy_tailed = True

    def priors(self, features: Features) -> dict[str, Prior]:
        """Return, by name, lognormal priors of the scale noise_sd and of the degrees of freedom noise_dof.

        The prior of noise_sd has sigma 1 (sd of the logarithm); its median is the roughness of the record (sd of its
        noise over short windows). The prior of noise_dof has the median 6 and sigma 0.8.
        """
        return {**super().priors(features), "noise_dof": LogNormal(median=6.0, sigma=0.8)}

    def start(self, r: np.ndarray, gaps: np.ndarray) -> dict[str, float]:
        """Return start values by name: noise_sd, 1.4826 times the median absolute residual, and noise_dof, always 6.

        r: residuals in the unit of the record, (n,). gaps has no effect.
        """
        return {"noise_sd": float(1.4826 * np.median(np.abs(r)) + 1e-300), "noise_dof": 6.0}

    def log_density(self, r: np.ndarray, p: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the log of Student's density (nats) of each residual, (..., n).

        r: residuals in the unit of the record. p: the scale noise_sd and the degrees of freedom noise_dof, by name.
        """
        sd, dof = p["noise_sd"], p["noise_dof"]
        constant = betaln(0.5 * dof, 0.5) + 0.5 * np.log(dof) + np.log(sd)
        return -0.5 * (dof + 1) * np.log1p(np.square(r / sd) / dof) - constant

    def slope(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the derivative of the log density by each residual, −(ν + 1) r / (ν σ² + r²), (..., n).

        r: residuals in the unit of the record, (..., n). σ is noise_sd and ν is noise_dof in p. gaps has no effect.
        """
        p = by_sample(p)
        sd, dof = p["noise_sd"], p["noise_dof"]
        return -(dof + 1) * r / (dof * sd**2 + np.square(r))

    def information_root(self, v: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return v/σ √((ν + 1)/(ν + 3)), (..., n), from the Fisher information of Student's t distribution.

        The sum of squares of the result is the information about the shift v of the record, (..., n). σ is noise_sd and
        ν is noise_dof. gaps has no effect.
        """
        p = by_sample(p)
        return v / p["noise_sd"] * np.sqrt((p["noise_dof"] + 1) / (p["noise_dof"] + 3))

    def whiten(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return whitened residuals, (..., n): the standard normal quantiles of their cumulative probabilities.

        The probabilities are those of the residuals r under Student's t distribution with the scale noise_sd and
        noise_dof degrees of freedom, both in p. The map is not linear in r. gaps has no effect.
        """
        p = by_sample(p)
        t, dof = r / p["noise_sd"], p["noise_dof"]
        tail = 0.5 * betainc(0.5 * dof, 0.5, dof / (dof + t**2))
        return -np.sign(t) * ndtri(np.clip(tail, 1e-300, 0.5))

    def draw(self, rng: np.random.Generator, gaps: np.ndarray, p: Mapping[str, float]) -> np.ndarray:
        """Draw independent noise, (n,): Student's t with noise_dof degrees of freedom, times noise_sd (both in p).

        Only the size of gaps, (n − 1,), has an effect.
        """
        return p["noise_sd"] * rng.standard_t(p["noise_dof"], gaps.size + 1)


PLUGIN = StudentT()
