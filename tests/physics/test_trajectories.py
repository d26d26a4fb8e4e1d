"""Records from parameters by name: against SciPy's solver of order eight, closed forms, and central differences."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.trajectories import Trajectories
from tests.physics.independent import LAWS, PAPER, SUMS, restoring, trajectory, with_coulomb

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


def test_a_looser_tolerance_is_another_record() -> None:
    """Control: the errors that the tests allow can be told apart."""
    p, osc = acting(SUMS[-1], "linear"), Oscillator(SUMS[-1], "linear")
    loose, tight = (Trajectories(osc, TIMES, "angle", p, 0.3 * e).record(p) for e in (1e-4, 1e-10))
    assert 1e-9 < np.max(np.abs(loose - tight)) < 1e-4


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


def test_slopes_without_the_rest_are_seen() -> None:
    """Control: what a spring angle does by the rest alone is far beyond the limit."""
    osc = Oscillator("displacement", "horizontal_pendulum")
    made = Trajectories(osc, TIMES, "angle", HANGING, 1e-10)
    ((whole,), (alone,)) = (made.with_slopes(HANGING, ["spring_angle"])[1], _without_rest(made))
    assert np.max(np.abs(whole - alone)) > 1e-2 * np.max(np.abs(whole))


def _without_rest(made: Trajectories) -> np.ndarray:
    made._slopes_of_rest = lambda p: {}  # type: ignore[method-assign]
    return made.with_slopes(HANGING, ["spring_angle"])[1]


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


def test_many_are_each() -> None:
    osc, p = Oscillator("viscous", "linear"), acting("viscous", "linear")
    made = Trajectories(osc, TIMES, "angle", p)
    values = {name: np.full(3, value) for name, value in p.items()} | {"zeta": np.array([0.0, 0.05, 0.2])}
    found = made.many(values)
    assert found.shape == (3, TIMES.size)
    for zeta, row in zip(values["zeta"], found, strict=True):
        assert np.array_equal(row, made.record({**p, "zeta": zeta}))
    assert np.max(np.abs(found[0] - found[1])) > 1e-2


def test_an_escaping_motion_is_nan() -> None:
    """A softening spring beyond its hilltop, and a law without an equilibrium; before it, a motion is finite."""
    osc, p = Oscillator("viscous", "duffing"), acting("viscous", "duffing")
    made = Trajectories(osc, TIMES, "angle", p)
    found, slopes = made.with_slopes({**p, "theta0": 0.7}, ["zeta"])
    assert np.all(np.isnan(found))
    assert np.all(np.isnan(slopes))
    assert np.all(np.isfinite(made.record(p)))
    away = acting("viscous", "linear", stiffness=-20.0)
    assert np.all(
        np.isnan(Trajectories(Oscillator("viscous", "linear"), 10 * TIMES, "angle", away).record(away))
    )


def test_a_single_time_is_the_start() -> None:
    osc, p = Oscillator("viscous", "linear"), acting("viscous", "linear", omega0=0.4)
    for quantity, start in (("angle", 0.3), ("velocity", 0.4)):
        assert Trajectories(osc, np.array([2.0]), quantity, p).record(p).tolist() == [start]


def test_exact_friction_and_its_slopes() -> None:
    """Through turning points and sticking, against central differences of the closed form."""
    times = np.linspace(0.0, 10.0, 1003)
    p = {"mu_c": 0.3, "stiffness": 20.0, "rest_angle": 0.05, "epsilon": 0.0, "theta0": 0.35, "omega0": 1.3}
    names = ("mu_c", "stiffness", "theta0", "omega0")
    found, slopes = Trajectories(Oscillator("coulomb", "linear"), times, "angle", p, 1e-7).with_slopes(
        p, names
    )
    assert np.max(np.abs(found - with_coulomb(p, times)[:, 0])) < 1.5e-7
    for name, slope in zip(names, slopes, strict=True):
        d = 1e-6 * max(1.0, abs(p[name]))
        up, down = ({**p, name: p[name] + s * d} for s in (1, -1))
        difference = (with_coulomb(up, times)[:, 0] - with_coulomb(down, times)[:, 0]) / (2 * d)
        assert np.max(np.abs(slope - difference)) < 2e-4 * max(1.0, float(np.max(np.abs(difference))))
    narrow = Trajectories(Oscillator("coulomb", "linear"), times, "angle", p).record({**p, "epsilon": 0.05})
    assert np.max(np.abs(narrow - found)) > 1e-4  # control
