"""The target of one model on one record: its prior, motion and noise, and the default priors.

Inferred parameters are monotone maps of normal scores z, shape (d,). The prior is N(0, 1) in each score, except for the
coefficients whose priors share an unknown scale (`SharedHalfNormal`). Default priors are the same in every damping
model, so that evidence can be compared.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bayesdamp.inference.model.deviation import Deviation
from bayesdamp.inference.noise import NOISES, NoiseModel
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.oscillator import Oscillator
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
from bayesdamp.types import Reference, Signal, System

AT_ZERO = 1e-12
"""Score at which the slope of a reflected map is taken in place of zero, where it has none."""
SMALL = 1e-6
"""Share of a step over which its direction is measured."""
EPSILON_RANGE = (0.0005, 0.05)
"""Range of the prior of ε where it is inferred, in shares of the peak velocity."""


class Scores:
    """Inferred parameters as monotone maps of scores, with the prior of these.

    The prior is N(0, 1) in each score, except for coefficients whose priors share an unknown scale.
    """

    priors: Mapping[str, Prior]
    """Of the inferred parameters, in the order of the scores."""
    known: Mapping[str, float]
    scales: tuple[float, ...] = tuple(map(float, SHARED_SIGMAS))
    """Scales that coefficients may share, in scores, all equally probable."""

    @cached_property
    def reflected(self) -> np.ndarray:
        """Which of the scores, (d,), have half-normal priors: z and −z give the same value."""
        return np.array([p.reflected for p in self.priors.values()], bool)

    @cached_property
    def shared(self) -> np.ndarray:
        """Which of the scores, (d,), are coefficients whose priors share an unknown scale."""
        return np.array([isinstance(p, SharedHalfNormal) for p in self.priors.values()], bool)

    def prior_precision(
        self, z: np.ndarray, scales: Sequence[float] | np.ndarray = SHARED_SIGMAS
    ) -> np.ndarray:
        """Return the factors, (d,), that turn scores, (d,), into minus the slope of the log prior.

        A factor is 1, or the mean of 1/σ² over the scales for scores that share a scale. The log prior nowhere curves
        more than this: it is the curvature of the normal that touches the prior at z from below.
        """
        precision, shared = np.ones(z.size), self.shared
        if shared.any():
            squares = np.sum(z[shared] ** 2)
            precision[shared] = shared_precision(squares, int(shared.sum()), np.asarray(scales))
        return precision

    def prior_draws(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Draw scores from the prior, (n, d); reflected ones are not negative."""
        z = rng.standard_normal((count, len(self.priors)))
        if self.shared.any():
            z[:, self.shared] *= rng.choice(self.scales, count)[:, None]
        z[:, self.reflected] = np.abs(z[:, self.reflected])
        return z

    @cached_property
    def _rates(self):
        return [(type(p).derivative, p.numbers, p.reflected) for p in self.priors.values()]

    def rates(self, z: np.ndarray) -> np.ndarray:
        """Return the derivative of each inferred parameter by its score at z, both (d,)."""
        both = zip(self._rates, z.tolist(), strict=True)
        return np.array(
            [rate((z or AT_ZERO) if reflected else z, *numbers) for (rate, numbers, reflected), z in both],
            float,
        )

    def retracted(self, restoring: str, z: np.ndarray, new: np.ndarray) -> np.ndarray:
        """Return the end of a step from scores z to `new`, both (d,), along the restoring law's natural coordinates.

        To first order it is the same step. It stays in directions that the record determines poorly where the step
        starts in one. The result is `new` where the law has no such coordinates, or not all of its parameters are
        inferred.

        References
        ----------
        P.-A. Absil, R. Mahony and R. Sepulchre, Optimization Algorithms on Matrix Manifolds, 2008, on retractions.
        """
        law, priors = LAWS.get(restoring), self.priors
        names = [n for n in (*law.parameters, "theta0") if n in priors]
        if not set(law.parameters) <= set(names):
            return new
        order, known = list(priors), {"theta0": 0.0, **self.known}
        places = [order.index(n) for n in names]

        def coordinates(z: np.ndarray) -> np.ndarray | None:
            values = {n: float(priors[n].value(z[i])) for n, i in zip(names, places, strict=True)}
            natural = law.natural({**known, **values})
            return None if natural is None else np.array([natural[n] for n in names])

        here = coordinates(z)
        near = None if here is None else coordinates(z + SMALL * (new - z))
        if here is None or near is None:
            return new
        ends = here + (near - here) / SMALL
        end = law.from_natural({**known, **dict(zip(names, ends.tolist(), strict=True))})
        if end is None:
            return new
        along = np.array([float(priors[n].score(end[n])) for n in names])
        if not np.all(np.isfinite(along)):
            return new
        curved = new.copy()
        curved[places] = along
        return curved


