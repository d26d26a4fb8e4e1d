"""Read what we ship: pages on simulated records against the truth that made these records."""

from __future__ import annotations

import csv
import json
import math
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bayesdamp.config.load import load_study
from validation.reports import __main__ as making
from validation.reports.contradictions import (
    COEFFICIENTS,
    Quoted,
    Simulated,
    contradictions,
    missed,
    of_document,
    of_many,
    of_rows,
    true_ratio,
)
from validation.reports.recipes import Recipe
from validation.truth.oscillator import Oscillator

ROOT = Path(__file__).parents[3]
REPORTS = ROOT / "reports"
PAGES = sorted(p.name for p in REPORTS.iterdir() if p.is_dir())
DOCUMENTS = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
PAPER = Oscillator(
    "horizontal_pendulum", {"stiffness": 20.0, "spring_angle": 0.0, "gravity": 1.0}, {"coulomb": 0.03}, 0.1
)


def test_no_shipped_page_contradicts_the_truth() -> None:
    assert {name: found for name in PAGES if (found := contradictions(REPORTS / name))} == {}


def test_no_example_contradicts_its_record() -> None:
    assert {page.name: found for page in DOCUMENTS if (found := of_document(page))} == {}


def test_a_shipped_run_has_the_truth_of_its_study() -> None:
    """What a page is compared with is what the study file says today."""
    compared = 0
    for study in sorted((ROOT / "studies").glob("*.toml")):
        file = REPORTS / study.stem / "run.json"
        run = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {"kind": "not shipped"}
        if "kind" in run:  # or its records are drawn from the priors
            continue
        today = {s.name: s.source for s in load_study(study).signals}
        for signal in run["study"]["signals"]:
            truth = Simulated.of(signal)
            source: Any = today[truth.name]
            assert frozenset(source.damping) == truth.damping
            assert {n: source.truth[n] for n in truth.truth} == truth.truth
            compared += 1
    assert compared > 3


def test_the_true_ratio_is_that_of_small_damping() -> None:
    """Of a linear spring: ζ/ω, 2 μ/(π ω² A) and 4 μ A/(3π)."""
    linear = {"stiffness": 20.0, "rest_angle": 0.1}
    for damping, ratio in (
        ({"viscous": 0.05}, 0.05 / math.sqrt(20)),
        ({"coulomb": 0.03}, 2 * 0.03 / (math.pi * 20 * 0.2)),
        ({"quadratic": 0.05}, 4 * 0.05 * 0.2 / (3 * math.pi)),
    ):
        assert true_ratio(Oscillator("linear", linear, damping), 0.2) == pytest.approx(ratio, rel=1e-6)
    assert true_ratio(PAPER, 0.25) == pytest.approx(0.0038, rel=0.01)


# --- negative controls: pages with a fault ---

RATIO = true_ratio(PAPER, 0.25)
VERDICT: dict[str, Any] = {
    "record": "coulomb-noisy", "decided": True, "damping": "coulomb", "probability": 0.99,
    "rivals": [{"damping": "quadratic", "probability": 0.01}], "sentence": "Coulomb damping, 0.38 % & more.",
    "damping_ratio": [{"amplitude": 0.25, "unit": "rad", "low": 0.99 * RATIO, "high": 1.01 * RATIO}],
}  # fmt: skip
EVIDENCE = [
    {"signal": "coulomb-noisy", "method": "importance", "model": model, "log_evidence": log, "outcome": "ok"}
    for model, log in (("coulomb", "10.0"), ("quadratic", "2.0"))
]
POSTERIOR = {
    "signal": "coulomb-noisy", "repeat": "0", "model": "coulomb", "sampler": "nuts", "parameter": "mu_c",
    "q2.5": "0.0299", "q97.5": "0.0301", "outcome": "ok",
}  # fmt: skip
EXCLUDING = {
    "decided": False,
    "damping": "quadratic",
    "rivals": [{"damping": "coulomb", "probability": 0.001}],
}
OUTSIDE = {"damping_ratio": [{"amplitude": 0.25, "unit": "rad", "low": 1.1 * RATIO, "high": 1.12 * RATIO}]}
ESTIMATE = {"signal": "coulomb-noisy", "parameter": "mu_c", "truth": "0.03"}


