"""The target of one model on one record: its priors, known parameters and noise model; and the default priors.

Each inferred parameter is a monotone function of a standard normal score z; all scores have the shape (d,). The prior
is N(0, 1) in each score, except for coefficients whose priors have a common, unknown scale (`SharedHalfNormal`). A
parameter with a half-normal prior depends on |z| only: its score is called reflected. Default priors are the same in
every damping model, so that evidence can be compared.

`Deviation` is the likelihood with the deviations from the laws integrated out. The deviations are g (log damping) and h
(relative frequency), with values at knots in time; their hyperparameters are sizes (prior sds) and correlation lengths.
The motion is an exact function of the parameters. The deviations change it linearly, by their derivatives at the mode.
For each combination of hyperparameters they therefore add a covariance of low rank to that of the noise, and the
likelihood is the mixture over all combinations. Without knots it is the likelihood of exact laws with white noise of
known variance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from bayesdamp.inference.noise import NOISES, NoiseModel
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.oscillator import Oscillator, Trajectories
from bayesdamp.physics.restoring import LAWS
from bayesdamp.priors import (
    SHARED_SIGMAS,
    LogNormal,
    LogUniform,
    Normal,
    Prior,
    SharedHalfNormal,
    shared_precision,
)
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import InputError, Reference, Refusal, Signal, System


@dataclass(frozen=True, eq=False)
class Deviation(NoiseModel):
    """The distribution of record minus motion: white noise of known variance plus the effect of deviations.

    The deviations from the damping and restoring laws are g (log damping) and h (relative frequency), at knots in time.
    Their hyperparameters are their prior sds and correlation lengths. The motion is that of `motions`, in which the
    deviations are fixed. The class takes the place of a noise model; its methods ignore their arguments `gaps`, `p` and
    `features`, and `draw` raises Refusal.

    Attributes
    ----------
    motions : Trajectories
        Solver of the motions, with the deviations g and h fixed at their posterior mode.
    variance : float
        Variance of the noise, in the record's unit squared.
    samples : float
        Effective number of independent values in the record.
    basis : ndarray, shape (m, k)
        Orthonormal basis of the changes of the record's m values that deviations at the knots can cause, to first
        order. k is the number of values of g and h together.
    shift : ndarray, shape (m,)
        Change of the motion that the deviations at the mode cause, to first order, in the record's unit. It is added to
        residuals, which are then relative to a motion without deviations.
    log_prior : ndarray, shape (c,)
        Log prior probabilities of the c combinations of hyperparameters.
    maps : ndarray, shape (c, k, k)
        For each combination, the matrix that maps k independent standard normal numbers to g and h at the knots.
    effects : ndarray, shape (c, k, k)
        For each combination, the changes of the record along `basis` that unit values of these k numbers cause, in
        standard deviations of the noise.
    probabilities : ndarray, shape (c,)
        Posterior probabilities of the combinations near the mode, with which the Fisher information is averaged.
    """

    motions: Trajectories
    variance: float
    samples: float
    basis: np.ndarray
    shift: np.ndarray
    log_prior: np.ndarray
    maps: np.ndarray
    effects: np.ndarray
    probabilities: np.ndarray
    name = "gaussian"
    parameters = ()

    @cached_property
    def _whitening(self) -> tuple[np.ndarray, np.ndarray]:
        """The inverse Cholesky factors of the residuals' covariances along `basis`, and the log normalisations.

        There is one of each for each of the c combinations of hyperparameters (prior sds and correlation lengths of the
        deviations). The factors are stacked, (c k, k). A log normalisation is the log of (prior probability of the
        combination / square root of the determinant of its covariance), (c,).
        """
        k = self.effects.shape[1]
        lower = np.linalg.cholesky(np.eye(k) + self.effects @ np.swapaxes(self.effects, 1, 2))
        log_scale = np.sum(np.log(np.diagonal(lower, axis1=1, axis2=2)), axis=1)
        return np.linalg.inv(lower).reshape(len(lower) * k, k), self.log_prior - log_scale

    def _parts(self, r: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Split r + `shift`, (m,), into parts along `basis` and orthogonal to it, in standard deviations of the noise.

        r: residuals. Returns four arrays: the part along the basis, (k,); the orthogonal part, (m,); the part along the
        basis, whitened for each of the c combinations of prior sds and correlation lengths of the deviations, (c, k);
        and the log of each combination's prior probability times the density of r, up to a term that all combinations
        have in common, (c,).
        """
        scaled = (r + self.shift) / np.sqrt(self.variance)
        along = scaled @ self.basis
        whitening, log_mass = self._whitening
        white = (whitening @ along).reshape(len(log_mass), along.size)
        each = log_mass - 0.5 * np.einsum("ci,ci->c", white, white)
        return along, scaled - self.basis @ along, white, each

    def log_likelihood(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the log density of residuals r, (m,), in nats, with the deviations integrated out.

        The normalisation of the white noise counts `samples` values instead of m. gaps and p have no effect.
        """
        _, across, _, each = self._parts(r)
        constant = 0.5 * self.samples * np.log(2 * np.pi * self.variance)
        return np.asarray(np.logaddexp.reduce(each) - 0.5 * float(across @ across) - constant)

    def slope(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the derivative of the log density of residuals r, (m,), by each residual, (m,).

        The deviations are integrated out. gaps and p have no effect.
        """
        _, across, white, each = self._parts(r)
        by_basis = (np.exp(each - np.logaddexp.reduce(each))[:, None] * white).ravel() @ self._whitening[0]
        return -(self.basis @ by_basis + across) / np.sqrt(self.variance)

    def information_root(self, v: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return R v, (..., m + c k), for shifts v of the record, (..., m); RᵀR is the information about a shift.

        It is the Fisher information, averaged over the c combinations of hyperparameters (prior sds and correlation
        lengths of the deviations) with `probabilities`; k is the number of values of the deviations at their knots in
        time. gaps and p have no effect.
        """
        v = v / np.sqrt(self.variance)
        along = v @ self.basis
        white = along @ self._whitening[0].T * np.repeat(np.sqrt(self.probabilities), along.shape[-1])
        return np.concatenate([v - along @ self.basis.T, white], axis=-1)

    def combination_given(self, r: np.ndarray, rng: np.random.Generator) -> int:
        """Draw the index of a combination of hyperparameters from its posterior given residuals r, (m,).

        Hyperparameters are the prior sds and correlation lengths of the deviations. The index is along the first axis
        of `maps`. The NUTS sampler draws a combination before each draw of the scores.
        """
        return _draw_index(self._parts(r)[-1], rng)

    def under(self, combination: int) -> Deviation:
        """Return a copy with only one combination of prior sds and correlation lengths, by index (see `maps`).

        Its log densities contain the log prior probability of the combination.
        """
        own = slice(combination, combination + 1)
        return replace(
            self,
            log_prior=self.log_prior[own],
            maps=self.maps[own],
            effects=self.effects[own],
            probabilities=np.ones(1),
        )

    def draw_given(self, r: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Draw the deviations, g and then h at the knots, (k,), from their posterior given residuals r, (m,).

        g is the deviation of the log damping, h the relative one of the frequency. A combination of hyperparameters is
        drawn first, from its posterior given r. The draws are deviations from the laws, not from the mode.
        """
        along, _, _, each = self._parts(r)
        c = _draw_index(each, rng)
        inverse, effect = self._conditional[c], self.effects[c]
        return self.maps[c] @ (inverse.T @ (inverse @ (effect.T @ along) + rng.standard_normal(along.size)))

    @cached_property
    def _conditional(self) -> np.ndarray:
        """Inverse Cholesky factors of the posterior precision of the deviations at fixed parameters, (c, k, k).

        There is one for each of the c combinations of hyperparameters. The deviations are expressed as k numbers with
        standard normal priors, which `maps` converts to g and h.
        """
        information = np.swapaxes(self.effects, 1, 2) @ self.effects + np.eye(self.effects.shape[1])
        return np.linalg.inv(np.linalg.cholesky(information))

    def priors(self, features: Features) -> dict[str, Prior]:
        """Return no priors: this model has no parameters."""
        return {}

    def start(self, r: np.ndarray, gaps: np.ndarray) -> dict[str, float]:
        """Return no values: this model has no parameters."""
        return {}

    def whiten(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return whitened residuals, (m,): r + `shift`, whitened by the covariance of noise and deviations.

        The covariance is that under the combination of hyperparameters (prior sds and correlation lengths of
        deviations) that is most probable given r + `shift`, which includes the first-order effect of the deviations at
        the mode. gaps and p have no effect.
        """
        _, across, white, each = self._parts(r)
        return across + self.basis @ white[int(np.argmax(each))]

    def log_likelihoods(self, r: np.ndarray, gaps: np.ndarray, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Raise Refusal: deviations from the laws correlate the errors, so no residual has a density of its own."""
        raise Refusal(
            "with deviations from the laws the errors of samples are correlated, so that no sample has a density of "
            'its own; use deviation "none"'
        )


def _draw_index(log_weights: np.ndarray, rng: np.random.Generator) -> int:
    """Draw an index of the array log_weights, (n,), with probabilities proportional to exp(log_weights)."""
    return int(rng.choice(log_weights.size, p=np.exp(log_weights - np.logaddexp.reduce(log_weights))))


NEAR_ZERO_SCORE = 1e-12
"""Standard normal score that replaces 0 where the derivative of a parameter with a half-normal prior is computed,
because this derivative does not exist at 0."""
DIRECTION_STEP = 1e-6
"""`Scores.retract` converts the direction of a step to quantities that a record determines well, such as the frequency
(the restoring law's natural coordinates). It does this by a finite difference over this fraction of the step."""
EPSILON_RANGE = (0.0005, 0.05)
"""Smallest and largest value of ε in its default prior, as fractions of the peak velocity. ε is the width of the
velocity range in which dry friction changes its sign."""


class Scores:
    """Inferred parameters as functions of standard normal scores, and the prior of the scores.

    It is the base class of `Target` and of `deviation.parameters.Parameters`. The functions are those of `Prior.value`.
    """

    priors: Mapping[str, Prior]
    """Priors of the inferred parameters, in the order of the scores."""
    known: Mapping[str, float]
    """Values of the parameters that are not inferred."""
    scales: tuple[float, ...] = tuple(map(float, SHARED_SIGMAS))
    """Possible values of the common prior scale of coefficients (the standard deviation of their scores), all equally
    probable."""

    @cached_property
    def reflected(self) -> np.ndarray:
        """Mask of the scores, (d,), with half-normal priors: z and −z give the same value of the parameter."""
        return np.array([p.reflected for p in self.priors.values()], bool)

    @cached_property
    def shared(self) -> np.ndarray:
        """Mask of the scores, (d,), of coefficients whose half-normal priors have a common, unknown scale."""
        return np.array([isinstance(p, SharedHalfNormal) for p in self.priors.values()], bool)

    def prior_precision(
        self, z: np.ndarray, scales: Sequence[float] | np.ndarray = SHARED_SIGMAS
    ) -> np.ndarray:
        """Return numbers P, (d,), such that the gradient of the log prior at standard normal scores z, (d,), is −P z.

        A number is 1, or for coefficients with a common, unknown prior scale σ the mean of 1/σ² over the values in
        `scales`, given z. It is an upper bound of the negative curvature of the log prior. The attribute `scales` has
        no effect.
        """
        precision, shared = np.ones(z.size), self.shared
        if shared.any():
            squares = np.sum(z[shared] ** 2)
            precision[shared] = shared_precision(squares, int(shared.sum()), np.asarray(scales))
        return precision

    def prior_draws(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Draw scores from the prior, (count, d), in the order of `priors`; reflected scores are not negative.

        Coefficients with a common, unknown prior scale share one random scale in each draw.
        """
        z = rng.standard_normal((count, len(self.priors)))
        if self.shared.any():
            z[:, self.shared] *= rng.choice(self.scales, count)[:, None]
        z[:, self.reflected] = np.abs(z[:, self.reflected])
        return z

    @cached_property
    def _functions(self):
        """For each score a tuple of four, with which its parameter is computed.

        They are the function from the score to the parameter, its derivative, further arguments of both functions, and
        whether the score is reflected (z and −z give the same value).
        """
        return [(type(p).transform, type(p).derivative, p.numbers, p.reflected) for p in self.priors.values()]

    def rates(self, z: np.ndarray) -> np.ndarray:
        """Return the derivative of each inferred parameter by its own standard normal score, at scores z, (d,).

        The derivatives, (d,), have the units of the parameters. For a half-normal prior the derivative is negative at a
        negative score, and `NEAR_ZERO_SCORE` replaces a score of 0.
        """
        both = zip(self._functions, z.tolist(), strict=True)
        rates = [
            rate((z or NEAR_ZERO_SCORE) if reflected else z, *numbers)
            for (_, rate, numbers, reflected), z in both
        ]
        return np.array(rates, float)

    def retract(self, restoring: str, z: np.ndarray, new: np.ndarray) -> np.ndarray:
        """Return the end, (d,), of a step from scores z that is straight in the restoring law's natural coordinates.

        Natural coordinates are quantities that a record determines well, such as the frequency
        (`RestoringLaw.natural`). They replace the scores of the law's parameters and of θ₀. To first order, the step is
        the straight one from z to `new`, (d,); all scores other than those of the law and θ₀ end at `new`. Parameters
        that fit about equally well often form a curve; it is nearly straight in the natural coordinates, so that a step
        along it stays on it. The result is `new` if the law has no such coordinates, if not all of its parameters are
        inferred, or if no parameter values with finite scores belong to the coordinates of the end. restoring: name of
        the law.

        References
        ----------
        P.-A. Absil, R. Mahony and R. Sepulchre, Optimization Algorithms on Matrix Manifolds, 2008, on retractions.
        """
        law, priors = LAWS.get(restoring), self.priors
        names = [n for n in (*law.parameters, "theta0") if n in priors]
        if not set(law.parameters) <= set(names):
            return new
        order, known = list(priors), {"theta0": 0.0, **self.known}
        indices = [order.index(n) for n in names]

        def coordinates(z: np.ndarray) -> np.ndarray | None:
            each = [(self._functions[i], float(z[i])) for i in indices]
            values = {n: f[0](x, *f[2]) for n, (f, x) in zip(names, each, strict=True)}
            natural = law.natural({**known, **values})
            return None if natural is None else np.array([natural[n] for n in names])

        here = coordinates(z)
        near = None if here is None else coordinates(z + DIRECTION_STEP * (new - z))
        if here is None or near is None:
            return new
        ends = here + (near - here) / DIRECTION_STEP
        end = law.from_natural({**known, **dict(zip(names, ends.tolist(), strict=True))})
        if end is None:
            return new
        along = np.array([float(priors[n].score(end[n])) for n in names])
        if not np.all(np.isfinite(along)):
            return new
        curved = new.copy()
        curved[indices] = along
        return curved


@dataclass(frozen=True)
class Target(Scores):
    """One model on one record: its oscillator, noise model, priors and known parameters, which define a posterior.

    The settings of the solver are not included; see `Likelihood`.

    Attributes
    ----------
    signal : Signal
        The record.
    oscillator : Oscillator
        The oscillator: damping terms and restoring law.
    noise : str
        Name of the noise model; the likelihood does not use it if `deviation` is given.
    priors : mapping of str to Prior
        Priors of the inferred parameters, in the order of the scores.
    known : mapping of str to float
        Values of the other parameters, of the noise's constants, and of the references on which damping forces depend
        (equilibrium, velocity, amplitude). ValueError is raised if one of these is in neither `priors` nor `known`.
    scales : tuple of float
        Possible values of the common scale of `SharedHalfNormal` priors (the standard deviation of their scores), all
        equally probable.
    deviation : Deviation or None
        Effect of deviations from the laws on the record; None under exact laws.
    """

    signal: Signal
    oscillator: Oscillator
    noise: str
    priors: Mapping[str, Prior]
    known: Mapping[str, float]
    scales: tuple[float, ...] = tuple(map(float, SHARED_SIGMAS))
    deviation: Deviation | None = None

    def __post_init__(self) -> None:
        noise = self.noise_model
        needed = {*self.oscillator.inputs, *noise.parameters, *noise.constants}
        missing = needed - set(self.priors) - set(self.known)
        if missing:
            raise ValueError(
                f"parameters that are neither known nor inferred: {', '.join(sorted(missing))}; give priors or values"
            )

    @cached_property
    def noise_model(self) -> NoiseModel:
        """The distribution of the residuals: the noise model `noise` or, with deviations from the laws, `deviation`."""
        return NOISES.get(self.noise) if self.deviation is None else self.deviation

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the inferred parameters, in the order of the scores."""
        return tuple(self.priors)

    @cached_property
    def moving(self) -> np.ndarray:
        """Indices, (k,), of the inferred parameters on which the motion depends; the others belong to the noise."""
        return np.array([i for i, n in enumerate(self.priors) if n in self.oscillator.parameters], int)

    @cached_property
    def of_noise(self) -> np.ndarray:
        """Indices, (s,), of the scores of the noise parameters."""
        return np.setdiff1d(np.arange(len(self.priors)), self.moving)

    def follow_step(self, z: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Return the end, (d,), of a step from scores z that is straight in the restoring law's natural coordinates.

        Natural coordinates are quantities that a record determines well, such as the frequency. To first order the end
        is z + step. It is exactly z + step if the law has no such coordinates, if not all of its parameters are
        inferred, or if no parameter values with finite scores belong to the coordinates of the end. In the search for
        the posterior mode, such a step follows the curve of parameters that fit about equally well.
        """
        return self.retract(self.oscillator.restoring, z, z + step)

    def scores(self, values: Mapping[str, float]) -> np.ndarray:
        """Return the standard normal scores of parameter values by name, (d,), limited to ±6.

        A parameter without a value gets the score 0, or ½ if it is reflected (has a half-normal prior). A score that is
        nan becomes 0. Other names are ignored.
        """
        z = [float(p.score(values[n])) if n in values else 0.5 * p.reflected for n, p in self.priors.items()]
        return np.clip(np.nan_to_num(np.asarray(z), nan=0.0, posinf=6.0, neginf=-6.0), -6.0, 6.0)

    def values(self, z: np.ndarray) -> dict[str, np.ndarray]:
        """Return the inferred parameters at standard normal scores z, (..., d), as arrays (...) by name.

        They have the units of the parameters.
        """
        return {n: np.asarray(p.value(z[..., i])) for i, (n, p) in enumerate(self.priors.items())}

    def all_values(self, z: np.ndarray) -> dict[str, float]:
        """Return the values of all parameters, known (with all of `known`) and inferred, by name, at scores z, (d,)."""
        values = self._given.copy()
        for name, (value, _, numbers, _), score in zip(self.priors, self._functions, z.tolist(), strict=True):
            values[name] = value(score, *numbers)
        return values

    @cached_property
    def _given(self) -> dict[str, float]:
        return {name: float(value) for name, value in self.known.items()}


def build_target(
    signal: Signal,
    damping: tuple[str, ...],
    system: System,
    features: Features,
    reference: Reference,
    *,
    noise: str = "gaussian",
    term_priors: Mapping[str, Prior] | None = None,
) -> Target:
    """Build the target of one damping model under exact laws: its oscillator, noise model, priors and known parameters.

    Coefficients of damping terms are always inferred; other parameters are inferred if they have no known value. There
    is one exception: ε, the velocity range in which dry friction changes its sign, is fixed at
    `reference.friction_width` unless `system` has a value of it, or lists it as inferred.

    Parameters
    ----------
    signal : Signal
        The record.
    damping : tuple of str
        Names of the damping terms.
    system : System
        What is known of the oscillator: its restoring law, values of parameters (those of coefficients have no effect),
        and priors that replace the default ones.
    features : Features
        Features of the record, on which default priors depend.
    reference : Reference
        Amplitude (rad or m) and angular frequency (rad/s) on which the widths of the default priors depend.
    noise : str
        Name of the noise model.
    term_priors : mapping of str to Prior, optional
        Priors of coefficients by the names of damping terms, instead of the default ones and those in `system`.

    Raises
    ------
    ValueError
        If the method `read` of the noise model does not return all of its constants.
    InputError
        If an inferred parameter has neither a prior in `system` or `term_priors` nor a default one, or if there is no
        damping term, restoring law or noise model with a given name.
    Refusal
        If the noise model does not apply to the record.
    """
    osc, noise_model = Oscillator(damping, system.restoring), NOISES.get(noise)
    by_term = term_priors or {}
    by_parameter = {t.parameter: by_term[t.name] for t in osc.terms if t.name in by_term}
    given: dict[str, object] = {**system.free, **by_parameter}
    scales = reference.scales(features.rest)
    known = {**{n: scales[n] for n in osc.scales}, **system.known, **noise_model.read(signal)}
    if osc.switches and "epsilon" not in known and "epsilon" not in system.free:
        known["epsilon"] = reference.friction_width
    priors: dict[str, Prior] = {}
    for name in (*osc.parameters, *noise_model.parameters):
        if name not in known or name in osc.coefficients:
            priors[name] = given.get(name) or default_prior(name, osc, noise, reference, features)  # type: ignore[assignment]
    return Target(signal, osc, noise, priors, {k: v for k, v in known.items() if k not in priors})


def damping_priors(terms: Sequence[str], reference: Reference) -> dict[str, Prior]:
    """Return the default priors of damping terms' parameters by name: coefficients first, then other parameters.

    Coefficients have half-normal priors with a common, unknown scale (`SharedHalfNormal`). reference: amplitude (rad or
    m) and angular frequency (rad/s) on which the widths of the priors depend.
    """
    a, w = reference.amplitude, reference.frequency
    every = [TERMS.get(name) for name in terms]
    coefficients = {t.parameter: SharedHalfNormal(per_ratio=1.0 / t.ratio_per_unit(a, w)) for t in every}
    return {**coefficients, **{p.name: p.prior(a, w) for t in every for p in t.inferred}}


def default_prior(name: str, osc: Oscillator, noise: str, reference: Reference, features: Features) -> Prior:
    """Return the default prior of the parameter `name`. Raises InputError if it has none or `noise` is unknown.

    With the amplitude A and the frequency ω of `reference`, displacements (θ₀ and equilibrium angles) are normal about
    the record's midline with sd 2A. The start velocity (sd 2Aω), gravity (ω²/2) and the cubic stiffness (ω²/(2A²)) are
    normal about 0. Stiffness is lognormal about ω² with sigma ½, ε log-uniform (`EPSILON_RANGE`). Priors of damping
    terms are those of `damping_priors`, those of the noise from `NoiseModel.priors`.
    """
    a, w = reference.amplitude, reference.frequency
    of_damping = damping_priors([term.name for term in osc.terms], reference)
    if name in of_damping:
        return of_damping[name]
    priors: Mapping[str, Prior] = {
        "stiffness": LogNormal(median=w**2, sigma=0.5),
        "gravity": Normal(mean=0.0, sd=0.5 * w**2),
        "cubic": Normal(mean=0.0, sd=0.5 * w**2 / a**2),
        "spring_angle": Normal(mean=features.rest, sd=2 * a),
        "rest_angle": Normal(mean=features.rest, sd=2 * a),
        "theta0": Normal(mean=features.rest, sd=2 * a),
        "omega0": Normal(mean=0.0, sd=2 * a * w),
        "epsilon": LogUniform(low=EPSILON_RANGE[0] * a * w, high=EPSILON_RANGE[1] * a * w),
        **NOISES.get(noise).priors(features),
    }
    if name not in priors:
        of_noise = name in NOISES.get(noise).parameters
        owner = f"noise model {noise}" if of_noise else f"restoring law {osc.restoring}"
        raise InputError(f"parameter {name!r} of the {owner} has no default prior; give a prior or its value")
    return priors[name]
