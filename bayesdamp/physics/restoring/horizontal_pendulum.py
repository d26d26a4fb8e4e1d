"""The paper's horizontal pendulum k(θ − θ_s) − γ cos θ (paper, equation 1, with θ_s = 0 and γ = 1)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from bayesdamp.physics.forces import newton
from bayesdamp.physics.restoring import LinearForm, RestoringLaw


class HorizontalPendulum(RestoringLaw):
    """F = k(θ − θ_s) − γ cos θ: an arm on a torsion spring. γ may be negative and as large as k."""

    name = "horizontal_pendulum"
    formula = "k(θ − θs) − γ cos θ"
    parameters = ("stiffness", "gravity", "spring_angle")

    @staticmethod
    def kernel(x: float, p: Sequence[float] | np.ndarray) -> float:
        """Return F at the angle x; p = (k, γ, θ_s)."""
        return p[0] * (x - p[2]) - p[1] * math.cos(x)

    def start(self, frequency: float, rest: float, known: Mapping[str, float]) -> dict[str, float]:
        """Return an initial guess; known parameters keep their values.

        At the equilibrium θ_e = `rest`, k follows from ω² = F′(θ_e) = k + γ sin θ_e, and θ_s from F(θ_e) = 0.
        """
        gravity = known.get("gravity", 0.0)
        stiffness = known.get("stiffness", frequency**2 - gravity * math.sin(rest))
        spring = rest - gravity * math.cos(rest) / stiffness
        return {"stiffness": stiffness, "gravity": gravity, "spring_angle": spring, **known}

    def natural(self, p: Mapping[str, float]) -> dict[str, float] | None:
        """Return ω² of small oscillations under `stiffness`, γ under `gravity`, θ_e under `spring_angle`, and θ₀ − θ_e.

        The last is stored under `theta0`. θ_e is the equilibrium that Newton's method reaches from the start angle or,
        if it fails from there, from θ_s. Return None if it fails from both.
        """
        k, gravity, spring = p["stiffness"], p["gravity"], p["spring_angle"]

        def force_and_slope(x: float) -> tuple[float, float]:
            return k * (x - spring) - gravity * math.cos(x), k + gravity * math.sin(x)

        rest = newton(force_and_slope, p["theta0"]) if "theta0" in p else None
        if rest is None:
            rest = newton(force_and_slope, spring)
        if rest is None:
            return None
        displacement = p.get("theta0", 0.0) - rest
        _, squared_frequency = force_and_slope(rest)
        return {
            "stiffness": squared_frequency,
            "gravity": gravity,
            "spring_angle": rest,
            "theta0": displacement,
        }

    def from_natural(self, p: Mapping[str, Any]) -> dict[str, Any]:
        """Return the parameters from θ_e, γ, ω² and θ₀ − θ_e: k = ω² − γ sin θ_e, and θ_s from F(θ_e) = 0.

        k and θ_s are NaN where k would be ≤ 0.
        """
        rest, gravity = p["spring_angle"], p["gravity"]
        k = p["stiffness"] - gravity * np.sin(rest)
        k = np.where(k > 0, k, np.nan)
        spring = rest - gravity * np.cos(rest) / k
        start = p.get("theta0", 0.0) + rest
        return {"stiffness": k, "gravity": gravity, "spring_angle": spring, "theta0": start}

    def linear_form(self, theta: np.ndarray, known: Mapping[str, float]) -> LinearForm:
        """Return the regression for k, γ and kθ_s; known k and γ are left out, and kθ_s if θ_s is known."""
        names, columns, offset = [], [], np.zeros_like(theta)
        spring = known.get("spring_angle")
        lever = theta if spring is None else theta - spring
        if "stiffness" in known:
            offset = offset + known["stiffness"] * lever
        else:
            names.append("stiffness")
            columns.append(lever)
        if "gravity" in known:
            offset = offset - known["gravity"] * np.cos(theta)
        else:
            names.append("gravity")
            columns.append(-np.cos(theta))
        if spring is None:
            names.append("torque")
            columns.append(-np.ones_like(theta))

        def decode(c: np.ndarray) -> dict[str, float]:
            values = dict(zip(names, map(float, c)))
            if spring is None:
                torque = values.pop("torque")
                values["spring_angle"] = torque / values.get("stiffness", known.get("stiffness", np.nan))
            return values

        return LinearForm(np.column_stack(columns) if columns else np.zeros((theta.size, 0)), offset, decode)


PLUGIN = HorizontalPendulum()
