"""Units and quantities in the names of columns."""

import pytest

import bayesdamp
from bayesdamp.records.cleaning.clean import clean
from bayesdamp.records.files.contents import Column, seconds_in, unit_and_quantity, unit_of_column
from bayesdamp.records.read import read_record
from bayesdamp.records.readers.text import parse_table
from bayesdamp.types import InputError
from tests.records.tables import T, Y, write_table

TIMES = {
    1.0: "Time_Elapsed(s) | Zeit [s] | Time (s) Run #1 | seconds | TimeSec | time (sec.) | Group/t / s",
    1e-3: "time (ms) | Zeit ms | time_ms | t(ms) | millis | t / ms | t/ms",
    1e-6: "TimeUS | elapsed_us | log.TimeUS | time_us | timestamp [µs]",
    1e-9: "timestampNs", 1e-12: "time (ps)", 60.0: "t in min | Time min",
    3600.0: "time (h) | t_h | Zeit [Std] | Time (hour(s)) | hours | log.t / hrs. | Zeit h",
    86400.0: "t in d | Elapsed days | timestamp [d] | Zeit Tage",
    None: "x min | times | systems | atoms | time | t | ms | stamps | theta_s (ms) [s] | Height (h) | x / d | theta_d"
          " | displacement (d) | power (PS) | day | hour | operating hours | mean_std",
}  # fmt: skip
VALUES = {
    ("deg", "angle"): "Angle(deg) | Winkel in Grad | phi [°] | Winkel Grad | phi/deg",
    ("rad", "angle"): "theta_rad | x/rad", ("m", "angle"): "Position (m) Run #1", ("mm", "angle"): "x / mm | Weg mm",
    ("m", "velocity"): "Velocity (m/s) | v/m/s", ("deg", "velocity"): "gyro z [deg/s] | rate_deg/s",
    ("rad", "velocity"): "w / (rad/s) | ω [rad s^-1]", ("rpm", "velocity"): "speed [rpm]",
    ("dps", "velocity"): "gyro_z (dps)",
    ("m", "acceleration"): "Linear Acceleration x (m/s^2) | a [m/s²] | a [m s⁻²]", ("mm", "acceleration"): "a (mm/s/s)",
    ("cm", "acceleration"): "a_cm/s²", ("g", "acceleration"): "acc (g)", ("V", "angle"): "U [V] | U/V",
    ("cm", "angle"): "Position (cm)", ("in", "angle"): "x / in", ("mV", "velocity"): "Velocity [mV]",
    ("counts", "angle"): "y (a.u.) | adc", ("px", "angle"): "x (px)", ("um", "angle"): "disp_um",
    ("ustrain", "angle"): "strain (um/m) | gauge 1 [µm/m] | ε (µε) | strain_um/m",
    None: "angle | phi | x_m_1 | m | angle (deg) (rad) | Angle(s) | x_in | theta_v | m (kg) | left foot | mm | left in"
          " | dx/dt | m/s | a (g/s)",
}  # fmt: skip
COLUMNS = {
    ("m", "acceleration"): "a in m s^-2 | a / m s⁻² Run 2 | a in m / s^2", ("m", "velocity"): "v / m s^-1",
    ("1/s", "velocity"): "Winkelgeschwindigkeit in 1/s | Drehrate in 1/s", ("s⁻¹", "velocity"): "ω in s⁻¹ | ω/s⁻¹",
    ("", "velocity"): "Winkelgeschwindigkeit | theta_dot | Vitesse angulaire | omega", ("N", ""): "F in N",
    ("", "acceleration"): "Beschleunigung | accélération | theta_ddot",
    ("deg", "velocity"): "phi / deg s^-1 | omega in Grad pro Sekunde | gyro (degrees per second)",
    ("", ""): "run in air | angle / run 2 | Sensor 1 in Box 3 | Group/left | dot | swing in x | \\theta_{r}",
}  # fmt: skip


def test_units_in_names() -> None:
    columns = COLUMNS, lambda name: unit_of_column(Column(name, T))
    for table, read in ((TIMES, seconds_in), (VALUES, unit_and_quantity), columns):
        units = {name: unit for unit, names in table.items() for name in names.split(" | ")}
        assert {name: read(name) for name in units} == units


def test_a_given_unit_that_contradicts_the_name_gives_a_warning(tmp_path):
    raw = read_record(write_table(tmp_path / "x.csv", "t,phi (deg)", T, Y), time=1, value=2)
    for unit, warns in (("rad", True), ("deg", False)):
        warnings = str(clean(raw, name="x", unit=unit).provenance.warnings)
        assert ("'phi (deg)', but its values are used as displacements in rad; if" in warnings) is warns


@pytest.mark.parametrize(
    ("column", "given_unit", "given_quantity", "unit", "quantity"),
    [
        ("a (mm/s²)", None, None, "mm", "acceleration"), (2, None, None, "mm", "acceleration"),
        (2, "m", None, "m", "acceleration"), (2, "rad", "angle", "rad", "angle"), ("U [V]", None, None, "V", "angle"),
        (3, "g", None, "g", "acceleration"), (4, None, None, "rad", "velocity"), (4, "deg", None, "deg", "velocity"),
        (4, None, "angle", "rad", "angle"), (5, None, None, "rad", "angle"),
    ],
)  # fmt: skip
def test_a_given_unit_or_quantity_replaces_that_of_the_name(
    tmp_path, column, given_unit, given_quantity, unit, quantity
):
    y = [0.1 * Y] * 4
    path = write_table(tmp_path / "x.csv", "t [ms],a (mm/s²),U [V],angularVelocity,accuracy", 1e3 * T, *y)
    record = bayesdamp.read(path, value=column, unit=given_unit, quantity=given_quantity)
    assert (record.unit, record.quantity) == (unit, quantity)


def test_an_unknown_unit_is_refused(tmp_path) -> None:
    for head in ("t in s,Drehrate in 1/s", "t,ω\ns,1/s", "t (s),x (1/s)"):
        path = write_table(tmp_path / "x.csv", head, T, Y)
        with pytest.raises(InputError, match="its unit, '1/s', is not known; give a unit such as deg, rad/s"):
            bayesdamp.read(path).signal()
        assert bayesdamp.read(path, unit="rad").signal().quantity == "velocity"


ROWS = [f"{0.5 * i:.3f},{i % 7 - 3.0:.3f}" for i in range(40)]


def test_a_line_of_units_below_the_names_is_joined_to_them():
    for heads, labels in (
        (["Model,DSO", "Record Length,3000", "Time (ms),CH1 (V)"], ["Time (ms)", "CH1 (V)"]),
        (["Time,Channel A", "(ms),(V)", ""], ["Time (ms)", "Channel A (V)"]),
        (["Time,Angle", "s,-"], ["Time (s)", "Angle"]),
        (["# from the lab, 3 May", "t,phi"], ["t", "phi"]),
        (["s,V"], ["s", "V"]),
        (["Time,Angle", "h,deg"], ["Time (h)", "Angle (deg)"]),
        (["Rig 3,Rig 4", "h,d"], ["h", "d"]),
        (["a,b", "start,0.5"], ["a", "b"]),
    ):
        assert [column.label for column in parse_table([*heads, *ROWS]).columns] == labels
