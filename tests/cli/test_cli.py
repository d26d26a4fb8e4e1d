# ruff: noqa: E501
"""The commands: one line for each error, the exit status, and no incomplete files."""

import csv
import signal
from collections.abc import Callable
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

import bayesdamp
from bayesdamp.cli import main
from bayesdamp.cli.runs import compilation_notice
from bayesdamp.types import InputError, Refusal
from tests.records.tables import write_table
from tests.studies import VISCOUS, study_text

STUDY = study_text(simulate=VISCOUS, name="one") + '[estimators]\nuse = ["least_squares"]\n'
LAW = ["--restoring", "horizontal_pendulum", "--duration", "10"]
SET = [*LAW, "--set", "stiffness=20,gravity=1,theta0=0.3", "--set", "spring_angle=0"]


RUN_STUDY = "bayesdamp.cli.runs.run_study"
SIMULATE = ["simulate", "--out", "x.csv", "--damping"]
WRONG = (
    (["check", "option.toml"], "did you mean 'variant'?"),
    (["study", "good.toml", "--out", "bad.toml"], "'bad.toml', and bad.toml is not a folder; give another"),
    (["report", "nowhere"], "nowhere: no such folder; give the folder of a run"),
    ([*SIMULATE, "viscuos=1", *SET], "did you mean 'viscous'?"),
    ([*SIMULATE, "viscous", *SET], "--damping: is 'viscous'; it must be NAME="),
    ([*SIMULATE, "viscous=1,viscous=2", *SET], "is given twice"),
    ([*SIMULATE, "power=0.1"], "power also needs exponent; give exponent=NUMBER"),
    ([*SIMULATE, "viscous=1", "--restoring", "pendulm"], "did you mean 'pendul"),
    (["simulate", "--out", "x.csv", "--viscous", "0.1"],
     "No such option: --viscous; it is --damping viscous=NUMBER; see bayesdamp simulate --help"),
    (["simulate", "--out", "x.csv", "--rest-angle", "0.1"], "it is --set rest_angle=NUMBER"),
    ([*SIMULATE, "viscous=1", "--set", "stifness=20,gravity=1"], "linear has no parameter 'stifness'; did you mean 'stiffness'?"),
    (["simulate", "--damping", "viscous=1", *SET], "Missing option '--out'"),
)  # fmt: skip
"""Wrong commands whose line says what is valid; tests/bad_input has more."""


@pytest.mark.parametrize(("arguments", "expected"), WRONG)
def test_wrong_input_is_one_line_exit_status_2_and_nothing_written(
    folder: Path, refused: Callable[..., str], arguments: list[str], expected: str
) -> None:
    (folder / "good.toml").write_text(STUDY)
    (folder / "bad.toml").write_text(STUDY + "[posterior]\nchain = 2\n")
    (folder / "option.toml").write_text(STUDY + "[estimators.least_squares]\nvarant = 3\n")
    before = sorted(folder.rglob("*"))
    assert expected in refused(*arguments)
    assert sorted(folder.rglob("*")) == before


