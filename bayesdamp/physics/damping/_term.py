"""What a damping term is."""

from __future__ import annotations

from abc import ABC, abstractmethod

from jax import Array
from jax.typing import ArrayLike


class DampingTerm(ABC):
    """A force F(θ̇) = coefficient · shape(θ̇) that takes energy out of the oscillation."""

    name: str
    parameter: str
    unit: str
    """Unit of the coefficient for an angle in rad; `m` in place of rad for a record in metres."""
    switches: bool = False
    """Whether the shape jumps with the sign of the velocity within the width ε."""

    @abstractmethod
    def shape(self, velocity: ArrayLike, epsilon: ArrayLike) -> Array:
        """Force per unit of the coefficient; velocity in rad/s, any shape."""

    @staticmethod
    def kernel(x: float, v: float, epsilon: float) -> float:
        """`shape` at one displacement x (rad) and velocity v (rad/s), ε > 0 (rad/s): what compiled kernels are made of.

        Plain Python with `math` and `np` alone. A term may depend on x too, which `shape` cannot.
        """
        raise NotImplementedError

    @abstractmethod
    def ratio_per_unit(self, amplitude: float, frequency: float) -> float:
        """Equivalent viscous damping ratio per unit of the coefficient.

        amplitude in rad, frequency in rad/s; from the energy lost in a cycle of a harmonic motion.
        """
