"""Quintic Hermite interpolation: the dense output between two nodes of a trajectory.

With θ, θ̇ and θ̈ at both ends of a step of length h the error is of order h⁶, the order of the integrator.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from bayesdamp.numerics.lazily import jit, jnp

if TYPE_CHECKING:
    from jax import Array


_C = (
    # Powers 0..5 of the six basis functions in the fraction s of the step, for
    # (θ_l, h θ̇_l, h² θ̈_l, θ_r, h θ̇_r, h² θ̈_r).
    (1.0, 0.0, 0.0, -10.0, 15.0, -6.0),
    (0.0, 1.0, 0.0, -6.0, 8.0, -3.0),
    (0.0, 0.0, 0.5, -1.5, 1.5, -0.5),
    (0.0, 0.0, 0.0, 10.0, -15.0, 6.0),
    (0.0, 0.0, 0.0, -4.0, 7.0, -3.0),
    (0.0, 0.0, 0.0, 0.5, -1.0, 0.5),
)


@jit(static_argnums=2)
def basis(fraction: Array, step: Array, derivative: int = 0) -> Array:
    """Weights of (θ_l, θ̇_l, θ̈_l, θ_r, θ̇_r, θ̈_r), shape (..., 6).

    fraction: position in the step, 0 to 1, shape (...); step: its length in s, same shape.
    derivative: 0 for the angle, 1 for the velocity, 2 for the acceleration.
    """
    powers = jnp.arange(6)
    factor = jnp.ones(6)
    for k in range(derivative):
        factor = factor * (powers - k)
    raised = [jnp.ones_like(fraction)]
    for _ in range(5):
        raised.append(raised[-1] * fraction)  # several times faster than a power, and so is its derivative
    exponent = jnp.maximum(powers - derivative, 0)
    monomials = factor * jnp.stack(raised, axis=-1)[..., exponent]
    weights = monomials @ jnp.asarray(_C).T
    h = step[..., None]
    scale = jnp.concatenate([jnp.ones_like(h), h, h**2, jnp.ones_like(h), h, h**2], axis=-1)
    return weights * scale / h**derivative
