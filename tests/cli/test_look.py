"""`bayesdamp look` and `bayesdamp init`, and files with several records in `compare` and in a study."""

import os
import re
from concurrent.futures import BrokenExecutor
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

import bayesdamp as bd
from bayesdamp.cli import main
from bayesdamp.cli.commands.compare import early_lines
from bayesdamp.cli.records import ReadingOptions, records_in, select_records, study_signals
from bayesdamp.config import Recording, in_keys, load_study
from bayesdamp.config.load import comparison_study
from bayesdamp.machine import processes
from bayesdamp.pipeline.records import read_raw
from bayesdamp.types import InputError
from tests.records.tables import T, Y, write_table
from tests.report.pages import numbers

NOISE = np.random.default_rng(4).normal(0, 0.01, T.size)


def output_of_look(path: Path, capsys: pytest.CaptureFixture[str], *options: str) -> str:
    """Return the output of `look` in one line."""
    assert main(["look", str(path), *options]) == 0
    return " ".join(capsys.readouterr().out.split())


def runs(path: Path) -> Path:
    """Write three runs; the second is only noise."""
    names, columns = [], []
    for i, y in ((1, 40 * Y), (2, NOISE), (3, 30 * Y)):
        names += [f"Time (s) Run #{i}", f"Angle, left (deg) Run #{i}", f"Supply (V) Run #{i}"]
        columns += [T, y, np.full(T.size, 5.0)]
    rows = [";".join(f"{x:.6f}".replace(".", ",") for x in row) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([";".join(names), *rows]), encoding="utf-8-sig")
    return path


def test_look_shows_columns_units_clock_and_the_free_decay(tmp_path, capsys) -> None:
    file = runs(tmp_path / "rig.csv")
    assert main(["look", str(file)]) == 0
    printed = capsys.readouterr().out
    flat = " ".join(printed.split())
    assert "rig.csv: text" in printed
    read = r"run 1, Angle, left \(deg\): column 'Angle.* #1' as angle in deg, times from column 'T.* #1', 600 samples"
    assert re.search(read, flat)
    assert f"time 0 to {T[-1]} s, values {40 * Y.min():.4g} to {40 * Y.max():.4g}" in flat
    assert "No free decay" in flat
    assert "11.5 cycles of 1.047 s" in flat or "11.4 cycles of 1.047 s" in flat
    assert sum(0x2800 < ord(c) < 0x2900 for c in printed) > 100
    assert re.search(rf"│ 2 .* │ 600 +│ {40 * Y.min():.6g} +│ {40 * Y.max():.6g} +│", printed)
    assert main(["look", str(file), "--runs", "3"]) == 0
    assert "run 3" not in capsys.readouterr().out.replace("Run #3", "")  # a single record needs no label


def test_look_shows_the_columns_if_none_can_be_chosen(tmp_path, capsys) -> None:
    write_table(tmp_path / "a.csv", "millis,left,right", 1e3 * T, Y, np.cos(5 * T) * np.exp(-0.2 * T))
    assert main(["look", str(tmp_path / "a.csv")]) == 2
    out, error = capsys.readouterr()
    assert re.search(r"millis\W+ms\W", out)
    assert "left" in out
    assert "'left', 'right' may each be the record; give the name" in error
    assert "(--angle, --channel)" in error
    assert error.count("\n") == 1


def test_look_reports_a_gap_in_the_samples(tmp_path, capsys) -> None:
    """On the record's own time axis. Control: a record without a gap."""
    for name, recorded in (("whole.csv", T >= 0), ("gap.csv", (T < 4) | (T > 5))):
        path = write_table(tmp_path / name, "t,angle (rad)", T[recorded] + 20, (Y + 0.1 * NOISE)[recorded])
        shown = "No samples for 1.04 s from 23.98 s on; the fit" in output_of_look(path, capsys)
        assert shown is (name == "gap.csv")
    assert " as angle in rad, 50 Hz, " in output_of_look(path, capsys, "--angle", "2", "--rate", "50")


