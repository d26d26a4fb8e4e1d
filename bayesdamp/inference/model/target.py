"""The target of one model on one record: its prior, motion and noise, and which parameters are inferred.

Inferred parameters are monotone maps of normal scores z, shape (d,). The prior is N(0, 1) in each score, except for the
coefficients whose priors share an unknown scale (`SharedHalfNormal`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bayesdamp.inference.model.deviation import Deviation
from bayesdamp.inference.noise import NOISES, NoiseModel
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS
from bayesdamp.priors import SHARED_SIGMAS, Prior, SharedHalfNormal, shared_precision
from bayesdamp.types import Signal

AT_ZERO = 1e-12
"""Score at which the slope of a reflected map is taken in place of zero, where it has none."""
SMALL = 1e-6
"""Share of a step over which its direction is measured."""


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
