"""Units of records and of parameters."""

from __future__ import annotations

import pytest

from bayesdamp.physics.symbols import parameter_unit
from bayesdamp.units import UNITS, quantity_unit


def test_how_much_of_a_unit_is_one_of_its_base():
    cases = [
        *(("deg", 57.29577951308232, "rad"), ("mrad", 1000.0, "rad"), ("rpm", 9.549296585513721, "rad")),
        *(("mm", 1000.0, "m"), ("in", 39.37007874015748, "m"), ("ft", 3.280839895013123, "m")),
        *(("g", 0.10197162129779283, "m"), ("mV", 1000.0, "V"), ("px", 1.0, "px")),
    ]
    for name, amount, base in cases:
        assert UNITS[name].scale == pytest.approx(amount, rel=1e-12)
        assert UNITS[name].base == base


def test_every_base_is_a_unit_of_itself():
    for unit in UNITS.values():
        assert UNITS[unit.base].factor == 1.0
        assert UNITS[unit.base].base == unit.base
        assert unit.displacement.quantity is None


def test_how_recorded_values_are_labelled():
    labels = [quantity_unit("deg", q) for q in ("angle", "velocity", "acceleration")]
    assert labels == ["deg", "deg/s", "deg/s²"]
    assert quantity_unit("g", "acceleration") == "g"
    assert quantity_unit("rpm", "velocity") == "rpm"
    called = [
        UNITS[u].quantity_name(q)
        for u, q in (("deg", "angle"), ("in", "angle"), ("V", "angle"), ("V", "velocity"))
    ]
    assert called == ["angle", "position", "signal", "velocity"]


def test_parameters_of_a_sensors_record_have_its_unit():
    names = ("zeta", "mu_c", "mu_q", "theta0", "cubic", "noise_sd")
    units = [parameter_unit(n, "duffing", "V", "acceleration") for n in names]
    assert units == ["1/s", "V/s²", "1/V", "V", "1/(V² s²)", "V/s²"]
