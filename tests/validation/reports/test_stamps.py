"""Reports are stale if something changed that their numbers depend on."""

import dataclasses
from pathlib import Path

import pytest

from validation.reports.recipes import RECIPES, Recipe
from validation.reports.stamps import digest, stale

ROOT = Path(__file__).parents[3]
CODE = 'def force(v):\n    """Of a damper."""\n    return 2 * v  # newtons\n'


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    (tmp_path / "physics").mkdir()
    (tmp_path / "physics" / "force.py").write_text(CODE)
    (tmp_path / "study.toml").write_text("seed = 1\n")
    return tmp_path


RECIPE = Recipe("paper", 1, ("true",), ("physics", "study.toml"))


def test_comments_and_docstrings_do_not_make_a_report_stale(tree: Path):
    before = digest(RECIPE, tree)
    other = CODE.replace("newtons", "N").replace("Of a damper", "A damper's")
    for text in ("def force(v):\n    return 2 * v\n", other):
        (tree / "physics" / "force.py").write_text(text)
        assert digest(RECIPE, tree) == before


def test_the_place_of_a_statement_and_imports_do_not_make_a_report_stale(tree: Path):
    """Negative control: a second statement with the same code is a change."""
    before = digest(RECIPE, tree)
    (tree / "physics" / "damper.py").write_text(CODE)
    assert digest(RECIPE, tree) != before
    users = "from typing import TYPE_CHECKING\n\nfrom .damper import force\n\nif TYPE_CHECKING:\n    import math\n"
    (tree / "physics" / "force.py").write_text(users)
    assert digest(RECIPE, tree) == before


def test_changes_of_code_study_files_and_commands_make_a_report_stale(tree: Path):
    contents = {
        "physics/force.py": CODE.replace("2 * v", "3 * v"),
        "study.toml": "seed = 2\n",
        "physics/new.py": "X = 1\n",
    }
    digests = [digest(RECIPE, tree), digest(dataclasses.replace(RECIPE, commands=("false",)), tree)]
    for name, text in contents.items():
        (tree / name).write_text(text)
        digests.append(digest(RECIPE, tree))
    assert len(set(digests)) == 5


def test_every_report_has_a_recipe_and_its_sources_exist():
    other = {"answer.png", "benchmarks", "made.json", "quickstart"}
    assert {p.name for p in (ROOT / "reports").iterdir()} - other <= {r.name for r in RECIPES}
    for recipe in RECIPES:
        for source in recipe.sources:
            assert (ROOT / source).exists(), source


@pytest.mark.slow
def test_reports_are_fresh():
    """`make reports` computes those that are not fresh."""
    assert [recipe.name for recipe in stale(ROOT)] == []
