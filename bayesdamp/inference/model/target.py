"""Prior, motion and noise over one record: which parameters are inferred, and from what.

Inferred parameters are monotone maps of normal scores z, shape (d,). The prior is N(0, 1) in each score, but for the
coefficients whose priors share an unknown scale (`SharedHalfNormal`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from bayesdamp.inference.model.deviation import Deviation
from bayesdamp.inference.model.scores import Scores
from bayesdamp.inference.noise import NOISES, NoiseModel
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.priors import SHARED_SIGMAS, Prior
from bayesdamp.types import Signal


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
        What deviations of the laws do to the record, where these hold approximately; None where they hold exactly.
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
        """The noise model itself, with the deviations in it where there are any."""
        return NOISES.get(self.noise) if self.deviation is None else self.deviation

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the inferred parameters, in the order of the scores."""
        return tuple(self.priors)

    @cached_property
    def shared_places(self) -> np.ndarray:
        """Places of these, (m,)."""
        return np.flatnonzero(self.shared)

    @cached_property
    def moving(self) -> np.ndarray:
        """Places, (k,), of the scores that move the motion; the others are the noise's."""
        return np.array([i for i, n in enumerate(self.priors) if n in self.oscillator.parameters], int)

    @cached_property
    def still(self) -> np.ndarray:
        """Places, (s,), of the scores that are the noise's."""
        return np.setdiff1d(np.arange(len(self.priors)), self.moving)

    def followed(self, z: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Return where a step from scores z leads along the law's natural coordinates, all (d,)."""
        return self.retracted(self.oscillator.restoring, z, z + step)

    def scores(self, values: Mapping[str, float]) -> np.ndarray:
        """Return the scores of parameter values, (d,), within ±6; what is not given is at its prior's centre."""
        z = [float(p.score(values[n])) if n in values else 0.5 * p.reflected for n, p in self.priors.items()]
        return np.clip(np.nan_to_num(np.asarray(z), nan=0.0, posinf=6.0, neginf=-6.0), -6.0, 6.0)

    def values(self, z: np.ndarray) -> dict[str, np.ndarray]:
        """Return the inferred parameters at scores z, (..., d): arrays (...) by name."""
        return {n: np.asarray(p.value(z[..., i])) for i, (n, p) in enumerate(self.priors.items())}

    def all_values(self, z: np.ndarray) -> dict[str, float]:
        """Return every parameter, known and inferred, at scores z, (d,)."""
        found = self._given.copy()
        for (name, value, numbers), score in zip(self._maps, z.tolist(), strict=True):
            found[name] = value(score, *numbers)
        return found

    def noise_values(self, z: np.ndarray) -> dict[str, float]:
        """Return the noise's parameters and constants at scores z, (d,)."""
        found, maps = self._noise_given.copy(), self._maps
        for place in self.still.tolist():
            name, value, numbers = maps[place]
            found[name] = value(float(z[place]), *numbers)
        return found

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
