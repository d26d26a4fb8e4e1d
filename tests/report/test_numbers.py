"""Every number that the page and the terminal show is the stored one, to half a unit of its last digit."""

import io
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from pkgutil import resolve_name
from shutil import copytree
from typing import Any

import pytest
from rich.console import Console

from bayesdamp.report.sections import render
from bayesdamp.report.terminal import VerdictPrinter
from bayesdamp.verdict.types import load_verdicts
from tests.report import stored as expected
from tests.report.conftest import EPSILON, RunMaker, write_answers
from tests.report.pages import Comparison, Tables, numbers
from tests.report.stored import MODEL, UNIT


def compare_answer(c: Comparison, where: str, v: Any, unit: float, texts: list[str]) -> None:
    """Compare an answer's sentences: the first one, the energy lost, and the limits of other terms."""
    limits = {f["form"]: 100 * f["share_below"] for f in v["other_forms"]}
    c.check(f"{where} answer", texts[0], expected.of_sentence(v, unit))
    limits = limits and {"95": 95.0, **limits}
    for start, stored in (("Energy lost", expected.of_energy(v)), ("Of the energy lost", limits)):
        c.check(f"{where} {start}", next((t for t in texts if t.startswith(start)), ""), stored)


def compare_page(c: Comparison, folder: Path) -> None:
    """Compare the tables and the answers of the page with the files, and count the rows that it leaves out."""
    page = Tables(render(folder).read_text(encoding="utf-8"))
    f, of_answers, counts = expected.Folder(folder), expected.Folder(folder), Counter[tuple[str, str]]()
    for table in page.tables:
        (section, signal), headers = table.path[:2], table.headers
        names = [name.lower() for name in table.path[2:]]
        model = next((MODEL[name] for name in reversed(names) if name in MODEL), None)
        for i, line in enumerate(table.rows):
            cells = dict(zip(headers, line, strict=True))
            at = {"signal": signal, "repeat": int(cells.get("repeat", 1)) - 1}
            at["model"] = model or MODEL.get(cells.get("model", "").lower())
            if section == "answer":
                stored = expected.of_answer_table(f.verdicts[signal], signal, i, cells)
            elif section == "overview" and "parameter" in cells:
                section, stored = "population", expected.of_population()
            elif section == "overview":
                stored = expected.of_overview(f.verdicts[cells["record"]], UNIT[cells["record"]])
            elif section == "evidence" and "damping" in cells:
                stored = expected.of_odds(of_answers, at, cells)
            elif section in expected.OF_SECTION and expected.OF_SECTION[section][0] in headers:
                stored = expected.OF_SECTION[section][1](f, at, cells)
            else:
                continue
            kind = expected.KIND[headers[0]] if section == "answer" else section
            c.row(kind, cells, stored)
            counts[signal, kind] += 1
    for signal, v in f.verdicts.items():
        own = [(tag, text) for path, tag, text in page.texts if path[:2] == ["answer", signal]]
        compare_answer(c, "page", v, UNIT[signal], [text for tag, text in own if tag in ("claim", "p")])
        at = {"signal": signal, "repeat": 0, "model": v["damping"]}
        (width,) = (t for p, _, t in page.texts if p[:2] == ["record", signal] and "compared with ε" in t)
        c.check("ε", width, {"": EPSILON, "of the peak velocity": 2.0})
        by = {m: of_answers.row("evidence", **at, method=m)["probability"] for m in ("bridge", "importance")}
        by["answer"] = v["probability"] / (v["probability"] + v["rivals"][0]["probability"])
        c.check("check of the probability", next(t for _, t in own if t.startswith("Probability of")), by)
        rows = {"ratio": len(v["damping_ratio"]), "coefficient": len(v["coefficients"]), "candidate": 2}
        for kind, count in rows.items():
            c.mark(f"{kind}: rows", counts[signal, kind] == count, f"{counts[signal, kind]} of {signal}")
    for kind, count in (("overview", len(f.verdicts)), ("population", 1)):
        c.mark(f"{kind}: rows", counts["Population of the specimens", kind] == count, str(counts))
    for name, rows in f.tables.items():
        first = set(rows.index[rows.repeat == 0])
        c.mark(f"{name}: rows", first <= f.looked_up[name], f"not shown: {first - f.looked_up[name]}")


