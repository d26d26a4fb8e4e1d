"""Horizontal pendulum: an arm on a torsion spring under gravity, with the restoring force k(θ − θ_s) − γ cos θ.

k is the stiffness, θ_s the angle of the relaxed spring, γ the gravity term. With θ_s = 0 and γ = 1 this is equation 1
of the paper whose claims bayesdamp tests.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from bayesdamp.physics.forces import newton
from bayesdamp.physics.restoring import LinearForm, RestoringLaw


class HorizontalPendulum(RestoringLaw):
    """Horizontal pendulum F = k(θ − θ_s) − γ cos θ per unit of inertia: an arm on a torsion spring, under gravity.

    k is the stiffness of the spring, θ_s the angle at which it is relaxed, and γ the gravity term, which may be
    negative and as large as k.
    """

    formula = "k(θ − θs) − γ cos θ"
    parameters = ("stiffness", "gravity", "spring_angle")

    @staticmethod
    def kernel(x: float, p: Sequence[float] | np.ndarray) -> float:
        """Return the restoring force k(x − θ_s) − γ cos x per unit of inertia, in rad/s², at the angle x (rad).

        p: the parameters k (1/s²), γ (rad/s²) and θ_s (rad), in this order.
        """
        return p[0] * (x - p[2]) - p[1] * math.cos(x)

    def start(self, frequency: float, rest: float, known: Mapping[str, float]) -> dict[str, float]:
        """Return an initial guess of the parameters; known parameters keep their values.

        The law is F(θ) = k(θ − θ_s) − γ cos θ. If γ is unknown, it is 0. If k is unknown, it follows from ω² = F′(θ_e)
        = k + γ sin θ_e, with the equilibrium θ_e = `rest` (rad) and ω = `frequency` (rad/s). If θ_s is unknown, it
        follows from F(θ_e) = 0, or is θ_e if k = 0.
        """
        gravity = known.get("gravity", 0.0)
        stiffness = known.get("stiffness", frequency**2 - gravity * math.sin(rest))
        spring = rest - gravity * math.cos(rest) / stiffness if stiffness else rest
        return {"stiffness": stiffness, "gravity": gravity, "spring_angle": spring, **known}

    def natural(self, p: Mapping[str, float]) -> dict[str, float] | None:
        """Convert the parameters to natural coordinates: ω² of small oscillations, γ, equilibrium θ_e, and θ₀ − θ_e.

        They are stored under the keys `stiffness`, `gravity`, `spring_angle` and `theta0`. p: the parameters, under the
        same keys: stiffness k, gravity term γ, angle θ_s of the relaxed spring, and the start angle θ₀ (0 if missing).
        θ_e is the equilibrium that Newton's method reaches from θ₀ or, if it fails from there or θ₀ is missing, from
        θ_s. Return None if it fails from θ_s too.
        """
        k, gravity, spring = p["stiffness"], p["gravity"], p["spring_angle"]

        def force_and_slope(x: float) -> tuple[float, float]:
            return k * (x - spring) - gravity * math.cos(x), k + gravity * math.sin(x)

        rest = newton(force_and_slope, p["theta0"]) if "theta0" in p else None
        if rest is None:
            rest = newton(force_and_slope, spring)
        if rest is None:
            return None
        _, slope = force_and_slope(rest)
        start = p.get("theta0", 0.0) - rest
        return {"stiffness": slope, "gravity": gravity, "spring_angle": rest, "theta0": start}

    def from_natural(self, p: Mapping[str, Any]) -> dict[str, Any]:
        """Convert natural coordinates back to the law's parameters k, γ, θ_s and the start angle θ₀, by name.

        The force is F(θ) = k(θ − θ_s) − γ cos θ. p: the natural coordinates, under the keys `stiffness`, `gravity`,
        `spring_angle` and `theta0`: ω² of small oscillations, γ, the equilibrium θ_e, and θ₀ − θ_e (0 if missing). The
        result has these four keys. It follows from k = ω² − γ sin θ_e and F(θ_e) = 0. k and θ_s are NaN where k would
        be ≤ 0.
        """
        rest, gravity = p["spring_angle"], p["gravity"]
        k = p["stiffness"] - gravity * np.sin(rest)
        k = np.where(k > 0, k, np.nan)
        spring = rest - gravity * np.cos(rest) / k
        start = p.get("theta0", 0.0) + rest
        return {"stiffness": k, "gravity": gravity, "spring_angle": spring, "theta0": start}

    def linear_form(self, theta: np.ndarray, known: Mapping[str, float]) -> LinearForm:
        """Write the force k(θ − θ_s) − γ cos θ at angles theta, (n,), as a linear regression for unknown parameters.

        The result contains regressors, an offset, and a function that converts the coefficients to the unknown
        parameters (see `LinearForm`). The coefficients are the stiffness k and the gravity term γ, if they are unknown.
        If the angle θ_s of the relaxed spring is unknown, the product kθ_s is a further coefficient. The offset is the
        part of the force that follows from known parameters. known: their values, by name.
        """
        spring = known.get("spring_angle")
        if spring is not None:
            return LinearForm.of_sum({"stiffness": theta - spring, "gravity": -np.cos(theta)}, known)
        regressors = {"stiffness": theta, "gravity": -np.cos(theta), "torque": -np.ones_like(theta)}
        form = LinearForm.of_sum(regressors, known)

        def decode(c: np.ndarray) -> dict[str, float]:
            values = form.decode(c)
            torque = values.pop("torque")
            return {**values, "spring_angle": torque / {**known, **values}["stiffness"]}

        return LinearForm(form.columns, form.offset, decode)


PLUGIN = HorizontalPendulum()
