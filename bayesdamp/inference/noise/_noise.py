"""Noise models: their base classes, and a model on given residuals.

Of the latter: its most probable parameters, its evidence, and the working residuals of a least-squares fit.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import scipy  # loads its modules when they are used
from numpy.typing import ArrayLike

from bayesdamp.plugins import Registry
from bayesdamp.priors import LogNormal, Prior
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Refusal, Signal

DIFFERENCE = 1e-5
"""Step of central differences, relative to the noise's scale: close to the cube root of the rounding error, at which
rounding and truncation are equally large."""
GAUSSIAN, CORRELATED = "gaussian", "correlated"
STEP = 0.02
"""Step of second differences, in scores."""
SHIFT = 0.3
"""Shift for the observed information, in median absolute residuals (conventional)."""
LEAST_INFORMATION = 0.3
"""Smallest observed information, as a share of the expected one: by chance it can be negative (conventional)."""
FARTHEST = 6.0
"""Largest score at which a search for the noise's parameters starts."""


class NoiseModel(ABC):
    """Distribution of the residuals, which are the record minus the motion.

    The methods have these arguments, where (...) stands for any leading axes, such as draws:

    r: residuals in the unit of the record, shape (..., n); the last axis is time.
    gaps: times between samples in s, shape (n - 1,).
    p: values of the parameters and constants by name, each a number or an array that broadcasts to the shape (...).
    """

    name: str
    parameters: tuple[str, ...]
    constants: tuple[str, ...] = ()
    """Numbers that are read from the record, such as its recording step; they are not inferred."""
    tied: tuple[str, str] | None = None
    """Two parameters of which the data determine a combination much better than the second one."""
    heavy_tailed: bool = False
    """Whether the model allows for outliers, so that they are not reported as a misfit."""

    def read(self, signal: Signal) -> dict[str, float]:
        """Return the constants. Raises Refusal where the model does not apply to the record."""
        return {}

    @abstractmethod
    def priors(self, features: Features) -> dict[str, Prior]:
        """Return default priors. They depend on the record's features alone: all dampings have the same ones."""

    @abstractmethod
    def start(self, r: np.ndarray, gaps: np.ndarray) -> dict[str, float]:
        """Estimate the parameters from residuals, (n,), as the start of a search."""

    @abstractmethod
    def log_likelihood(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the log density of the residuals in nats, shape (...)."""

    @abstractmethod
    def slope(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the derivative of the log likelihood by each residual, shape (..., n)."""

    def parameter_slopes(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, float]) -> dict[str, float]:
        """Return the derivatives of the log likelihood of residuals (n,) by the parameters, by central differences."""
        slopes = {}
        for name in self.parameters:
            step = DIFFERENCE * abs(p[name])
            above, below = (self.log_likelihood(r, gaps, {**p, name: p[name] + s}) for s in (step, -step))
            slopes[name] = float(above - below) / (2 * step)
        return slopes

    @abstractmethod
    def information_root(self, v: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return R v, shape (..., n), where RᵀR is the Fisher information about a shift of the record by v."""

    @abstractmethod
    def whiten(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return scores, shape (..., n), that are independent and standard normal if the model holds."""

    @abstractmethod
    def log_likelihoods(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the log density of each residual given all others, shape (..., n).

        Leave-one-out cross-validation uses it.
        """

    def draw(self, rng: np.random.Generator, gaps: np.ndarray, p: Mapping[str, float]) -> np.ndarray:
        """Draw the noise of one record, shape (n,). Raises Refusal where the model cannot be drawn from."""
        raise Refusal(f"noise {self.name!r} cannot be drawn from")


class IndependentNoise(NoiseModel):
    """Noise whose residuals are independent and have a common scale `noise_sd`. `log_density` defines it.

    The other methods have defaults. Override `slope` where the derivative is known, which is faster, and
    `information_root` and `whiten` where the noise is far from normal.
    """

    parameters = ("noise_sd",)

    @abstractmethod
    def log_density(self, r: np.ndarray, p: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the log density of each residual in nats, shape (..., n); the values in p broadcast to r."""

    def priors(self, features: Features) -> dict[str, Prior]:
        """Return a lognormal prior for the scale, with the record's roughness as its median and sigma 1."""
        return {"noise_sd": LogNormal(median=features.roughness, sigma=1.0)}

    def start(self, r: np.ndarray, gaps: np.ndarray) -> dict[str, float]:
        """Estimate the scale by the root mean square of the residuals."""
        return {"noise_sd": float(np.sqrt(np.mean(r**2)))}

    def log_likelihood(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Sum the log densities."""
        return np.sum(self.log_likelihoods(r, gaps, p), axis=-1)

    def log_likelihoods(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the log densities: the other residuals do not matter."""
        return self.log_density(r, by_sample(p))

    def slope(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Differentiate the log density by central differences."""
        p = by_sample(p)
        above, below = r + DIFFERENCE * p["noise_sd"], r - DIFFERENCE * p["noise_sd"]
        return (self.log_density(above, p) - self.log_density(below, p)) / (above - below)

    def information_root(self, v: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Divide by the scale, as for normal noise."""
        return v / by_sample(p)["noise_sd"]

    def whiten(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Divide by the scale, as for normal noise."""
        return r / by_sample(p)["noise_sd"]


def by_sample(p: Mapping[str, ArrayLike]) -> dict[str, np.ndarray]:
    """Add a last axis of length 1 to each parameter, so that it broadcasts against residuals."""
    return {name: np.asarray(value, float)[..., None] for name, value in p.items()}


NOISES: Registry[NoiseModel] = Registry("bayesdamp.inference.noise", "noise model")


@dataclass(frozen=True)
class FittedNoise:
    """A noise model with the parameters that are most probable for given residuals.

    Attributes
    ----------
    name : str
        The noise model.
    values : mapping of str to float
        Its parameters and constants, in the unit of the record.
    log_evidence : float
        Log density of the residuals in nats, integrated over the parameters by Laplace's approximation.
    """

    name: str = GAUSSIAN
    values: Mapping[str, float] = field(default_factory=dict)
    log_evidence: float = float("nan")

    def variance(self, residual: np.ndarray, direction: np.ndarray, gaps: np.ndarray) -> float:
        """Compute the variance of white Gaussian noise that gives as much information about a shift of the record.

        For a shift that oscillates at one frequency, least squares under white noise of this variance is as good as
        generalised least squares (U. Grenander, Ann. Math. Stat. 25, 252 (1954)). The information is the observed one,
        from differences of the slope.

        Parameters
        ----------
        residual : ndarray, shape (n,)
            Record minus motion.
        direction : ndarray, shape (n,)
            The shift.
        gaps : ndarray, shape (n - 1,)
            Times between the samples, in s.
        """
        noise = NOISES.get(self.name)
        step = SHIFT * float(np.median(np.abs(residual)) / np.max(np.abs(direction))) * direction
        above, below = (noise.slope(residual + s, gaps, self.values) for s in (step, -step))
        observed = float(step @ (below - above)) / (2 * float(step @ step))
        root = noise.information_root(direction, gaps, self.values)
        expected = float(np.sum(root**2) / np.sum(direction**2))
        return 1.0 / max(observed, LEAST_INFORMATION * expected)

    def working_residuals(self, residual: np.ndarray, gaps: np.ndarray, variance: float) -> np.ndarray:
        """Compute residuals, (n,), whose least-squares gradient is that of the log density.

        A least-squares fit of the motion plus these, repeated until they no longer change, is at the mode of the
        noise's density (P. J. Huber, Robust Statistics, 1981, section 7.8, "modified residuals").

        Parameters
        ----------
        residual : ndarray, shape (n,)
            Record minus motion.
        gaps : ndarray, shape (n - 1,)
            Times between the samples, in s.
        variance : float
            As `variance` computes it.
        """
        return -variance * NOISES.get(self.name).slope(residual, gaps, self.values)


@dataclass(frozen=True)
class SampleNoise:
    """The noise of a record's samples.

    Attributes
    ----------
    fitted : FittedNoise
        The model that the answer uses, and its parameters.
    weighed : tuple of FittedNoise
        All models that apply to the record, on the residual of the sum of all terms, or of amplitudes and phases.
    """

    fitted: FittedNoise = field(default_factory=FittedNoise)
    weighed: tuple[FittedNoise, ...] = ()

    @property
    def name(self) -> str:
        """The noise model that the answer uses."""
        return self.fitted.name

    @property
    def likeliest(self) -> str:
        """The noise model of highest evidence, which may be the correlated one that the answer allows for otherwise."""
        return max(self.weighed, key=lambda model: model.log_evidence, default=self.fitted).name

    @property
    def ahead(self) -> float:
        """Nats by which the answer's model is ahead of Gaussian noise; nan where that was not weighed."""
        logs = {model.name: model.log_evidence for model in self.weighed}
        return logs.get(self.name, np.nan) - logs.get(GAUSSIAN, np.nan)


def fit_noise(
    name: str,
    residual: np.ndarray,
    signal: Signal,
    features: Features,
    known: Mapping[str, float] | None = None,
    priors: Mapping[str, Prior] | None = None,
) -> FittedNoise:
    """Fit a noise model to residuals.

    Parameters
    ----------
    name : str
        The noise model.
    residual : ndarray, shape (n,)
        Record minus motion.
    signal : Signal
        The record of the residuals.
    features : Features
        Features of the record; default priors depend on them.
    known, priors : mapping, optional
        Values and priors of the noise's parameters in place of the default priors.

    Raises
    ------
    Refusal
        Where the model does not apply to the record.
    """
    noise = NOISES.get(name)
    constants = {**noise.read(signal), **{n: v for n, v in (known or {}).items() if n in noise.parameters}}
    given = {n: p for n, p in (priors or {}).items() if n in noise.parameters}
    inferred = {n: p for n, p in {**noise.priors(features), **given}.items() if n not in constants}
    gaps = np.diff(signal.t)

    def values(z: np.ndarray) -> dict[str, float]:
        own = {n: float(p.value(x)) for (n, p), x in zip(inferred.items(), z, strict=True)}
        return {**own, **constants}

    def depth(z: np.ndarray) -> float:
        with np.errstate(all="ignore"):
            density = float(noise.log_likelihood(residual, gaps, values(z))) - 0.5 * float(z @ z)
        return -density if np.isfinite(density) else 1e300

    start = noise.start(residual, gaps)
    z = np.array([float(np.clip(p.score(start[n]), -FARTHEST, FARTHEST)) for n, p in inferred.items()])
    if not z.size:
        return FittedNoise(name, values(z), -depth(z))
    z = scipy.optimize.minimize(depth, z, method="Nelder-Mead", options={"xatol": 1e-4, "fatol": 1e-4}).x
    axes = STEP * np.eye(z.size)
    mixed = [
        [depth(z + a + b) - depth(z + a - b) - depth(z - a + b) + depth(z - a - b) for b in axes]
        for a in axes
    ]
    sign, log_det = np.linalg.slogdet(np.array(mixed) / (4 * STEP**2))
    return FittedNoise(name, values(z), (-depth(z) - 0.5 * float(log_det)) if sign > 0 else -np.inf)
