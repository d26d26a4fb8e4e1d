"""The log likelihood and log posterior of a record as functions of scores, with gradient and information.

Scores are parameters, transformed so that their priors are standard normal. The ODE solver computes the motion, and its
derivatives by parameters from the variational equations. The noise model computes the first derivatives by the few
parameters of the noise; the second ones are finite differences.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from bayesdamp.inference.model.target import Target
from bayesdamp.machine import at_once
from bayesdamp.physics.oscillator import Trajectories
from bayesdamp.priors import log_prior_of

NOISE_STEP = 1e-2
"""Step of the finite differences for the second derivatives of the log likelihood by the noise parameters, in units of
their standard normal scores (prior standard deviations)."""


@dataclass(frozen=True)
class Line:
    """The motion as a linear function of the parameters, about one point (the point of expansion).

    Attributes
    ----------
    residual : ndarray, shape (n,)
        Record minus motion at the point of expansion; it and `slopes` are all nan if the motion is unbounded.
    slopes : ndarray, shape (k, n)
        Derivatives of the motion by the values (not scores) of the k inferred parameters on which it depends.
    at : ndarray, shape (k,)
        Values of these parameters at the point of expansion.
    """

    residual: np.ndarray
    slopes: np.ndarray
    at: np.ndarray


@dataclass(frozen=True)
class Likelihood:
    """The likelihood of the samples of a record, or of a part of them, and the prior of the scores.

    Attributes
    ----------
    target : Target
        The record, its model and priors.
    reference : mapping of str to float
        Values of all parameters, near those at which the likelihood will be evaluated. They set the amplitude and
        frequency with which the tolerances of the solver scale.
    tolerance : float
        Largest error of a motion, in the unit of the record. If the target has deviations, `reference` and `tolerance`
        have no effect, because `Deviation.motions` is the solver.
    part : slice
        Samples that are used, a slice without a step; all, if the target has deviations. The motion always starts at
        the first sample of the record.
    scales : tuple of float
        Possible values of the common prior scale of coefficients (standard deviation of their scores), all equally
        probable; the prior is averaged over them.
    """

    target: Target
    reference: Mapping[str, float]
    tolerance: float
    part: slice
    scales: tuple[float, ...]

    def __post_init__(self) -> None:
        assert self.target.deviation is None or self.part == slice(None)

    @classmethod
    def near(cls, target: Target, z: np.ndarray, tolerance: float) -> Self:
        """Return the likelihood of all samples of a record, for evaluations near scores z, (d,).

        z: standard normal scores of the inferred parameters; the parameter values at z become the `reference`, which
        sets the scales of the solver. tolerance: largest error of a motion, in the unit of the record.
        """
        return cls(target, target.all_values(z), tolerance, slice(None), target.scales)

    def with_scale(self, scale: float) -> Likelihood:
        """Return this likelihood with the common prior scale of damping coefficients fixed instead of averaged out.

        scale: scale of the half-normal priors of these coefficients, in units of their scores; a score of 1 is an
        equivalent damping ratio of 0.1. It has no effect without such coefficients. The search for the mode fixes it at
        1.
        """
        return replace(self, scales=(float(scale),))

    def under(self, combination: int) -> Likelihood:
        """Return this likelihood given one combination of the hyperparameters of the deviations from the laws.

        Hyperparameters are prior sds and correlation lengths of deviations of damping and frequency. combination: its
        index along the first axis of `Deviation.maps`, from 0. The target must have deviations. Log likelihoods of the
        result contain the log prior probability of the combination. The NUTS sampler moves the scores under one
        combination at a time.
        """
        assert self.target.deviation is not None
        return replace(self, target=replace(self.target, deviation=self.target.deviation.under(combination)))

    @cached_property
    def y(self) -> np.ndarray:
        """The samples of the record that are used (see `part`), in its unit, (n,)."""
        return self.target.signal.y[self.part]

    @cached_property
    def gaps(self) -> np.ndarray:
        """Times between the samples that are used in s, (n − 1,)."""
        return np.diff(self.target.signal.t[self.part])

    @cached_property
    def motions(self) -> Trajectories:
        """Solver of the motion at the times of the samples, from the first of the record to the last one that is used.

        If the model allows for deviations from its laws, it is a solver with these deviations fixed at the mode.
        """
        if self.target.deviation is not None:
            return self.target.deviation.motions
        signal = self.target.signal
        times = signal.t[: self.part.stop]
        return Trajectories(self.target.oscillator, times, signal.quantity, self.reference, self.tolerance)

    def residual(self, z: np.ndarray) -> np.ndarray:
        """Return record minus motion, (n,), in the unit of the record; all nan if the motion is unbounded.

        z: all d inferred parameters as standard normal scores, in the order of `Target.names`.
        """
        return self._residual_of(self.target.all_values(z))

    def residuals(self, z: np.ndarray) -> np.ndarray:
        """Return record minus motion at each of m points z, (m, d), of standard normal scores: shape (m, n)."""
        return np.stack([self.residual(row) for row in z])

    def log_prior(self, z: np.ndarray) -> np.ndarray:
        """Return the log prior density (nats), (...), of standard normal scores z, (..., d).

        Only the absolute value of a reflected score (one with a half-normal prior) matters. Its prior density here is
        that of a normal distribution over both signs, so negative values are allowed (see `folded`). The density is
        averaged over `scales`.
        """
        return log_prior_of(z, self.target.shared, self.scales)

    def log_noise(self, residual: np.ndarray, z: np.ndarray) -> float:
        """Return the log density (nats) of residuals, (n,), in the unit of the record; −∞ if it is not finite.

        z: all inferred parameters as standard normal scores, (d,), of which only those of the noise matter. If the
        target has deviations, they are integrated out and z has no effect.
        """
        return self._log_density(residual, self.target.all_values(z))

    def log_likelihood(self, z: np.ndarray) -> float:
        """Return the log likelihood (nats) at scores z, (d,); −∞ if it is not finite, as for an unbounded motion.

        z: all d inferred parameters as standard normal scores.
        """
        return self.log_likelihood_of(self.target.all_values(z))

    def log_likelihoods(self, z: np.ndarray) -> np.ndarray:
        """Return the log likelihood (nats) at each of m points z of standard normal scores, (m, d): shape (m,)."""
        return np.array([self.log_likelihood(row) for row in z])

    def log_posterior(self, z: np.ndarray) -> float:
        """Return log prior plus log likelihood (nats) at standard normal scores z, (d,).

        It is not normalised. It is −∞ if the log likelihood is not finite. Scores with half-normal priors may be
        negative (see `folded`).
        """
        return self.log_likelihood(z) + float(self.log_prior(z))

    def log_posteriors(self, z: np.ndarray) -> np.ndarray:
        """Return `log_posterior` (nats) at each of m points z of standard normal scores, (m, d): shape (m,)."""
        # A motion with deviations takes so long that several threads are faster.
        return np.array(list((map if self.target.deviation is None else at_once)(self.log_posterior, z)))

    def folded(self, z: np.ndarray) -> np.ndarray:
        """Return the log posterior (nats), (m,), at scores z, (m, d), for half-normal priors on scores ≥ 0 only.

        `log_posteriors` spreads the half-normal prior of a reflected score over both signs. This function adds log 2
        for each such score, for evidence methods that allow only values ≥ 0. The sign of the scores in z is not
        checked.
        """
        return self.log_posteriors(z) + np.sum(self.target.reflected) * np.log(2.0)

    def line(self, z: np.ndarray) -> Line:
        """Return the motion as a linear function of its parameters, about their values at scores z, (d,).

        z: all d inferred parameters as standard normal scores. If the motion is unbounded, the result contains nan.
        """
        return self._line_of(self.target.all_values(z))

    def gradient(self, z: np.ndarray, line: Line | None = None) -> tuple[float, np.ndarray]:
        """Return the log posterior (nats) at standard normal scores z, (d,), and its gradient by the scores, (d,).

        If the log likelihood is not finite, the value is −∞ and the gradient is that of the log prior. line: the motion
        linearised at z, if it is known already; by default it is computed.
        """
        line = line or self.line(z)
        value = self.log_noise(line.residual, z)
        if not np.isfinite(value):
            return value, -z * self.target.prior_precision(z, self.scales)
        return value + float(self.log_prior(z)), self.gradient_along(line, z)

    def gradient_along(self, line: Line, z: np.ndarray) -> np.ndarray:
        """Return the gradient, (d,), of the log posterior by the scores z, (d,), for the linearised motion `line`.

        The motion at z is extrapolated linearly from the point where `line` was computed. The ODE is not solved, so
        that NUTS steps are fast.
        """
        p = self.target.all_values(z)
        away = np.array([p[n] for n in self._moving_names]) - line.at
        slopes = self._slopes(line.residual - away @ line.slopes, line.slopes, p)
        return -z * self.target.prior_precision(z, self.scales) + self.target.rates(z) * slopes

    def curvature(self, z: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Return the log posterior at scores z, (d,), its gradient, (d,), and its Gauss–Newton information, (d, d).

        The log posterior is in nats, and derivatives are by the scores. The information approximates the negative
        Hessian and is positive definite; it has no cross terms between parameters of the motion and of the noise. The
        search for the mode and the coordinates of samplers use it. If the log likelihood is not finite, the value is
        −∞, and gradient and information are those of the log prior.
        """
        line = self.line(z)
        value, gradient = self.gradient(z, line)
        information = np.diag(self.target.prior_precision(z, self.scales))
        if not np.isfinite(value):
            return value, gradient, information
        moving, of_noise = self.target.moving, self.target.of_noise
        tangents = self.target.rates(z)[moving, None] * line.slopes
        roots = self.target.noise_model.information_root(tangents, self.gaps, self.target.all_values(z))
        information[np.ix_(moving, moving)] += roots @ roots.T
        if of_noise.size:
            # The negative second differences of the log density of the residuals; negative eigenvalues become zero.
            steps = NOISE_STEP * np.eye(z.size)[of_noise]
            block = np.zeros((len(steps), len(steps)))
            for i, a in enumerate(steps):
                for j, b in enumerate(steps[: i + 1]):
                    corners = [self.log_noise(line.residual, z + s) for s in (a + b, a - b, b - a, -a - b)]
                    second = (corners[0] - corners[1] - corners[2] + corners[3]) / (4 * NOISE_STEP**2)
                    block[i, j] = block[j, i] = -second
            if np.all(np.isfinite(block)):
                values, axes = np.linalg.eigh(block)
                information[np.ix_(of_noise, of_noise)] += (axes * np.maximum(values, 0.0)) @ axes.T
        return value, gradient, information

    def whitened(self, residual: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Return whitened residuals, (n,): independent and standard normal if the noise is that at scores z, (d,).

        residual: record minus motion in the unit of the record, (n,).
        """
        return self.target.noise_model.whiten(residual, self.gaps, self.target.all_values(z))

    def log_likelihood_of(self, p: Mapping[str, float]) -> float:
        """Return the log likelihood (nats) for values of all parameters, also known ones, by name; −∞ if not finite."""
        return self._log_density(self._residual_of(p), p)

    def slopes_of(self, p: Mapping[str, float]) -> tuple[float, np.ndarray]:
        """Return the log likelihood (nats) for parameter values, and its derivatives by the inferred ones, (d,).

        These are derivatives by the values, not by the scores, in the order of `Target.names`; all are 0 if the log
        likelihood is −∞. p: values of all parameters by name, also of known ones.
        """
        line = self._line_of(p)
        value = self._log_density(line.residual, p)
        if not np.isfinite(value):
            return value, np.zeros(len(self.target.names))
        return value, self._slopes(line.residual, line.slopes, p)

    def _slopes(self, residual: np.ndarray, slopes: np.ndarray, p: Mapping[str, float]) -> np.ndarray:
        """Return the derivatives of the log density of residuals, (n,), by the d inferred parameters, (d,).

        They are derivatives by the parameters' values, not by their scores. slopes: derivatives of the motion by the k
        of these parameters on which it depends, (k, n). p: values of all parameters by name.
        """
        target, noise = self.target, self.target.noise_model
        derivatives = np.zeros(len(target.names))
        derivatives[target.moving] = -(slopes @ noise.slope(residual, self.gaps, p))
        if target.of_noise.size:
            by_name = noise.parameter_slopes(residual, self.gaps, p)
            derivatives[target.of_noise] = [by_name[target.names[i]] for i in target.of_noise]
        return derivatives

    def _residual_of(self, p: Mapping[str, float]) -> np.ndarray:
        return self.y - self.motions.record(p)[self.part.start :]

    def _log_density(self, residual: np.ndarray, p: Mapping[str, float]) -> float:
        """Return the log density (nats) of residuals (n,) for noise parameters p; −∞ if it is not finite."""
        with np.errstate(all="ignore"):  # a noise model may overflow at extreme scores
            value = float(self.target.noise_model.log_likelihood(residual, self.gaps, p))
        return value if np.isfinite(value) else -np.inf

    def _line_of(self, p: Mapping[str, float]) -> Line:
        """Return the motion as a linear function of its inferred parameters, about the parameter values p (by name)."""
        motion, slopes = self.motions.with_slopes(p, self._moving_names)
        at, start = np.array([p[n] for n in self._moving_names]), self.part.start
        return Line(self.y - motion[start:], slopes[:, start:], at)

    @cached_property
    def _moving_names(self) -> tuple[str, ...]:
        return tuple(self.target.names[i] for i in self.target.moving)
