"""Equivalent damping ratios of cycles: closed forms for harmonic ones, elliptic integrals for a pendulum's."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import ellipk

from bayesdamp.inference.deviation.draws import (
    balanced_frequency,
    natural_frequency,
    orbit_at,
    works_on,
)
from bayesdamp.physics.damping import PAPER_TERMS
from bayesdamp.physics.forces import by_kernel, rest_near
from bayesdamp.physics.kernel import Solver
from bayesdamp.physics.restoring import LAWS

W, A = 4.5, 0.3
SMALL = 1e-6


def rest_of(restoring: str, law: np.ndarray, near: float, reach: float) -> float | None:
    return rest_near(by_kernel(LAWS.get(restoring).kernel, law), near, reach)


def cycle_at(
    amplitude: float, terms: tuple[str, ...], epsilon: float, restoring: str, law: np.ndarray, rest: float
) -> SimpleNamespace | None:
    """Return the cycle whose turning points are twice the amplitude apart, if there is one."""
    orbit = orbit_at(amplitude, restoring, tuple(map(float, law)), rest)
    if orbit is None:
        return None
    solver = Solver(terms, restoring, np.zeros(1), "angle", amplitude, W, epsilon, np.zeros(2))
    work = works_on(orbit, solver, np.zeros((1, 0)), np.ones(len(terms), bool))[0]
    ratios = work / (4 * np.pi * orbit.energy)
    return SimpleNamespace(energy=orbit.energy, work=work, ratios=ratios)


def test_a_pendulum_of_large_amplitude() -> None:
    """The energy is 2k sin²(A/2), and the work of the terms a quadrature over the angle, x = A sin φ."""
    k, amplitude = W**2, 2.8
    found = cycle_at(amplitude, PAPER_TERMS, SMALL, "pendulum", np.array([k, 0.1]), 0.1)
    assert found is not None
    assert found.energy == pytest.approx(2 * k * math.sin(amplitude / 2) ** 2, rel=1e-10)

    def speed(phi: float) -> float:
        x = amplitude * math.sin(phi)
        return math.sqrt(2 * k * (math.cos(x) - math.cos(amplitude)))

    shapes = (lambda v: 2 * v, lambda v: 1.0, lambda v: v * v)
    work = [
        4 * quad(lambda phi, s=s: s(speed(phi)) * amplitude * math.cos(phi), 0, math.pi / 2)[0]
        for s in shapes
    ]
    assert found.work == pytest.approx(work, rel=1e-3)
    assert abs(found.ratios[0] * W - 1) > 0.03  # control: not the small amplitude's


def test_no_cycle_beyond_the_barrier() -> None:
    """The barrier of a softening spring is at √(k/−β) = 0.577, that of a pendulum at π."""
    spring, pendulum = np.array([20.0, 0.0, -60.0]), np.array([20.0, 0.0])
    for amplitude, inside in ((0.5, True), (0.57, True), (0.59, False), (0.9, False)):
        assert (cycle_at(amplitude, ("viscous",), SMALL, "duffing", spring, 0.0) is not None) is inside
    for amplitude, inside in ((3.1, True), (3.2, False), (7.0, False)):
        assert (cycle_at(amplitude, ("viscous",), SMALL, "pendulum", pendulum, 0.0) is not None) is inside


def test_rest_and_frequency() -> None:
    law = np.array([20.0, -0.3, -60.0])
    assert rest_of("duffing", law, 0.0, 0.5) == pytest.approx(-0.3, abs=1e-9)
    assert rest_of("duffing", law, 5.0, 0.5) is None
    assert natural_frequency("duffing", law, -0.3, 0.3) == pytest.approx(math.sqrt(20), rel=1e-6)
    # At an amplitude a pendulum's is that of the elliptic integral; the first harmonic alone is 4e-4 off.
    orbit, pendulum = orbit_at(1.0, "pendulum", (20.0, 0.0), 0.0), np.array([20.0, 0.0])
    exact = math.sqrt(20) * math.pi / 2 / ellipk(math.sin(0.5) ** 2)
    assert orbit is not None
    assert orbit.frequency == pytest.approx(exact, rel=1e-10)
    assert balanced_frequency("pendulum", pendulum, 0.0, 1.0) == pytest.approx(exact, rel=1e-3)
    assert balanced_frequency("pendulum", pendulum, 0.0, 1.0) != pytest.approx(exact, rel=1e-4)
    paper = np.array([20.0, 1.0, 0.0])
    rest = rest_of("horizontal_pendulum", paper, 0.0, 1.0)
    assert rest is not None
    assert natural_frequency("horizontal_pendulum", paper, rest, 0.3) == pytest.approx(
        math.sqrt(20 + math.sin(rest))
    )
