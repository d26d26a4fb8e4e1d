"""A posterior as a NumPyro model that others can run, extend, or put under a prior of their own."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import numpy as np
import numpyro
from jax import Array
from jax import numpy as jnp
from numpyro import distributions as dist

from bayesdamp.plugins import nearest
from bayesdamp.priors import Prior, SharedHalfNormal, shared_log_density
from bayesdamp.types import InputError

Model = Callable[..., dict[str, Any]]


def numpyro_model(
    priors: Mapping[str, Prior],
    value_and_slopes: Callable[[np.ndarray], tuple[float, np.ndarray]],
    centre: np.ndarray,
    covariance: np.ndarray,
    prefix: str,
) -> Model:
    """A NumPyro model of parameters with these priors and this log likelihood.

    value_and_slopes: of the log likelihood at parameters, (d,), in the order of priors. centre, covariance: of the
    parameters' scores, (d,) and (d, d), by which what is sampled is whitened.
    """
    names = list(priors)
    density = _traced(value_and_slopes, len(names))

    def model(**given: Any) -> dict[str, Any]:
        for name in given:
            if name not in names:
                raise InputError(f"numpyro: unknown parameter {name!r}{nearest(name, names)}")
        values = {**given, **_sampled([n for n in names if n not in given])}
        numpyro.factor(
            f"{prefix}log_likelihood", density(jnp.stack([jnp.asarray(values[n], float) for n in names]))
        )
        return {n: values[n] for n in names}

    def _sampled(free: Sequence[str]) -> dict[str, Any]:
        """Parameters under their priors, as sites of their names; what is sampled are whitened scores, as a posterior
        that is narrow and correlated is hard to find one's way into."""
        if not free:
            return {}
        at = [names.index(n) for n in free]
        factor = np.linalg.cholesky(covariance[np.ix_(at, at)])
        u = numpyro.sample(f"{prefix}whitened", dist.Normal(0.0, 1.0).expand([len(free)]).to_event(1))
        z = jnp.asarray(centre[at] + factor @ jnp.asarray(u))
        # The density of u times that of what is put in its place: the prior of the scores, and the volume.
        volume = float(np.sum(np.log(np.diag(factor))))
        own = _log_prior(z, [isinstance(priors[n], SharedHalfNormal) for n in free])
        numpyro.factor(f"{prefix}prior", 0.5 * jnp.sum(jnp.asarray(u) ** 2) + own + volume)
        return {
            n: numpyro.deterministic(f"{prefix}{n}", type(priors[n]).transform(z[i], *priors[n].numbers))
            for i, n in enumerate(free)
        }

    return model


def _traced(
    value_and_slopes: Callable[[np.ndarray], tuple[float, np.ndarray]], count: int
) -> Callable[[Array], Array]:
    """Return the log likelihood of `count` parameters as JAX calls it, with its gradient."""
    shape = jax.ShapeDtypeStruct((1 + count,), float)

    def computed(x: Any) -> np.ndarray:
        value, slopes = value_and_slopes(np.asarray(x, float))
        return np.append(value, slopes)

    def both(x: Array) -> tuple[Array, Array]:
        found = jax.pure_callback(computed, shape, x, vmap_method="sequential")
        return found[0], found[1:]

    @jax.custom_jvp
    def density(x: Array) -> Array:
        return both(x)[0]

    def along(at: tuple[Array], direction: tuple[Array]) -> tuple[Array, Array]:
        value, slopes = both(*at)
        return value, slopes @ direction[0]

    density.defjvp(along)
    return density


def _log_prior(z: Array, shared: Sequence[bool]) -> Array:
    """Log prior density of scores z, (d,), over (2π)^(−d/2): N(0, 1), or with an unknown scale, the same for all, where
    `shared`. A score that is reflected has half of the density on each side of zero."""
    places = np.flatnonzero(shared)
    if not places.size:
        return -0.5 * jnp.sum(z**2)
    squares = jnp.sum(z[places] ** 2)
    constant = places.size * (0.5 * np.log(2 * np.pi) - np.log(2.0))
    return -0.5 * (jnp.sum(z**2) - squares) + shared_log_density(squares, places.size) + constant
