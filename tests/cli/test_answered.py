"""`bayesdamp compare` from a file to its tables."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bayesdamp.cli import main
from bayesdamp.store import read_table
from tests.interface.problems import closed_form
from tests.records.tables import write_table

ZETA = 0.12


def compare(folder: Path, *options: str) -> Path:
    """Compare dampings on a linear viscous oscillation in closed form with 1 % of noise; return the run's folder."""
    t = np.arange(400) / 40
    truth = {"zeta": ZETA, "stiffness": 36.0, "theta0": 0.3, "rest_angle": 0.0, "omega0": 0.0}
    y = closed_form(t, truth) + 0.003 * np.random.default_rng(5).standard_normal(t.size)
    words = [
        "compare",
        str(write_table(folder / "a.csv", "t,angle", t, y)),
        "--restoring",
        "linear",
        "--workers",
        "1",
    ]
    words += ["--damping", "viscous", "--damping", "coulomb", "--out", str(folder / "out")]
    assert main([*words, *options]) == 0
    return folder / "out"


@pytest.fixture(scope="module")
def compared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compare(tmp_path_factory.mktemp("compared"))


def test_posteriors_have_the_truth_and_the_parts_of_their_uncertainty(compared: Path) -> None:
    """Within four standard deviations: one false alarm in 16,000 seeds."""
    rows = [r for r in read_table(compared / "posteriors.csv") if r["model"] == "viscous"]
    assert {r["sampler"] for r in rows} == {"smc"}
    zeta = next(r for r in rows if r["parameter"] == "zeta")
    assert zeta["unit"] == "1/s"
    assert abs(zeta["mean"] - ZETA) < 4 * zeta["sd"]
    assert zeta["sd"] ** 2 == pytest.approx(zeta["sd_noise"] ** 2 + zeta["sd_law"] ** 2)
    assert zeta["q2.5"] < zeta["median"] < zeta["q97.5"]
    fit = next(r for r in read_table(compared / "fits.csv") if r["model"] == "viscous")
    assert 0 <= fit["deviation_low"] <= fit["deviation"] <= fit["deviation_high"]


def test_exact_laws_are_sampled_only_on_request(compared: Path) -> None:
    assert {r["method"] for r in read_table(compared / "evidence.csv")} == {"smc"}
    page = (compared / "report.html").read_text(encoding="utf-8")
    assert "Sequential Monte Carlo gives this result and confirms that of linear approximations" in page


def test_a_quick_comparison_samples_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = compare(tmp_path, "--quick")
    printed = capsys.readouterr().out
    assert "Viscous damping" in printed
    assert "ampling" not in printed
    assert read_table(out / "posteriors.csv") == []
