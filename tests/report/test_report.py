"""The report: whole, partial and empty folders, one self-contained file, the contract of its sections."""

from __future__ import annotations

import io
import json
import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console

from bayesdamp.report import render
from bayesdamp.report.results.reading import coefficients, models_by_rank, models_kept, ranking
from bayesdamp.report.results.run import Run
from bayesdamp.report.sections import SECTIONS, Section, in_order
from bayesdamp.report.sections._layout import drawn
from bayesdamp.report.sections.study.asked import _sentences
from bayesdamp.report.terminal import conclude
from bayesdamp.store import CellResult, Store, write_json
from bayesdamp.store.folders import claim
from bayesdamp.types import InputError


class Page(HTMLParser):
    """Collects what a page loads, its identifiers and its text, and checks that tags close in order."""

    VOID = frozenset({"meta", "img", "br", "link", "input", "hr", "source"})

    def __init__(self, html: str) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.ids: list[str] = []
        self.text: list[str] = []
        self.open: list[str] = []
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        if tag not in self.VOID:
            self.open.append(tag)
        for name, value in attrs:
            if name in ("src", "href", "data", "srcset", "action"):
                self.loads.append(value or "")
            if name == "id":
                self.ids.append(value or "")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)

    @property
    def words(self) -> str:
        return re.sub(r"\s+", " ", " ".join(self.text))


def foreign(html: str) -> list[str]:
    """Everything that a browser would fetch from elsewhere."""
    loads = [load for load in Page(html).loads if not load.startswith(("data:", "#"))]
    return loads + re.findall(r"@import[^;]*|url\([^)]*\)|https?://[^\s\"'<]+", html)


@pytest.fixture(scope="module")
def page(whole_run) -> str:
    path = render(whole_run)
    assert path == whole_run / "report.html"
    return path.read_text(encoding="utf-8")


def test_the_page_loads_nothing(page):
    assert foreign(page) == []


@pytest.mark.parametrize(
    "html",
    [
        "<p><img src='https://example.org/x.png'></p>",
        "<style>@import 'x.css';</style>",
        "<p style='background: url(x.png)'></p>",
        "<script src='figures/x.js'></script>",
    ],
)
def test_the_check_for_foreign_loads_sees_them(html):
    assert foreign(html)


def test_every_section_is_there_in_order(page):
    ids = [i for i in Page(page).ids if i in SECTIONS.names()]
    assert ids == [
        "summary", "against", "asked", "record", "estimates", "findings", "posteriors", "evidence", "fit_quality",
        "priors", "provenance",
    ]  # fmt: skip


def test_the_verdict_comes_first_and_warns(page):
    words = Page(page).words
    verdict = words.index("Damping is viscous + Coulomb, with probability > 0.999 among 4 candidates.")
    assert verdict < words.index("What was asked")
    assert "damping is most likely viscous, with probability 0.802." in words
    assert "viscous + Coulomb keeps a probability of 0.198" in words
    assert "move by 4.1 of the standard deviations that chance allows them" in words
    assert "predictive p 0.0030" in words
    assert "truth 0.05, inside" in words
    assert "not converged: R̂ of stiffness is 1.034" in words
    assert "ε was not given: 2 % of the peak velocity" in words


def test_measured_signals_have_no_truth(page):
    """Error columns: ζ of the simulated signal, under the two models that have it, none for μ = 0."""
    section = page[page.index('id="estimates"') : page.index('id="findings"')]
    bench, sim = section.split("<h3>sim</h3>")
    assert bench.count("error / %") == 0
    assert sim.count("error / %") == 2


def test_figures_are_saved_and_inside(page, whole_run):
    svg = {p.stem for p in (whole_run / "figures").glob("*.svg")}
    assert svg == {p.stem for p in (whole_run / "figures").glob("*.png")}
    assert {"record-bench", "record-sim", "evidence-bench", "pairs-bench-viscous+coulomb"} <= svg
    assert page.count("<img ") == len(svg)
    assert not (whole_run / "figures" / ".tmp").exists()


