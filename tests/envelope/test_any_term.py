"""Other terms than the paper's in envelopes: turning points of the full oscillator, solved by SciPy, with noise."""

import csv
import json

import numpy as np
import pytest

from bayesdamp.cli import main
from bayesdamp.inference.envelope.decay import free_decay
from bayesdamp.inference.envelope.sums import distinguishable_sums
from bayesdamp.interface.envelopes import analyse
from bayesdamp.physics.damping import all_sums, parse_model
from bayesdamp.records.envelope.record import EnvelopeRecord, make_record
from bayesdamp.types import InputError
from tests.records.tables import write_table
from tests.studies import plugin_source
from validation.truth.turning_points import FORCES, FREQUENCY, OMEGA, readings, turning_points

SUMS = tuple(
    map(parse_model, ["viscous", "coulomb", "quadratic", "viscous+quadratic", "viscous+coulomb", "cubic"])
)


def envelope(force, seed: int, unit: str = "rad") -> EnvelopeRecord:
    t, a = readings(force, seed)
    return make_record("x", t, 20 * np.log10(a) if unit == "dB" else a, unit, FREQUENCY)


@pytest.mark.parametrize(
    ("term", "truths", "unit"),
    [
        ("cubic", {"mu_3": 0.15}, "dB"),
        ("stribeck", {"mu_k": 0.07, "static_excess": 3.0, "stribeck_velocity": 1.2}, "rad"),
        pytest.param("power", {"exponent": 1.5}, "rad", marks=pytest.mark.slow),
        pytest.param("dry_position", {"mu_p": 0.09, "friction_curvature": 2.0}, "dB", marks=pytest.mark.slow),
    ],
)
def test_a_term_and_its_parameters_are_recovered(term, truths, unit):
    """In dB without a reference, parameters with a scale are relative to the amplitude at the start."""
    answer = analyse(envelope(FORCES[term], 1, unit), sums=(*SUMS, *([] if term == "cubic" else [(term,)])))
    result = answer.verdict
    assert (result.damping, result.decided) == (term, True)
    start = 10 ** (np.mean(answer.curve.level[:3]) / 20.0) if unit == "dB" else 1.0
    powers = {"mu_3": 2, "mu_k": -1, "mu_p": -1, "stribeck_velocity": -1}
    coefficients = {c.name: c for c in result.coefficients}
    for name, truth in truths.items():
        scaled = truth * start ** powers.get(name, 0)
        assert coefficients[name].low <= scaled <= coefficients[name].high, name
    assert sum(item.share for item in result.energy) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize(
    ("force", "named"), [(FORCES["cubic"], "cubic"), (lambda x, v, turn: 0.1 * v * abs(v), "quadratic")]
)
def test_cubic_damping_is_compared_by_default(force, named):
    """With a twentieth of the prior odds of the seven sums. Control: quadratic damping keeps its name."""
    chosen, left_out = distinguishable_sums(tuple(map(parse_model, all_sums())))
    verdict = analyse(envelope(force, 2, "dB"), sums=chosen).verdict
    assert (verdict.damping, verdict.decided, left_out) == (named, True, ())
    sums = free_decay(envelope(force, 2, "dB"), None, chosen)[1]
    assert [sums[0].log_prior, sums[-1].log_prior] == pytest.approx([0.0, np.log(0.125 * 0.05)])


def written(path, unit: str = "rad") -> str:
    record = envelope(FORCES["thinning"], 3)
    return str(write_table(path, f"time (s),amplitude ({unit})", record.t, 10 ** (record.level / 20)))


def test_a_user_s_own_term_is_compared(tmp_path, capsys, refused):
    """Amplitudes in volts are refused if its force depends on a fixed velocity."""
    plugin, out = tmp_path / "thinning.py", tmp_path / "out"
    plugin.write_text(plugin_source("thinning"))
    options = ["--quantity", "envelope", "--frequency", str(OMEGA / 2 / np.pi), "--plugin", str(plugin)]
    assert main(["compare", written(tmp_path / "r.csv"), *options, "--out", str(out)]) == 0
    (item,) = json.loads((out / "verdict.json").read_text())
    assert item["damping"] == "thinning"
    assert "hinning damping" in item["sentence"]
    c = next(c for c in item["coefficients"] if c["name"] == "c_thinning")
    assert c["low"] <= 0.5 <= c["high"]
    (row,) = csv.DictReader((out / "verdicts.csv").read_text().splitlines())
    assert [float(row["thinning"])] == [e["probability"] for e in item["energy"] if e["term"] == "thinning"]
    assert "thinning" in (out / "report.html").read_text()
    capsys.readouterr()
    plugin.write_text(plugin_source("thinning").replace("/ thinning_velocity", "/ 0.35"))
    message = refused("compare", written(tmp_path / "v.csv", "V"), *options, "--out", str(tmp_path / "no"))
    assert "depends on the amplitude in rad or m" in message
    assert not (tmp_path / "no").exists()


def test_a_sum_of_indistinguishable_terms_is_refused():
    message = "viscous and structural dissipate the same energy at every amplitude"
    with pytest.raises(InputError, match=message):
        distinguishable_sums([parse_model("viscous+structural")])


def test_of_indistinguishable_sums_only_the_first_is_compared_with_a_remark():
    names = ["viscous", "structural", "cubic", "viscous+displacement", "displacement+structural"]
    sums, left_out = distinguishable_sums([parse_model(name) for name in names])
    assert sums == (("viscous",), ("cubic",), ("viscous", "displacement"))
    assert left_out == (
        "structural is left out: it dissipates the same energy as viscous at every amplitude.",
        "displacement+structural is left out: it dissipates the same energy as viscous+displacement at every "
        "amplitude.",
    )
    alone = analyse(envelope(FORCES["structural"], 2), sums=(("structural",), ("quadratic",))).verdict
    assert alone.damping == "structural"
    assert any("cannot distinguish structural" in line and "from viscous" in line for line in alone.remarks)
    kappa = next(c for c in alone.coefficients if c.name == "kappa")
    assert kappa.low <= 3.2 <= kappa.high


def test_decay_rates_are_right_if_no_sum_fits():
    """Cubic damping with the seven sums only: the answer is a deviation, with rates of the measured curve.

    Control: the rates of quadratic damping, the best of the sums, would be wrong by a factor of about two.
    """
    result = analyse(envelope(FORCES["cubic"], 3), sums=tuple(map(parse_model, all_sums()))).verdict
    assert (result.grade, result.decided, result.damping) == ("deviates", False, "quadratic")
    assert any("rates are computed from it" in line for line in result.remarks)
    t, a = turning_points(FORCES["cubic"])
    for item in result.decay_rate:
        near = item.amplitude * np.exp([0.1, -0.1])
        before, after = np.interp(-near, -a, t)
        assert item.value == pytest.approx(0.2 / (after - before), rel=0.02)
    assert result.deviation.low > 0.2
