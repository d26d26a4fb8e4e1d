"""`bayesdamp compare` on envelopes: how they are recognised, what is printed and written, and refusals."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from bayesdamp.cli import main
from bayesdamp.records.envelope.record import are_envelopes, read_envelope, unit_in
from bayesdamp.types import InputError
from tests.records.tables import write_table
from validation.truth.ringdowns import Ringdown, simulate

HEAD = "% Frequency [Hz]: 1562325.84\n%\n% time [s], power [dBm]\n"


def written(path: Path, seed: int = 1, head: str = HEAD) -> Path:
    drawn = simulate(Ringdown({"viscous": 0.2}, drop=5.0, scatter=0.02), np.random.default_rng(seed))
    lines = [f"{t:.6g}, {y:.8g}" for t, y in zip(drawn.t, drawn.level)]
    path.write_text(head + "\n".join(lines) + "\n")
    return path


def test_envelopes_in_decibels_are_recognised_and_answered(tmp_path, capsys):
    files = [written(tmp_path / f"r{k}.txt", k) for k in (1, 2)]
    out = tmp_path / "out"
    assert main(["compare", *map(str, files), "--repeats", "--out", str(out)]) == 0
    text = capsys.readouterr().out.splitlines()
    cells = [line.split() for line in text]
    answers = [line.partition(" damping (")[0] for line in text if " damping (prob" in line]
    assert answers == ["r1: Viscous", "r2: Viscous", "specimen: 2 records: Viscous"]
    verdicts = json.loads((out / "verdict.json").read_text())
    (more,) = (row for row in cells if row[1:4] == ["One", "more", "record"])
    next_q = [verdicts[2]["next_value"][part] for part in ("value", "low", "high")]
    assert [1e7 * float(more[i].strip("(")) for i in (8, 11, 15)] == pytest.approx(next_q, rel=1e-3)
    truth = np.pi * 1562325.84 / 0.2
    for item in verdicts[:2]:
        assert item["quality_factor"]["low"] <= truth <= item["quality_factor"]["high"]
        assert item["damping"] == "viscous"
        assert len(item["damping_ratio"]) == 3
        assert item["damping_ratio"][0]["value"] == pytest.approx(0.1 / (np.pi * 1562325.84), rel=0.1)
        assert any("structural" in line for line in item["remarks"])
        (row,) = (row for row in cells if row[:2] == [item["record"], "viscous"])
        sizes = [1e-7 * item["quality_factor"]["value"], item["exponent"]["value"]]
        assert [float(row[i]) for i in (6, 9)] == pytest.approx(sizes, abs=6e-4)
    rates = [(rate["amplitude"], rate["value"]) for item in verdicts[:2] for rate in item["decay_rate"]]
    shown = [[float(row[i].replace("−", "-")) for i in (1, 4)] for row in cells if row[2:3] == ["dBm"]]
    assert np.array(shown) == pytest.approx(np.array(rates), rel=1e-3)
    assert (verdicts[2]["record"], verdicts[2]["records"]) == ("specimen", 2)
    rows = list(csv.DictReader((out / "verdicts.csv").read_text().splitlines()))
    assert [row["record"] for row in rows] == ["r1", "r2", "specimen"]
    assert float(rows[0]["quality_factor"]) == verdicts[0]["quality_factor"]["value"]
    assert (out / "report.html").read_text().count("data:image/svg+xml") == 2


def test_a_bad_file_is_named_and_the_others_are_answered(tmp_path, capsys):
    files = [written(tmp_path / f"r{k}.txt", k) for k in (1, 2, 3)]
    lines = files[1].read_text().splitlines()
    files[1].write_text("\n".join([*lines[:-1], f"{lines[-1].partition(',')[0]}, nan"]) + "\n")
    out = tmp_path / "out"
    assert main(["compare", *map(str, files), "--out", str(out)]) == 3
    text = capsys.readouterr()
    assert [line.partition(":")[0] for line in text.out.splitlines() if " damping (" in line] == ["r1", "r3"]
    assert text.err.splitlines()[-1].startswith(f"failed: r2.txt: line {len(lines)}: the value is nan")
    assert len(json.loads((out / "verdict.json").read_text())) == 2


def test_a_wrong_option_is_refused_in_one_line_and_nothing_is_written(tmp_path, refused):
    file, out, bad = written(tmp_path / "r.txt"), tmp_path / "out", tmp_path / "bad.txt"
    bad.write_text(file.read_text() + "9999, nan\n")
    for options, message in (
        (["--frequency", "-3"], "must be positive, in Hz"),
        (["--repeats"], "there is one record"),
        ([str(bad), "--repeats"], "only one record is usable, but several are needed; bad.txt: line "),
        (["--noise", "white"], "--noise: does not apply to envelope"),
        (["--sensor", "0.1", "--deviation", "none"], "--sensor: does not apply with --deviation none"),
        (["--sensor", "0.002"], "--sensor: does not apply to envelope"),  # the default, but stated
        (["--exact"], "--exact: does not apply to envelope"),
    ):
        assert message in refused("compare", str(file), *options, "--out", str(out))
        assert not out.exists()


def test_envelopes_and_motions_in_one_call_are_refused(tmp_path):
    other = tmp_path / "o.csv"
    other.write_text("t,angle (deg)\n0,1\n1,2\n")
    with pytest.raises(InputError, match="separate calls"):
        are_envelopes([written(tmp_path / "r.txt"), other], None, None, None)
    assert not are_envelopes([other], None, None, None)
    assert are_envelopes([other], None, None, "envelope")


def test_the_frequency_and_the_unit_are_read_from_the_head(tmp_path, capsys):
    """The sampling frequency is not that of the oscillation."""
    for head, frequency in (
        ("# resonance frequency: 1.5 MHz\n# sampling rate: 100 Hz\n# time [s], power [dBm]\n", 1.5e6),
        ("% Frequency [mHz]: 500\n% time [s], power [dBm]\n", 0.5),
        ("% Sampling frequency [kHz]: 50\n" + HEAD, 1562325.84),
        (HEAD.replace("Frequency [Hz]", "Sampling frequency [Hz]"), None),
    ):
        assert read_envelope(written(tmp_path / "r.txt", head=head)).frequency == pytest.approx(frequency)
        assert main(["look", str(tmp_path / "r.txt")]) == 0
        assert (f"is {frequency:.9g} Hz." if frequency else "--frequency") in capsys.readouterr().out
    assert [unit_in(f"power [{unit}]") for unit in ("MW", "mW", "µW", "DBM")] == ["MW", "mW", "uW", "dBm"]


def test_the_refusal_of_amplitudes_suggests_the_envelope_option(tmp_path, capsys):
    """Control: an amplitude cannot be negative."""
    file = tmp_path / "r.csv"
    t = np.linspace(0, 60, 400)
    y = np.maximum(np.exp(-0.05 * t), 1e-3)
    for lowest, suggested in ((0.0, True), (-1e-9, False)):
        y[-1] = lowest
        write_table(file, "time,R (V)", t, y)
        assert main(["compare", str(file), "--out", str(tmp_path / "out")]) == 2
        assert ("--quantity envelope" in capsys.readouterr().err) == suggested
