"""Laplace's approximation: the normal distribution at the mode, truncated where a coefficient is zero."""

from __future__ import annotations

import numpy as np

from bayesdamp.inference.coordinates.truncated_normal import laplace
from bayesdamp.inference.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.samplers._approximation import approximate_posterior
from bayesdamp.inference.samplers._sampler import Sampler, Settings
from bayesdamp.types import Posterior


class LaplaceSampler(Sampler):
    """Draws from the normal distribution with the log posterior's gradient and whole Hessian at the mode.

    It is one of the scores, truncated where a reflected score is zero. A mode at zero, where the gradient is not zero,
    gives a normal with its mean beyond the wall, of which the tail inside remains. The approximation ignores curvature
    that changes within the posterior's width (between friction and viscous damping, say), but its importance weights
    show this.
    """

    name = "laplace"
    approximate = True

    def sample(self, target: Target, mode: Mode, settings: Settings) -> Posterior:
        """Return independent draws of the normal distribution about the mode, judged by their importance weights."""
        normal = laplace(target, mode)
        z = normal.draw(np.random.default_rng(settings.seed), settings.chains * settings.draws)
        return approximate_posterior(self.name, target, mode, z, normal.log_density(z), settings)


PLUGIN = LaplaceSampler()
