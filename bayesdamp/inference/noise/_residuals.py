"""A noise model on given residuals: its parameters, its evidence, and the working residuals of a least-squares fit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.inference.noise import NOISES
from bayesdamp.priors import Prior
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Signal

GAUSSIAN, CORRELATED = "gaussian", "correlated"
STEP = 0.02
"""Step of second differences, in scores."""
SHIFT = 0.3
"""Shift for the observed information, in median absolute residuals (conventional)."""
LEAST_INFORMATION = 0.3
"""Smallest observed information, as a share of the expected one: by chance it can be negative (conventional)."""
FARTHEST = 6.0
"""Largest score at which a search for the noise's parameters starts."""


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
