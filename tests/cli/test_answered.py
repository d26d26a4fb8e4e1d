"""`bayesdamp compare` from a file to its tables: the answer, and what sampling the motions made of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bayesdamp.cli import main
from bayesdamp.store import read_table

ZETA, OMEGA = 0.12, 6.0


def write(path: Path) -> Path:
    """A linear viscous oscillation in closed form, with 1 % of noise."""
    t = np.arange(400) / 40
    damped = np.sqrt(OMEGA**2 - ZETA**2)
    y = 0.3 * np.exp(-ZETA * t) * (np.cos(damped * t) + ZETA / damped * np.sin(damped * t))
    y += 0.003 * np.random.default_rng(5).standard_normal(t.size)
    np.savetxt(path, np.stack([t, y], axis=1), delimiter=",", header="t,angle", comments="")
    return path


def compare(folder: Path, *dampings: str) -> list[str]:
    """The command that compares dampings on that oscillation; its answer goes to `out` in the folder."""
    asked = ["compare", str(write(folder / "a.csv")), "--restoring", "linear", "--workers", "1"]
    return [*asked, *(word for one in dampings for word in ("--damping", one)), "--out", str(folder / "out")]


@pytest.fixture(scope="module")
def compared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("compared")
    assert main(compare(folder, "viscous", "coulomb")) == 0
    return folder / "out"


def test_posteriors_have_the_truth_and_the_parts_of_their_uncertainty(compared: Path) -> None:
    """Within four standard deviations: false alarm 6e-5 at a fixed seed."""
    rows = [r for r in read_table(compared / "posteriors.csv") if r["model"] == "viscous"]
    assert {r["sampler"] for r in rows} == {"smc"}
    zeta = next(r for r in rows if r["parameter"] == "zeta")
    assert zeta["unit"] == "1/s"
    assert abs(zeta["mean"] - ZETA) < 4 * zeta["sd"]
    assert zeta["sd"] ** 2 == pytest.approx(zeta["sd_noise"] ** 2 + zeta["sd_law"] ** 2)
    assert zeta["q2.5"] < zeta["median"] < zeta["q97.5"]
    fit = next(r for r in read_table(compared / "fits.csv") if r["model"] == "viscous")
    assert 0 <= fit["deviation_low"] <= fit["deviation"] <= fit["deviation_high"]


def test_exact_laws_are_sampled_only_where_that_is_asked_for(compared: Path) -> None:
    assert {r["method"] for r in read_table(compared / "evidence.csv")} == {"smc"}
    page = (compared / "report.html").read_text(encoding="utf-8")
    assert "Sequential Monte Carlo gives this result and confirms that of linear approximations" in page


def test_a_quick_comparison_samples_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*compare(tmp_path, "viscous", "coulomb"), "--quick"]) == 0
    said = capsys.readouterr().out
    assert "Viscous damping" in said
    assert "ampling" not in said
    assert read_table(tmp_path / "out" / "posteriors.csv") == []
