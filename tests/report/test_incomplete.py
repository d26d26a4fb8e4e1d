"""The report of a folder in which something is missing, damaged, refused or in doubt."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from bayesdamp.report.render import render
from bayesdamp.store import Store, TaskResult, write_json
from bayesdamp.store.results import claim
from bayesdamp.types import InputError
from tests.report.pages import Page


def test_an_empty_run_says_so(tmp_path):
    claim(tmp_path)
    write_json(tmp_path / "run.json", {})
    words = Page(render(tmp_path).read_text()).words
    assert "does not contain any results yet" in words


def without(folder: Path, *kinds: str) -> None:
    for path in (folder / "cells").rglob("*.npz"):
        if path.relative_to(folder / "cells").parts[0] in kinds:
            path.unlink()


@pytest.mark.parametrize(
    ("missing", "cells", "text"),
    [
        (["estimates.csv"], ["estimate"], "No estimator ran in this study."),
        (["evidence.csv"], ["evidence"], "No verdict on the damping: no evidence was computed."),
        ([], ["signal"], "The samples of this record are not stored with the run; run the study again."),
        (
            ["estimates.csv", "posteriors.csv", "evidence.csv", "fits.csv"],
            ["posterior", "estimate", "evidence", "mode"],
            "Nothing was computed for this signal.",
        ),
    ],
)
def test_what_is_missing_is_said(maker, missing, cells, text):
    folder = maker.make()
    for name in missing:
        (folder / name).unlink()
    without(folder, *cells)
    assert text in Page(render(folder).read_text()).words


def test_a_run_of_another_version_is_one_line(maker):
    folder = maker.make()
    store = Store(folder)
    with store.lock():
        cell = store.read("mode/sim/0/viscous")
        store.write(replace(cell, meta={**cell.meta, "climbs": [{"seed": "prior 1"}]}))
    with pytest.raises(InputError, match="another version of bayesdamp") as error:
        render(folder)
    assert str(folder) in str(error.value)
    assert "\n" not in str(error.value)


def test_a_damaged_cell_is_missing_not_fatal(maker):
    folder = maker.make()
    path = folder / "cells" / "mode" / "sim" / "0" / "viscous.npz"
    path.write_bytes(path.read_bytes()[:1000])
    assert "No fit of viscous is stored." in Page(render(folder).read_text()).words


def test_a_refusal_is_shown(maker):
    folder = maker.make()
    maker.store.write(TaskResult("mode/sim/0/viscous", "k", {}, {}, "not applicable: a record without noise"))
    words = Page(render(folder).read_text()).words
    assert "No fit of viscous: not applicable: a record without noise" in words
    assert "1 task ended without a result" in words


def test_poor_evidence_is_not_to_be_believed(maker):
    folder = maker.make()
    text = (folder / "evidence.csv").read_text()
    assert "not settled" not in Page(render(folder).read_text()).words
    text = re.sub(r"(bridge,[^,]*,[^,]*,[^,]*,[^,]*,[^,]*),,ok", r"\1,halves apart,not settled", text)
    (folder / "evidence.csv").write_text(text)
    words = Page(render(folder).read_text()).words
    assert "The evidence of viscous (bridge sampling): not settled." in words


def test_a_table_of_another_program(maker):
    folder = maker.make()
    (folder / "fits.csv").write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match=r"fits\.csv: column deviation, .* predictive_p"):
        render(folder)
