"""`bayesdamp compare` from a file to its tables."""

import re
import shutil
from pathlib import Path

import pytest

from bayesdamp.cli import main
from bayesdamp.pipeline.run import SOME_FAILED
from bayesdamp.store.files import read_table
from bayesdamp.verdict.types import load_verdicts

COMPARE = "compare ok.csv --restoring linear --workers 1 --damping viscous --damping coulomb --out out"
ZETA = 0.1
"""The damping of `folder`."""


def test_posteriors_have_the_truth_and_the_parts_of_their_uncertainty(folder: Path) -> None:
    """Within four standard deviations: one false alarm in 16,000 seeds. Exact laws are sampled only on request."""
    assert main(COMPARE.split()) == 0
    rows = [r for r in read_table(folder / "out" / "posteriors.csv") if r["model"] == "viscous"]
    assert {r["sampler"] for r in rows} == {"smc"}
    zeta = next(r for r in rows if r["parameter"] == "zeta")
    assert zeta["unit"] == "1/s"
    assert abs(zeta["mean"] - ZETA) < 4 * zeta["sd"]
    assert zeta["sd"] ** 2 == pytest.approx(zeta["sd_noise"] ** 2 + zeta["sd_law"] ** 2)
    assert zeta["q2.5"] < zeta["median"] < zeta["q97.5"]
    fit = next(r for r in read_table(folder / "out" / "fits.csv") if r["model"] == "viscous")
    assert 0 <= fit["deviation_low"] <= fit["deviation"] <= fit["deviation_high"]
    assert {r["method"] for r in read_table(folder / "out" / "evidence.csv")} == {"smc"}
    page = (folder / "out" / "report.html").read_text(encoding="utf-8")
    assert "Sampling (sequential Monte Carlo) confirms the result of linear approximations" in page


def test_a_quick_comparison_samples_nothing(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Its only figure is that of the answer, which shows the record too."""
    assert main([*COMPARE.split(), "--quick", "--unit", "deg"]) == 0
    printed = capsys.readouterr().out
    assert " deg │" in printed
    assert "Viscous damping" in printed
    assert "ampling" not in printed
    assert read_table(folder / "out" / "posteriors.csv") == []
    amplitudes = [float(r["amplitude"]) for r in read_table(folder / "out" / "damping_curves.csv")]
    assert 0.03 < max(amplitudes) < 0.5  # in degrees
    assert [path.stem for path in (folder / "out" / "figures").glob("*.svg")] == ["answer-ok"]


def test_many_files_have_the_same_verdicts_in_one_process_and_in_two(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """And alone. A file that cannot be used is reported at the end, and leaves no trace in the run. On a terminal, a
    bar counts the files that have been read."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    files = [shutil.copy("ok.csv", f"run_{i}.csv") for i in range(6)]
    (folder / "flat.csv").write_text("t,y\n" + "".join(f"{i},0\n" for i in range(99)))
    options, verdicts = ["compare", "--restoring", "linear", "--damping", "viscous", "--quick", "--out"], []
    for workers in ("1", "2"):
        assert main([*options, workers, "--workers", workers, "flat.csv", *files]) == SOME_FAILED
        assert re.search("reading 7 files.*7/7.*failed: flat.csv", capsys.readouterr().err, re.DOTALL)
        verdicts.append(load_verdicts(folder / workers / "verdict.json"))
    assert [v.record for v in verdicts[0]] == [f"run_{i}" for i in range(6)]
    assert verdicts[0] == verdicts[1]
    assert main([*options, "alone", *files[:1]]) == 0
    assert load_verdicts(folder / "alone" / "verdict.json") == verdicts[0][:1]
