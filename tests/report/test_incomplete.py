"""The report of a folder with missing, damaged, refused or foreign results."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from bayesdamp.report.results.run import summary_rows
from bayesdamp.report.sections import render
from bayesdamp.store.files import write_json
from bayesdamp.store.results import Store, TaskResult, claim
from bayesdamp.types import InputError
from tests.report.pages import Page


def test_the_page_of_an_empty_run_says_that_it_has_no_results(tmp_path):
    claim(tmp_path)
    write_json(tmp_path / "run.json", {})
    assert "does not contain any results yet" in Page(render(tmp_path).read_text()).words


def without(kinds: str, *tables: str) -> Callable[[Path], None]:
    """Return a function that removes results of these kinds, and tables, from a run."""

    def spoil(folder: Path) -> None:
        for path in (*(folder / f"{name}.csv" for name in tables), *(folder / "cells").rglob("*.npz")):
            if path.suffix == ".csv" or path.relative_to(folder / "cells").parts[0] in kinds.split():
                path.unlink()

    return spoil


def cut_off(folder: Path) -> None:
    path = folder / "cells" / "mode" / "sim" / "0" / "viscous.npz"
    path.write_bytes(path.read_bytes()[:1000])


def refused(folder: Path, count: int = 1) -> None:
    outcome = "not applicable: a record without noise"
    for repeat in range(count):
        Store(folder).write(TaskResult(f"mode/sim/{repeat}/viscous", "k", {}, {}, outcome))


SPOILED: list[tuple[Callable[[Path], None], str]] = [
    (without("evidence", "evidence"), "No verdict on the damping: no evidence was computed."),
    (without("signal"), "The samples of this record are not stored with the run; run the study again."),
    (
        without("posterior estimate evidence mode", "estimates", "posteriors", "evidence", "fits"),
        "No verdict on the damping: nothing was computed for this signal.",
    ),
    (cut_off, "No fit of viscous is stored."),
    (refused, "No fit of viscous: not applicable: a record without noise"),
    (refused, "1 task ended without a result"),
    (lambda folder: refused(folder, 5), "mode/sim/2/viscous and 2 more"),
    (lambda folder: refused(folder, 5), "5 tasks ended without a result"),
]


@pytest.mark.parametrize(("spoil", "text"), SPOILED)
def test_the_page_says_what_is_missing_damaged_or_refused(maker, spoil, text):
    spoil(folder := maker.make())
    assert text in Page(render(folder).read_text()).words


def test_a_run_of_another_version_is_refused_in_one_line(maker):
    folder = maker.make()
    store = Store(folder)
    with store.lock():
        cell = store.read("mode/sim/0/viscous")
        store.write(replace(cell, meta={**cell.meta, "shares": 1.0}))
    with pytest.raises(InputError, match="another version of bayesdamp") as error:
        render(folder)
    assert str(folder) in str(error.value)
    assert "\n" not in str(error.value)


def test_a_table_with_other_columns_is_refused(maker):
    folder = maker.make()
    (folder / "fits.csv").write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match=r"fits\.csv: column deviation, .* predictive_p"):
        render(folder)


@pytest.mark.parametrize("content", ["", "{", "[3]", '[{"record": "sim"}]', "\udcff"])
def test_a_damaged_verdict_is_one_line(maker, content):
    folder = maker.make()
    (folder / "verdict.json").write_text(content, encoding="utf-8", errors="surrogateescape")
    with pytest.raises(InputError, match=r"verdict\.json: this file is damaged; run the study again"):
        render(folder)


def test_a_sampler_without_doubts_is_preferred_and_then_nuts() -> None:
    for nuts, emcee, chosen in (("ok", "ok", "nuts"), ("no", "ok", "emcee"), ("no", "no", "nuts")):
        row = {"signal": "s", "repeat": 0, "model": "viscous", "mean": 1.0}
        rows = [{**row, "sampler": s, "outcome": o} for s, o in (("emcee", emcee), ("nuts", nuts))]
        run = SimpleNamespace(posteriors=rows)
        assert [row["sampler"] for row in summary_rows(run, "s", 0, "viscous")] == [chosen]
