"""A run that was cut off between two cells ends with the numbers of one that was not, to the bit."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from bayesdamp.config import load_study
from bayesdamp.pipeline import run_study
from bayesdamp.store import Store, read_table
from tests.pipeline.workers.test_spread import STUDY

WEIGHED = STUDY.replace('["viscous", "quadratic"]', '["viscous"]').replace('["laplace"]', '["importance"]')


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run's folder, its study beside it."""
    folder = tmp_path_factory.mktemp("whole")
    (folder / "tiny.toml").write_text(WEIGHED, encoding="utf-8")
    assert run_study(load_study(folder / "tiny.toml"), folder / "out", workers=1) == 0
    return folder / "out"


def evidence(out: Path) -> list[str]:
    rows = read_table(out / "evidence.csv")
    assert any(row["method"] == "importance" and row["log_evidence"] for row in rows)
    return [repr({**row, "seconds": 0}) for row in rows]


@pytest.mark.parametrize("from_cell", ["evidence", "mode"])
def test_what_is_computed_again_is_what_was_there(whole: Path, tmp_path: Path, from_cell: str):
    """Evidence alone has its mode from a file; as it has in a run that computes both."""
    out = tmp_path / "out"
    shutil.copytree(whole, out)
    order = ["mode", "evidence"]
    for kind in order[order.index(from_cell) :]:
        shutil.rmtree(out / "cells" / kind)
    kept = set(Store(out).names())
    assert not [name for name in kept if name.startswith("evidence/")]
    assert run_study(load_study(whole.parent / "tiny.toml"), out, workers=1) == 0
    assert evidence(out) == evidence(whole)
