"""What a form of damping is."""

from __future__ import annotations

from abc import ABC, abstractmethod


class Form(ABC):
    """A force coefficient · shape(θ, θ̇; further parameters) that takes energy out of the oscillation.

    further: names of what the shape takes beside θ, θ̇ and ε, in order: `rest`, where the motion comes to rest, and
    `reference_velocity` are given, others are inferred.
    """

    name: str
    parameter: str
    words: str
    switches: bool = False
    further: tuple[str, ...] = ()

    @staticmethod
    @abstractmethod
    def kernel(x: float, v: float, epsilon: float) -> float:
        """Force per unit of the coefficient at one point, in plain Python and `math`."""

    @abstractmethod
    def ratio_per_unit(self, amplitude: float, frequency: float) -> float:
        """Equivalent viscous damping ratio per unit of the coefficient, as of a damping term."""
