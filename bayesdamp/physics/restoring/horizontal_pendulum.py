"""The paper's horizontal pendulum k(θ − θ_s) − γ cos θ (paper, equation 1, with θ_s = 0 and γ = 1)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from bayesdamp.physics.forces import newton
from bayesdamp.physics.restoring import LinearForm, RestoringLaw


class HorizontalPendulum(RestoringLaw):
    """F = k(θ − θ_s) − γ cos θ: an arm on a torsion spring; γ is signed and may be as large as k."""

    name = "horizontal_pendulum"
    formula = "k(θ − θs) − γ cos θ"
    parameters = ("stiffness", "gravity", "spring_angle")

    @staticmethod
    def kernel(x: float, p: Sequence[float] | np.ndarray) -> float:
        """F at an angle x, p = (k, γ, θ_s)."""
        return p[0] * (x - p[2]) - p[1] * math.cos(x)

    def start(self, frequency: float, rest: float, known: Mapping[str, float]) -> dict[str, float]:
        """Return k from ω² = k + γ sin θ at rest and θ_s from the balance there, except for known parameters."""
        gravity = known.get("gravity", 0.0)
        stiffness = known.get("stiffness", frequency**2 - gravity * math.sin(rest))
        spring = rest - gravity * math.cos(rest) / stiffness
        return {"stiffness": stiffness, "gravity": gravity, "spring_angle": spring, **known}

    def natural(self, p: Mapping[str, float]) -> dict[str, float] | None:
        """Return the squared frequency of small motions, gravity, the equilibrium, and the start relative to it."""
        k, gravity, spring = p["stiffness"], p["gravity"], p["spring_angle"]

        def force_and_slope(x: float) -> tuple[float, float]:
            return k * (x - spring) - gravity * math.cos(x), k + gravity * math.sin(x)

        rest = newton(force_and_slope, p["theta0"]) if "theta0" in p else None
        rest = newton(force_and_slope, spring) if rest is None else rest
        if rest is None:
            return None
        start = p.get("theta0", 0.0) - rest
        slope = k + gravity * math.sin(rest)
        return {"stiffness": slope, "gravity": gravity, "spring_angle": rest, "theta0": start}

    def from_natural(self, p: Mapping[str, float]) -> dict[str, float] | None:
        """Return k = ω² − γ sin θ at rest, and θ_s by balance, from the angle at rest, γ and ω²."""
        rest, gravity = p["spring_angle"], p["gravity"]
        k = p["stiffness"] - gravity * math.sin(rest)
        if k <= 0:
            return None
        spring = rest - gravity * math.cos(rest) / k
        start = p.get("theta0", 0.0) + rest
        return {"stiffness": k, "gravity": gravity, "spring_angle": spring, "theta0": start}

    def linear_form(self, theta: np.ndarray, known: Mapping[str, float]) -> LinearForm:
        """Return a form that is linear in k, kθ_s and γ, or in the unknown ones of these."""
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
