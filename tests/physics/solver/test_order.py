"""Measured orders of convergence: of the step, of the dense output, of both together."""

from __future__ import annotations

import math

import jax.numpy as jnp
import numpy as np
import pytest

from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.solver import stepper
from bayesdamp.physics.solver.hermite import basis
from bayesdamp.physics.solver.steps import MeshPlan
from bayesdamp.physics.solver.tableau import ORDER, A, B
from tests.physics.independent import LAWS, trajectory

PENDULUM = {**LAWS["pendulum"], "zeta": 0.4}
DURATION = 3.0


def slope(counts: list[int], errors: list[float]) -> float:
    """Measured order: minus the slope of log error against log number of steps."""
    return -float(np.polyfit(np.log(counts), np.log(errors), 1)[0])


def stepped(count: int) -> float:
    """The angle after DURATION in `count` equal steps."""
    p, theta, omega = PENDULUM, PENDULUM["theta0"], PENDULUM["omega0"]

    def acceleration(th, om):
        return -2 * p["zeta"] * om - p["stiffness"] * math.sin(th - p["rest_angle"])

    for _ in range(count):
        theta, omega, _ = stepper.step(acceleration, DURATION / count, theta, omega)  # type: ignore[arg-type]
    return float(theta)


def measured_order_of_step() -> float:
    truth = trajectory("pendulum", PENDULUM, np.asarray([0.0, DURATION]), longest=0.005)[-1, 0]
    counts = [192, 256, 384]
    return slope(counts, [abs(stepped(n) - truth) for n in counts])


def test_order_of_step():
    assert measured_order_of_step() == pytest.approx(ORDER, abs=0.3)


@pytest.mark.parametrize(("row", "column"), [(3, 1), (5, 2), (6, 5)])
def test_order_is_lost_with_a_wrong_coefficient(monkeypatch, row, column):
    """Negative control: one coefficient off by a thousandth, its row's sum kept."""
    rows = [list(r) for r in A]
    rows[row][column] += 1e-3
    rows[row][0] -= 1e-3
    monkeypatch.setattr(stepper, "A", tuple(map(tuple, rows)))
    assert measured_order_of_step() < ORDER - 1


def test_tableau_satisfies_the_quadrature_conditions():
    """Σ b c^(q−1) = 1/q for q = 1 … 6, c the sums of the rows."""
    c = [sum(row) for row in A]
    for q in range(1, ORDER + 1):
        assert sum(b * x ** (q - 1) for b, x in zip(B, c)) == pytest.approx(1 / q, abs=1e-14)


def test_landing_step_finds_the_turning_point():
    """One step in the velocity, from θ̇ small to θ̇ = 0, is of order six as well (closed form: a sinusoid)."""
    errors, lags = [], [0.4, 0.2, 0.1]
    for lag in lags:
        time, theta = stepper.land(lambda th, om: -th, math.cos(-lag), math.sin(lag))  # type: ignore[arg-type]
        errors.append(abs(float(time) - lag) + abs(float(theta) - 1.0))
    assert slope([round(1 / x) for x in lags], errors) > ORDER - 0.5


@pytest.mark.parametrize(("derivative", "order"), [(0, 6), (1, 5), (2, 4)])
def test_order_of_dense_output(derivative, order):
    """Between exact nodes of a sinusoid; each derivative costs one order."""
    s = np.linspace(0.0, 1.0, 41)
    errors, counts = [], [4, 8, 16, 32]
    for n in counts:
        h = 2.0 / n
        ends = np.array([[math.sin(t), math.cos(t), -math.sin(t)] for t in (0.7, 0.7 + h)]).reshape(-1)
        values = np.asarray(basis(jnp.asarray(s), jnp.full(s.shape, h), derivative)) @ ends
        truth = [np.sin, np.cos, lambda t: -np.sin(t)][derivative](0.7 + s * h)
        errors.append(float(np.max(np.abs(values - truth))))
    assert slope(counts, errors) == pytest.approx(order, abs=0.4)


def test_dense_output_is_exact_at_the_nodes():
    for derivative in range(3):
        weights = np.asarray(basis(jnp.asarray([0.0, 1.0]), jnp.asarray([0.3, 0.3]), derivative))
        expected = np.zeros((2, 6))
        expected[0, derivative] = expected[1, 3 + derivative] = 1.0
        np.testing.assert_allclose(weights, expected, atol=1e-13)


def test_order_of_a_record():
    """Steps and dense output together: the record at samples that are no nodes."""
    osc = Oscillator(("viscous",), "pendulum")
    times = np.linspace(0.0, DURATION, 101)
    truth = trajectory("pendulum", PENDULUM, times, longest=0.005)[:, 0]
    p = {n: jnp.asarray(PENDULUM[n]) for n in osc.parameters}
    errors, counts = [], [48, 96, 192]
    for n in counts:
        nodes = np.linspace(0.0, DURATION, n + 1)
        interval = np.clip(np.searchsorted(nodes, times, side="right") - 1, 0, n - 1)
        h = np.diff(nodes)
        weights = basis(jnp.asarray((times - nodes[interval]) / h[interval]), jnp.asarray(h[interval]))
        y = np.asarray(
            MeshPlan(jnp.asarray(h), jnp.asarray(n), jnp.asarray(interval), weights).record(osc, p)
        )
        errors.append(float(np.max(np.abs(y - truth))))
    assert slope(counts, errors) == pytest.approx(6, abs=0.5)
