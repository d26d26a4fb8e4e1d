"""One Runge–Kutta step of the oscillator, in time and in velocity."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeAlias

from bayesdamp.numerics.lazily import jnp
from bayesdamp.physics.solver.tableau import A, B

if TYPE_CHECKING:
    from jax import Array

Acceleration: TypeAlias = "Callable[[Array, Array], Array]"


def step(acceleration: Acceleration, h: Array, theta: Array, omega: Array) -> tuple[Array, Array, Array]:
    """θ, θ̇ after the time h, and θ̈ before it."""
    slopes_theta: list[Array] = []
    slopes_omega: list[Array] = []
    for row in A:
        th, om = theta, omega
        for a, kt, ko in zip(row, slopes_theta, slopes_omega, strict=True):
            th, om = th + (a * h) * kt, om + (a * h) * ko
        slopes_theta.append(om)
        slopes_omega.append(acceleration(th, om))
    for b, kt, ko in zip(B, slopes_theta, slopes_omega, strict=True):
        if b:
            theta, omega = theta + (b * h) * kt, omega + (b * h) * ko
    return theta, omega, slopes_omega[0]


def land(acceleration: Acceleration, theta: Array, omega: Array) -> tuple[Array, Array]:
    """Time to, and θ at, θ̇ = 0: one step with the velocity as the variable (Hénon, Physica D 5, 1982).

    dt/dθ̇ = 1/θ̈ and dθ/dθ̇ = θ̇/θ̈, from the present θ̇ to 0; for a state already close to its turning point.
    """
    h = -omega
    slopes_time: list[Array] = []
    slopes_theta: list[Array] = []
    for row in A:
        th, om = theta, omega + sum(row) * h
        for a, kt in zip(row, slopes_theta, strict=True):
            th = th + (a * h) * kt
        inverse = 1.0 / acceleration(th, om)
        slopes_time.append(inverse)
        slopes_theta.append(om * inverse)
    time = sum((b * h) * k for b, k in zip(B, slopes_time, strict=True))
    theta = theta + sum((b * h) * k for b, k in zip(B, slopes_theta, strict=True))
    return jnp.asarray(time), jnp.asarray(theta)
