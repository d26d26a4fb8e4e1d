"""Records from parameters by name: against SciPy's solver of order eight, closed forms, and central differences."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.trajectories import Trajectories
from tests.physics.independent import LAWS, PAPER, restoring, trajectory
from validation.truth.oscillator import SUMS

TIMES = np.linspace(0.0, 6.0, 241)
QUANTITIES = ("angle", "velocity", "acceleration")
UNITS = {
    "zeta": 0.05,
    "mu_c": 0.03,
    "mu_q": 0.05,
    "epsilon": 0.1,
    "c_xxv": 2.0,
    "stiffness": 20.0,
    "gravity": 5.0,
}
"""Sizes of parameters, of which central differences are a share; 0.1 for angles."""


def acting(damping: str, law: str, **changed: float) -> dict[str, float]:
    """The paper's coefficients of a sum, 0 for terms that it lacks, and a law's parameters."""
    terms = {"viscous": "zeta", "coulomb": "mu_c", "quadratic": "mu_q"}
    shares = {parameter: PAPER[parameter] * (name in damping) for name, parameter in terms.items()}
    return {**shares, **LAWS[law], **changed}


@pytest.mark.parametrize(("law", "damping"), [("pendulum", SUMS[0]), ("duffing", SUMS[-1])])
def test_a_record_is_within_its_tolerance(law: str, damping: str) -> None:
    """Of the angle, velocity and acceleration, from a time that is not 0; repeated times have the same value."""
    p = acting(damping, law)
    truth = trajectory(law, p, TIMES)
    times = 3.0 + np.repeat(TIMES, 2)
    for order, quantity in enumerate(QUANTITIES):
        scale = 0.3 * math.sqrt(20.0) ** order
        for share in (1e-5, 1e-8):
            found = Trajectories(Oscillator(damping, law), times, quantity, p, share * scale).record(p)
            assert np.array_equal(found[::2], found[1::2])
            assert np.max(np.abs(found[::2] - truth[:, order])) < share * scale


def pushed(p: dict[str, float]) -> np.ndarray:
    """The angle under c (θ − rest)² θ̇ on a horizontal pendulum, rest by bisection."""
    spring = restoring("horizontal_pendulum", p)
    low, high = -2.0, 2.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if spring(middle) < 0 else (low, middle)

    def slope(_: float, y: np.ndarray) -> list[float]:
        return [y[1], -p["c_xxv"] * (y[0] - low) ** 2 * y[1] - spring(y[0])]

    start = p["theta0"], p["omega0"]
    return solve_ivp(
        slope, (0.0, TIMES[-1]), start, "DOP853", TIMES, rtol=1e-12, atol=1e-14, max_step=0.05
    ).y[0]


HANGING = {"c_xxv": 2.0, "stiffness": 20.0, "gravity": 5.0, "spring_angle": 0.1, "theta0": 0.8, "omega0": 0.3}


def test_the_rest_moves_with_the_law() -> None:
    """Damping by the displacement: its rest is the equilibrium, whatever rest is given nearby, and so are slopes."""
    osc = Oscillator("displacement", "horizontal_pendulum")
    made = Trajectories(osc, TIMES, "angle", HANGING, 1e-10)
    names = tuple(HANGING)
    found, slopes = made.with_slopes(HANGING, names)
    assert np.max(np.abs(found - pushed(HANGING))) < 1e-9
    assert made.record({**HANGING, "rest": 0.2}) == pytest.approx(found, abs=1e-10)
    for name, row in zip(names, slopes, strict=True):
        h = 1e-4 * UNITS.get(name, 0.1)
        up, down = (pushed({**HANGING, name: HANGING[name] + sign * h}) for sign in (1, -1))
        truth = (up - down) / (2 * h)
        assert np.max(np.abs(row - truth)) < 1e-5 * np.max(np.abs(truth)), name


@pytest.mark.parametrize("quantity", ["angle", "acceleration"])
def test_slopes_are_central_differences(quantity: str) -> None:
    """By every parameter of the paper's sum, ε among them, of another solver's motions."""
    osc, order = Oscillator(SUMS[-1], "horizontal_pendulum"), QUANTITIES.index(quantity)
    p = acting(SUMS[-1], "horizontal_pendulum")
    found, slopes = Trajectories(osc, TIMES, quantity, p, 1e-10).with_slopes(p, osc.parameters)
    assert slopes.shape == (len(osc.parameters), TIMES.size)
    assert found == pytest.approx(trajectory("horizontal_pendulum", p, TIMES)[:, order], abs=1e-8)
    for name, row in zip(osc.parameters, slopes, strict=True):
        h = 1e-3 * UNITS.get(name, 0.1)
        ends = [trajectory("horizontal_pendulum", {**p, name: p[name] + s * h}, TIMES) for s in (1, -1)]
        truth = (ends[0] - ends[1])[:, order] / (2 * h)
        limit = 1e-3 if name == "epsilon" else 1e-4
        assert np.max(np.abs(row - truth)) < limit * np.max(np.abs(truth)), name