@dataclass(frozen=True)
class Target(Scores):
    """The posterior of one model on one record.

    Attributes
    ----------
    signal : Signal
        The record.
    oscillator : Oscillator
        Its damping terms and restoring law.
    noise : str
        Name of the noise model.
    priors : mapping of str to Prior
        Of every inferred parameter, in the order of the scores.
    known : mapping of str to float
        Values of the other parameters.
    scales : tuple of float
        Scales that coefficients with a `SharedHalfNormal` prior may share, in scores, all equally probable.
    deviation : Deviation or None
        Effect of deviations of the laws on the record; None where the laws hold exactly.
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
            raise ValueError(f"neither known nor inferred: {', '.join(sorted(missing))}")

    @cached_property
    def noise_model(self) -> NoiseModel:
        """The noise model, which includes the deviations where there are any."""
        return NOISES.get(self.noise) if self.deviation is None else self.deviation

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the inferred parameters, in the order of the scores."""
        return tuple(self.priors)

    @cached_property
    def moving(self) -> np.ndarray:
        """Places, (k,), of the scores that change the motion; the others are of the noise."""
        return np.array([i for i, n in enumerate(self.priors) if n in self.oscillator.parameters], int)

    @cached_property
    def still(self) -> np.ndarray:
        """Places, (s,), of the scores of the noise."""
        return np.setdiff1d(np.arange(len(self.priors)), self.moving)

    def followed(self, z: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Return the end of a step from scores z along the law's natural coordinates, all (d,)."""
        return self.retracted(self.oscillator.restoring, z, z + step)

    def scores(self, values: Mapping[str, float]) -> np.ndarray:
        """Return the scores of parameter values, (d,), within ±6; a missing value gives its prior's centre."""
        z = [float(p.score(values[n])) if n in values else 0.5 * p.reflected for n, p in self.priors.items()]
        return np.clip(np.nan_to_num(np.asarray(z), nan=0.0, posinf=6.0, neginf=-6.0), -6.0, 6.0)

    def values(self, z: np.ndarray) -> dict[str, np.ndarray]:
        """Return the inferred parameters at scores z, (..., d): arrays (...) by name."""
        return {n: np.asarray(p.value(z[..., i])) for i, (n, p) in enumerate(self.priors.items())}

    def all_values(self, z: np.ndarray) -> dict[str, float]:
        """Return every parameter, known and inferred, at scores z, (d,)."""
        values = self._given.copy()
        for (name, value, numbers), score in zip(self._maps, z.tolist(), strict=True):
            values[name] = value(score, *numbers)
        return values

    def noise_values(self, z: np.ndarray) -> dict[str, float]:
        """Return the noise's parameters and constants at scores z, (d,)."""
        values = self._noise_given.copy()
        for place in self.still.tolist():
            name, value, numbers = self._maps[place]
            values[name] = value(float(z[place]), *numbers)
        return values

    @cached_property
    def _noise_given(self) -> dict[str, float]:
        noise = self.noise_model
        return {n: self._given[n] for n in (*noise.parameters, *noise.constants) if n in self._given}

    @cached_property
    def _given(self) -> dict[str, float]:
        return {name: float(value) for name, value in self.known.items()}

    @cached_property
    def _maps(self) -> list[tuple[str, Callable[..., float], tuple[float, ...]]]:
        """Each parameter's name, its value as a function of a score and the prior's numbers, and these numbers."""
        return [(n, type(p).transform, p.numbers) for n, p in self.priors.items()]


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
    """Build the target of one damping model on one record.

    Parameters
    ----------
    signal : Signal
        The record.
    damping : tuple of str
        Names of the damping terms.
    system : System
        What is known of the oscillator, and priors in place of the defaults.
    features : Features
        Of the record; default priors depend on them.
    reference : Reference
        Amplitude and frequency that the priors are relative to.
    noise : str
        Name of the noise model.
    term_priors : mapping of str to Prior, optional
        Priors of the damping terms' coefficients, by the terms' names, in place of the defaults.

    Raises
    ------
    ValueError
        Where a parameter has neither a value nor a prior.
    Refusal
        Where the noise model does not apply to the record.
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
    """Return the default priors of damping terms: coefficients first, then the terms' own parameters."""
    a, w = reference.amplitude, reference.frequency
    every = [TERMS.get(name) for name in terms]
    coefficients = {t.parameter: SharedHalfNormal(per_ratio=1.0 / t.ratio_per_unit(a, w)) for t in every}
    return {**coefficients, **{p.name: p.prior(a, w) for t in every for p in t.inferred}}


def default_prior(name: str, osc: Oscillator, noise: str, reference: Reference, features: Features) -> Prior:
    """Return the default prior of a parameter. Raises KeyError for a name without one.

    Priors of angles are wide compared with the record's amplitude and centred on its midline. Gravity may have either
    sign and be as large as the stiffness.
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
    return priors[name]
