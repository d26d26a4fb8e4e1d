"""Define what a restoring law is, and register the laws: one class in one module each, found by name."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from bayesdamp.physics.forces import on_arrays, slope_of
from bayesdamp.plugins import Registry
from bayesdamp.types import Symbol

SYMBOLS = {
    "stiffness": Symbol("stiffness k", r"stiffness $k$", "stiffness"),
    "gravity": Symbol("gravity γ", r"gravity $\gamma$", "gravity term"),
    "spring_angle": Symbol("spring angle θs", r"spring angle $\theta_s$", "angle of the relaxed spring"),
    "rest_angle": Symbol("rest angle θe", r"rest angle $\theta_e$", "angle at rest"),
    "cubic": Symbol("cubic β", r"cubic $\beta$", "cubic stiffness"),
}
"""Symbols of the laws that ship, which share most parameters."""


@dataclass(frozen=True)
class LinearForm:
    """F_rest(θ) = offset(θ) + columns(θ) @ coefficients, for regressions.

    columns: shape (n, c); offset: the known part, shape (n,); decode: returns the free parameters' values for
    coefficients, shape (c,).
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
    """How parameters are written; by default their names."""
    translates: bool = False
    """Whether the law also describes a translation in metres."""
    shift: ClassVar[str] = ""
    """The parameter that only moves the force along the angle; empty where there is none."""

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
        """Return the derivative of the force by the angle, 1/s²."""
        return slope_of(lambda x: self.force(x, p), np.asarray(theta, float))

    @abstractmethod
    def start(self, frequency: float, rest: float, known: Mapping[str, float]) -> dict[str, float]:
        """Return all parameters such that small motions about `rest` (rad) have this angular frequency (rad/s).

        Known parameters have their known values, as far as these allow that frequency.
        """

    @abstractmethod
    def linear_form(self, theta: np.ndarray, known: Mapping[str, float]) -> LinearForm:
        """Return the law as a linear regression on the parameters that are not in `known`; θ of shape (n,)."""

    def natural(self, p: Mapping[str, float]) -> dict[str, float] | None:
        """Return coordinates in which quantities that a record determines well are linear.

        They have the names of the law's parameters and theta0 (which is in p). None where the parameters themselves are
        such coordinates, or there are none.
        """
        return None

    def from_natural(self, p: Mapping[str, float]) -> dict[str, float] | None:
        """Return the inverse of `natural`; None where no parameters have these coordinates."""
        return None

    def unit(self, parameter: str) -> str:
        """Return the unit of a parameter for an angle in rad."""
        return {"stiffness": "1/s²", "gravity": "rad/s²", "cubic": "1/(rad² s²)"}.get(parameter, "rad")


LAWS: Registry[RestoringLaw] = Registry("bayesdamp.physics.restoring", "restoring law")
