"""The true damping ratio of a simulated record equals closed forms and quadrature of the energy."""

import numpy as np
import pytest

from validation.truth.motion import NoMotionError, solve_motion
from validation.truth.oscillator import Discrepancy, Oscillator
from validation.truth.ratio import RatioCurve, harmonic_ratio, ratio_curve, true_ratio

W, A = 3.0, 0.4
LINEAR = {"stiffness": W * W, "rest_angle": 0.3}
SPRINGS = {
    "horizontal_pendulum": {"stiffness": 9.0, "spring_angle": 0.2, "gravity": -6.0},
    "duffing": LINEAR | {"cubic": 20.0},
}


def curve_of(oscillator: Oscillator, cycles: float, amplitude: float = A) -> RatioCurve:
    return ratio_curve(solve_motion(oscillator, amplitude, W, 2 * np.pi * cycles / W), oscillator.potential())


def inner(curve: RatioCurve) -> np.ndarray:
    """Return which points of a curve are far enough from its ends for records to be judged there."""
    return (curve.cycles > 0.75) & (curve.cycles < curve.cycles[-1] - 0.25)


@pytest.mark.parametrize(("cycles", "rel"), [(8, 1e-3), (60, 1e-6)])
def test_coulomb_friction_has_its_closed_form(cycles: float, rel: float) -> None:
    """Control: a ratio that is 0.2 % larger is not accepted."""
    friction = 0.85 * A * W**2 / (4 * cycles)
    curve = curve_of(Oscillator("linear", LINEAR, {"coulomb": friction}), cycles)
    at = inner(curve)
    expected = 2 * friction / (np.pi * W**2 * curve.amplitude[at])
    assert curve.ratio[at] == pytest.approx(expected, rel=rel)
    assert curve.ratio[at] != pytest.approx(1.002 * expected, rel=rel)


@pytest.mark.parametrize("law", ["horizontal_pendulum", "duffing"])
def test_light_damping_loses_the_energy_of_an_undamped_cycle(law: str) -> None:
    """Two ways: along the motion, and by quadrature over an undamped cycle of the same amplitude."""
    oscillator = Oscillator(law, SPRINGS[law], {"viscous": 0.003, "coulomb": 0.006})
    assert curve_of(oscillator, 40)(0.3) == pytest.approx(true_ratio(oscillator, 0.3), rel=1e-4)


def test_the_ratio_of_a_force_in_harmonic_motion_has_its_closed_form() -> None:
    assert harmonic_ratio(lambda x, v: abs(v) * v, A, W) == pytest.approx(4 * A / (3 * np.pi))
    assert harmonic_ratio(lambda x, v: x * x * v, A, W) == pytest.approx(A**2 / (8 * W))


def test_damping_that_drifts_has_the_ratio_of_each_time() -> None:
    odd = Discrepancy(scale=lambda t: 1 + 0.05 * t / 60)
    curve = curve_of(Oscillator("linear", LINEAR, {"viscous": 0.003 * W}, discrepancy=odd), 30)
    at = inner(curve)
    times = 2 * np.pi * curve.cycles[at] / W
    assert curve.ratio[at] == pytest.approx(0.003 * (1 + 0.05 * times / 60), rel=1e-4)


def test_a_motion_that_sticks_or_escapes_is_refused() -> None:
    with pytest.raises(NoMotionError, match="sticks"):
        solve_motion(Oscillator("linear", LINEAR, {"coulomb": 0.3}), A, W, 40.0)
    with pytest.raises(NoMotionError, match="creeps or escapes"):
        solve_motion(Oscillator("duffing", LINEAR | {"cubic": -100.0}, {"viscous": 0.01}), A, W, 40.0)
    with pytest.raises(ValueError, match="outside"):
        curve_of(Oscillator("linear", LINEAR, {"viscous": 0.03}), 20)(A)