def test_times_in_an_unlikely_unit_are_refused_unless_the_unit_is_given(tmp_path) -> None:
    """Other doubts are in tests/records/test_findings.py."""
    path = write_table(tmp_path / "a.csv", "t,angle", 1e6 * T, Y)
    with pytest.raises(InputError, match=r"are they in us\? \(--time-unit us, or s if they are in s\)"):
        select_records([path], ReadingOptions())
    with pytest.raises(InputError, match=r"time_unit="):
        bd.read(path)
    with pytest.raises(InputError, match=r"\(signal.time_unit, signal.rate\)$"), in_keys():
        read_raw(Recording(file=path.name, path=path, angle=2, time=1))
    assert select_records([path], ReadingOptions(time_unit="s")).records
    assert bd.read(path, time_unit="s").raw[0].t is not None
    assert read_raw(Recording(file=path.name, path=path, angle=2, time=1, time_unit="s")).t is not None


def test_files_are_read_by_processes_or_here_if_one_is_killed(tmp_path, monkeypatch) -> None:
    """Their paths are relative to the folder of this process, not to that of the others."""
    write_table(tmp_path / "a.csv", "t,angle", T, Y)
    killed = Mock(map=Mock(side_effect=BrokenExecutor))
    with processes(1) as pool:
        assert pool.submit(os.getcwd).result() != str(tmp_path)  # the process has started
        monkeypatch.chdir(tmp_path)
        chosen = [select_records([Path("a.csv")], ReadingOptions(), pool=p) for p in (pool, killed)]
        assert [record.path for each in chosen for record in each.records] == [Path("a.csv")] * 2
    killed.restart.assert_called_once_with()


def test_the_frequency_of_a_fast_or_slow_record_is_printed(tmp_path) -> None:
    """The same motion with the periods of a resonator and of a tide; the unit of the times is given."""
    for period in (1e-9, 44712.0):
        t = period / 40 * np.arange(600)
        x = 0.3 * np.exp(-0.1 * t / period) * np.cos(2 * np.pi * t / period)
        path = write_table(tmp_path / "a.csv", "t (s),x (m)", t, x)
        (line,) = early_lines(records_in(path, ReadingOptions()), ReadingOptions())
        frequency, half = numbers(line.partition(" at ")[2].partition(" Hz")[0])
        assert 0 < half.value < 1e-3 / period
        assert frequency.value == pytest.approx(1 / period, rel=1e-3)


def test_times_since_an_epoch_count_from_the_first_sample_and_other_releases_are_listed(tmp_path) -> None:
    t = np.arange(1600) / 20
    y = np.exp(-0.05 * (t % 40)) * np.cos(3 * (t % 40)) + 1e-3 * np.sin(77 * t)
    stamps = write_table(tmp_path / "a.csv", "stamp (s),x (mm)", np.round(1700000000.25 + t, 2), y)
    chosen = select_records([stamps], ReadingOptions())
    assert "a.csv: Times are counted from the first sample (1700000000.25 s)." in chosen.notes
    (first,) = early_lines(records_in(stamps, ReadingOptions()), ReadingOptions())
    remarks = bd.compare(bd.read(stamps).signal(), sample=False).verdict.remarks
    (others,) = [r for r in remarks if r.startswith("Another free decay is in the record and not used: ")]
    spans = [tuple(map(float, re.findall(r"([\d.]+) to ([\d.]+) s", text)[0])) for text in (first, others)]
    early, late = sorted(spans)
    assert 0 <= early[0] < 5 < 30 < early[1] <= late[0] < 45 < 70 < late[1] < 80
    options = ReadingOptions(start=41.0)
    (later,) = early_lines(records_in(stamps, options), options)
    assert float(re.findall(r"\(([\d.]+) to", later)[0]) >= 41


