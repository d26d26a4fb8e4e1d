"""A user's sampler that returns draws without a summary, and one whose chains do not agree."""

from __future__ import annotations

import numpy as np

from bayesdamp.inference.coordinates.truncated_normal import laplace
from bayesdamp.inference.samplers import Sampler
from bayesdamp.types import Posterior


class Independence(Sampler):
    """Metropolis and Hastings's independence sampler (Tierney 1994): the normal at the mode proposes."""

    name = "independence"
    apart = 0.0

    def sample(self, target, mode, settings):
        """Return draws without a summary."""
        rng, normal = np.random.default_rng(settings.seed), laplace(target, mode)
        z = normal.draw(rng, settings.chains * settings.draws)
        likelihood = mode.likelihood.log_likelihoods(z)
        weights = likelihood + mode.likelihood.log_prior(z) - normal.log_density(z)
        grid = np.arange(z.shape[0]).reshape(settings.chains, settings.draws)
        accepted = grid.copy()
        for chain in accepted:
            for i in range(1, settings.draws):
                if np.log(rng.random()) >= weights[chain[i]] - weights[chain[i - 1]]:
                    chain[i] = chain[i - 1]
        values = {n: v[accepted] for n, v in target.values(z).items()}
        draws = np.stack(list(values.values()), axis=-1)
        shift = self.apart * draws.std((0, 1)) * np.arange(settings.chains)[:, None, None]
        return Posterior(self.name, tuple(values), draws + shift, likelihood[accepted])


class Apart(Independence):
    """The means of successive chains are two standard deviations apart."""

    name = "apart"
    apart = 2.0


PLUGINS = [Independence(), Apart()]
