"""The report is one self-contained file with all sections, warnings, figures and escaped text."""

import io
import json
import re
from base64 import b64encode
from concurrent.futures import ThreadPoolExecutor

import pytest
from rich.console import Console

from bayesdamp.report.drawing import LARGEST_SVG
from bayesdamp.report.results.run import RunFolder, models_not_pruned
from bayesdamp.report.sections import SECTIONS, render
from bayesdamp.report.terminal import print_conclusion
from bayesdamp.store.files import write_json
from tests.report.conftest import LAW, RunMaker
from tests.report.pages import Page, Tables, foreign


@pytest.fixture(scope="module")
def page(whole_run) -> str:
    path = render(whole_run)
    assert path == whole_run / "report.html"
    return path.read_text(encoding="utf-8")


def test_the_page_loads_nothing(page):
    """Control: four kinds of loads."""
    assert foreign(page) == []
    assert foreign("<p><img src='https://example.org/x.png'></p>")
    assert foreign("<style>@import 'x.css';</style>")
    assert foreign("<p style='background: url(x.png)'></p>")
    assert foreign("<script src='figures/x.js'></script>")


def test_the_page_has_every_section_in_order(page):
    assert [i for i in Page(page).ids if i in SECTIONS.names()] == [
        "answer", "study", "record", "estimates", "posteriors", "evidence", "fit_quality", "priors", "provenance",
    ]  # fmt: skip


def test_warnings_are_on_the_page(page):
    words = Page(page).words
    for text in (
        "changes by up to 4.1 times the standard deviation that is expected by chance",
        "predictive p 0.0030",
        "emcee: not converged: R̂ of stiffness is 1.034",
        "are not shown, because for 7 draws they do not exist",
        "The study names 4 damping models",
        "ε, within which friction changes its sign, was not given; it is assumed.",
    ):
        assert text in words
    assert "bench and sim: Restoring force" not in words  # what is the same for all signals names none


def test_measured_signals_have_no_truth(page):
    """Errors are shown for ζ of the simulated signal under the two models that have it, and not for μ = 0."""
    section = page[page.index('id="estimates"') : page.index('id="posteriors"')]
    assert [part.count("<th>error ") for part in section.split("<h3>sim</h3>")] == [0, 2]
    assert section.count(": truth ζ = 0.05 1/s. ") == 1


def test_figures_are_saved_and_embedded(page, whole_run):
    """As SVG; those of which it would be too large as PNG."""
    files = {p.stem: p for p in (whole_run / "figures").glob("*.*g")}
    assert {"record-bench", "record-sim", "pairs-bench-viscous+coulomb"} <= set(files)
    assert page.count("<img ") == len(files)
    assert {path.suffix for path in files.values()} == {".svg", ".png"}
    for path in files.values():
        assert path.suffix == ".png" or path.stat().st_size <= LARGEST_SVG
        assert b64encode(path.read_bytes()).decode() in page
    assert not (whole_run / "figures" / ".tmp").exists()


def test_a_second_report_is_the_same(tmp_path):
    """Also if another thread draws it. Only figures that a report drew before are removed."""
    folder = RunMaker(tmp_path, signals=["sim"], repeats={"sim": 1}, models=("viscous",)).make()
    first, figures = render(folder).read_text(encoding="utf-8"), folder / "figures"
    drawn = {path.name: path.read_bytes() for path in figures.glob("*.*g")}
    (figures / ".drawn").write_text((figures / ".drawn").read_text() + "\nstale.png\n../report.html")
    for name in ("stale.png", "another.png"):
        (figures / name).write_bytes(b"")
    before = {p: p.stat().st_mtime_ns for p in (folder / "cells").rglob("*.npz")}
    with ThreadPoolExecutor(1) as pool:
        assert render(folder, pool).read_text(encoding="utf-8") == first
    assert {path.name: path.read_bytes() for path in figures.glob("*.*g")} == drawn | {"another.png": b""}
    assert before == {p: p.stat().st_mtime_ns for p in (folder / "cells").rglob("*.npz")}


def test_further_results_of_methods_are_under_the_true_damping(maker):
    """Also if two restoring laws are compared, and another damping is more probable. Negative terms are subtracted."""
    folder, info = maker.make(), maker.info()
    info["signals"]["sim"]["restoring"] = [LAW, "linear"]
    info["study"]["signals"][0]["source"] = {"damping": ["viscous", "coulomb"]}
    write_json(folder / "run.json", info)
    stored = folder / "cells/estimate/sim/0/viscous+coulomb"
    stored.rename(f"{stored}@{LAW}")
    tables = Tables(render(folder).read_text(encoding="utf-8")).tables
    (table,) = (table for table in tables if table.headers == ["method", "damping"])
    assert table.path[-1] == "Viscous + Coulomb (horizontal pendulum)"
    assert ["SINDy", "0.05020·2θ̇ − 20.10·θ"] in table.rows


def test_text_of_the_user_is_escaped(maker):
    folder = maker.make()
    info = maker.info() | {"name": "<script>alert(1)</script>", "description": "a & b"}
    info["signals"]["sim"]["notes"] = ["<img src=x>"]
    write_json(folder / "run.json", info)
    html = render(folder).read_text()
    assert "<script>alert" not in html
    assert "<img src=x" not in html
    assert "a &amp; b" in html


def test_many_signals_are_collapsed_and_only_their_best_models_are_drawn(maker_of):
    folder = maker_of(signals=[f"sim-{i}" for i in range(6)], models=("viscous", "coulomb")).make()
    html = render(folder).read_text()
    assert html.count("<summary>sim-5</summary>") >= 3
    assert "show only the most probable model of each" in html
    drawn = (folder / "figures").glob("marginals-sim-5-*.svg")
    assert [path.stem for path in drawn] == ["marginals-sim-5-viscous"]


def test_warnings_from_reading_a_record_are_on_the_page_and_on_the_terminal(maker_of) -> None:
    folder = maker_of(signals=("bench",), repeats={"bench": 1}, models=("viscous+coulomb", "viscous")).make()
    warning = "it swings by 80 turns to either side."
    for warned in (False, True):
        printed = io.StringIO()
        print_conclusion(folder, Console(file=printed, width=200))
        assert (f"Beware: {warning}" in printed.getvalue()) == warned
        words = Page(render(folder).read_text()).words
        assert (f"Warning from reading the record: {warning}" in words) == warned
        info = json.loads((folder / "run.json").read_text())
        info["signals"]["bench"]["warnings"] = [warning]
        (folder / "run.json").write_text(json.dumps(info))


def test_a_pruned_model_is_not_a_failed_check(maker_of) -> None:
    """It has a row in a table of its own, with its reason, and no fit. Control: a refused model is a failed check."""
    folder = maker_of(signals=("sim",), repeats={"sim": 1}, models=("viscous", "coulomb", "quadratic")).make()
    table = (folder / "evidence.csv").read_text()
    for outcome, is_pruned in (("pruned: far behind", True), ("refused: no mode", False)):
        changed = re.sub(r"(,coulomb,.*),ok$", rf"\1,{outcome}", table, flags=re.MULTILINE)
        (folder / "evidence.csv").write_text(changed)
        words = Page(render(folder).read_text()).words
        assert ("The evidence of Coulomb (" in words) != is_pruned
        assert ("Not computed further: 1 model, and why" in words) == is_pruned
        assert ("far behind" in words) == is_pruned
        assert ("coulomb" in models_not_pruned(RunFolder(folder), "sim", 0)) != is_pruned
