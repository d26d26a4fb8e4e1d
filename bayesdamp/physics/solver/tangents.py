"""Forward tangents by named parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from bayesdamp.numerics.lazily import jax, jnp

if TYPE_CHECKING:
    from jax import Array


def with_slopes(
    fun: Callable[[dict[str, Any]], Array], names: Sequence[str], p: Mapping[str, Any]
) -> tuple[Array, Array]:
    """fun at parameters p, an array, and its derivatives by those of these names, one more axis in front."""

    def of(x: Array) -> Array:
        return fun({**p, **dict(zip(names, x, strict=True))})

    x = jnp.stack([jnp.asarray(p[name], float) for name in names])
    push = jax.vmap(lambda v: jax.jvp(of, (x,), (v,)), out_axes=(None, 0))
    return push(jnp.eye(x.size))