def test_a_second_report_is_the_same(maker_type, tmp_path):
    folder = maker_type(tmp_path, signals=["sim"], repeats={"sim": 1}, models=("viscous",)).make()
    first = render(folder).read_text(encoding="utf-8")
    drawn = folder / "figures" / ".drawn"
    drawn.write_text(drawn.read_text() + "\nstale.png\n../report.html")
    for name in ("stale.png", "another.png"):
        (folder / "figures" / name).write_bytes(b"")
    before = {p: p.stat().st_mtime_ns for p in (folder / "cells").rglob("*.npz")}
    assert render(folder).read_text(encoding="utf-8") == first
    assert not (folder / "figures" / "stale.png").exists()
    assert (folder / "figures" / "another.png").exists()  # which no report drew
    assert before == {p: p.stat().st_mtime_ns for p in (folder / "cells").rglob("*.npz")}


@pytest.mark.parametrize("name", SECTIONS.names())
def test_contract_of_a_section(name, whole_run, tmp_path, sketchy):
    section = SECTIONS.get(name)
    assert isinstance(section, Section)
    assert section.name == name
    assert section.title
    claim(tmp_path)
    write_json(tmp_path / "run.json", {})
    for run in (Run(whole_run), Run(tmp_path)):
        if section.applies(run):
            Page(section.render(run))


def test_sections_have_different_orders():
    orders = [section.order for section in in_order()]
    assert orders == sorted(set(orders))


class Extra(Section):
    order, name, title = 15, "extra", "An extra section"

    def applies(self, run):
        return True

    def render(self, run):
        return "<p>said by a plug-in</p>"


def test_a_section_is_one_class(tmp_path):
    claim(tmp_path)
    write_json(tmp_path / "run.json", {})
    SECTIONS.add("extra", Extra())
    try:
        assert "said by a plug-in" in render(tmp_path).read_text()
    finally:
        SECTIONS.remove("extra")
    assert "said by a plug-in" not in render(tmp_path).read_text()


def test_an_empty_run_says_so(tmp_path):
    claim(tmp_path)
    write_json(tmp_path / "run.json", {})
    words = Page(render(tmp_path).read_text()).words
    assert "holds no signal yet" in words


def without(folder: Path, *kinds: str) -> None:
    for path in (folder / "cells").rglob("*.npz"):
        if path.relative_to(folder / "cells").parts[0] in kinds:
            path.unlink()


@pytest.mark.parametrize(
    ("missing", "cells", "said"),
    [
        (["estimates.csv"], ["estimate"], "No estimator ran in this study."),
        (["posteriors.csv"], ["posterior"], "No posterior was sampled in this study."),
        (["evidence.csv"], ["evidence"], "Which damping it is was not decided: no evidence was computed."),
        (["fits.csv"], ["mode"], "No model was fitted in this study."),
        ([], ["signal"], "The record is not in this folder."),
        ([], ["mode"], "No fit of viscous + Coulomb is stored."),
        ([], ["posterior", "estimate", "evidence", "mode", "signal"], "damping is most likely viscous"),
        (
            ["estimates.csv", "posteriors.csv", "evidence.csv", "fits.csv"],
            ["posterior", "estimate", "evidence", "mode"],
            "Nothing was computed for this signal.",
        ),
    ],
)
def test_what_is_missing_is_said(maker, missing, cells, said):
    folder = maker.make()
    for name in missing:
        (folder / name).unlink()
    without(folder, *cells)
    assert said in Page(render(folder).read_text()).words


def test_a_damaged_cell_is_missing_not_fatal(maker):
    folder = maker.make()
    path = folder / "cells" / "mode" / "sim" / "0" / "viscous.npz"
    path.write_bytes(path.read_bytes()[:1000])
    assert "No fit of viscous is stored." in Page(render(folder).read_text()).words


def test_a_refusal_is_shown(maker):
    folder = maker.make()
    maker.store.write(CellResult("mode/sim/0/viscous", "k", {}, {}, "not applicable: a record without noise"))
    words = Page(render(folder).read_text()).words
    assert "No fit of viscous: not applicable: a record without noise" in words
    assert "1 task ended with a sentence instead of a result" in words


def test_poor_evidence_is_not_to_be_believed(maker):
    folder = maker.make()
    text = (folder / "evidence.csv").read_text()
    assert "was weighed by bridge" not in Page(render(folder).read_text()).words
    text = re.sub(r"(bridge,[^,]*,[^,]*,[^,]*,[^,]*,[^,]*),,ok", r"\1,halves apart,not settled", text)
    (folder / "evidence.csv").write_text(text)
    words = Page(render(folder).read_text()).words
    assert "that viscous was weighed by bridge: not settled" in words


