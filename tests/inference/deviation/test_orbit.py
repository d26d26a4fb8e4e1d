"""Equivalent damping ratios of cycles: closed forms for harmonic ones, elliptic integrals for a pendulum's."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import ellipk

from bayesdamp.inference.deviation.numbers.curves import (
    balanced_frequency,
    natural_frequency,
    orbit_at,
    works_on,
)
from bayesdamp.physics.damping import PAPER_TERMS
from bayesdamp.physics.kernel import Solver
from bayesdamp.physics.rest import by_kernel, rest_near
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


@pytest.mark.parametrize("law", LAWS.names())
def test_harmonic_ratios(law: str) -> None:
    """Ratios are ζ/ω, 2μ/(πω²A) and 4μA/(3π): for a linear spring at any amplitude, for every law at a small one."""
    amplitude = A if law == "linear" else 1e-4
    p = LAWS.get(law).start(W, 0.2, {})
    law_p = np.array([p[n] for n in LAWS.get(law).parameters])
    found = cycle_at(amplitude, PAPER_TERMS, SMALL * amplitude * W, law, law_p, 0.2)
    assert found is not None
    expected = [1 / W, 2 / (math.pi * W**2 * amplitude), 4 * amplitude / (3 * math.pi)]
    assert found.ratios == pytest.approx(expected, rel=1e-4)
    assert found.energy == pytest.approx(0.5 * W**2 * amplitude**2, rel=1e-6)


@pytest.mark.parametrize("amplitude", [0.5, 1.5, 2.8])
def test_a_pendulum_of_large_amplitude(amplitude: float) -> None:
    """The energy is 2k sin²(A/2), and the work of the terms a quadrature over the angle, x = A sin φ."""
    k = W**2
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
    harmonic = 1 / W
    if amplitude > 1:
        assert abs(found.ratios[0] - harmonic) > 0.03 * harmonic  # control: not the small amplitude's


def test_an_uneven_spring_turns_at_equal_energies() -> None:
    """A horizontal pendulum under strong gravity has turning points, 2A apart, of equal potential."""
    law = np.array([20.0, 15.0, 0.0])
    rest = rest_of("horizontal_pendulum", law, 0.0, 2.0)
    assert rest is not None
    assert 20 * rest == pytest.approx(15 * math.cos(rest), abs=1e-9)
    found = cycle_at(0.8, ("viscous",), SMALL, "horizontal_pendulum", law, rest)
    assert found is not None

    def potential(x: float) -> float:
        return 10 * (x * x - rest * rest) - 15 * (math.sin(x) - math.sin(rest))

    centre = min(
        np.linspace(rest - 0.3, rest + 0.3, 60001), key=lambda c: abs(potential(c + 0.8) - potential(c - 0.8))
    )
    assert found.energy == pytest.approx(potential(float(centre) + 0.8), rel=1e-4)
    assert (
        abs(potential(rest + 0.8) - potential(rest - 0.8)) > 0.01 * found.energy
    )  # control: not about the rest


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
