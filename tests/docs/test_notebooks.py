"""The notebooks run in a kernel, with warnings as errors, show their figures, and their results are true."""

import json
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

NOTEBOOKS = Path(__file__).parents[2] / "docs" / "notebooks"
ERRORS = 'import warnings; warnings.filterwarnings("error", module="__main__|bayesdamp")'
CHECKS = {
    "own_record": """
summary = posterior.summary()
for name, truth in {"zeta": 0.03, "mu_c": 0.06}.items():
    assert abs(summary.loc[name, "mean"] - truth) < 4 * summary.loc[name, "sd"]
""",
    "paper": "assert all(row[name] < 1e-4 for row in rows for name in row if name.endswith('refined'))",
    "many_specimens": """
third = difference("third", "first")
assert third["difference %"] > 2 * third["sd"]
""",
}
"""A last cell for each notebook, which compares its results with the truth."""
DRAWN = """
import matplotlib
import bayesdamp as bd
signal = bd.simulate({"viscous": 0.05}, stiffness=20.0, duration=6.0, samples=150, noise_sd=0.003)
"""


def count_pictures(cells: list[str], monkeypatch: pytest.MonkeyPatch, backend: str = "agg") -> list[int]:
    """Return the number of pictures that each cell shows in a kernel with this backend."""
    monkeypatch.setenv("MPLBACKEND", backend)
    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(source) for source in cells])
    resources = {"metadata": {"path": NOTEBOOKS}}
    NotebookClient(book, timeout=300, kernel_name="python3", resources=resources).execute()
    return [sum("image/png" in o.get("data", {}) for o in cell.outputs) for cell in book.cells]


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["agg", "module://matplotlib_inline.backend_inline"])
def test_a_plot_is_shown_below_its_cell(backend: str, monkeypatch: pytest.MonkeyPatch) -> None:
    assert count_pictures([DRAWN, "signal.plot();", "signal"], monkeypatch, backend) == [0, 1, 0]


@pytest.mark.slow
@pytest.mark.parametrize("path", sorted(NOTEBOOKS.glob("*.ipynb")), ids=lambda path: path.stem)
def test_a_notebook_shows_its_figures_and_its_results_are_true(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    drawing = [".plot(" in source or "subplots(" in source for source in code]
    assert any(drawing)
    counts = count_pictures([ERRORS, *code, CHECKS[path.stem]], monkeypatch)
    assert [n > 0 for n in counts] == [False, *drawing, False]
