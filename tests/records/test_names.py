"""Units that columns are named after."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bayesdamp.records.cleaning.clean import clean
from bayesdamp.records.files.names import find_columns, seconds_in, unit_and_quantity, unit_said
from bayesdamp.records.opening import contents
from bayesdamp.records.read import read_record
from bayesdamp.records.readers.text import parse_table
from bayesdamp.records.record import resolved_unit


def unit_asked(path, value, unit, quantity) -> tuple[str, str]:
    """As `read` and the commands find them."""
    column = find_columns(contents(path).columns, value)[0]
    return resolved_unit(unit, quantity, *unit_said(column))


@pytest.mark.parametrize(
    ("name", "seconds"),
    [
        *(("Time_Elapsed(s)", 1.0), ("Zeit [s]", 1.0), ("Time (s) Run #1", 1.0), ("time (ms)", 1e-3)),
        *(("Zeit ms", 1e-3), ("x min", None), ("seconds", 1.0)),
        *(("TimeUS", 1e-6), ("timestampNs", 1e-9), ("time_ms", 1e-3), ("t(ms)", 1e-3), ("elapsed_us", 1e-6)),
        *(
            ("log.TimeUS", 1e-6),
            ("TimeSec", 1.0),
            ("millis", 1e-3),
            ("times", None),
            ("systems", None),
            ("atoms", None),
        ),
        *(("t / ms", 1e-3), ("time_us", 1e-6), ("t in min", 60.0), ("t/ms", 1e-3), ("timestamp [µs]", 1e-6)),
        *(
            ("time", None),
            ("t", None),
            ("ms", None),
            ("times", None),
            ("stamps", None),
            ("theta_s (ms) [s]", None),
        ),
        *(("time (h)", 3600.0), ("t_h", 3600.0), ("t in d", 86400.0), ("Zeit [Std]", 3600.0)),
        *(("Time (hour(s))", 3600.0), ("hours", 3600.0), ("Elapsed days", 86400.0), ("log.t / hrs.", 3600.0)),
        *(("time (ps)", 1e-12), ("timestamp [d]", 86400.0), ("Zeit Tage", 86400.0), ("time (sec.)", 1.0)),
        *(("Height (h)", None), ("x / d", None), ("theta_d", None), ("displacement (d)", None)),
        *(("power (PS)", None), ("day", None), ("hour", None), ("operating hours", None), ("mean_std", None)),
    ],
)
def test_times(name, seconds):
    assert seconds_in(name) == seconds


@pytest.mark.parametrize(
    ("name", "said"),
    [
        *(
            ("Angle(deg)", ("deg", "angle")),
            ("Winkel in Grad", ("deg", "angle")),
            ("phi [°]", ("deg", "angle")),
            ("theta_rad", ("rad", "angle")),
        ),
        *(("Position (m) Run #1", ("m", "angle")), ("x / mm", ("mm", "angle"))),
        *(("Velocity (m/s)", ("m", "velocity")), ("gyro z [deg/s]", ("deg", "velocity"))),
        *(("w / (rad/s)", ("rad", "velocity")), ("ω [rad s^-1]", ("rad", "velocity"))),
        *(("Linear Acceleration x (m/s^2)", ("m", "acceleration")), ("a [m/s²]", ("m", "acceleration"))),
        *(("a [m s⁻²]", ("m", "acceleration")), ("a (mm/s/s)", ("mm", "acceleration"))),
        *(("angle", None), ("phi", None), ("x_m_1", None), ("m", None)),
        *(
            ("angle (deg) (rad)", None),
            ("Angle(s)", None),
            ("x_in", None),
            ("theta_v", None),
            ("m (kg)", None),
        ),
        *(
            ("acc (g)", ("g", "acceleration")),
            ("speed [rpm]", ("rpm", "velocity")),
            ("U [V]", ("V", "angle")),
        ),
        *(
            ("gyro_z (dps)", ("dps", "velocity")),
            ("Position (cm)", ("cm", "angle")),
            ("x / in", ("in", "angle")),
        ),
        *(
            ("Velocity [mV]", ("mV", "velocity")),
            ("y (a.u.)", ("counts", "angle")),
            ("x (px)", ("px", "angle")),
        ),
        *(
            ("Winkel Grad", ("deg", "angle")),
            ("Weg mm", ("mm", "angle")),
            ("adc", ("counts", "angle")),
            ("left foot", None),
            ("mm", None),
            ("left in", None),
            ("U/V", ("V", "angle")),
            ("phi/deg", ("deg", "angle")),
            ("v/m/s", ("m", "velocity")),
            ("dx/dt", None),
        ),
        *(("m/s", None), ("x/rad", ("rad", "angle")), ("phi_dot/(deg/s)", ("deg", "velocity"))),
        *(("a (cm/s²)", ("cm", "acceleration")), ("a (g/s)", None), ("disp_um", ("um", "angle"))),
    ],
)
def test_values(name, said):
    assert unit_and_quantity(name) == said


T = np.arange(1500) * 0.01
Y = 0.3 * np.exp(-0.1 * T) * np.cos(6 * T)


def test_times_are_read_in_their_unit(tmp_path):
    for name, scale in (
        ("t (ms)", 1e3),
        ("t (s)", 1.0),
        ("t", 1.0),
        ("time (h)", 1 / 3600),
        ("t [d]", 1 / 86400),
    ):
        lines = [
            f"{name},angle",
            *(f"{scale * t!r},{y!r}" for t, y in zip(T.tolist(), Y.tolist(), strict=True)),
        ]
        path = tmp_path / "x.csv"
        path.write_text("\n".join(lines), encoding="utf-8")
        raw = read_record(path, time=1, value=2)
        assert raw.t is not None
        np.testing.assert_allclose(raw.t, T, atol=1e-12)
        assert any("Times are taken ×" in str(note) for note in raw.provenance.notes) == (scale != 1)


def test_a_name_that_says_another_unit_is_told_of(tmp_path):
    path = tmp_path / "x.csv"
    lines = ["t,phi (deg)", *(f"{t!r},{y!r}" for t, y in zip(T.tolist(), Y.tolist(), strict=True))]
    path.write_text("\n".join(lines), encoding="utf-8")
    raw = read_record(path, time=1, value=2)
    notes = [clean(raw, name="x", unit=unit).provenance.warnings for unit in ("rad", "deg")]
    told = [
        any("'phi (deg)'; its values are read as displacements in rad." in n for n in some) for some in notes
    ]
    assert told == [True, False]
    raw = replace(raw, provenance=replace(raw.provenance, value_column="gyro (deg/s)"))
    told = [clean(raw, name="x", unit=u, quantity="velocity").provenance.warnings for u in ("dps", "rpm")]
    assert [any("'gyro (deg/s)'" in n for n in some) for some in told] == [False, True]


def test_compare_takes_unit_and_quantity_from_the_name(tmp_path):
    path = tmp_path / "x.csv"
    path.write_text("t [ms];a (mm/s²);U [V]\n0,0;1,0;2,0\n10,0;1,5;2,0\n20,0;1,0;2,0\n", encoding="utf-8")
    for column in ("a (mm/s²)", 2, "2"):
        assert unit_asked(path, column, None, None) == ("mm", "acceleration")
    assert unit_asked(path, 2, "m", None) == ("m", "acceleration")
    assert unit_asked(path, 2, "rad", "angle") == ("rad", "angle")
    for column in (3, "U [V]"):
        assert unit_asked(path, column, None, None) == ("V", "angle")
    assert unit_asked(path, 3, "g", None) == ("g", "acceleration")


def test_compare_takes_the_quantity_from_a_word_where_no_unit_is_named(tmp_path):
    path = tmp_path / "x.csv"
    path.write_text("t,angularVelocity,accuracy\n0,0,1\n1,5,1\n2,0,1\n", encoding="utf-8")
    assert unit_asked(path, 2, None, None) == ("rad", "velocity")
    assert unit_asked(path, 2, "deg", None) == ("deg", "velocity")
    assert unit_asked(path, 2, None, "angle") == ("rad", "angle")
    assert unit_asked(path, 3, None, None) == ("rad", "angle")


ROWS = [f"{0.5 * i:.3f},{i % 7 - 3.0:.3f}" for i in range(40)]


@pytest.mark.parametrize(
    ("heads", "labels"),
    [
        (["Model,DSO", "Record Length,3000", "Time (ms),CH1 (V)"], ["Time (ms)", "CH1 (V)"]),
        (["Time,Channel A", "(ms),(V)", ""], ["Time (ms)", "Channel A (V)"]),
        (["Time,Angle", "s,-"], ["Time (s)", "Angle"]),
        (["Source,CH1", "second,Volt"], ["Source (second)", "CH1 (Volt)"]),
        (["# from the lab, 3 May", "t,phi"], ["t", "phi"]),
        (["s,V"], ["s", "V"]),
        (["Time,Angle", "h,deg"], ["Time (h)", "Angle (deg)"]),
        (["Rig 3,Rig 4", "h,d"], ["h", "d"]),
        (["a,b", "start,0.5"], ["a", "b"]),
    ],
)
def test_a_line_of_units_below_the_names_and_an_instruments_preamble(tmp_path, heads, labels):
    assert [column.label for column in parse_table([*heads, *ROWS]).columns] == labels


def test_a_column_may_be_asked_for_without_the_unit_that_stands_below(tmp_path):
    path = tmp_path / "x.csv"
    path.write_text("\n".join(["Time,Channel A", "(ms),(mV)", *ROWS]), encoding="utf-8")
    raw = read_record(path, time="Time", value="Channel A")
    assert raw.t is not None
    assert raw.t[1] - raw.t[0] == pytest.approx(5e-4)
    assert unit_asked(path, "Channel A", None, None) == ("mV", "angle")
