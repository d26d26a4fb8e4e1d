"""What a restoring law is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from bayesdamp.physics.arrays import on_arrays, slope_of
from bayesdamp.types import Symbol

SYMBOLS = {
    "stiffness": Symbol("stiffness k", r"stiffness $k$", "stiffness"),
    "gravity": Symbol("gravity γ", r"gravity $\gamma$", "gravity term"),
    "spring_angle": Symbol("spring angle θs", r"spring angle $\theta_s$", "angle of the relaxed spring"),
    "rest_angle": Symbol("rest angle θe", r"rest angle $\theta_e$", "angle at rest"),
    "cubic": Symbol("cubic β", r"cubic $\beta$", "cubic stiffness"),
}
"""Of the laws that ship, which share most parameters."""


@dataclass(frozen=True)
class LinearForm:
    """F_rest(θ) = offset(θ) + columns(θ) @ coefficients, for regressions.

    columns: shape (n, c); offset: shape (n,), the part that is known.
    decode: coefficients, shape (c,), to the values of the free parameters.
    """

    columns: np.ndarray
    offset: np.ndarray
    decode: Callable[[np.ndarray], dict[str, float]]


class RestoringLaw(ABC):
    """F_rest(θ) with named parameters. Units for an angle in rad and a time in s."""

    name: str
    parameters: tuple[str, ...]
    formula: str = ""
    """The force as a report shows it."""
    symbols: ClassVar[Mapping[str, Symbol]] = SYMBOLS
    """How parameters are written, by their names where nothing is said."""
    translates: bool = False
    """Whether the law also describes a translation in metres."""
    shift: ClassVar[str] = ""
    """The parameter that moves the force along the angle and changes nothing else, "" where there is none."""

    @staticmethod
    def kernel(x: float, p: Sequence[float] | np.ndarray) -> float:
        """Restoring force per inertia, rad/s², at one angle x (rad), p in the order of `parameters`.

        Plain Python with `math` and `np` alone: compiled kernels are made of it, and `force`.
        """
        raise NotImplementedError

    def force(self, theta: ArrayLike, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the restoring force, rad/s²; θ of any shape, parameters broadcast against it."""
        values = tuple(np.asarray(p[n], float) for n in self.parameters)
        return on_arrays(self.kernel)(np.asarray(theta, float), values)

    def slope(self, theta: ArrayLike, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return its derivative by the angle, 1/s²."""
        return slope_of(lambda x: self.force(x, p), np.asarray(theta, float))

    @abstractmethod
    def start(self, frequency: float, rest: float, known: Mapping[str, float]) -> dict[str, float]:
        """All parameters, the known ones as known, the others such that small motions about `rest` (rad)
        have this angular frequency (rad/s), as far as what is known allows."""

    @abstractmethod
    def linear_form(self, theta: np.ndarray, known: Mapping[str, float]) -> LinearForm:
        """The law as a linear regression on the parameters that are not in `known`; θ of shape (n,)."""

    def natural(self, p: Mapping[str, float]) -> dict[str, float] | None:
        """Coordinates in which what a record shows well is straight, under the names of the law's parameters and
        theta0 (given among p); None where the parameters are such already, or none can be told."""
        return None

    def from_natural(self, p: Mapping[str, float]) -> dict[str, float] | None:
        """The inverse of `natural`; None where no parameters have these coordinates."""
        return None

    def unit(self, parameter: str) -> str:
        """Unit of a parameter for an angle in rad."""
        return {"stiffness": "1/s²", "gravity": "rad/s²", "cubic": "1/(rad² s²)"}.get(parameter, "rad")
