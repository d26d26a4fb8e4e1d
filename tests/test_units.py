"""Units of records and of parameters."""

import pytest

from bayesdamp.physics.symbols import parameter_unit
from bayesdamp.types import UNITS, quantity_unit


def test_factors_of_units_are_those_of_their_definitions():
    bases = {
        "rad": {"deg": 57.29577951308232, "mrad": 1000.0, "urad": 1e6, "rpm": 9.549296585513721},
        "m": {"mm": 1000.0, "in": 39.37007874015748, "ft": 3.280839895013123, "g": 0.10197162129779283},
        "V": {"mV": 1000.0, "uV": 1e6}, "px": {"px": 1.0},
    }  # fmt: skip
    for base, scales in bases.items():
        assert {name: UNITS[name].scale for name in scales} == pytest.approx(scales, rel=1e-12)
        assert {UNITS[name].base for name in scales} == {base}


def test_every_base_is_a_unit_with_factor_1():
    for unit in UNITS.values():
        assert (UNITS[unit.base].factor, UNITS[unit.base].base) == (1.0, unit.base)
        assert unit.displacement.quantity is None


def test_recorded_values_are_labelled_with_quantity_and_unit():
    units = {("deg", "angle"): "deg", ("deg", "velocity"): "deg/s", ("deg", "acceleration"): "deg/s²",
             ("g", "acceleration"): "g", ("rpm", "velocity"): "rpm", ("rpm", "acceleration"): "rpm/s"}  # fmt: skip
    assert {pair: quantity_unit(*pair) for pair in units} == units
    names = {("deg", "angle"): "angle", ("in", "angle"): "position",
             ("V", "angle"): "signal", ("V", "velocity"): "velocity"}  # fmt: skip
    assert {(unit, q): UNITS[unit].quantity_name(q) for unit, q in names} == names


def test_parameters_of_a_record_in_volts_are_in_volts():
    names = ("zeta", "mu_c", "mu_q", "theta0", "cubic", "noise_sd")
    units = [parameter_unit(n, "duffing", "V", "acceleration") for n in names]
    assert units == ["1/s", "V/s²", "1/V", "V", "1/(V² s²)", "V/s²"]