def page_of(
    folder: Path,
    verdict: dict[str, Any] | None = None,
    evidence: list[dict[str, str]] | None = None,
    posterior: dict[str, str] | None = None,
    estimate: dict[str, str] | None = None,
    sentence: str | None = None,
) -> Path:
    """A page of the paper's Coulomb pendulum, with what is to be wrong in it."""
    run = json.loads((REPORTS / "paper" / "run.json").read_text(encoding="utf-8"))
    kept = [s for s in run["study"]["signals"] if s["name"] == "coulomb-noisy"]
    (folder / "run.json").write_text(json.dumps({"study": {"signals": kept}}), encoding="utf-8")
    said = {**VERDICT, **(verdict or {})}
    (folder / "verdict.json").write_text(json.dumps([said]), encoding="utf-8")
    text = (sentence or said["sentence"]).replace("&", "&amp;")
    (folder / "report.html").write_text(f"<h1>x</h1><p>{text}</p>", encoding="utf-8")
    tables = {
        "evidence": evidence or EVIDENCE,
        "posteriors": [{**POSTERIOR, **(posterior or {})}],
        "estimates": [{**ESTIMATE, **(estimate or {})}],
    }
    for name, rows in tables.items():
        with (folder / f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
    return folder


def test_a_right_page_passes(tmp_path: Path) -> None:
    assert contradictions(page_of(tmp_path)) == []


def test_an_undecided_page_that_holds_the_truth_possible_passes(tmp_path: Path) -> None:
    open_one = {
        "decided": False,
        "probability": 0.6,
        "rivals": [{"damping": "quadratic", "probability": 0.4}],
    }
    assert contradictions(page_of(tmp_path, open_one)) == []


def test_a_wrong_page_is_found(tmp_path: Path) -> None:
    cases = [
        ({"verdict": {"damping": "quadratic"}}, "quadratic is named, but the truth is coulomb"),
        ({"verdict": EXCLUDING}, "the true damping, coulomb, has a probability of 0.001"),
        ({"verdict": OUTSIDE}, "far outside"),
        ({"evidence": [{**EVIDENCE[0], "log_evidence": "1.0"}, EVIDENCE[1]]}, "puts quadratic first"),
        ({"posterior": {"q2.5": "0.0303", "q97.5": "0.0305"}}, "mu_c by nuts"),
        ({"estimate": {"truth": "0.05"}}, "estimates.csv states mu_c = 0.05"),
        ({"sentence": "Another sentence."}, "does not contain the sentence"),
    ]
    for fault, words in cases:
        found = contradictions(page_of(tmp_path, **fault))
        assert any(words in one for one in found), found


def test_a_wrong_example_is_found(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
    for old, new, words in (
        ("--damping viscous=0.05,coulomb=0.03", "--damping viscous=0.05,quadratic=0.03", "is named"),
        ("coulomb=0.03", "coulomb=0.04", "far outside"),
    ):
        wrong = tmp_path / "tutorial.md"
        assert old in text
        wrong.write_text(text.replace(old, new), encoding="utf-8")
        assert any(words in one for one in of_document(wrong))


def test_wrong_tables_are_found(tmp_path: Path) -> None:
    """The shipped rows with every interval moved by 3 %, and with every tenth name changed."""
    with (REPORTS / "deviation" / "rows.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))

    def written(changed: Callable[[int, dict[str, str]], dict[str, str]]) -> list[str]:
        table = tmp_path / "rows.csv"
        with table.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, list(rows[0]))
            writer.writeheader()
            writer.writerows(changed(i, row) for i, row in enumerate(rows))
        return of_rows(table, "family")

    def moved(_: int, row: dict[str, str]) -> dict[str, str]:
        ends = {n: str(1.03 * float(row[n])) for n in ("low_2", "high_2") if row[n]}
        return {**row, **ends}

    def renamed(i: int, row: dict[str, str]) -> dict[str, str]:
        return row if i % 10 else {**row, "named": "viscous+coulomb+quadratic", "true_probability": "0.01"}

    assert written(lambda _, row: row) == []
    assert any("miss the truth" in sentence for sentence in written(moved))
    assert any("named wrongly" in one for one in written(renamed))


def test_chance_is_allowed() -> None:
    """Five misses of 100 intervals are what 95 % means; fifteen are not (probability 4e-5)."""

    def intervals(misses: int) -> list[Quoted]:
        return [Quoted(str(i), "x", 1.0, 2.0, 2.1 if i < misses else 1.5) for i in range(100)]

    assert missed(intervals(5)) == []
    assert len(missed(intervals(15))) == 15
    truth = frozenset(["viscous"])
    assert (
        of_many([(truth, True, "viscous", 0.97, 0.97)] * 97 + [(truth, True, "coulomb", 0.97, 0.03)] * 3, "x")
        == []
    )
    assert of_many([(truth, True, "coulomb", 0.97, 0.03)] * 20, "x")


def test_a_page_that_contradicts_its_truth_is_not_marked_as_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """`make reports` goes on, and says which page is wrong."""
    for part in ("reports", "right", "wrong"):
        (tmp_path / part).mkdir()
    page_of(tmp_path / "right")
    page_of(tmp_path / "wrong", {"damping": "quadratic"})
    monkeypatch.setattr(making, "ROOT", tmp_path)
    monkeypatch.setattr(subprocess, "run", _copied)
    monkeypatch.setattr(making, "_git", lambda *_: "")
    for name, done in (("right", True), ("wrong", False)):
        recipe = Recipe(name, 1, (f"copy {tmp_path / name} {{out}}",), ())
        assert making._make(recipe) is done
        assert (name in making.stamps(tmp_path / "reports")) is done
    assert "quadratic is named, but the truth is coulomb" in capsys.readouterr().err


def _copied(words: list[str], **_: object) -> subprocess.CompletedProcess[str]:
    shutil.copytree(words[1], words[2], dirs_exist_ok=True)
    return subprocess.CompletedProcess(words, 0)


def test_the_coefficients_are_those_of_the_terms() -> None:
    from bayesdamp.physics.damping import TERMS

    assert {term: TERMS.get(term).parameter for term in COEFFICIENTS} == dict(COEFFICIENTS)
