"""The work of damping in a cycle, against quadrature for a pendulum of large amplitude."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from bayesdamp.inference.deviation.draws import unit_works
from bayesdamp.physics.damping import PAPER_TERMS
from bayesdamp.physics.forces import by_kernel
from bayesdamp.physics.kernel import Solver
from bayesdamp.physics.orbit import orbit_about
from bayesdamp.physics.restoring import LAWS

W = 4.5


def test_energy_and_work_of_a_pendulum_are_those_of_quadrature() -> None:
    """The energy is 2k sin²(A/2), and the work of the terms a quadrature over the angle, x = A sin φ."""
    k, amplitude = W**2, 2.8
    orbit = orbit_about(by_kernel(LAWS.get("pendulum").kernel, np.array([k, 0.1])), 0.1, amplitude)
    assert orbit.energy == pytest.approx(2 * k * math.sin(amplitude / 2) ** 2, rel=1e-10)
    solver = Solver(PAPER_TERMS, "pendulum", np.zeros(1), "angle", amplitude, W, 1e-6, np.zeros(2))
    works = unit_works(orbit, solver, np.zeros((1, 0)), np.ones(3, bool))[0]

    def speed(phi: float) -> float:
        x = amplitude * math.sin(phi)
        return math.sqrt(2 * k * (math.cos(x) - math.cos(amplitude)))

    shapes = (lambda v: 2 * v, lambda v: 1.0, lambda v: v * v)
    powers = (lambda phi, s=s: 4 * s(speed(phi)) * amplitude * math.cos(phi) for s in shapes)
    assert works == pytest.approx([quad(power, 0, math.pi / 2)[0] for power in powers], rel=1e-3)
    assert abs(works[0] * W / (4 * np.pi * orbit.energy) - 1) > 0.03  # control: not the small amplitude's
