"""Several records in one study: repeats joined, specimens summarised, in tables, report and terminal."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from bayesdamp.config import load_study
from bayesdamp.pipeline import run_study
from bayesdamp.pipeline.many import joining
from bayesdamp.report.results.run import Run
from bayesdamp.report.results.specimens import sentences
from bayesdamp.store import Store, read_table
from tests.pipeline.many.test_specimens import write

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """Run once. Not to be changed by a test."""
    folder = tmp_path_factory.mktemp("many")
    assert run_study(load_study(write(folder)), folder / "out", workers=1) == 0
    return folder / "out"


def rows(run: Path, **wanted) -> list[dict]:
    return [r for r in read_table(run / "specimens.csv") if all(r[k] == v for k, v in wanted.items())]


def test_repeats_are_joined_and_their_joint_interval_is_narrower(run):
    (joint,) = rows(run, specimen="a", record="", parameter="zeta")
    alone = [rows(run, specimen="a", record=n, parameter="zeta")[0] for n in ("a1", "a2")]
    assert joint["outcome"] == "ok"
    assert joint["shared"] == "damping"  # the law is known
    # four posterior sds: a false alarm once in 16,000 seeds
    assert abs(joint["mean"] - 0.05) < 4 * joint["sd"]
    assert joint["sd"] == pytest.approx(sum(r["sd"] ** -2 for r in alone) ** -0.5, rel=0.1)
    assert joint["effective"] > 1000
    assert not rows(run, specimen="a", record="", parameter="theta0")  # each record's own
    assert rows(run, specimen="a", record="a1", parameter="theta0")


def test_records_that_differ_are_said_to_disagree(run):
    (joint,) = rows(run, specimen="b", record="", parameter="zeta")
    assert joint["outcome"].startswith("the records disagree")
    said = Store(run).read("joint/b").meta["agreement"]["damping"]["log_bayes_factor"]
    assert said < -20
    # Negative control of each other: those of a do agree.
    assert Store(run).read("joint/a").meta["agreement"]["damping"]["log_bayes_factor"] > 0


def test_the_population_has_a_row_for_mean_spread_and_each_specimen(run):
    found = [r for r in read_table(run / "population.csv") if r["over"] == "specimens"]
    assert [(r["what"], r["of"]) for r in found] == [
        ("mean", ""), ("spread", ""), ("own value", "a"), ("own value", "b"), ("own value", "c")
    ]  # fmt: skip
    mean, spread = found[:2]
    assert mean["q2.5"] < 0.0575 < mean["q97.5"]
    assert spread["q2.5"] > 0.002
    assert "only 3" in mean["outcome"]
    assert "the records of b disagree" in mean["outcome"]
    assert {r["over"] for r in read_table(run / "population.csv")} == {
        "repeats of a", "repeats of b", "specimens"
    }  # fmt: skip


def test_the_report_and_the_terminal_say_it(run):
    page = (run / "report.html").read_text(encoding="utf-8")
    for text in ("Many records", "Repeats of a", "Over the specimens", "an encoder may be offset"):
        assert text in page
    a, b, over = sentences(Run(run))
    assert a.startswith("a: 2 records together, if every law held exactly: damping is viscous")
    assert "disagree" in b
    assert "disagree" not in a
    assert over.startswith(
        "Over 3 specimens, all taken as viscous, if every law held exactly: ζ has the mean"
    )


def test_cells_are_done_once(run, tmp_path, monkeypatch):
    names = Store(run).names()
    monkeypatch.setattr("bayesdamp.pipeline.run._render", lambda folder, pool: None)
    before = {n: Store(run).read(n).seconds for n in names}
    assert run_study(load_study(write(tmp_path)), run, workers=1) == 0
    assert {n: Store(run).read(n).seconds for n in names} == before


def test_a_joint_fit_that_was_cut_off_goes_on(run, tmp_path, monkeypatch):
    """Killed after the last candidate was weighed: none is weighed again, and the end is the same."""
    folder = tmp_path / "cut"
    shutil.copytree(run, folder)
    (path,) = (folder / "cells" / "joint").glob("a.*")
    whole = Store(run).read("joint/a")
    path.unlink()
    monkeypatch.setattr("bayesdamp.pipeline.run._render", lambda folder, pool: None)
    weighed = []
    real = joining.weigh
    monkeypatch.setattr(joining, "weigh", lambda mode, seed: weighed.append(seed) or real(mode, seed))
    assert run_study(load_study(write(tmp_path)), folder, workers=1) == 0
    assert weighed == []
    assert repr(Store(folder).read("joint/a").meta) == repr(whole.meta)
    # The control: without what was kept, it is weighed.
    shutil.rmtree(folder / "cells" / "weighed")
    path.unlink()
    assert run_study(load_study(write(tmp_path)), folder, workers=1) == 0
    assert weighed != []
