"""Closed forms of the averaged amplitude against SciPy's integrator."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bayesdamp.physics.amplitude import (
    LOG_AT_REST,
    SUMS,
    ClosedForm,
    coefficient_from_rate,
    decay,
    power_decay,
)

T = np.linspace(0.0, 5.0, 41)
RATES = {"viscous": 0.4, "coulomb": 0.02, "quadratic": 0.3}


def integrated(speed, x0: float) -> np.ndarray:
    return solve_ivp(
        lambda t, x: -speed(t, x), (0.0, T[-1]), [x0], t_eval=T, rtol=1e-11, atol=1e-12, max_step=0.05
    ).y[0]


@pytest.mark.parametrize("scale", [1.0, 1e-7])
def test_closed_forms_solve_their_equation(scale):
    for terms in SUMS:
        rates = np.array([RATES[term] for term in terms])
        rates[1:] *= scale
        truth = integrated(
            lambda t, x, terms=terms, rates=rates: ClosedForm(tuple(terms)).rate(x, rates), 0.3
        )
        assert decay(T, 0.3, terms, rates) == pytest.approx(truth, abs=1e-8), terms


def test_friction_stops_the_motion():
    x = decay(T, 0.0, ("coulomb",), np.array([1.0]))
    assert x[T >= 1.0] == pytest.approx(LOG_AT_REST)
    assert np.exp(x[T < 1.0]) == pytest.approx(1.0 - T[T < 1.0])
    x = decay(T, 0.0, SUMS[-1], np.array([0.1, 1.0, 1.0]))
    assert np.all(x[T > 1.0] == LOG_AT_REST)


def test_the_decay_of_a_power_law_solves_its_equation():
    for power in (0.5, 1.0, 1.0 + 1e-5, 3.0):
        truth = integrated(lambda t, x, power=power: 0.3 * np.exp((power - 1.0) * x), 0.2)
        assert power_decay(T, 0.2, np.log(0.3), power) == pytest.approx(truth, abs=1e-6), power


def test_coefficients_from_rates_are_those_of_the_equation_of_motion():
    """Rates of the averaged equation (Nayfeh & Mook 1979) at A = 0.2 and ω = 7 for known ζ, μc and μq."""
    omega, amplitude, zeta, mu_c, mu_q = 7.0, 0.2, 0.05, 0.3, 0.4
    friction, drag = 2 * mu_c / (np.pi * omega), 4 * mu_q * omega * amplitude**2 / (3 * np.pi)
    losses = np.array([zeta * amplitude, friction, drag])
    coefficients = [
        coefficient_from_rate(*pair, amplitude, omega) for pair in zip(SUMS[-1], losses / amplitude)
    ]
    assert {name: float(value) for name, value, _ in coefficients} == pytest.approx(
        {"zeta": zeta, "mu_c": mu_c, "mu_q": mu_q}
    )
    free = [coefficient_from_rate(*pair, amplitude, None) for pair in zip(SUMS[-1], losses / amplitude)]
    total = sum(float(c) * amplitude**p for (_, c, _), p in zip(free, (1, 0, 2)))
    assert total == pytest.approx(losses.sum())
