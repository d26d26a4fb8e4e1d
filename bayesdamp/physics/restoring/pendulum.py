"""Gravity pendulum: restoring force k sin(θ − θ_e) with stiffness k and hanging position θ_e."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from bayesdamp.physics.restoring import LinearForm, RestoringLaw


class Pendulum(RestoringLaw):
    """Gravity pendulum F = k sin(θ − θ_e) per unit of inertia, with hanging position θ_e.

    k is the stiffness for small displacements, which is the square of the natural frequency.
    """

    formula = "k sin(θ − θe)"
    parameters = ("stiffness", "rest_angle")
    shift = "rest_angle"
    positive = ("stiffness",)

    @staticmethod
    def kernel(x: float, p: Sequence[float] | np.ndarray) -> float:
        """Return the restoring force k sin(x − θ_e) per unit of inertia, in rad/s², at the angle x (rad).

        p: the parameters k (1/s²) and θ_e (rad), in this order.
        """
        return p[0] * math.sin(x - p[1])

    def start(self, frequency: float, rest: float, known: Mapping[str, float]) -> dict[str, float]:
        """Return an initial guess of the parameters: k = ω², θ_e = `rest`; known parameters keep their values.

        frequency: ω in rad/s. rest: in rad.
        """
        return {"stiffness": frequency**2, "rest_angle": rest, **known}

    def linear_form(self, theta: np.ndarray, known: Mapping[str, float]) -> LinearForm:
        """Write the force k sin(θ − θ_e) at angles theta, (n,), as a linear regression for its unknown parameters.

        The result contains regressors, an offset, and a function that converts the coefficients to the unknown
        parameters (see `LinearForm`). If the hanging position θ_e is unknown, the coefficients are k cos θ_e and −k sin
        θ_e, and the offset is 0; a known value of the stiffness k is then not used in the fit. If only θ_e is known,
        the coefficient is k, and the offset is 0. If both are known, there is no coefficient, and the offset is the
        force. known: values of the known parameters, by name.
        """
        rest = known.get("rest_angle")
        if rest is not None:
            return LinearForm.of_sum({"stiffness": np.sin(theta - rest)}, known)

        def decode(c: np.ndarray) -> dict[str, float]:
            stiffness = {} if "stiffness" in known else {"stiffness": float(np.hypot(*c))}
            return {**stiffness, "rest_angle": math.atan2(-c[1], c[0])}

        return LinearForm(np.column_stack([np.sin(theta), np.cos(theta)]), np.zeros_like(theta), decode)


PLUGIN = Pendulum()
