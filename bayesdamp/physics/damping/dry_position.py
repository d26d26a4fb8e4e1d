"""Dry friction that depends on the position, to second order in the displacement.

It occurs where the normal force depends on the position (B. F. Feeny and F. C. Moon, J. Sound Vib. 170, 303 (1994)).
"""

import math
from collections.abc import Mapping

import numpy as np

from bayesdamp.physics.damping import DampingTerm, FreeParameter
from bayesdamp.priors import Normal
from bayesdamp.types import Symbol


class DryPosition(DampingTerm):
    """Friction F = μ_p max(1 + s u + q u², 0) tanh(θ̇/ε) per unit of inertia, with u = (θ − θ_e)/A and μ_p in rad/s².

    θ_e is the equilibrium, A a reference amplitude, and ε the width of the range of velocities θ̇ in which the friction
    changes its sign. μ_p is the friction at the equilibrium. s and q (numbers without unit) are the slope and the
    curvature of the friction with the position u. As long as 1 + s u + q u² > 0, a cycle of amplitude a dissipates the
    energy 4 μ_p a (1 + q (a/A)²/3); the slope has no effect on this energy.
    """

    parameter = "mu_p"
    symbol = Symbol("μp", r"$\mu_p$", "friction at the equilibrium")
    unit = "rad/s²"
    words = "position-dependent friction"
    formula = "μp max(1 + s u + q u², 0) tanh(θ̇/ε), u = (θ − θe)/A"
    switches = True
    inferred = (
        FreeParameter(
            "friction_slope",
            "1",
            lambda amplitude, frequency: Normal(mean=0.0, sd=0.5),
            Symbol("friction slope", "friction slope", "slope of friction with the position"),
        ),
        FreeParameter(
            "friction_curvature",
            "1",
            lambda amplitude, frequency: Normal(mean=0.0, sd=1.0),
            Symbol("friction curvature", "friction curvature", "curvature of friction with the position"),
        ),
    )
    given = ("rest", "reference_amplitude")
    reduces = (("friction_slope", 0.0), ("friction_curvature", 0.0))

    @staticmethod
    def kernel(
        x: float,
        v: float,
        epsilon: float,
        slope: float = 0.0,
        curvature: float = 0.0,
        rest: float = 0.0,
        scale: float = 1.0,
    ) -> float:
        """Return the friction per unit of its coefficient μ_p: max(1 + slope·u + curvature·u², 0) tanh(v/ε).

        Here u = (x − rest)/scale is the displacement from the equilibrium, relative to a reference amplitude. x, v:
        displacement and velocity in rad and rad/s, or in m and m/s. epsilon: width ε > 0, in the unit of v, of the
        range of velocities in which the friction changes its sign. slope, curvature: numbers without unit. rest, scale:
        the equilibrium and the reference amplitude, in the unit of x.
        """
        u = (x - rest) / scale
        return max(1.0 + slope * u + curvature * u * u, 0.0) * math.tanh(v / epsilon)

    def work(self, amplitude: float, frequency: float, further: Mapping[str, float]) -> float:
        """Return the energy lost in a cycle for μ_p = 1 rad/s², per unit of inertia (rad²/s²), in closed form.

        For a cycle of amplitude a (rad) it is 2 A ∫ (1 + s u + q u²) du over those u between −a/A and a/A at which the
        integrand is positive. It does not depend on the frequency. further: values of `friction_slope` (s),
        `friction_curvature` (q) and `reference_amplitude` (A, by default a), by name.
        """
        s, q = further["friction_slope"], further["friction_curvature"]
        scale = further.get("reference_amplitude", amplitude)
        end, discriminant = amplitude / scale, s * s - 4.0 * q
        zeros = []  # zeros of 1 + s u + q u², by a formula without cancellation for small q
        if discriminant > 0.0:
            half = -0.5 * (s + math.copysign(math.sqrt(discriminant), s))
            zeros = sorted(u for u in (1.0 / half, half / q if q else math.inf))
        edges = np.array([-end, *(u for u in zeros if abs(u) < end), end])
        integrals = np.diff(edges * (1.0 + edges * (s / 2.0 + edges * q / 3.0)))
        return float(2.0 * scale * np.maximum(integrals, 0.0).sum())


PLUGIN = DryPosition()
