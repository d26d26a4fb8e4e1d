"""Motions and their derivatives by parameters, against SciPy's eighth-order solver and central differences."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from bayesdamp.physics.damping import all_sums
from bayesdamp.physics.kernel.solve import QUANTITIES
from bayesdamp.physics.oscillator import Oscillator, Trajectories, simulate
from bayesdamp.physics.restoring import LAWS as LAW_PLUGINS
from tests.physics.independent import LAWS, PAPER, restoring, trajectory
from validation.truth.oscillator import SUMS

TIMES = np.linspace(0.0, 6.0, 241)
UNITS = {**PAPER, "c_xxv": 2.0, "stiffness": 20.0, "gravity": 5.0}
"""Sizes of parameters for central differences; 0.1 for angles and ε."""
LIMIT = 1e-6
"""Largest error in rad with the default settings."""


def acting(damping: str, law: str, **changed: float) -> dict[str, float]:
    """Return the parameters of a law and the paper's coefficients, 0 for terms that are not in the sum."""
    terms = {"viscous": "zeta", "coulomb": "mu_c", "quadratic": "mu_q"}
    shares = {parameter: PAPER[parameter] * (name in damping) for name, parameter in terms.items()}
    return {**shares, **LAWS[law], **changed}


@pytest.mark.parametrize(("law", "damping"), [("pendulum", SUMS[0]), ("duffing", SUMS[-1])])
def test_angle_velocity_and_acceleration_are_within_the_tolerance(law: str, damping: str) -> None:
    """The times do not begin at 0, and repeated times have equal values."""
    p = acting(damping, law)
    truth = trajectory(law, p, TIMES)
    times = 3.0 + np.repeat(TIMES, 2)
    for order, quantity in enumerate(QUANTITIES):
        scale = 0.3 * 20.0 ** (order / 2)
        for share in (1e-5, 1e-8):
            y = Trajectories(Oscillator(damping, law), times, quantity, p, share * scale).record(p)
            assert np.array_equal(y[::2], y[1::2])
            assert np.max(np.abs(y[::2] - truth[:, order])) < share * scale


def test_the_tables_of_tests_contain_every_law_and_sum() -> None:
    assert sorted(LAWS) == LAW_PLUGINS.names()
    assert list(SUMS) == all_sums()


@pytest.mark.parametrize("damping", SUMS)
def test_the_motion_of_every_sum_is_that_of_another_solver(damping: str) -> None:
    """Control: coefficients that are wrong by 1e-4."""
    p = acting(damping, "linear")
    y = simulate(Oscillator(tuple(damping.split("+")), "linear"), p, TIMES)
    assert np.max(np.abs(y - trajectory("linear", p, TIMES)[:, 0])) < LIMIT
    wrong = {n: v * (1.0001 if n in PAPER else 1.0) for n, v in p.items()}
    assert np.max(np.abs(y - trajectory("linear", wrong, TIMES)[:, 0])) > LIMIT


@pytest.mark.parametrize(
    ("law", "changed"),
    [
        ("horizontal_pendulum", {"stiffness": 491.0, "gravity": -243.0, "spring_angle": 0.56, "theta0": 1.2}),
        ("pendulum", {"theta0": 3.2, "omega0": 0.0}),  # nearly upside down: slow, then fast
        ("duffing", {"cubic": 2000.0, "theta0": 0.4}),
        ("linear", {"theta0": 0.05, "omega0": -2.0, "zeta": 6.0}),  # overdamped
        ("linear", {"theta0": 100.0, "stiffness": 1e4, "rest_angle": 0.0}),  # other scales
    ],
)
def test_unusual_motions_are_those_of_another_solver(law: str, changed: dict[str, float]) -> None:
    p = acting("viscous+quadratic", law, **changed)
    y = simulate(Oscillator(("viscous", "quadratic"), law), p, TIMES)
    truth = trajectory(law, p, TIMES, longest=0.01)[:, 0]
    assert np.max(np.abs(y - truth)) < LIMIT * max(1.0, abs(p["theta0"]))


def test_a_missing_parameter_and_an_unknown_quantity_are_refused() -> None:
    osc, p = Oscillator(("viscous",), "linear"), acting("viscous", "linear")
    with pytest.raises(ValueError, match="'zeta' is missing"):
        simulate(osc, {k: v for k, v in p.items() if k != "zeta"}, TIMES)
    with pytest.raises(ValueError, match="quantity"):
        simulate(osc, p, TIMES, quantity="angel")


def about_rest(p: dict[str, float]) -> np.ndarray:
    """Return the angle under c (θ − rest)² θ̇ on a horizontal pendulum by SciPy, with the rest by its root finder."""
    spring = restoring("horizontal_pendulum", p)
    rest = brentq(spring, -2.0, 2.0, xtol=1e-15)

    def slope(_: float, y: np.ndarray) -> list[float]:
        return [y[1], -p["c_xxv"] * (y[0] - rest) ** 2 * y[1] - spring(y[0])]

    fine = {"rtol": 1e-12, "atol": 1e-14, "max_step": 0.05}
    return solve_ivp(slope, (0.0, TIMES[-1]), (p["theta0"], p["omega0"]), "DOP853", TIMES, **fine).y[0]


HANGING = {"c_xxv": 2.0, "stiffness": 20.0, "gravity": 5.0, "spring_angle": 0.1, "theta0": 0.8, "omega0": 0.3}


def test_damping_by_the_displacement_is_about_the_equilibrium() -> None:
    """A given rest is only a start for its search. Also the derivatives follow the equilibrium."""
    osc = Oscillator("displacement", "horizontal_pendulum")
    trajectories = Trajectories(osc, TIMES, "angle", HANGING, 1e-10)
    y, slopes = trajectories.with_slopes(HANGING, tuple(HANGING))
    assert np.max(np.abs(y - about_rest(HANGING))) < 1e-9
    assert trajectories.record({**HANGING, "rest": 0.2}) == pytest.approx(y, abs=1e-10)
    for name, row in zip(HANGING, slopes, strict=True):
        h = 1e-4 * UNITS.get(name, 0.1)
        up, down = (about_rest({**HANGING, name: HANGING[name] + sign * h}) for sign in (1, -1))
        truth = (up - down) / (2 * h)
        assert np.max(np.abs(row - truth)) < 1e-5 * np.max(np.abs(truth)), name


def test_derivatives_of_an_acceleration_are_central_differences() -> None:
    """By every parameter of the paper's sum, also ε, of motions by another solver."""
    osc, p = Oscillator(SUMS[-1], "horizontal_pendulum"), acting(SUMS[-1], "horizontal_pendulum")
    y, slopes = Trajectories(osc, TIMES, "acceleration", p, 1e-10).with_slopes(p, osc.parameters)
    assert slopes.shape == (len(osc.parameters), TIMES.size)
    assert y == pytest.approx(trajectory("horizontal_pendulum", p, TIMES)[:, 2], abs=1e-8)
    for name, row in zip(osc.parameters, slopes, strict=True):
        h = 1e-3 * UNITS.get(name, 0.1)
        ends = [trajectory("horizontal_pendulum", {**p, name: p[name] + s * h}, TIMES) for s in (1, -1)]
        truth = (ends[0] - ends[1])[:, 2] / (2 * h)
        limit = 1e-3 if name == "epsilon" else 1e-4
        assert np.max(np.abs(row - truth)) < limit * np.max(np.abs(truth)), name
