"""`bayesdamp compare`: its study, its options and its folder, before anything is computed."""

import subprocess
import sys
from functools import partial
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from bayesdamp.cli import main
from bayesdamp.cli.runs import choose_folder
from bayesdamp.config.load import comparison_study, laws_for, record_question
from bayesdamp.pipeline.records import StudyRecord, compute_signal
from bayesdamp.pipeline.tasks import Task, compute_and_store
from bayesdamp.store.files import write_json
from bayesdamp.store.results import Store
from tests.records.tables import T, Y, write_table
from tests.studies import COMPARED, VISCOUS, signal_text, study_text


def write(path: Path) -> Path:
    return write_table(path, "t,angle", T, Y)


def signal_of(path: Path) -> dict[str, str]:
    """Return the keys of a signal in this file, which is written if it does not exist."""
    return {"file": str(path if path.exists() else write(path)), "time": "t", "angle": "angle"}


def test_the_study_has_every_damping_under_every_law_with_free_parameters(tmp_path) -> None:
    signal = signal_of(tmp_path / "a.csv")
    study = comparison_study([signal])
    spec = study.signals[0]
    assert len(study.compare(spec)) == 7 * len(laws_for("rad")) == 28
    assert not spec.system.known
    assert study.evidence.methods == ("importance", "bridge")
    assert study.evidence.referee == "auto"
    assert all(not system.known for system in spec.alternatives)
    assert "pendulum" in laws_for("deg")
    assert set(laws_for("mm")) == {"linear", "duffing"}
    assert len({s.name for s in comparison_study([signal] * 2).signals}) == 2


