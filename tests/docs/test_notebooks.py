"""The notebooks run cell by cell with warnings as errors, their results are true, and a kernel shows their figures."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import nbformat
import pytest
from nbclient import NotebookClient

NOTEBOOKS = Path(__file__).parents[2] / "docs" / "notebooks"
NAMES = ("own_record", "paper", "many_specimens")


def cells(path: Path) -> list[str]:
    """Return the code cells of a notebook."""
    book = json.loads(path.read_text(encoding="utf-8"))
    return ["".join(cell["source"]) for cell in book["cells"] if cell["cell_type"] == "code"]


def own_record(names: dict[str, Any]) -> bool:
    summary, truth = names["posterior"].summary(), {"zeta": 0.03, "mu_c": 0.06}
    return all(abs(summary.loc[n, "mean"] - true) < 4 * summary.loc[n, "sd"] for n, true in truth.items())


def paper(names: dict[str, Any]) -> bool:
    return all(row[name] < 1e-4 for row in names["rows"] for name in row if name.endswith("refined"))


def many_specimens(names: dict[str, Any]) -> bool:
    third = names["difference"]("third", "first")
    return third["difference %"] > 2 * third["sd"]


@pytest.mark.slow
@pytest.mark.parametrize("holds", [own_record, paper, many_specimens])
def test_the_results_of_a_notebook_are_true(
    holds: Callable[..., bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each function checks the names after the last cell of the notebook with its name."""
    monkeypatch.chdir(NOTEBOOKS)
    mpl.use("agg")
    space: dict[str, Any] = {"__name__": "__main__"}
    try:
        for i, source in enumerate(cells(NOTEBOOKS / f"{holds.__name__}.ipynb")):
            exec(compile(source, f"{holds.__name__}.ipynb, cell {i}", "exec"), space)
    finally:
        plt.close("all")
    assert holds(space)


def test_every_notebook_is_tested() -> None:
    assert {path.stem for path in NOTEBOOKS.glob("*.ipynb")} == set(NAMES)


DRAWN = """
import matplotlib
import bayesdamp as bd
signal = bd.simulate({"viscous": 0.05}, stiffness=20.0, duration=6.0, samples=150, noise_sd=0.003)
"""


def shown(cells: list[str], monkeypatch: pytest.MonkeyPatch, backend: str = "agg") -> list[int]:
    """Return the number of pictures that each cell shows in a kernel with this backend."""
    monkeypatch.setenv("MPLBACKEND", backend)
    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(source) for source in cells])
    NotebookClient(
        book, timeout=300, kernel_name="python3", resources={"metadata": {"path": NOTEBOOKS}}
    ).execute()
    return [sum("image/png" in o.get("data", {}) for o in cell.outputs) for cell in book.cells]


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["agg", "module://matplotlib_inline.backend_inline"])
def test_a_plot_is_shown_below_its_cell(backend: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert shown([DRAWN, "signal.plot();", "signal"], monkeypatch, backend) == [0, 1, 0]


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_every_notebook_shows_its_figures(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    code = cells(NOTEBOOKS / f"{name}.ipynb")
    drawing = [".plot(" in source or "subplots(" in source for source in code]
    assert any(drawing)
    assert [n > 0 for n in shown(code, monkeypatch)] == drawing
