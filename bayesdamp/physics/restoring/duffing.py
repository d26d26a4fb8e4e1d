"""Duffing spring: restoring force k(θ − θ_e) + β(θ − θ_e)³ with stiffness k, cubic stiffness β and equilibrium θ_e."""

from collections.abc import Mapping, Sequence

import numpy as np

from bayesdamp.physics.restoring import LinearForm, RestoringLaw


class Duffing(RestoringLaw):
    """Duffing spring F = k x + β x³ per unit of inertia, with x = θ − θ_e and the equilibrium θ_e.

    k is the stiffness at the equilibrium. The cubic stiffness β may be negative; a trajectory can then escape to
    infinity.
    """

    formula = "k(θ − θe) + β(θ − θe)³"
    parameters = ("stiffness", "rest_angle", "cubic")
    shift = "rest_angle"
    translates = True

    @staticmethod
    def kernel(x: float, p: Sequence[float] | np.ndarray) -> float:
        """Return the restoring force k(x − θ_e) + β(x − θ_e)³ per unit of inertia at the displacement x (rad or m).

        The force is in rad/s² or m/s². p: the parameters k (1/s²), θ_e (rad or m) and β (1/(s² rad²) or 1/(s² m²)), in
        this order.
        """
        return (p[0] + p[2] * (x - p[1]) ** 2) * (x - p[1])

    def start(self, frequency: float, rest: float, known: Mapping[str, float]) -> dict[str, float]:
        """Return an initial guess of the parameters: k = ω², θ_e = `rest`, β = 0; known parameters keep their values.

        frequency: ω in rad/s. rest: in rad or m. known: values of known parameters, by name.
        """
        return {"stiffness": frequency**2, "rest_angle": rest, "cubic": 0.0, **known}

    def linear_form(self, theta: np.ndarray, known: Mapping[str, float]) -> LinearForm:
        """Write the force (k + β(θ − θ_e)²)(θ − θ_e) at angles theta, (n,), as a regression for its unknown parameters.

        The result contains regressors, an offset, and a function that converts the coefficients to the unknown
        parameters (see `LinearForm`). If the equilibrium θ_e is known, the coefficients are the stiffness k and the
        cubic stiffness β, if they are unknown; the offset is the part of the force that follows from the known one. If
        θ_e is unknown, the coefficients are the four coefficients of a general cubic polynomial in θ minus its mean,
        from which the parameters follow; the offset is 0, and known values of k and β are not used in the fit. known:
        values of the known parameters, by name.
        """
        if "rest_angle" in known:
            x = theta - known["rest_angle"]
            return LinearForm.of_sum({"stiffness": x, "cubic": x**3}, known)

        # If θ_e is unknown, fit a general cubic, which has one coefficient more than the law. θ_e is then the real
        # root of the cubic that is nearest to the mean angle; k is the slope there.
        centre = float(theta.mean())
        x = theta - centre

        def decode(c: np.ndarray) -> dict[str, float]:
            roots = np.roots(c[::-1])
            real = roots[np.abs(roots.imag) < 1e-9 * (1 + np.abs(roots))].real
            x_e = float(real[np.argmin(np.abs(real))])
            values = {"stiffness": float(c[1] + 2 * c[2] * x_e + 3 * c[3] * x_e**2), "cubic": float(c[3])}
            return {"rest_angle": centre + x_e, **{n: v for n, v in values.items() if n not in known}}

        return LinearForm(np.column_stack([x**0, x, x**2, x**3]), np.zeros_like(x), decode)


PLUGIN = Duffing()
