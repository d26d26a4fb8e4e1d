"""A record of a joint fit whose laws may hold approximately: deviations of its own, integrated out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bayesdamp.inference.deviation.sampled.marginal import Marginal
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.priors import Prior
from bayesdamp.types import Refusal


@dataclass(frozen=True)
class Joined:
    """A record as `inference.many` takes one, of which `Marginal` is the density."""

    marginal: Marginal

    @property
    def oscillator(self) -> Oscillator:
        """Its laws, as if they held exactly."""
        candidate = self.marginal.result.candidate
        return Oscillator(candidate.damping, candidate.restoring)

    @property
    def priors(self) -> Mapping[str, Prior]:
        """Of what is inferred, in the order of the scores."""
        parameters = self.marginal.result.fit.parameters
        return {n: parameters.priors[n] for n in parameters.free_names}

    @property
    def live(self) -> tuple[str, ...]:
        """All of it."""
        return self.marginal.result.fit.parameters.free_names

    def scores(self, values: Mapping[str, float]) -> np.ndarray:
        """Scores of values by name, (d,)."""
        return self.marginal.result.fit.parameters.scores(values)

    def about(self, z: np.ndarray) -> Whole:
        """Its density, which is one at all scores, and its information at z, (d,). Raises Refusal."""
        value, _, information = self.marginal.curvature(z)
        if not np.isfinite(value):
            raise Refusal("a record has no finite likelihood where the joint mode is looked for")
        parameters = self.marginal.result.fit.parameters
        height = float(value) + float(parameters.log_prior(np.abs(z)))
        return Whole(self.marginal, z, height, information + np.diag(parameters.prior_precision(z)))


@dataclass(frozen=True)
class Whole:
    """The likelihood; height, information: of the log posterior at scores z, but for a constant."""

    marginal: Marginal
    z: np.ndarray
    height: float
    information: np.ndarray

    def curvature(self, z: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Log likelihood at scores z, (d,), its gradient (d,) and information (d, d)."""
        return self.marginal.curvature(z)

    def log_likelihood(self, z: np.ndarray) -> np.ndarray:
        """Log likelihood at scores z, (n, d): (n,), −∞ where a motion escapes."""
        return self.marginal.log_likelihood(z)

    def cost(self, z: np.ndarray) -> float:
        """Nats by which the log posterior is lower at other scores: with larger deviations it falls by far less than
        its parabola at the mode."""
        prior = float(self.marginal.log_prior_of(np.abs(z)[None])[0])
        return self.height - float(self.log_likelihood(z[None])[0]) - prior

    def holds(self, z: np.ndarray) -> bool:
        """At all scores: motions are exact in the parameters."""
        return True
