"""Envelopes as signals of a study, and in Python."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bayesdamp as bd
from bayesdamp.cli import main
from bayesdamp.interface.envelopes import analyse
from bayesdamp.records.envelope.record import make_record
from tests.envelope.test_command import written
from tests.studies import study_text

STUDY = study_text(
    'models = { compare = ["viscous", "coulomb"] }',
    "estimators = { use = [] }",
    "posterior = { samplers = [] }\nevidence = { methods = ['laplace'] }",
    system="",
    name="level",
    file="r.txt",
    quantity="envelope",
)


def test_a_study_answers_an_envelope_as_compare_does(tmp_path: Path, capsys) -> None:
    record = bd.read_envelope(written(tmp_path / "r.txt"))
    (tmp_path / "both.toml").write_text(STUDY)
    assert main(["study", str(tmp_path / "both.toml"), "--out", str(tmp_path / "out"), "--workers", "1"]) == 0
    (stored,) = json.loads((tmp_path / "out" / "verdict.json").read_text())
    direct = bd.compare(record, damping=["viscous", "coulomb"], seed=3).verdict
    assert stored["record"] == "level"
    assert stored["quality_factor"]["value"] == direct.quality_factor.value
    assert [share["term"] for share in stored["energy"]] == ["viscous", "coulomb"]
    assert main(["check", str(tmp_path / "both.toml")]) == 0
    assert capsys.readouterr().out.endswith("both.toml: ok\n")


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ('clock = "uniform"', "signal[level].clock: does not apply to an envelope"),
        ("frequency = -1.0", "signal[level].frequency: is -1.0; it must be the frequency"),
        ('compare = ["viscous+coulomb+quadratic+cubic"]', "at most 3 terms"),
    ],
)
def test_a_wrong_key_is_refused_in_one_line(tmp_path: Path, refused, line: str, message: str) -> None:
    written(tmp_path / "r.txt")
    (tmp_path / "both.toml").write_text(STUDY + line + "\n")
    command = ("study", str(tmp_path / "both.toml"), "--out", str(tmp_path / "out"), "--workers", "1")
    assert message in refused(*command)
    assert not (tmp_path / "out").exists()


def test_a_comparison_in_python_saves_plots_and_reports_the_analysis(tmp_path: Path) -> None:
    t = np.linspace(0.0, 60.0, 300)
    noise = 0.1 * np.random.default_rng(1).standard_normal(t.size)
    record = make_record("r", t, -40.0 - 0.8 * t + noise, "dBm", 1e6)
    result = bd.compare(record)
    assert result.verdict.to_dict() == analyse(record).verdict.to_dict()
    assert bd.load(result.save(tmp_path / "r.npz")).verdict.to_dict() == result.verdict.to_dict()
    assert result.report(tmp_path / "r.html").read_text(encoding="utf-8").count("data:image/svg+xml") == 1
    short = bd.compare(make_record("short", t, -40.0 - 0.12 * t + 20 * noise, "dBm", 1e6))
    listed = short.report(tmp_path / "short.html").read_text(encoding="utf-8").partition("in a sum: ")[2]
    assert all(f" {term.probability:.2f}" in listed[:90] for term in short.verdict.energy)
    (whole, rest), curve = result.plot(), analyse(record).curve
    assert whole.get_ylabel() == "level / dBm"
    assert rest.lines[0].get_ydata() == pytest.approx(curve.level - curve.fit)
    in_volts = replace(record, unit="V", level=record.level + 60)
    assert bd.compare(in_volts).plot()[0].get_ylabel() == "level / dB of 1 V"
    many = bd.compare([record, make_record("s", t, record.level + noise[::-1], "dBm", 1e6)], repeats=True)
    assert many.verdict.records == 2
    assert [item.verdict.record for item in many.records] == ["r", "s"]
    flat = make_record("flat", t, -90.0 + noise, "dBm", 1e6)
    for pair in ([record, flat], [flat, record]):
        assert bd.compare(pair, repeats=True).verdict == result.verdict


def test_options_that_only_motions_have_are_refused() -> None:
    t = np.linspace(0.0, 60.0, 300)
    for option in ({"known": {"stiffness": 1.0}}, {"sensor": 0.1}, {"sample": False}):
        with pytest.raises(bd.InputError, match="does not apply to envelopes"):
            bd.compare(make_record("r", t, -40.0 - 0.8 * t, "dBm"), **option)  # type: ignore[arg-type]
