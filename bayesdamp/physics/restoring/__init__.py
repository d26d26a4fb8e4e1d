"""Define the base class of restoring laws and their registry. Each law is one class in a module of its own."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

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
"""Symbols of the parameters of the laws that ship with bayesdamp."""


@dataclass(frozen=True)
class LinearForm:
    """A restoring law written for linear regression: F_rest(θ) = offset(θ) + columns(θ) @ coefficients.

    columns: shape (n, c); offset: the part from known parameters, shape (n,); decode: function that converts the
    coefficients, (c,), to the values of the unknown parameters by name.
    """

    columns: np.ndarray
    offset: np.ndarray
    decode: Callable[[np.ndarray], dict[str, float]]


class RestoringLaw(ABC):
    """A restoring law F_rest(θ) with named parameters; θ in rad (or m for a translation), time in s."""

    name: str
    parameters: tuple[str, ...]
    formula: str = ""
    """The force as a report shows it."""
    symbols: ClassVar[Mapping[str, Symbol]] = SYMBOLS
    """Symbols of the parameters by name; a parameter without a symbol is shown by its name."""
    translates: bool = False
    """Whether the law also describes a translation in metres."""
    shift: ClassVar[str] = ""
    """The parameter that only shifts the force along θ, such as the rest angle; "" if there is none."""

    @staticmethod
    def kernel(x: float, p: Sequence[float] | np.ndarray) -> float:
        """Return the restoring force per inertia, rad/s², at one angle x (rad); p is in the order of `parameters`.

        It may use only plain Python, `math` and `np`, because its source is compiled.
        """
        raise NotImplementedError

    def force(self, theta: ArrayLike, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the restoring force in rad/s². θ has any shape; parameters broadcast against it."""
        values = tuple(np.asarray(p[n], float) for n in self.parameters)
        return on_arrays(self.kernel)(np.asarray(theta, float), values)

    def slope(self, theta: ArrayLike, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the derivative of the force with respect to the angle, 1/s². Shapes are as in `force`."""
        return slope_of(lambda x: self.force(x, p), np.asarray(theta, float))

    @abstractmethod
    def start(self, frequency: float, rest: float, known: Mapping[str, float]) -> dict[str, float]:
        """Return an initial guess of all parameters.

        Known parameters keep their values. The others are chosen such that the equilibrium is `rest` (rad) and small
        oscillations about it have the angular frequency `frequency` (rad/s), as far as the known values allow it.
        """

    @abstractmethod
    def linear_form(self, theta: np.ndarray, known: Mapping[str, float]) -> LinearForm:
        """Return the law, at angles θ (n,), as a linear regression for the parameters that are not in `known`."""

    def natural(self, p: Mapping[str, float]) -> dict[str, float] | None:
        """Return better coordinates for sampling: quantities that a record determines well, such as the frequency.

        The result has the same keys as p (the law's parameters and theta0), but a key only marks a place: its value is
        another quantity, see the law. Return None if the law has no such coordinates or needs none.
        """
        return None

    def from_natural(self, p: Mapping[str, Any]) -> dict[str, Any] | None:
        """Return the parameters from coordinates of `natural`, which are numbers or arrays of one shape.

        At least one parameter is NaN where no valid parameters have these coordinates. Return None if the law has no
        such coordinates.
        """
        return None

    def unit(self, parameter: str) -> str:
        """Return the unit of a parameter for an angle in rad; for an unknown name "rad"."""
        return {"stiffness": "1/s²", "gravity": "rad/s²", "cubic": "1/(rad² s²)"}.get(parameter, "rad")


LAWS: Registry[RestoringLaw] = Registry("bayesdamp.physics.restoring", "restoring law")
"""All restoring laws, by name."""
