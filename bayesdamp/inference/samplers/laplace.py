"""Laplace's approximation: the normal distribution at the mode, cut off where a coefficient is zero."""

from __future__ import annotations

import numpy as np

from bayesdamp.inference.coordinates.truncated_normal import laplace
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.samplers._approximation import approximate_posterior
from bayesdamp.inference.samplers._sampler import Sampler, Settings
from bayesdamp.types import Posterior


class Laplace(Sampler):
    """Draws from the normal distribution with the log posterior's gradient and whole Hessian at the mode.

    In scores, and cut off where a reflected one is zero: a mode at zero, where the gradient is not zero, makes a normal
    with its mean beyond the wall, of which the tail inside is left. Curvature that changes within the posterior's
    width (between friction and viscous damping, say) it does not see; its importance weights do.
    """

    name = "laplace"
    approximate = True

    def sample(self, target: Target, mode: Mode, settings: Settings) -> Posterior:
        """Independent draws of the normal distribution about the mode, with their importance weights' worth."""
        normal = laplace(target, mode)
        z = normal.draw(np.random.default_rng(settings.seed), settings.chains * settings.draws)
        return approximate_posterior(self.name, target, mode, z, normal.log_density(z), settings)


PLUGIN = Laplace()
