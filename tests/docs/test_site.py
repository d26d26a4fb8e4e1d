"""The site's pages: generated tables follow their source, numbers in the text are those of reports/, commands exist."""

import importlib.util
import re
import shlex
import sys
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import ModuleType

import pandas as pd
import pytest

import bayesdamp as bd
from bayesdamp.cli.app import command
from bayesdamp.estimators import names_for_all
from bayesdamp.physics.damping import TERMS
from bayesdamp.verdict import parts
from bayesdamp.verdict.types import Verdict

ROOT = Path(__file__).parents[2]
PAGES = sorted((ROOT / "docs").glob("*.md")) + sorted((ROOT / "docs" / "howto").glob("*.md"))


@pytest.fixture(scope="module")
def generated() -> ModuleType:
    spec = importlib.util.spec_from_file_location("generated", ROOT / "docs" / "generated.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["generated"] = module
    spec.loader.exec_module(module)
    return module


def test_every_estimator_and_term_is_in_the_table(generated: ModuleType) -> None:
    lines = generated.terms_taken().splitlines()
    assert lines[0].count("`") == 2 * len([n for n in TERMS.names() if TERMS.ships(n)])
    rows = {line.split("`")[1]: line for line in lines[2:] if line.startswith("| `")}
    assert set(rows) == set(names_for_all())
    with_parameters = [n for n in TERMS.names() if TERMS.ships(n) and TERMS.get(n).inferred]
    assert rows["genetic"].count("yes") == len(lines[0].split("`")) // 2 - len(with_parameters)
    assert rows["topological"].count("yes") == 3
    assert any("which estimators do not estimate" in line for line in lines)


def test_methods_errors_are_those_of_the_reports(generated: ModuleType) -> None:
    frame = pd.read_csv(ROOT / "reports" / "noise" / "estimates.csv")
    own = frame[(frame.parameter == "zeta") & (frame.estimator == "envelope") & (frame.stage == "initial")]
    middle = own[own.signal == "base"].error_pct.abs().median()
    assert generated.errors_in_noise(frame, "initial")["envelope"]["base"] == pytest.approx(middle)


def test_every_question_on_validation_is_answered_from_its_report(generated: ModuleType) -> None:
    text = generated.validated(ROOT)
    assert len(text.splitlines()) == 2 + len(generated.QUESTIONS)
    for name in generated.QUESTIONS:
        path = ROOT / "reports" / name
        page = (path if path.suffix else path / "README.md").read_text(encoding="utf-8")
        answer = generated.found_in(page)
        assert 20 < len(answer) < 500, name
        assert answer.replace("|", "\\|") in text


def test_commands_and_options_in_the_pages_exist() -> None:
    for page in PAGES:
        text = page.read_text(encoding="utf-8").replace("\\\n", " ")
        for line in re.findall(r"^bayesdamp (.*)$", text, re.MULTILINE):
            words = shlex.split(line)
            known = {option for p in command(words[0]).params for option in p.opts}
            assert {w.partition("=")[0] for w in words if w.startswith("--")} <= known


def test_citation_and_changelog_have_the_current_version() -> None:
    assert f"\nversion: {bd.__version__}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"## {bd.__version__}" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_every_field_of_a_verdict_is_described() -> None:
    page = (ROOT / "docs" / "columns.md").read_text(encoding="utf-8")
    described = set(re.findall(r"`(\w+)`", page.partition("## The tables")[0]))
    written = Verdict("rig", parts.Grade.EXACT, True, "viscous", 0.9).to_dict()
    assert written["schema"] == 3
    assert set(written) <= described
    assert not {"record", "new_field"} <= described, "the negative control"
    kinds = [kind for kind in vars(parts).values() if isinstance(kind, type) and is_dataclass(kind)]
    inner = set(kinds) - {parts.Table}  # it is in no file
    assert {f.name for kind in inner for f in fields(kind)} <= described


def undocumented(page: str, names: list[str]) -> list[str]:
    """Return the names that a page of the interface does not document."""
    entries = re.findall(r"^\.\. auto\w+:: ([\w.]+)", page, re.MULTILINE)
    return [n for n in names if n not in {entry.rpartition(".")[2] for entry in entries}]


def test_the_page_of_the_interface_documents_every_public_name() -> None:
    page = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    examples = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
    imported = re.findall(r"^from bayesdamp(\.(?!priors|types)[\w.]+) import (.+)$", examples, re.MULTILINE)
    used = [name for _, names in imported for name in names.split(", ")]
    assert len(used) > 10
    assert not undocumented(page, [n for n in bd.__all__ if n != "__version__"] + used)
    assert undocumented(page.replace(".. autoclass:: Fit()", ""), ["Fit"]) == ["Fit"]  # the control
