"""Laplace's approximation: a normal distribution at the mode, truncated where a coefficient is zero."""

from __future__ import annotations

import numpy as np

from bayesdamp.inference.coordinates.truncated_normal import laplace
from bayesdamp.inference.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.samplers._approximation import approximate_posterior
from bayesdamp.inference.samplers._sampler import Sampler, Settings
from bayesdamp.types import Posterior


class LaplaceSampler(Sampler):
    """Draws from Laplace's approximation: the normal distribution with the gradient and Hessian of the log posterior.

    Both are taken at the mode, and the full Hessian is used. The distribution is one of standard normal scores,
    truncated at zero for coefficients that cannot be negative. If a coefficient is zero at the mode, its gradient is
    not zero: the mean of its normal distribution is negative and only the tail remains. If the Hessian changes within
    the width of the posterior, the approximation is poor, which its importance weights show.
    """

    name = "laplace"
    approximate = True

    def sample(self, target: Target, mode: Mode, settings: Settings) -> Posterior:
        """Return independent draws of the approximation, judged by their importance weights.

        Raises Refusal if the Hessian is not positive definite.
        """
        normal = laplace(target, mode)
        z = normal.draw(np.random.default_rng(settings.seed), settings.chains * settings.draws)
        return approximate_posterior(self.name, target, mode, z, normal.log_density(z), settings)


PLUGIN = LaplaceSampler()
