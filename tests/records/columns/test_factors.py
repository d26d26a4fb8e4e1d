"""A factor that a column's name has beside its unit, and what looks like one and is none."""

from __future__ import annotations

import pytest

from bayesdamp.records.columns.factors import factor_beside_unit

FACTORS = {
    "angle (deg x1000)": ("x1000", "deg"), "angle x1000 (deg)": ("x1000", "deg"), "angle (deg) x1000": ("x1000", "deg"),
    "angle (deg, x10)": ("x10", "deg"), "angle (x1000 deg)": ("x1000", "deg"), "angle*1000 (deg)": ("*1000", "deg"),
    "100*angle (deg)": ("100*", "deg"), "angle (deg/100)": ("/100", "deg"), "angle (0.1 deg)": ("0.1", "deg"),
    "angle_x1000_deg": ("x1000", "deg"), "phi_deg_x100": ("x100", "deg"), "angle (rad) 1e-3": ("1e-3", "rad"),
    "angle [°×100]": ("×100", "°"), "angle / 1e-3 rad": ("1e-3", "rad"), "angle in 1e-3 rad": ("1e-3", "rad"),
    "disp (1e-3 m)": ("1e-3", "m"), "disp [m x 10^-3]": ("x 10^-3", "m"), "disp (m·10^-3)": ("·10^-3", "m"),
    "disp (10⁻³ m)": ("10⁻³", "m"), "disp / 10^-3 m": ("10^-3", "m"), "accel (10^-3 m/s^2)": ("10^-3", "m/s^2"),
    "acc 10^(-3) (m/s^2)": ("10^(-3)", "m/s^2"), "a (10^3 counts)": ("10^3", "counts"), "U (V x1000)": ("x1000", "V"),
    "10^-3 m": ("10^-3", "m"), "time (1e-3 s)": ("1e-3", "s"), "time x1000 (s)": ("x1000", "s"),
}  # fmt: skip
NONE = (
    "", "x1", "x10", "x1000", "x1 (mm)", "x10 (mm)", "x1000 (mm)", "pos x10 (mm)", "x_10 (deg)", "v2 (mm/s)", "1e3 (m)",
    "Ch1 x10", "Ch1 x10 (V)", "probe x100 (V)", "Ch1 (1:10 V)", "U (V x10)", "A1e3 (deg)", "angle10 (deg)", "m1000 (m)",
    "accel (2 g)", "accel (16g)", "accel (±2g)", "accel (1000 g)", "sensor (10V)", "sensor (0-10 V)",
    "x (100 mm range)",
    "angle (10 deg)", "pos 0.01 (m)", "test 1/100 (mm)", "date 10/10 (deg)", "run 1000 (deg)", "angle (deg) 1000 Hz",
    "acc (m/s^2)", "acc (m/s2)", "acc (m s^-2)", "acc (m·s⁻²)", "vel (1/min)", "angle (deg)", "t (ms)", "F (x1000 N)",
    "angle x1000", "(" * 5000, "x1000 " * 5000, "_" * 5000, "1" * 5000 + " (deg)",
)  # fmt: skip


@pytest.mark.parametrize("name", FACTORS)
def test_a_factor_beside_a_unit(name: str) -> None:
    assert factor_beside_unit(name) == FACTORS[name]


@pytest.mark.parametrize("name", NONE, ids=lambda name: name[:30])
def test_what_is_none(name: str) -> None:
    """The negative control."""
    assert factor_beside_unit(name) is None


def test_a_unit_that_stands_apart() -> None:
    assert factor_beside_unit("disp", "[10^-3 m]") == ("10^-3", "m")
    assert factor_beside_unit("disp", "mm") is None
