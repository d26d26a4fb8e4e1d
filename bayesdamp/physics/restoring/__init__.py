"""Define the base class of restoring laws and their registry. Each law is one class in a module of its own."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from bayesdamp.physics.forces import on_arrays, slope_of
from bayesdamp.plugins import Plugin, Registry
from bayesdamp.types import Symbol

SYMBOLS = {
    "stiffness": Symbol("stiffness k", r"stiffness $k$", "stiffness"),
    "gravity": Symbol("gravity γ", r"gravity $\gamma$", "gravity term"),
    "spring_angle": Symbol("spring angle θs", r"spring angle $\theta_s$", "angle of the relaxed spring"),
    "rest_angle": Symbol("rest angle θe", r"rest angle $\theta_e$", "angle at rest"),
    "cubic": Symbol("cubic β", r"cubic $\beta$", "cubic stiffness"),
}
"""Symbols for reports of the parameters of the shipped restoring laws, by name of the parameter."""


@dataclass(frozen=True)
class LinearForm:
    """A restoring law in the form of a linear regression: F_rest(θ) = offset + columns @ coefficients, at n angles θ.

    columns: matrix with the c regressors (known functions of the angle) as columns, (n, c); c = 0 if no parameter is
    unknown. The c coefficients are unknown and are fitted. offset: the part of the force that follows from known
    parameters, (n,); zeros if there is none. decode: function that converts fitted coefficients, (c,), to the values of
    the law's unknown parameters by name.
    """

    columns: np.ndarray
    offset: np.ndarray
    decode: Callable[[np.ndarray], dict[str, float]]

    @classmethod
    def of_sum(cls, regressors: Mapping[str, np.ndarray], known: Mapping[str, float]) -> LinearForm:
        """Return the linear regression for a force that is a sum of parameters, each times a regressor.

        A regressor is a known function of the angle. The coefficients are the parameters that are not in `known`.
        regressors: values of the regressor of each parameter, (n,), by its name. known: the values of the known
        parameters, by name.
        """
        free = [name for name in regressors if name not in known]
        zero = np.zeros_like(next(iter(regressors.values())))
        offset = sum((known[name] * f for name, f in regressors.items() if name in known), zero)
        columns = np.array([regressors[name] for name in free]).reshape(len(free), zero.size).T
        return cls(columns, offset, lambda c: dict(zip(free, map(float, c))))


class RestoringLaw(Plugin, ABC):
    """A restoring force F_rest(θ) per unit of inertia, with named parameters; θ in rad (or m for a translation).

    name: name of the law. parameters: names of its parameters, in the order in which `kernel` takes their values.
    """

    parameters: tuple[str, ...]
    formula: str = ""
    """Formula of the force, for reports."""
    symbols: ClassVar[Mapping[str, Symbol]] = SYMBOLS
    """Symbols of the parameters in reports, by name; a parameter without a symbol is shown by its name."""
    translates: bool = False
    """Whether the law can also describe a translation, with displacements in metres instead of angles."""
    shift: ClassVar[str] = ""
    """Name of the parameter that only shifts the force along θ, such as the rest angle; "" if the law has no such
    parameter. A record of velocities or accelerations does not determine it."""
    positive: ClassVar[tuple[str, ...]] = ()
    """Names of the parameters that must be above 0."""

    @staticmethod
    def kernel(x: float, p: Sequence[float] | np.ndarray) -> float:
        """Return the restoring force per unit of inertia, in rad/s², at one angle x (rad).

        p: values of the parameters, in the order of `parameters`. Each law must define this method. It may use only
        plain Python, `math` and `np`, because its source is compiled.
        """
        raise NotImplementedError

    def force(self, theta: ArrayLike, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the restoring force per unit of inertia, in rad/s², at angles θ (rad) of any shape.

        p: values of the parameters by name, which broadcast against θ.
        """
        values = tuple(np.asarray(p[n], float) for n in self.parameters)
        return on_arrays(self.kernel)(np.asarray(theta, float), values)

    def slope(self, theta: ArrayLike, p: Mapping[str, ArrayLike]) -> np.ndarray:
        """Return the derivative of the restoring force by the angle, in 1/s², at angles θ (rad) of any shape.

        p: values of the parameters by name, which broadcast against θ.
        """
        return slope_of(lambda x: self.force(x, p), np.asarray(theta, float))

    @abstractmethod
    def start(self, frequency: float, rest: float, known: Mapping[str, float]) -> dict[str, float]:
        """Return an initial guess of all parameters of the law, by name, at which fits start.

        Known parameters keep their values. The others are chosen such that the equilibrium is `rest` (rad) and small
        oscillations about it have the angular frequency `frequency` (rad/s), as far as the known values allow it.
        """

    @abstractmethod
    def linear_form(self, theta: np.ndarray, known: Mapping[str, float]) -> LinearForm:
        """Write the law, at angles θ (n,), as a linear regression for the parameters that are not in `known`.

        Estimators fit forces with it. The result contains the regressors, the part of the force that follows from known
        parameters, and a function that converts fitted coefficients, which can be other quantities than the parameters,
        to the unknown parameters (see `LinearForm`). A law may ignore known values here if their parameters cannot be
        separated from unknown ones. known: values of known parameters of the law, by name.
        """

    def natural(self, p: Mapping[str, float]) -> dict[str, float] | None:
        """Convert the law's parameters to natural coordinates, which are quantities that a record determines well.

        An example is the frequency. Searches for a mode make straight steps in these coordinates. p: values of the
        law's parameters and theta0, by name. The result has the same keys, but the value under a key can be another
        quantity. Return None if these coordinates do not exist for p, or if the law has none; of the shipped laws only
        the horizontal pendulum has them.
        """
        return None

    def from_natural(self, p: Mapping[str, Any]) -> dict[str, Any] | None:
        """Convert natural coordinates back to the law's parameters and theta0, by name.

        Natural coordinates are quantities that a record determines well, such as the frequency. p: their values, under
        the keys that `natural` returns, as numbers or arrays of one shape. If no valid parameters have these
        coordinates, at least one parameter in the result is NaN. Return None if the law has no natural coordinates.
        """
        return None

    def unit(self, parameter: str) -> str:
        """Return the unit of a parameter of the law, if displacements are in rad.

        Every parameter without an entry in this method is an angle, such as the angle at rest, so that its unit is rad.
        A law with a parameter of another unit must override this method. parameter: name of the parameter.
        """
        return {"stiffness": "1/s²", "gravity": "rad/s²", "cubic": "1/(rad² s²)"}.get(parameter, "rad")


LAWS: Registry[RestoringLaw] = Registry("bayesdamp.physics.restoring", "restoring law")
"""All restoring laws by name: those that ship with bayesdamp and those that a user adds."""