def test_a_study_has_the_options_and_the_exit_status_of_its_run(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = {}

    def run_study(study, out, **options) -> int:  # type: ignore[no-untyped-def]
        arguments.update(options, name=study.name, out=out)
        out.mkdir(parents=True)
        (out / "report.html").write_text("")
        (out / "run.json").write_text('{"name": "small", "signals": {}}')
        return 3

    monkeypatch.setattr(RUN_STUDY, run_study)
    (folder / "study.toml").write_text(STUDY)
    expected = {"workers": 2, "fresh": True, "scheduler": "tcp://127.0.0.1:1", "name": "small"}
    assert main(["study", "study.toml", "--workers", "2", "--fresh", "--scheduler", "tcp://127.0.0.1:1"]) == 3
    assert arguments["out"] == Path("reports/small")
    assert expected.items() <= arguments.items()
    assert capsys.readouterr().out.strip() == "reports/small/report.html"


INTERNAL = "internal error: RuntimeError: a b (please report it; BAYESDAMP_DEBUG=1 shows where)"


def test_an_error_that_stops_a_study_is_one_line(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "study.toml").write_text(STUDY)
    for error, status, expected in (
        (KeyboardInterrupt(), 130, "interrupted; the same command resumes"),
        (RuntimeError("a\nb"), 1, INTERNAL),
        (InputError("rig.csv: no\nnumbers"), 2, "rig.csv: no numbers"),
        (Refusal("no peak"), 2, "no peak"),
    ):
        monkeypatch.setattr(RUN_STUDY, Mock(side_effect=error))
        assert main(["study", "study.toml"]) == status
        (line,) = capsys.readouterr().err.splitlines()
        assert expected in line
    monkeypatch.setenv("BAYESDAMP_DEBUG", "1")
    monkeypatch.setattr(RUN_STUDY, Mock(side_effect=ZeroDivisionError))
    assert main(["study", "study.toml"]) == 1
    assert "Traceback" in capsys.readouterr().err


def test_a_signal_to_end_interrupts_a_command(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also a command that starts no processes; only commands with a run can be resumed."""

    def command(**_: object) -> int:
        assert signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL, "it would end the tests"
        signal.raise_signal(signal.SIGTERM)
        return 0

    monkeypatch.setattr("bayesdamp.cli.app.build_parser", lambda _: command)
    before = signal.signal(signal.SIGTERM, signal.SIG_DFL)  # the tests may run with the signal ignored
    try:
        assert [main(words) for words in (["study", "study.toml"], ["look", "rig.csv"])] == [130, 130]
    finally:
        signal.signal(signal.SIGTERM, before)
    assert capsys.readouterr().err == "interrupted; the same command resumes the run\ninterrupted\n"


def test_check_lists_a_study_and_writes_nothing(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "study.toml").write_text(STUDY.replace("noise_sd", "repeats = 2, noise_sd"))
    assert main(["check", "study.toml"]) == 0
    out = capsys.readouterr().out
    for word in ("one (x2)", "viscous", "least_squares", "nuts", "importance", "posterior", "study.toml: ok"):
        assert word in out
    assert [word for word in out.split() if word.isdigit()] == ["2", "2", "2", "6", "6", "12", "18", "48"]
    assert {p.name for p in folder.iterdir()} == {"ok.csv", "study.toml"}


def test_check_reads_the_records_as_the_run_would(
    folder: Path, capsys: pytest.CaptureFixture[str], refused: Callable[..., str]
) -> None:
    i = np.arange(600.0)
    write_table(folder / "rig.csv", "t,phi", 0.02 * i, 0.3 * np.exp(-0.001 * i) * np.cos(0.1 * i))
    measured = STUDY.partition("simulate =")[0] + 'file = "rig.csv"\nangle = "phi"\n[estimators]\nuse = []\n'
    (folder / "study.toml").write_text(measured)
    assert main(["check", "study.toml"]) == 0
    capsys.readouterr()
    (folder / "study.toml").write_text(measured.replace('"phi"', '"psi"'))
    assert refused("check", "study.toml") == "rig.csv: unknown column 'psi'; did you mean 'phi'?"
    (folder / "study.toml").write_text(measured.replace("stiffness = 20.0", "stiffness = -20.0"))
    assert "= -20: it must be above 0 under the law linear" in refused("study", "study.toml", "--out", "out")
    assert not (folder / "out").exists()


def test_simulate_writes_a_record_that_reads_back(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The noise is the difference from a record without noise. Its sd is within a tenth (201 samples: one false alarm in
    twenty seeds) of 1 % of the amplitude, 0.25 rad about the equilibrium."""
    simulate = ["simulate", "--damping", "viscous=0.05", *SET, "--samples", "201"]
    assert main([*simulate, "--out", "a.csv"]) == 0
    assert capsys.readouterr() == (
        "a.csv\n", "noise: sd 0.0025 rad, 1 % of the amplitude (--noise-sd 0 for none)\n",
    )  # fmt: skip
    for name, *more in (("b", "--seed", "0"), ("c", "--seed", "2"), ("clean", "--noise-sd", "0")):
        assert main([*simulate, "--out", f"{name}.csv", *more]) == 0
    noisy, clean = (np.loadtxt(folder / f"{n}.csv", delimiter=",", skiprows=2) for n in ("a", "clean"))
    assert np.std(noisy[:, 1] - clean[:, 1]) == pytest.approx(0.0025, rel=0.1)
    with (folder / "a.csv").open(newline="") as stream:
        mark, header, *rows = csv.reader(stream)
    assert mark == ["# simulated by bayesdamp"]
    assert header == ["t (s)", "angle (rad)"]
    assert len(rows) == 201
    assert (float(rows[0][0]), float(rows[-1][0])) == (0.0, 10.0)
    assert float(rows[0][1]) == pytest.approx(0.3, abs=0.02)
    assert (folder / "a.csv").read_bytes() == (folder / "b.csv").read_bytes()
    assert (folder / "a.csv").read_bytes() != (folder / "c.csv").read_bytes()


def test_a_simulation_prints_its_defaults(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With them as options the record is the same. The frequency is sqrt(40)/2π; with a cubic stiffness of 40 the first
    swings are a few per cent faster. Control: a command with all options prints none."""
    duffing = ["--restoring", "duffing", "--damping", "coulomb=0.1"]
    for words, defaults, frequency in (
        ([], "--damping viscous=0.1 --set stiffness=40,theta0=0.3", 1.0066),
        (duffing, "--set stiffness=40,cubic=40,theta0=0.3", 1.03),
        (["--set", "stiffness=90,theta0=0.1", "--damping", "viscous=0.2"], "", 1.5099),
    ):
        assert main(["simulate", "--out", "a.csv", "--noise-sd", "0", *words]) == 0
        assert capsys.readouterr().err == (f"defaults used: {defaults}\n" if defaults else "")
        t, y = np.loadtxt(folder / "a.csv", delimiter=",", skiprows=2).T
        crossings = t[:-1][np.diff(np.sign(y)) < 0]
        assert 1 / np.mean(np.diff(crossings[:6])) == pytest.approx(frequency, rel=0.015)
        assert main(["simulate", "--out", "b.csv", "--noise-sd", "0", *words, *defaults.split()]) == 0
        capsys.readouterr()
        assert (folder / "a.csv").read_bytes() == (folder / "b.csv").read_bytes()


def test_the_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"bayesdamp {bayesdamp.__version__}\n"


def test_the_first_command_prints_that_it_compiles(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Control: a folder with a compiled program."""
    monkeypatch.setenv("BAYESDAMP_CACHE", str(tmp_path))
    assert compilation_notice().startswith("compiling")
    (tmp_path / "kernels").mkdir()
    assert compilation_notice()
    (tmp_path / "kernels" / "bayesdamp_kernel_1").mkdir()
    assert not compilation_notice()
