"""Linear spring: restoring force k(θ − θ_e) with stiffness k and equilibrium θ_e."""

from collections.abc import Mapping, Sequence

import numpy as np

from bayesdamp.physics.restoring import LinearForm, RestoringLaw


class LinearSpring(RestoringLaw):
    """Linear spring F = k(θ − θ_e) per unit of inertia, with the stiffness k and the equilibrium θ_e."""

    formula = "k(θ − θe)"
    parameters = ("stiffness", "rest_angle")
    shift = "rest_angle"
    positive = ("stiffness",)
    translates = True

    @staticmethod
    def kernel(x: float, p: Sequence[float] | np.ndarray) -> float:
        """Return the restoring force k(x − θ_e) per unit of inertia at the displacement x (rad or m).

        The force is in rad/s² or m/s². p: the parameters k (1/s²) and θ_e (rad or m), in this order.
        """
        return p[0] * (x - p[1])

    def start(self, frequency: float, rest: float, known: Mapping[str, float]) -> dict[str, float]:
        """Return an initial guess of the parameters: k = ω², θ_e = `rest`; known parameters keep their values.

        frequency: ω in rad/s. rest: in rad or m.
        """
        return {"stiffness": frequency**2, "rest_angle": rest, **known}

    def linear_form(self, theta: np.ndarray, known: Mapping[str, float]) -> LinearForm:
        """Write the force k(θ − θ_e) at angles theta, (n,), as a linear regression for its unknown parameters.

        The result contains regressors, an offset, and a function that converts the coefficients to the unknown
        parameters (see `LinearForm`). The coefficients are the stiffness k, if it is unknown, and −kθ_e, if the
        equilibrium θ_e is unknown. The offset is the part of the force that follows from known parameters. known: their
        values, by name.
        """
        rest = known.get("rest_angle")
        if rest is not None:
            return LinearForm.of_sum({"stiffness": theta - rest}, known)
        form = LinearForm.of_sum({"stiffness": theta, "torque": np.ones_like(theta)}, known)

        def decode(c: np.ndarray) -> dict[str, float]:
            values = form.decode(c)
            torque = values.pop("torque")
            return {**values, "rest_angle": -torque / {**known, **values}["stiffness"]}

        return LinearForm(form.columns, form.offset, decode)


PLUGIN = LinearSpring()
