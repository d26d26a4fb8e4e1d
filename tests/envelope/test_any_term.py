"""Terms beside the paper's in envelopes: the full oscillator solved by SciPy, its turning points read with noise."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

from bayesdamp.cli import main
from bayesdamp.inference.envelope.sums import distinguishable_sums
from bayesdamp.interface.envelopes import analyse
from bayesdamp.physics.damping import parse_model
from bayesdamp.records.envelope.record import EnvelopeRecord, make_record
from bayesdamp.types import InputError
from validation.truth.turning_points import FORCES, FREQUENCY, OMEGA, readings, turning_points

SUMS = tuple(
    map(parse_model, ["viscous", "coulomb", "quadratic", "viscous+quadratic", "viscous+coulomb", "cubic"])
)
THINNING = '''
from bayesdamp.physics.damping import DampingTerm


class Thinning(DampingTerm):
    """F = c v / (1 + |v|/0.35)."""

    name = "thinning"
    parameter = "c_thinning"
    unit = "1/s"
    words = "thinning"

    @staticmethod
    def kernel(x, v, epsilon):
        return v / (1.0 + abs(v) / 0.35)


PLUGIN = Thinning()
'''


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
def test_a_term_is_named_and_its_numbers_are_recovered(term, truths, unit):
    """Without a scale, numbers that have one are relative to the amplitude at the start."""
    answer = analyse(envelope(FORCES[term], 1, unit), sums=(*SUMS, *([] if term == "cubic" else [(term,)])))
    result, level = answer.verdict, answer.curve.level[:3]
    assert result.damping == term
    assert result.decided
    start = float(np.exp(np.mean(np.log(10.0) / 20.0 * level))) if unit == "dB" else 1.0
    powers = {"mu_3": 2, "mu_k": -1, "mu_p": -1, "stribeck_velocity": -1}
    values = {c.name: c for c in result.coefficients}
    for name, truth in truths.items():
        item, true = values[name], truth * start ** powers.get(name, 0)
        assert item.low <= true <= item.high, name
    assert sum(item.share for item in result.energy) == pytest.approx(1.0, abs=0.05)


def written(path, unit: str = "rad") -> str:
    record = envelope(FORCES["thinning"], 3)
    y = 10 ** (record.level / 20)
    rows = "\n".join(f"{t:.7g},{a:.9g}" for t, a in zip(record.t, y))
    path.write_text(f"time (s),amplitude ({unit})\n{rows}\n")
    return str(path)


def test_a_user_s_own_term_is_weighed(tmp_path, capsys, refused):
    plugin = tmp_path / "thinning.py"
    plugin.write_text(THINNING)
    file = written(tmp_path / "r.csv")
    out = tmp_path / "out"
    frequency = ["--quantity", "envelope", "--frequency", str(OMEGA / 2 / np.pi), "--plugin", str(plugin)]
    assert main(["compare", file, *frequency, "--out", str(out)]) == 0
    (item,) = json.loads((out / "verdict.json").read_text())
    assert item["damping"] == "thinning"
    assert "hinning damping" in item["sentence"]
    c = next(c for c in item["coefficients"] if c["name"] == "c_thinning")
    assert c["low"] <= 0.5 <= c["high"]
    (row,) = csv.DictReader((out / "verdicts.csv").read_text().splitlines())
    assert [float(row["thinning"])] == [e["probability"] for e in item["energy"] if e["term"] == "thinning"]
    assert "thinning" in (out / "report.html").read_text()
    # It has a velocity of its own: volts do not say where that is.
    capsys.readouterr()
    volts = written(tmp_path / "v.csv", unit="V")
    said = refused("compare", volts, *frequency, "--out", str(tmp_path / "no"))
    assert "depends on the amplitude in rad or m" in said
    assert not (tmp_path / "no").exists()


def test_what_no_envelope_tells_is_refused():
    with pytest.raises(
        InputError, match="viscous and structural dissipate the same energy at every amplitude"
    ):
        distinguishable_sums([parse_model("viscous+structural")])
    with pytest.raises(InputError, match="at most 3 terms"):
        distinguishable_sums([parse_model("viscous+coulomb+quadratic+cubic")])


def test_twins_are_said_and_not_weighed_beside_each_other():
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


def test_a_decay_steeper_than_the_paper_s_laws_has_its_own_rates_without_being_asked():
    """Cubic damping under the default sums: said to be none of them, with the rates of the oscillation itself."""
    result = analyse(envelope(FORCES["cubic"], 3)).verdict
    assert result.grade == "deviates"
    assert not result.decided
    assert any("rates are computed from it" in line for line in result.remarks)
    t, a = turning_points(FORCES["cubic"])
    for item in result.decay_rate:
        near = item.amplitude * np.exp([0.1, -0.1])
        before, after = np.interp(-near, -a, t)
        assert item.value == pytest.approx(0.2 / (after - before), rel=0.02)
    # The control: by quadratic damping, the best of the sums, it is half or twice that.
    assert result.damping == "quadratic"
    assert result.deviation.low > 0.2