def test_methods_that_disagree_are_named(maker):
    folder = maker.make()
    run = Run(folder)
    agreed = ranking(run, "sim", 0)
    assert agreed
    assert agreed.others == {}
    for row in run.evidence:
        if row["method"] == "importance":
            row["probability"] = 1 - row["probability"]
    found = ranking(run, "sim", 0)
    assert found
    assert found.method == "bridge"
    assert found.others == {"importance": "viscous + Coulomb"}


def test_text_of_the_user_is_escaped(maker):
    folder = maker.make()
    info = json.loads((folder / "run.json").read_text())
    info |= {"name": "<script>alert(1)</script>", "description": "a & b"}
    info["signals"]["sim"]["notes"] = ["<img src=x>"]
    write_json(folder / "run.json", info)
    html = render(folder).read_text()
    assert "<script>alert" not in html
    assert "<img src=x" not in html
    assert "a &amp; b" in html


def test_many_signals_fold(maker_of):
    names = [f"sim-{i}" for i in range(6)]
    folder = maker_of(signals=names, models=("viscous", "coulomb")).make()
    html = render(folder).read_text()
    assert "The other signals, one by one" in html
    assert "All signals and repeats" in html
    assert html.count("<summary>sim-5</summary>") >= 3
    assert "only the best model of each is drawn" in html
    drawn = {p.stem for p in (folder / "figures").glob("*.svg")}
    assert "marginals-sim-5-viscous" in drawn
    assert "marginals-sim-5-coulomb" not in drawn


def test_one_model_is_no_comparison(maker_of):
    html = render(maker_of(signals=["sim"], models=("viscous",)).make()).read_text()
    assert "no other model was compared" in html
    assert "only the best model of each is drawn" not in html


def test_a_user_s_own_term_is_a_damping_coefficient(maker):
    folder = maker.make()
    run = Run(folder)
    run.posteriors.extend(
        {**row, "model": "drag_of_my_own", "parameter": "mu_own"} for row in run.posteriors[:1]
    )
    assert coefficients(run, "drag_of_my_own") == ["mu_own"]
    assert coefficients(run, "viscous+coulomb") == ["zeta", "mu_c"]
    assert models_by_rank(run, "sim", 0) == ["viscous", "viscous+coulomb", "drag_of_my_own"]


def test_draws_with_nan_are_not_drawn(maker):
    folder = maker.make()
    cell = maker.store.read("posterior/sim/0/viscous/nuts")
    draws = cell.arrays["draws"].copy()
    draws[0, 0, 0] = np.nan
    maker.store.write(CellResult(cell.name, cell.key, cell.meta, {"draws": draws}))
    assert "marginal posterior of each parameter by emcee." in Page(render(folder).read_text()).words


def test_a_folder_that_is_no_run(tmp_path):
    with pytest.raises(InputError, match=r"no run\.json here; give the folder of a run"):
        render(tmp_path)
    with pytest.raises(InputError, match=r"no run\.json here"):
        render(tmp_path / "absent")
    (tmp_path / "run.json").write_text('{"name": ')
    with pytest.raises(InputError, match=r"run\.json: cannot be read"):
        render(tmp_path)
    (tmp_path / "run.json").write_text("[]")
    with pytest.raises(InputError, match=r"run\.json: holds no description of a run"):
        render(tmp_path)
    assert not (tmp_path / "report.html").exists()


def test_a_table_of_another_program(maker):
    folder = maker.make()
    (folder / "fits.csv").write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match=r"fits\.csv: column model, predictive_p"):
        render(folder)


def test_what_methods_found_besides(maker):
    folder = maker.make()
    words = Page(render(folder).read_text()).words
    assert "What the methods found besides" in words
    assert "0.05020·2θ̇ + 20.10·θ" in words
    assert "f(v) = 0.1·v" in words
    figures = {p.name for p in (folder / "figures").iterdir()}
    assert any(name.startswith("force-neural_ode-sim") for name in figures)
    assert any(name.startswith("eigenvalues-koopman-sim") for name in figures)


