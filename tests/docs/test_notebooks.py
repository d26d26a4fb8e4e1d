"""The notebooks run as they stand, cell by cell, with warnings as errors."""

from __future__ import annotations

import json
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import pytest

NOTEBOOKS = Path(__file__).parents[2] / "docs" / "notebooks"
NAMES = ("own_record", "paper", "many_specimens")


def cells(path: Path) -> list[str]:
    """The code of a notebook."""
    found = json.loads(path.read_text(encoding="utf-8"))["cells"]
    return ["".join(cell["source"]) for cell in found if cell["cell_type"] == "code"]


def run(name: str, monkeypatch: pytest.MonkeyPatch) -> dict[str, object]:
    """What a notebook's names are after its last cell."""
    monkeypatch.chdir(NOTEBOOKS)
    mpl.use("agg")
    space: dict[str, object] = {"__name__": "__main__"}
    try:
        for i, source in enumerate(cells(NOTEBOOKS / f"{name}.ipynb")):
            exec(compile(source, f"{name}.ipynb, cell {i}", "exec"), space)
    finally:
        plt.close("all")
    return space


def test_the_three_are_all() -> None:
    assert {path.stem for path in NOTEBOOKS.glob("*.ipynb")} == set(NAMES)


@pytest.mark.slow
def test_own_record(monkeypatch: pytest.MonkeyPatch) -> None:
    found = run("own_record", monkeypatch)
    summary = found["posterior"].summary()  # type: ignore[attr-defined]
    for name, truth in (("zeta", 0.03), ("mu_c", 0.06)):
        assert abs(summary.loc[name, "mean"] - truth) < 4 * summary.loc[name, "sd"]


@pytest.mark.slow
def test_paper(monkeypatch: pytest.MonkeyPatch) -> None:
    found = run("paper", monkeypatch)
    for row in found["rows"]:  # type: ignore[attr-defined]
        assert max(error for name, error in row.items() if name.endswith("refined")) < 1e-4


@pytest.mark.slow
def test_many_specimens(monkeypatch: pytest.MonkeyPatch) -> None:
    found = run("many_specimens", monkeypatch)
    third = found["difference"]("third", "first")  # type: ignore[operator]
    assert third["difference %"] > 2 * third["sd"]
