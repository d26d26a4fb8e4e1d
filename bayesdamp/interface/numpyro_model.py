"""Turn a posterior into a NumPyro model, which can be run, extended, or given another prior."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import numpyro
from jax import Array, ShapeDtypeStruct, custom_jvp, numpy as jnp, pure_callback

from bayesdamp.config.checks import check_keys
from bayesdamp.priors import Prior, SharedHalfNormal, shared_log_density

Model = Callable[..., dict[str, Any]]


def numpyro_model(
    priors: Mapping[str, Prior],
    value_and_slopes: Callable[[np.ndarray], tuple[float, np.ndarray]],
    centre: np.ndarray,
    covariance: np.ndarray,
    prefix: str,
) -> Model:
    """Return a NumPyro model with the given priors of the parameters and the given log likelihood.

    Parameters
    ----------
    priors
        Priors by parameter.
    value_and_slopes
        Function of the parameters in their natural units, (d,), in the order of `priors`. It returns the log likelihood
        in nats and its gradient with respect to the parameters, (d,).
    centre, covariance
        Approximate posterior mean, (d,), and covariance, (d, d), of the parameters' standard normal scores z. The score
        of a parameter is a transformed value that is N(0, 1) under its prior. The sampler draws variables that are
        nearly uncorrelated, and the scores are computed from them with this mean and covariance.
    prefix
        Prefix of the names of the model's sites.

    Returns
    -------
    callable
        The model. Parameters that are passed to it by name are not sampled, and their prior is then not used. It
        returns all parameters by name, in natural units. It raises InputError for an unknown name.
    """
    names = list(priors)
    shape = ShapeDtypeStruct((1 + len(names),), float)

    def compute(x: Any) -> np.ndarray:
        value, slopes = value_and_slopes(np.asarray(x, float))
        return np.append(value, slopes)

    def both(x: Array) -> tuple[Array, Array]:
        result = pure_callback(compute, shape, x, vmap_method="sequential")
        return result[0], result[1:]

    @custom_jvp
    def density(x: Array) -> Array:
        return both(x)[0]

    def along(at: tuple[Array], direction: tuple[Array]) -> tuple[Array, Array]:
        value, slopes = both(*at)
        return value, slopes @ direction[0]

    density.defjvp(along)

    def sample(free: Sequence[str]) -> dict[str, Any]:
        """Sample the parameters named in `free` under their priors, and return them by name, in natural units.

        Each parameter becomes a deterministic site with its name. The sampler draws nearly uncorrelated variables u
        instead of the scores z, because it would explore a narrow, correlated posterior only slowly.
        """
        at = [names.index(n) for n in free]
        factor = np.linalg.cholesky(covariance[np.ix_(at, at)])
        u = numpyro.sample(
            f"{prefix}whitened", numpyro.distributions.Normal(0.0, 1.0).expand([len(free)]).to_event(1)
        )
        z = jnp.asarray(centre[at] + factor @ jnp.asarray(u))
        # z = centre + factor u. NumPyro adds log N(u; 0, I); replace it by the log prior of z plus log det factor.
        volume = float(np.sum(np.log(np.diag(factor))))
        # The log prior of z is −z²/2 for each score, without the constant −(d/2) log(2π), which cancels that of u. The
        # scores of parameters with a shared scale have a joint prior instead, in which the unknown scale is integrated
        # out; its density is divided by 2 for each of them, because z and −z give the same parameter.
        own = -0.5 * jnp.sum(z**2)
        places = np.flatnonzero([isinstance(priors[n], SharedHalfNormal) for n in free])
        if places.size:
            squares = jnp.sum(z[places] ** 2)
            constant = places.size * (0.5 * np.log(2 * np.pi) - np.log(2.0))
            own = -0.5 * (jnp.sum(z**2) - squares) + shared_log_density(squares, places.size) + constant
        numpyro.factor(f"{prefix}prior", 0.5 * jnp.sum(jnp.asarray(u) ** 2) + own + volume)
        return {
            n: numpyro.deterministic(f"{prefix}{n}", type(priors[n]).transform(z[i], *priors[n].numbers))
            for i, n in enumerate(free)
        }

    def model(**given: Any) -> dict[str, Any]:
        check_keys(given, names, "numpyro")
        free = [n for n in names if n not in given]
        values = {**given, **(sample(free) if free else {})}
        x = jnp.stack([jnp.asarray(values[n], float) for n in names])
        numpyro.factor(f"{prefix}log_likelihood", density(x))
        return {n: values[n] for n in names}

    return model