def test_the_summary_lists_what_is_not_ruled_out(maker_of) -> None:
    folder = maker_of(signals=("sim",), repeats={"sim": 1}, models=("viscous", "coulomb")).make()
    assert "rule out" not in Page(render(folder).read_text()).words
    store = Store(folder)
    cell = store.read("mode/sim/0/viscous")
    rivals = [{"words": f"it is {x}", "log_bayes": b} for x, b in zip("abcde", (0.0, 1.0, -1.0, -1.2, -4.0))]
    store.write(replace(cell, meta={**cell.meta, "rivals": rivals}))
    words = Page(render(folder).read_text()).words
    assert (
        "The record leaves open most other forms of damping (that it is b: 0.731); without these, damping"
        in words
    )
    assert (
        "rule out that it is b (0.731), it is a (0.500), it is c (0.269) or it is d (0.231). Each number"
        in words
    )
    assert (
        "what there might be beside it ln Bayes factor probability, against none it is b 1.00 0.731" in words
    )


def test_what_one_has_to_know_of_the_reading_is_a_doubt_and_on_the_terminal(maker_of) -> None:
    folder = maker_of(signals=("bench",), repeats={"bench": 1}, models=("viscous+coulomb", "viscous")).make()
    said = "it swings by 80 turns to either side."
    for warned in (False, True):
        printed = io.StringIO()
        conclude(folder, Console(file=printed, width=200))
        assert (f"Beware: {said}" in printed.getvalue()) == warned
        assert (f"the record's unit unseen: {said}" in Page(render(folder).read_text()).words) == warned
        info = json.loads((folder / "run.json").read_text())
        info["signals"]["bench"]["warnings"] = [said]
        (folder / "run.json").write_text(json.dumps(info))


def test_candidates_set_aside_are_no_doubt(maker_of) -> None:
    """They are counted among what to believe; another outcome is a doubt."""
    folder = maker_of(signals=("sim",), repeats={"sim": 1}, models=("viscous", "coulomb", "quadratic")).make()
    table = (folder / "evidence.csv").read_text()
    for outcome, believed in (("set aside: far behind", True), ("refused: no mode", False)):
        rows = [
            re.sub(r",ok$", f",{outcome}", row) if ",coulomb," in row else row for row in table.splitlines()
        ]
        (folder / "evidence.csv").write_text("\n".join(rows) + "\n")
        words = Page(render(folder).read_text()).words
        assert ("that 1 more candidate could be pruned unweighed" in words) == believed
        assert ("that Coulomb was weighed by" in words) != believed
        # What was set aside is a line of its own table, with its reason, and has no bar and no fit.
        assert ("1 candidate pruned by Laplace's evidence, and why" in words) == believed
        assert ("not shown: 1 that was pruned" in words) == believed
        assert ("far behind" in words) == believed
        assert ("coulomb" in models_kept(Run(folder), "sim", 0)) != believed


def test_sections_drawn_elsewhere_are_the_same_report(maker_of) -> None:
    """In another worker's thread, as in its process: the page and the figures of a report drawn here."""
    folder = maker_of(signals=("sim",), repeats={"sim": 1}, models=("viscous", "coulomb")).make()
    here = render(folder).read_text()
    figures = {path.name for path in (folder / "figures").iterdir()}
    assert figures
    with ThreadPoolExecutor(1) as pool:
        assert render(folder, pool).read_text() == here
    assert {path.name for path in (folder / "figures").iterdir()} == figures


def test_the_likeliest_four_of_few_signals_are_drawn_and_the_best_of_many(maker_of) -> None:
    few, many = (
        Run(maker_of(signals=[f"sim{i}" for i in range(n)], repeats={}, models=("viscous",)).make())
        for n in (4, 5)
    )
    assert [drawn(few, place) for place in range(6)] == [True] * 4 + [False] * 2
    assert [drawn(many, place) for place in range(6)] == [True] + [False] * 5


def test_what_was_asked_names_dampings_and_laws_once() -> None:
    made = SimpleNamespace(
        models=["viscous", "coulomb", "viscous@linear", "coulomb@linear", "viscous@duffing"],
        info={},
        signals=[],
        cells=lambda *_: [],
        about=lambda name: {"restoring": ["linear", "duffing"]},
    )
    system = {"restoring": "linear", "known": {}, "free": {"cubic": None}}
    first, second, *_ = _sentences(made, {"signals": [{"name": "a", "system": system}]})  # type: ignore[arg-type]
    assert first == "2 damping models were in play: viscous and Coulomb."
    assert second == "Restoring force: linear or Duffing."
    made.about = lambda name: {"restoring": ["linear"]}
    assert "To be found" in _sentences(made, {"signals": [{"name": "a", "system": system}]})[1]  # type: ignore[arg-type]