def compare_terminal(c: Comparison, folder: Path) -> None:
    out, f = io.StringIO(), expected.Folder(folder)
    show = VerdictPrinter(Console(file=out, width=200), {"bench": "deg"})
    for verdict in load_verdicts(folder / "verdict.json"):
        show(verdict)
    parts = re.split(rf"^({'|'.join(f.verdicts)}): ", out.getvalue(), flags=re.MULTILINE)
    for signal, text in zip(parts[1::2], parts[2::2], strict=True):
        v, lines = f.verdicts[signal], text.splitlines()
        compare_answer(c, "terminal", v, UNIT[signal], lines)
        grid = [[cell.strip() for cell in line.split("│")[1:-1]] for line in lines if line.startswith("│")]
        c.mark("terminal ratio: rows", len(grid) == len(v["damping_ratio"]), text)
        for row, r in zip(grid, v["damping_ratio"]):
            stored = expected.of_ratio(r, UNIT[signal])
            c.row("terminal ratio", dict(zip(stored, row)), stored)


@pytest.fixture(scope="module")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    counts, models = {"sim": 1, "sim-2": 2}, ("viscous", "viscous+coulomb")
    return RunMaker(tmp_path_factory.mktemp("numbers") / "run", ("bench", *counts), counts, models).make()


@pytest.fixture
def compared(run_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], Comparison]:
    """Compare a copy of the run, whose sentences are written when this is called. No figure is drawn."""
    monkeypatch.setattr("bayesdamp.report.drawing.Drawings.add", lambda *_, **__: "")

    def compare() -> Comparison:
        folder, c = copytree(run_folder, tmp_path / "run"), Comparison()
        write_answers(folder)
        compare_page(c, folder)
        compare_terminal(c, folder)
        return c

    return compare


def test_every_number_that_is_shown_is_the_stored_one(compared: Callable[[], Comparison]) -> None:
    c = compared()
    assert c.wrong == {}
    assert len(c.compared) > 190


def test_a_number_is_right_to_half_a_unit_of_its_last_digit() -> None:
    """The rule of the comparison; control: half a unit and 1 % of it is wrong."""
    for text, value, half in (
        ("−0.0120", -0.012, 5e-5), ("5\u202f000", 5000, 0.5), ("1.20 × 10⁷ ± 0.30 × 10⁷", 1.2e7, 5e4),
        ("85 ms", 0.085, 5e-4), ("0", 0, 0),
    ):  # fmt: skip
        number = numbers(text)[0]
        assert number.is_right(value)
        assert number.is_right(value + half)
        assert not number.is_right(value + 1.01 * half + 1e-12), text
    assert numbers("> 0.999")[0].is_right(0.9995)
    assert not numbers("> 0.999")[0].is_right(0.9985)


def exchange_errors(answer: Any) -> Any:
    """Return an answer in which the errors from noise and from the law are exchanged."""

    def exchange(rows: Any) -> Any:
        return tuple(replace(r, sd_noise=r.sd_law, sd_law=r.sd_noise) for r in rows)

    v = answer.verdict
    changed = replace(v, damping_ratio=exchange(v.damping_ratio), coefficients=exchange(v.coefficients))
    return replace(answer, verdict=changed)


Change = Callable[[Callable[..., Any]], Callable[..., Any]]
REPORT = "bayesdamp.report"
SIZES = ("bayesdamp.formatting.with_interval", "bayesdamp.verdict.words.with_interval")
CONTROLS: dict[str, tuple[tuple[str, ...], Change, str]] = {
    "interval starts at its value": (
        SIZES, lambda f: lambda value, low, high, *more: f(value, value, high, *more),
        r"(?!posteriors|.*(coulomb|viscous) ).* low"),
    "error halved": (
        (f"{REPORT}.sections.estimates._table",),
        lambda f: lambda *of: f(*of[:3], [{**r, "error_pct": r["error_pct"] / 2} for r in of[3]]),
        r"estimates, error.*: (least|largest|)"),
    "noise and law exchanged": (
        (f"{REPORT}.sections.answer.answer_of",), lambda f: lambda *place: exchange_errors(f(*place)),
        r"(ratio|coefficient), sd from (noise|the law): "),
    "rows reversed on the terminal": (
        (f"{REPORT}.terminal.ratios_table",), lambda f: lambda ratios: f(ratios[::-1]),
        r"terminal ratio, (?!.*count).*"),
    "posteriors left out": ((f"{REPORT}.sections.posteriors._tables",), lambda _: lambda *_: [], r"posteriors: rows"),
}  # fmt: skip
"""The functions that are replaced, by what, and a pattern of the names of all numbers that are wrong then."""


@pytest.mark.parametrize("control", CONTROLS)
def test_exactly_the_wrong_numbers_are_reported(
    control: str, compared: Callable[[], Comparison], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The negative control of the comparison."""
    names, change, wrong = CONTROLS[control]
    for name in names:
        monkeypatch.setattr(name, change(resolve_name(name)))
    c = compared()
    assert set(c.wrong) == {name for name in c.compared if re.fullmatch(wrong, name)} != set()
