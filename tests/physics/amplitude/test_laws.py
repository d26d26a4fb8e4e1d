"""Closed forms of the averaged amplitude against an independent integrator, and the deviation's derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bayesdamp.inference.deviation.linear import grid_of
from bayesdamp.inference.envelope.candidates import KNOTS, Blocks, solver_of
from bayesdamp.physics.amplitude import (
    NEAR_VISCOUS,
    RESTED,
    SUMS,
    ClosedForm,
    coefficient,
    decay,
    hats,
    power_decay,
    power_slopes,
)
from bayesdamp.physics.kernel.solve import ALL

T = np.linspace(0.0, 5.0, 41)
RATES = {"viscous": 0.4, "coulomb": 0.02, "quadratic": 0.3}


def integrated(speed, x0: float) -> np.ndarray:
    return solve_ivp(
        lambda t, x: -speed(t, x), (0.0, T[-1]), [x0], t_eval=T, rtol=1e-11, atol=1e-12, max_step=0.1
    ).y[0]


@pytest.mark.parametrize("scale", [1.0, 1e-7])
def test_a_sum_decays_as_its_equation_says(scale):
    for terms in SUMS:
        rates = np.array([RATES[term] for term in terms])
        rates[1:] *= scale
        truth = integrated(
            lambda t, x, terms=terms, rates=rates: ClosedForm(tuple(terms)).rate(x, rates), 0.3
        )
        assert decay(T, 0.3, terms, rates) == pytest.approx(truth, abs=1e-8), terms


def test_all_three_with_more_friction_than_the_roots_of_the_riccati_equation_are_real():
    terms, rates = SUMS[-1], np.array([0.1, 0.3, 0.4])
    truth = integrated(lambda t, x: ClosedForm(tuple(terms)).rate(x, rates), 1.0)
    assert decay(T[:20], 1.0, terms, rates) == pytest.approx(truth[:20], abs=1e-8)


def test_friction_comes_to_rest_and_stays():
    x = decay(T, 0.0, ("coulomb",), np.array([1.0]))
    assert x[T >= 1.0] == pytest.approx(RESTED)
    assert np.exp(x[T < 1.0]) == pytest.approx(1.0 - T[T < 1.0])
    x = decay(T, 0.0, SUMS[-1], np.array([0.1, 1.0, 1.0]))
    assert np.all(x[T > 1.0] == RESTED)


def test_a_power_law_decays_as_its_equation_says():
    for power in (0.5, 1.0, 1.0 + 1e-5, 3.0):
        truth = integrated(lambda t, x, power=power: 0.3 * np.exp((power - 1.0) * x), 0.2)
        assert power_decay(T, 0.2, np.log(0.3), power) == pytest.approx(truth, abs=1e-6), power


def test_power_slopes_are_differences():
    """At and about the exponent 1, where the closed form has another limit."""
    t, step = np.linspace(0.0, 1.2, 13), 1e-4

    def at(p: np.ndarray) -> np.ndarray:
        return power_decay(t, p[0], p[1] - (p[2] - 1.0) * p[0], p[2])

    for exponent in (-0.5, 1.0, 1.0 - 3 * NEAR_VISCOUS, 3.0):
        p = np.array([0.2, -0.9, exponent])
        expected = np.column_stack([(at(p + step * e) - at(p - step * e)) / (2 * step) for e in np.eye(3)])
        np.testing.assert_allclose(power_slopes(t, p), expected, atol=2e-7)
        assert not np.allclose(power_slopes(t, p), 1.001 * expected, atol=2e-7)  # control


def test_coefficients_are_those_of_the_equation_of_motion():
    """dA/dt of the averaged equation (Nayfeh & Mook 1979) at A = 0.2, ω = 7, from ζ, μc, μq and from rates at 0.2."""
    omega, amplitude, zeta, mu_c, mu_q = 7.0, 0.2, 0.05, 0.3, 0.4
    losses = np.array(
        [zeta * amplitude, 2 * mu_c / (np.pi * omega), 4 * mu_q * omega * amplitude**2 / (3 * np.pi)]
    )
    found = [coefficient(*pair, amplitude, omega) for pair in zip(SUMS[-1], losses / amplitude)]
    assert [name for name, _, _ in found] == ["zeta", "mu_c", "mu_q"]
    assert [float(value) for _, value, _ in found] == pytest.approx([zeta, mu_c, mu_q])
    free = [coefficient(*pair, amplitude, None) for pair in zip(SUMS[-1], losses / amplitude)]
    assert sum(float(c) * amplitude**p for (_, c, _), p in zip(free, (1, 0, 2))) == pytest.approx(
        losses.sum()
    )


def test_the_grid_of_the_deviation_has_all_the_probability():
    grid = grid_of(KNOTS, phases=False)
    tau, log_prior = grid.size_g, grid.log_prior
    assert np.exp(log_prior).sum() == pytest.approx(1.0)
    assert np.exp(log_prior[tau == 0]).sum() == pytest.approx(0.8)
    assert np.exp(log_prior[tau > 0]) @ tau[tau > 0] / 0.2 == pytest.approx(0.03, rel=0.15)


def test_derivatives_are_those_of_the_integrated_equation():
    terms = SUMS[-1]
    rates = np.array([RATES[term] for term in terms])
    b = Blocks(T, decay(T, 0.3, terms, rates), float(T[-1]), 0.5)
    tangents = solver_of(b, ClosedForm(terms)).solve(np.append(rates, 0.3), tangents=ALL).tangents
    h, h0, warp = tangents[:, : len(terms)], tangents[:, len(terms)], tangents[:, len(terms) + 1 :]
    step = 1e-4

    def slope(x0=0.0, last=0.0, knot=0.0):
        """Central difference of the integrated decay; g is one hat."""
        found = []
        for sign in (1.0, -1.0):
            moved, g = rates.copy(), np.zeros(KNOTS)
            moved[-1] += sign * last
            g[4] = sign * knot

            def speed(t, x, moved=moved, g=g):
                return ClosedForm(tuple(terms)).rate(x, moved) * (
                    1.0 + hats(np.array([t / T[-1]]), KNOTS)[0] @ g
                )

            found.append(integrated(speed, 0.3 + sign * x0))
        return (found[0] - found[1]) / (2 * step)

    assert h0 == pytest.approx(slope(x0=step), abs=1e-5)
    assert h[:, -1] == pytest.approx(slope(last=step), abs=1e-3)
    assert warp[:, 4] == pytest.approx(slope(knot=step), abs=1e-4)
