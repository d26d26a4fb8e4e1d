"""A user's sampler that returns draws without a summary, and one whose chains do not agree."""

from __future__ import annotations

import numpy as np

from bayesdamp.inference.coordinates.truncated_normal import laplace
from bayesdamp.inference.samplers import Sampler
from bayesdamp.types import Posterior


class Independent(Sampler):
    """Independent draws from the normal distribution at the mode."""

    name = "independent"
    apart = 0.0

    def sample(self, target, mode, settings):
        """Return draws without a summary."""
        shape = settings.chains, settings.draws
        z = laplace(target, mode).draw(np.random.default_rng(settings.seed), settings.chains * settings.draws)
        values = {n: v.reshape(shape) for n, v in target.values(z).items()}
        draws = np.stack(list(values.values()), axis=-1)
        shift = self.apart * draws.std((0, 1)) * np.arange(settings.chains)[:, None, None]
        log_likelihood = mode.likelihood.log_likelihoods(z).reshape(shape)
        return Posterior(self.name, tuple(values), draws + shift, log_likelihood)


class Apart(Independent):
    """The means of successive chains are two standard deviations apart."""

    name = "apart"
    apart = 2.0


PLUGINS = [Independent(), Apart()]