def test_init_writes_a_study_that_passes_check(tmp_path, capsys) -> None:
    file = runs(tmp_path / "my rig.csv")
    out = tmp_path / "my rig.toml"
    assert main(["init", str(file), "--start", "1e4"]) == 2
    assert "start = 10000 s is outside the record" in capsys.readouterr().err
    assert not out.exists()
    assert main(["init", str(file)]) == 0
    printed, notes = capsys.readouterr()
    assert "run 2, Angle, left (deg) is left out" in notes
    assert f"bayesdamp check '{out}'" in printed  # quoted, because the name has a blank
    assert "bayesdamp study 'my rig.toml'" in out.read_text(encoding="utf-8")
    study = load_study(out)
    assert [s.specimen for s in study.signals] == ["my_rig"] * 2
    for spec, size in zip(study.signals, (40, 30), strict=True):
        assert spec.source.unit == "deg"
        np.testing.assert_allclose(read_raw(spec.source).y, size * Y, atol=1e-6)
    assert main(["check", str(out)]) == 0
    capsys.readouterr()
    before = out.read_bytes()
    assert main(["init", str(file)]) == 2
    assert "is not overwritten" in capsys.readouterr().err
    assert out.read_bytes() == before


def test_init_writes_the_study_of_compare(tmp_path) -> None:
    file, options = runs(tmp_path / "rig.csv"), ReadingOptions(runs="1,3")
    assert main(["init", str(file), "--runs", "1,3"]) == 0
    compared = comparison_study(study_signals(select_records([file], options).records, options)).resolved()
    written = load_study(tmp_path / "rig.toml").resolved()
    for signal in (*compared["signals"], *written["signals"]):
        signal["source"].pop("file")
    assert compared == written


def test_the_first_four_of_many_records_are_listed(tmp_path) -> None:
    names = ",".join(f"{name} Run #{i}" for i in range(1, 8) for name in ("t (s)", "x (m)"))
    note = select_records([write_table(tmp_path / "a.csv", names, *(T, Y) * 7)], ReadingOptions()).notes[0]
    assert re.fullmatch(r"a.csv: 7 records: (run \d[^;]*; ){3}run \d[^;]* and 3 more", note)


def test_a_file_without_a_free_decay_is_refused(tmp_path, capsys) -> None:
    names = ",".join(f"{name} Run #{i}" for i in (1, 2) for name in ("t (s)", "x (m)"))
    write_table(tmp_path / "a.csv", names, T, NOISE, T, NOISE)
    assert main(["compare", str(tmp_path / "a.csv"), "--out", str(tmp_path / "out")]) == 2
    assert "none of its 2 records is a free decay" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_study_selects_a_run_and_a_channel(tmp_path) -> None:
    file = str(runs(tmp_path / "rig.csv"))
    selected = {"run": 3, "channel": "Angle, left (deg)"}, {"run": "3", "channel": "angle, LEFT"}, {"run": 3}
    for keys in selected:
        (signal,) = comparison_study([{"file": file, **keys}]).signals
        np.testing.assert_allclose(read_raw(signal.source).y, 30 * Y, atol=1e-6)


def levels(path: Path, head: str) -> Path:
    """Write 30 s of an amplitude that falls by 1 dB/s from 2 s on, in dB or as a linear quantity."""
    t = np.arange(0.0, 30.0, 0.05)
    fall = -1.0 * np.maximum(t - 2.0, 0.0) + np.where(t < 2.0, 3.0, 0.0)
    return write_table(path, f"t (s),{head}", t, fall if "dB" in head else 10.0 ** (fall / 20))


def test_look_shows_the_decay_of_an_envelope(tmp_path, capsys) -> None:
    """An envelope has a unit in dB, or --quantity envelope. Control: without both a hint is printed."""
    printed = output_of_look(levels(tmp_path / "a.csv", "Power (dBm)"), capsys)
    assert "an envelope in dBm: 600 readings from 0 to 29.95 s" in printed
    assert "The decay starts at 2" in printed
    assert "the level falls by 2" in printed
    assert "--frequency HZ" in printed
    linear = levels(tmp_path / "b.csv", "magnitude")
    printed = output_of_look(linear, capsys, "--quantity", "envelope", "--start", "5")
    assert "The decay starts at 5 s, as specified" in printed
    assert [len(word) for word in printed.split() if set(word) == {"─"}] == [78 - int(78 * 5 / 29.95)]
    assert "use --quantity envelope" in output_of_look(linear, capsys)
