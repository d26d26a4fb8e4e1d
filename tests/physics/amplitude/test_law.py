"""Decays of an amplitude and their derivatives against SciPy's solver."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bayesdamp.inference.envelope.sums import Sum
from bayesdamp.physics.amplitude import (
    LOG_AT_REST,
    SUMS,
    AmplitudeSolver,
    DecayLaw,
    Scale,
    coefficient_from_rate,
    power_decay,
    rates_per_unit,
)
from bayesdamp.physics.damping import TERMS

T = np.linspace(0.0, 5.0, 41)


def law(*terms: str, scores: tuple[float, ...] = ()) -> DecayLaw:
    return Sum(terms, 0.5, -3.0, Scale()).law(scores)


def solved(t: np.ndarray, x0: float, rates: np.ndarray, rate: Callable, slope: Callable) -> np.ndarray:
    """Return x, where dx/dt = -Σ c_i s_i(x), and its derivatives by the rates c_i, (n, 1 + terms), until it rests.

    rate, slope: functions that return the shapes s_i and their derivatives, (terms,), at x.
    """

    def speed(_: float, y: np.ndarray) -> np.ndarray:
        return np.append(-rates @ rate(y[0]), -rate(y[0]) - rates @ slope(y[0]) * y[1:])

    def rests(_: float, y: np.ndarray) -> float:
        return y[0] + 20.0

    rests.terminal = True  # type: ignore[attr-defined]
    start = np.append(x0, np.zeros(rates.size))
    return solve_ivp(speed, (0.0, t[-1]), start, "DOP853", t, events=rests, rtol=1e-12, atol=1e-14).y.T


def solved_sum(t: np.ndarray, x0: float, terms: tuple[str, ...], rates: np.ndarray) -> np.ndarray:
    """Return `solved` for a sum of viscous, Coulomb and quadratic damping."""
    powers = np.array([{"viscous": 0.0, "coulomb": -1.0, "quadratic": 1.0}[term] for term in terms])
    return solved(t, x0, rates, lambda x: np.exp(powers * x), lambda x: powers * np.exp(powers * x))


@pytest.mark.parametrize(
    ("terms", "x0", "rates", "end"),
    [
        *((terms, 0.3, [0.4, 0.02, 0.3][: len(terms)], 5.0) for terms in SUMS),
        (("coulomb",), 0.3, [0.5], 5.0),
        (SUMS[-1], 0.3, [0.1, 1.0, 1.0], 5.0),
        (("viscous", "coulomb"), 0.3, [0.4, 0.0], 5.0),
        (SUMS[-1], 0.3, [0.0, 0.0, 0.0], 5.0),
        (SUMS[-1], 0.3, [1e-10, 1e-12, 1e-9], 5.0),
        (("viscous", "coulomb"), 0.3, [2.0, 1e-3], 5.0),
        (("coulomb", "quadratic"), 3.0, [1e-3, 3.0], 20.0),
    ],
)
def test_decays_and_their_derivatives_solve_their_equation(terms, x0, rates, end):
    """Two of them come to rest. Control: rates that are larger by 1e-5/s."""
    rates, t = np.array(rates), np.linspace(0.0, end, 41)
    truth = solved_sum(t, x0, terms, rates)
    n, solver = len(truth), AmplitudeSolver(law(*terms), t, end, 14)
    motion, other = (solver.solve(np.append(c, x0)) for c in (rates, rates + 1e-5))
    assert motion.y[:n] == pytest.approx(truth[:, 0], abs=1e-6)
    assert other.y[:n] != pytest.approx(truth[:, 0], abs=1e-6)
    assert motion.tangents[:n, :-1] == pytest.approx(truth[:, 1:], rel=1e-6, abs=1e-9)
    assert np.all(motion.y[n:] == LOG_AT_REST)
    assert not motion.tangents[n:].any()


def test_derivatives_are_exact_near_rest():
    """Viscous damping and friction, down to 0.3 % of the amplitude at the start, shortly before it becomes 0.

    Control: difference quotients with a step of 1e-4 of the mean rate, with which intervals were three times too wide.
    """
    terms, rates, end = ("viscous", "coulomb"), np.array([0.3, 0.045]), np.log(1.15 / 0.153) / 0.3
    t = np.linspace(0.0, end, 41)
    truth = solved_sum(t, 0.0, terms, rates)
    decay_law = law(*terms)
    assert decay_law.solve(t, 0.0, rates)[1] == pytest.approx(truth[:, 1:], rel=1e-6, abs=1e-9)
    steps = 1e-4 * -truth[-1, 0] / end * np.eye(2)
    ups, downs = ([decay_law.solve(t, 0.0, rates + sign * e)[0] for e in steps] for sign in (1, -1))
    quotients = (np.transpose(ups) - np.transpose(downs)) / (2 * steps[0, 0])
    assert quotients != pytest.approx(truth[:, 1:], rel=1e-3)


@pytest.mark.parametrize(
    ("terms", "scores", "rates"),
    [(("viscous", "power"), (0.6,), [0.2, 0.3]), (("stribeck",), (0.4, -0.3), [0.2])],
)
def test_decays_by_tables_solve_their_equation(terms, scores, rates):
    """Control: times that are longer by 1 %."""
    tabled, rates = law(*terms, scores=scores), np.array(rates)

    def rate(x: float) -> np.ndarray:
        return tabled.shapes(np.array([x]))[:, 0]

    truth = solved(T, 0.3, rates, rate, lambda x: (rate(x + 1e-6) - rate(x - 1e-6)) / 2e-6)
    (x, slopes), (later, other) = (tabled.solve(times, 0.3, rates) for times in (T, 1.01 * T))
    assert x == pytest.approx(truth[:, 0], abs=1e-6)
    assert slopes == pytest.approx(truth[:, 1:], rel=1e-6, abs=1e-9)
    assert later != pytest.approx(truth[:, 0], abs=1e-3)
    assert other != pytest.approx(truth[:, 1:], rel=1e-3)


def test_the_decay_of_a_power_law_solves_its_equation():
    for power in (0.5, 1.0, 1.0 + 1e-5, 3.0):
        q = power - 1.0
        shape, slope = lambda x, q=q: np.exp([q * x]), lambda x, q=q: q * np.exp([q * x])
        truth = solved(T, 0.2, np.array([0.3]), shape, slope)[:, 0]
        assert power_decay(T, 0.2, np.log(0.3), power) == pytest.approx(truth, abs=1e-6), power


def test_coefficients_from_rates_are_those_of_the_equation_of_motion():
    """Rates of the averaged equation (Nayfeh & Mook 1979) at A = 0.2 and ω = 7 for known ζ, μc and μq."""
    omega, amplitude, zeta, mu_c, mu_q = 7.0, 0.2, 0.05, 0.3, 0.4
    friction, drag = 2 * mu_c / (np.pi * omega), 4 * mu_q * omega * amplitude**2 / (3 * np.pi)
    losses = np.array([zeta * amplitude, friction, drag])
    rates = zip(SUMS[-1], losses / amplitude)
    coefficients = [coefficient_from_rate(*rate, amplitude, omega) for rate in rates]
    truth = {"zeta": zeta, "mu_c": mu_c, "mu_q": mu_q}
    assert {name: float(value) for name, value, _ in coefficients} == pytest.approx(truth)
    free = [coefficient_from_rate(*pair, amplitude, None) for pair in zip(SUMS[-1], losses / amplitude)]
    total = sum(float(c) * amplitude**p for (_, c, _), p in zip(free, (1, 0, 2)))
    assert total == pytest.approx(losses.sum())


def test_decay_rates_of_terms_are_those_of_the_documentation():
    """f(A) in dA/dt = -A f(A), from the table in docs/laws.md, at 0.2 rad and 7 rad/s."""
    a, omega, scale = 0.2, 7.0, Scale(0.2, 7.0)
    known = {
        "cubic": 3 / 8 * omega**2 * a**2,
        "displacement": a**2 / 8,
        "structural": 1 / (np.pi * omega),
        "coulomb": 2 / (np.pi * omega * a),
    }
    for name, truth in known.items():
        assert rates_per_unit(TERMS.get(name), np.zeros(1), {}, scale) == pytest.approx(truth, rel=1e-6), name
