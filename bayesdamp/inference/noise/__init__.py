"""Noise models: one class in one module each, looked up by name; their base classes, and their fit to residuals.

The fit gives the most probable parameters of the noise and the evidence of the model. It also gives working residuals:
modified residuals with which a least-squares fit finds the most probable motion.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import product

import numpy as np
import scipy  # loads its modules when they are used
from numpy.typing import ArrayLike

from bayesdamp.plugins import Plugin, Registry
from bayesdamp.priors import LogNormal, Prior
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Refusal, Signal

DERIVATIVE_STEP = 1e-5
"""Relative step of central differences: as a fraction of `noise_sd` for derivatives by a residual, and of a parameter's
value for derivatives by the parameter. It is near the cube root of the rounding error, where the errors of rounding and
of truncation are equal."""
GAUSSIAN, CORRELATED = "gaussian", "correlated"
"""Names of the noise models with independent and with correlated normal noise."""
EVIDENCE_STEP = 0.02
"""Step of the second differences from which Laplace's approximation of a noise model's evidence is computed, in units
of the standard normal scores of the noise parameters."""
INFORMATION_STEP = 0.3
"""`FittedNoise.variance` shifts residuals to compute a derivative. This is the largest shift of a residual, as a
multiple of the median absolute residual (conventional)."""
LEAST_INFORMATION = 0.3
"""Smallest observed Fisher information that `FittedNoise.variance` uses by default, as a fraction of the expected one;
a smaller one is replaced by this, because the observed one can be negative by chance (conventional)."""
LARGEST_SCORE = 6.0
"""Largest absolute value of the standard normal score of a noise parameter at which `fit_noise` starts its search. If
the score of the estimate is larger, the search starts at this value."""


class NoiseModel(Plugin, ABC):
    """A distribution of residuals, which are record minus motion.

    The methods have the following arguments, where (...) stands for any leading axes, such as draws.

    r: residuals in the unit of the record, shape (..., n); the last axis is time. gaps: times between samples in s,
    shape (n - 1,). p: values of the parameters and constants by name, each a number or an array that broadcasts to the
    shape (...).
    """

    parameters: tuple[str, ...]
    """Names of the parameters. Each is inferred, unless its value is known."""
    constants: tuple[str, ...] = ()
    """Names of numbers that `read` takes from the record and that are not inferred, such as its recording step."""
    tied: tuple[str, str] | None = None
    """Names of two parameters, if the record determines a combination of them much better than the second parameter
    alone; None if no parameters are like this. Samplers then use other coordinates for the two (`NoiseMap`)."""
    heavy_tailed: bool = False
    """True if the model allows for outliers; outliers are then not reported as a misfit."""

    def read(self, signal: Signal) -> dict[str, float]:
        """Return the values of `constants` for a record, by name; by default there are none.

        Raises Refusal if the model does not apply to the record.
        """
        return {}

    @abstractmethod
    def priors(self, features: Features) -> dict[str, Prior]:
        """Return the default priors of the parameters by name.

        They depend only on the features of the record, not on the damping model.
        """

    @abstractmethod
    def start(self, r: np.ndarray, gaps: np.ndarray) -> dict[str, float]:
        """Estimate all parameters, by name, from residuals, (n,).

        The search for the most probable parameters starts at this estimate. gaps: times between the samples in s, (n -
        1,).
        """

    @abstractmethod
    def log_likelihood(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the joint log density of all n residuals r, (..., n), in nats: (...).

        gaps: times between the samples in s, (n - 1,). p: parameters and constants of the noise by name, each a number
        or an array of shape (...).
        """

    @abstractmethod
    def slope(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the derivative of the log density (nats) of residuals r by each residual, (..., n).

        gaps: times between the samples in s, (n - 1,). p: parameters and constants of the noise by name, each a number
        or an array of shape (...).
        """

    def parameter_slopes(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, float]) -> dict[str, float]:
        """Return the derivatives of the log density of residuals r, (n,), by the parameters, by name.

        They are computed by central differences, unless a subclass has a closed form; constants have no entry. gaps:
        times between the samples in s, (n - 1,). p: parameters and constants of the noise by name.
        """
        slopes = {}
        for name in self.parameters:
            step = DERIVATIVE_STEP * abs(p[name])
            above, below = (self.log_likelihood(r, gaps, {**p, name: p[name] + s}) for s in (step, -step))
            slopes[name] = float(above - below) / (2 * step)
        return slopes

    @abstractmethod
    def information_root(self, v: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return R v, (..., n), for a shift v of the record, where RᵀR is the Fisher information about such a shift.

        v: change of each sample in the unit of the record, (..., n). The inner products of the results for several
        shifts are the Fisher information matrix of factors by which these shifts are multiplied. gaps: times between
        the samples in s, (n - 1,). p: parameters and constants of the noise by name.
        """

    @abstractmethod
    def whiten(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return whitened residuals, (..., n), which are independent and standard normal if the model is right.

        r: residuals in the unit of the record, (..., n). gaps: times between the samples in s, (n - 1,). p: parameters
        and constants of the noise by name.
        """

    @abstractmethod
    def log_likelihoods(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the log density of each residual given all others, (..., n), in nats, for cross-validation.

        r: residuals in the unit of the record, (..., n). gaps: times between the samples in s, (n - 1,). p: parameters
        and constants of the noise by name.
        """

    def draw(self, rng: np.random.Generator, gaps: np.ndarray, p: Mapping[str, float]) -> np.ndarray:
        """Draw the noise of one record, (n,), in its unit; a subclass without this method raises Refusal.

        gaps: times between the samples in s, (n - 1,). p: parameters and constants of the noise by name.
        """
        raise Refusal(f"the noise model {self.name!r} cannot be simulated, because it has no method `draw`")


class IndependentNoise(NoiseModel):
    """Independent residuals with a common scale `noise_sd`. A subclass must define only `name` and `log_density`.

    With more parameters it must also define `parameters`, `priors` and `start`. Override `slope` if the derivative is
    known, which is faster, `information_root` and `whiten` if the noise is far from normal, and `draw` for simulations.
    """

    parameters = ("noise_sd",)

    @abstractmethod
    def log_density(self, r: np.ndarray, p: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the log density of each residual in nats, shape (..., n).

        r: residuals in the unit of the record, (..., n). p: parameters and constants of the noise by name, in shapes
        that broadcast to r (see `by_sample`).
        """

    def priors(self, features: Features) -> dict[str, Prior]:
        """Return a lognormal prior, under the key `noise_sd`; its sigma (sd of the logarithm) is 1.

        Its median is the roughness of the record: the sd of its noise over short windows, in the unit of the record.
        """
        return {"noise_sd": LogNormal(median=features.roughness, sigma=1.0)}

    def start(self, r: np.ndarray, gaps: np.ndarray) -> dict[str, float]:
        """Return the root mean square of residuals r, (n,), under the key `noise_sd`. gaps has no effect."""
        return {"noise_sd": float(np.sqrt(np.mean(r**2)))}

    def log_likelihood(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the sum of the log densities of residuals r, (..., n), in nats: (...).

        gaps has no effect. p: parameters and constants of the noise by name, each a number or an array of shape (...).
        """
        return np.sum(self.log_likelihoods(r, gaps, p), axis=-1)

    def log_likelihoods(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the log density of each residual in nats, (..., n); it does not depend on the other residuals.

        gaps has no effect. p: parameters and constants of the noise by name, each a number or an array of shape (...).
        """
        return self.log_density(r, by_sample(p))

    def slope(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the derivative of each log density by its residual, (..., n), by central differences.

        gaps has no effect. p: parameters and constants of the noise by name; the step is a fraction of `noise_sd`.
        """
        p = by_sample(p)
        above, below = r + DERIVATIVE_STEP * p["noise_sd"], r - DERIVATIVE_STEP * p["noise_sd"]
        return (self.log_density(above, p) - self.log_density(below, p)) / (above - below)

    def information_root(self, v: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return v / noise_sd, (..., n), for a shift v of the record.

        v: change of each sample in the unit of the record, (..., n). For normal noise, the sum of squares of the result
        is the Fisher information about a factor by which the shift is multiplied. p: must contain `noise_sd`. gaps has
        no effect.
        """
        return v / by_sample(p)["noise_sd"]

    def whiten(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return residuals r, (..., n), divided by noise_sd in p; the result is standard normal for normal noise.

        gaps has no effect.
        """
        return r / by_sample(p)["noise_sd"]


def by_sample(p: Mapping[str, ArrayLike]) -> dict[str, np.ndarray]:
    """Return a dictionary of the parameters in p, (...) each, as arrays with an additional last axis of length 1.

    They then broadcast against residuals, (..., n).
    """
    return {name: np.asarray(value, float)[..., None] for name, value in p.items()}


NOISES: Registry[NoiseModel] = Registry("bayesdamp.inference.noise", "noise model")


@dataclass(frozen=True)
class FittedNoise:
    """A noise model with its most probable parameters for given residuals (record minus motion).

    Attributes
    ----------
    name : str
        Name of the noise model.
    values : mapping of str to float
        Values of its parameters, inferred or known, and constants by name; scales such as noise_sd are in the unit of
        the record. Empty if the noise model was not fitted (the default).
    log_evidence : float
        Log density of the residuals in nats, integrated over the parameters by Laplace's approximation; −∞ if the
        search did not end at a maximum, and nan if the noise model was not fitted. If all parameters are known, it is
        the log density itself.
    """

    name: str = GAUSSIAN
    values: Mapping[str, float] = field(default_factory=dict)
    log_evidence: float = float("nan")

    def variance(
        self, residual: np.ndarray, direction: np.ndarray, gaps: np.ndarray, least: float = LEAST_INFORMATION
    ) -> float:
        """Return the variance of white normal noise that gives the same Fisher information about a shift of the record.

        For a shift that oscillates at one frequency, least squares with this variance are as good as generalised least
        squares (U. Grenander, Ann. Math. Stat. 25, 252 (1954)). The information is the observed one, from finite
        differences of the derivative of the log density, but at least `least` times the expected one.

        Parameters
        ----------
        residual : ndarray, shape (n,)
            Record minus motion.
        direction : ndarray, shape (n,)
            The shift of each sample, up to a common factor; not all may be 0.
        gaps : ndarray, shape (n - 1,)
            Times between the samples, in s.
        least : float
            Smallest observed information that is used, as a fraction of the expected one.

        Returns
        -------
        float
            The variance, in the unit of the record squared.
        """
        noise = NOISES.get(self.name)
        step = INFORMATION_STEP * float(np.median(np.abs(residual)) / np.max(np.abs(direction))) * direction
        above, below = (noise.slope(residual + s, gaps, self.values) for s in (step, -step))
        observed = float(step @ (below - above)) / (2 * float(step @ step))
        root = noise.information_root(direction, gaps, self.values)
        expected = float(np.sum(root**2) / np.sum(direction**2))
        return 1.0 / max(observed, least * expected)

    def working_residuals(self, residual: np.ndarray, gaps: np.ndarray, variance: float) -> np.ndarray:
        """Return modified residuals, (n,), whose least-squares gradient is that of the log density of the noise.

        If they are added to the motion and the motion is fitted to the sum by least squares, repeatedly until nothing
        changes, the fit maximises the density of the noise (P. J. Huber, Robust Statistics, 1981, section 7.8).

        Parameters
        ----------
        residual : ndarray, shape (n,)
            Record minus motion.
        gaps : ndarray, shape (n - 1,)
            Times between the samples, in s.
        variance : float
            Variance of the least squares fit, from the method `variance`.

        Returns
        -------
        ndarray, shape (n,)
            The modified residuals, −variance · d log density / d residual.
        """
        return -variance * NOISES.get(self.name).slope(residual, gaps, self.values)


@dataclass(frozen=True)
class SampleNoise:
    """The noise model that is chosen for a record's samples, and the evidence of all noise models.

    Attributes
    ----------
    fitted : FittedNoise
        The noise model that is chosen, with its parameters; by default Gaussian noise that is not fitted. It may have
        been fitted to a later residual than the models in `weighed`.
    weighed : tuple of FittedNoise
        All noise models that were compared and apply to the record, each fitted to the same residual; () if none were
        compared. This is the residual of the motion with all damping terms together or, for a record of very many
        cycles, of the amplitudes and phases fitted to its blocks.
    """

    fitted: FittedNoise = field(default_factory=FittedNoise)
    weighed: tuple[FittedNoise, ...] = ()

    @property
    def name(self) -> str:
        """Name of the chosen noise model."""
        return self.fitted.name

    @property
    def likeliest(self) -> str:
        """Name of the noise model with the largest evidence in `weighed`; `name` if that is empty.

        Fits under exact laws use it. It may differ from `name`: if Gaussian noise is one of the models, another one is
        chosen only if its evidence is clearly larger, and correlated noise never.
        """
        return max(self.weighed, key=lambda model: model.log_evidence, default=self.fitted).name

    @property
    def ahead(self) -> float:
        """Log Bayes factor (nats) of the chosen noise model against Gaussian noise; nan if `weighed` lacks either."""
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
    """Fit a noise model to residuals: maximise the posterior density of its parameters.

    The density is that of standard normal scores, into which the priors transform the parameters.

    Parameters
    ----------
    name : str
        Name of the noise model.
    residual : ndarray, shape (n,)
        Record minus motion.
    signal : Signal
        The record, for its times and its recording step; `residual` replaces its values.
    features : Features
        Features of the record, on which default priors depend.
    known, priors : mapping, optional
        Known values of noise parameters, which are then not inferred, and priors that replace the default ones, by
        name; names that are not parameters of this model are ignored.

    Returns
    -------
    FittedNoise
        The most probable parameters, and the log evidence by Laplace's approximation, which may be −∞.

    Raises
    ------
    Refusal
        If the model does not apply to the record.
    InputError
        If there is no noise model with this name.
    """
    noise = NOISES.get(name)
    constants = {**noise.read(signal), **{n: v for n, v in (known or {}).items() if n in noise.parameters}}
    given = {n: p for n, p in (priors or {}).items() if n in noise.parameters}
    inferred = {n: p for n, p in {**noise.priors(features), **given}.items() if n not in constants}
    gaps = np.diff(signal.t)

    def values(z: np.ndarray) -> dict[str, float]:
        own = {n: float(p.value(x)) for (n, p), x in zip(inferred.items(), z, strict=True)}
        return {**own, **constants}

    def negative_log_density(z: np.ndarray) -> float:
        with np.errstate(all="ignore"):
            density = float(noise.log_likelihood(residual, gaps, values(z))) - 0.5 * float(z @ z)
        return -density if np.isfinite(density) else 1e300

    start = noise.start(residual, gaps)
    z = np.clip([float(p.score(start[n])) for n, p in inferred.items()], -LARGEST_SCORE, LARGEST_SCORE)
    if not z.size:
        density = -negative_log_density(z)
        return FittedNoise(name, values(z), density if density > -1e300 else -np.inf)
    options = {"xatol": 1e-4, "fatol": 1e-4}
    z = scipy.optimize.minimize(negative_log_density, z, method="Nelder-Mead", options=options).x
    axes = EVIDENCE_STEP * np.eye(z.size)

    def mixed(a: np.ndarray, b: np.ndarray) -> float:
        """Return the mixed second difference, not divided by the steps, of the negative log density at its mode.

        a, b: the two steps, (p,) each.
        """
        return sum(s * u * negative_log_density(z + s * a + u * b) for s, u in product((1, -1), repeat=2))

    hessian = np.array([[mixed(a, b) for b in axes] for a in axes]) / (4 * EVIDENCE_STEP**2)
    sign, log_det = np.linalg.slogdet(hessian)
    log_evidence = -negative_log_density(z) - 0.5 * float(log_det) if sign > 0 else -np.inf
    return FittedNoise(name, values(z), log_evidence)