def test_a_record_keeps_the_letters_of_its_file(tmp_path) -> None:
    # The second has ü as two characters.
    files = ["ä.csv", "r 1 u\u0308.csv", "проба №2.csv", "v².csv", "-ö.csv"]
    study = comparison_study([{"file": str(write(tmp_path / file))} for file in files])
    assert [s.name for s in study.signals] == ["ä", "r_1_ü", "проба__2", "v²", "_-ö"]


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ("", "has 3 columns"),
        ("--angle 2 --rate -3", "b.csv: rate must be a positive number of samples per second"),
        ("--angle 2 --rate 3 --time 1", "b.csv: give either time (a column) or rate (in Hz), not both"),
        ("--angle 2 --time 1 --start 5 --stop 2", "b.csv: start = 5 s must be before stop = 2 s"),
        ("--runs 2", "no runs '2'; there are none to choose from (--runs)"),
        ("--channel othr", "did you mean 'other'"),
        ("--angle 2 --time-unit weeks", "b.csv: unknown unit of time 'weeks'; valid are s, ms"),
        ("--angle 2 --time 1 --unit m --restoring pendulum", "--unit: is 'm'"),
    ],
)
def test_a_wrong_option_is_one_line_and_nothing_is_written(tmp_path, refused, options, line) -> None:
    file = write_table(tmp_path / "b.csv", "t,angle,other", T, Y, np.exp(-0.1 * T) * np.cos(5 * T + 1))
    assert line in refused("compare", str(file), *options.split(), "--out", str(tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def test_a_study_of_many_records_ends_with_a_table_of_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = [f"rig-{i}" for i in range(6)]
    others = [signal_text(name, VISCOUS) for name in names[1:]]
    text = "\n".join([study_text(COMPARED, simulate=VISCOUS, name=names[0]), *others])
    (tmp_path / "study.toml").write_text(text)
    assert main(["study", str(tmp_path / "study.toml"), "--quick", "--out", str(tmp_path / "out")]) == 0
    table = [line.split()[0] for line in capsys.readouterr().out.splitlines() if " viscous " in line]
    assert table == names


def test_one_bad_file_of_several_is_named_and_the_others_are_compared(tmp_path, capsys, monkeypatch) -> None:
    """Control: without the bad file nothing fails."""
    good, bad = [write(tmp_path / name) for name in ("a.csv", "c.csv")], tmp_path / "b.csv"
    lines = good[0].read_text().splitlines()
    bad.write_text("\n".join([*lines[:100], "1.98,nan", *lines[101:]]))
    run_study = Mock(return_value=0)
    monkeypatch.setattr("bayesdamp.cli.runs.run_study", run_study)
    monkeypatch.setattr("bayesdamp.cli.runs.print_conclusion", lambda *_: None)
    words = [*map(str, (good[0], bad, good[1])), "--quick", "--workers", "1", "--out", str(tmp_path / "out")]
    assert main(["compare", *words]) == 3
    lines = capsys.readouterr().err.splitlines()
    assert lines[-1].startswith("failed: b.csv: line 101: the value is nan")
    assert sum("b.csv" in line for line in lines) == 1
    assert main(["compare", *(word for word in words if word != str(bad))]) == 0
    studies = [call.args[0] for call in run_study.call_args_list]
    assert [[signal.name for signal in study.signals] for study in studies] == [["a", "c"], ["a", "c"]]
    assert "failed" not in capsys.readouterr().err


def test_different_comparisons_have_different_default_folders(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    signals = [signal_of(tmp_path / "a.csv")]
    first, other = comparison_study(signals), comparison_study(signals, damping=["viscous", "coulomb"])
    assert choose_folder(first) == choose_folder(other) == Path("reports/a")
    write_json(Path("reports/a/run.json"), {"asked": record_question(first, Path("reports/a"))})
    assert choose_folder(first) == Path("reports/a")
    assert choose_folder(other) == Path("reports/a-2")
    write_json(Path("reports/a-2/run.json"), {"name": "of an older version"})
    assert choose_folder(other) == Path("reports/a-3")
    (tmp_path / "elsewhere").mkdir()
    same_name = comparison_study([signal_of(tmp_path / "elsewhere" / "a.csv")])
    assert choose_folder(same_name) == Path("reports/a-3")


CLOSED = """
import sys
from pathlib import Path
from bayesdamp.report.terminal import PipeSafeConsole
console = PipeSafeConsole()
for _ in range(3):
    console.print("x")
Path(sys.argv[1]).write_text("went on", encoding="utf-8")
"""


def test_a_closed_output_does_not_end_the_run(tmp_path) -> None:
    """`bayesdamp compare rig.csv | head -1` closes it."""
    command, pipe = [sys.executable, "-c", CLOSED, str(tmp_path / "out")], subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe) as child:
        child.stdout.close()
        _, error = child.communicate(timeout=60)
    assert (child.returncode, error) == (0, b"")
    assert (tmp_path / "out").read_text(encoding="utf-8") == "went on"


def test_noise_is_added_to_a_record_without_noise(tmp_path) -> None:
    """A thousandth of the amplitude, within 20 % (600 samples: one false alarm in a million seeds). Control: a record
    with noise is not changed."""
    noise = 0.001 * np.random.default_rng(1).standard_normal(Y.size)
    write_table(tmp_path / "noisy.csv", "t,angle", T, Y + noise)
    results = {}
    for name in ("clean", "noisy"):
        study = comparison_study([signal_of(tmp_path / f"{name}.csv")])
        store, task = Store(tmp_path / "out"), f"signal/{name}/0"
        record = StudyRecord(study, study.signals[0], 0, store)
        compute_and_store(store, Task(task, record.key, partial(compute_signal, record)))
        results[name] = store.read(task)
    warnings = {name: result.meta["provenance"]["warnings"] for name, result in results.items()}
    assert all(result.meta["noisy"] for result in results.values())
    assert warnings["noisy"] == []
    assert "has no noise" in warnings["clean"][0]
    y = results["clean"].arrays["y"]
    assert np.std(y - Y) == pytest.approx(1e-3 * np.abs(y).max(), rel=0.2)
