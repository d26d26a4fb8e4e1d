"""A study with two methods for the evidence, a referee, and what the answer depends on."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from bayesdamp.inference.evidence import nested
from bayesdamp.pipeline.jobs import task_names
from bayesdamp.pipeline.run import run_study
from bayesdamp.store import Store, read_table
from tests.pipeline.test_study import SMALL
from tests.studies import write_study

pytestmark = pytest.mark.slow

EVIDENCE = 'evidence = { methods = ["importance", "bridge"], referee = "always" }'
TEXT = SMALL.replace("[[signal]]", f"{EVIDENCE}\n[[signal]]")


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """Run once, with a coarse referee: only its wiring is looked at. Not to be changed by a test."""
    folder = tmp_path_factory.mktemp("weighing")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(nested, "LIVE_POINTS", 100)
        patch.setattr(nested, "EFFECTIVE_DRAWS", 300)
        assert run_study(write_study(folder, TEXT), folder / "out", workers=1) == 0
    return folder / "out"


def test_every_method_has_its_rows_and_one_counts(run):
    rows = read_table(run / "evidence.csv")
    assert {r["method"] for r in rows} == {"importance", "bridge", "nested", "combined", "smc"}
    logs = {(r["model"], r["method"]): r for r in rows}
    for model in ("viscous", "quadratic"):
        assert logs[model, "combined"]["log_evidence"] == logs[model, "nested"]["log_evidence"]
        assert logs[model, "combined"]["diagnostic"].startswith("by nested sampling")
        apart = logs[model, "importance"]["log_evidence"] - logs[model, "bridge"]["log_evidence"]
        assert abs(apart) < 0.05
    assert logs["viscous", "combined"]["probability"] > 0.99


def test_where_they_agree_nobody_is_called(run, tmp_path):
    """The same cells under `auto`: the referee's cell says that it was not called, and the mean counts."""
    assert not any(
        "nested" in c for c in task_names(write_study(tmp_path, TEXT.replace('"always"', '"never"')))
    )
    study = write_study(tmp_path, TEXT.replace('"always"', '"auto"'))
    assert "evidence/noisy/0/viscous/nested" in task_names(study)
    shutil.copytree(run, tmp_path / "out")
    assert run_study(study, tmp_path / "out", workers=1) == 0
    cell = Store(tmp_path / "out").read("evidence/noisy/0/viscous/nested")
    assert cell.meta["evidence"] is None
    rows = [r for r in read_table(tmp_path / "out" / "evidence.csv") if r["model"] == "viscous"]
    rows = [r for r in rows if r["method"] != "smc"]
    assert {r["method"] for r in rows} == {"importance", "bridge", "combined"}
    assert rows[-1]["diagnostic"] == "importance and bridge agree"


def test_what_the_answer_depends_on_is_there(run):
    store = Store(run)
    widths = store.read("sensitivity/noisy/0/viscous/widths")
    whole = store.read("evidence/noisy/0/viscous/importance").meta["evidence"]["log_evidence"]
    assert widths.arrays["log_evidence"][4] == pytest.approx(whole, abs=1e-3)
    half = store.read("sensitivity/noisy/0/quadratic/half").meta
    assert half["evidence"]["outcome"] == "ok"
    assert half["log_predictive"] < store.read("sensitivity/noisy/0/viscous/half").meta["log_predictive"]
    assert "sensitivity/noisy/0/viscous/savage_dickey" not in store.names()
    average = store.read("averaged/noisy/0")
    own = store.read("posterior/noisy/0/viscous/nuts").arrays["curve/equivalent_ratio"]
    np.testing.assert_allclose(average.arrays["curve/equivalent_ratio"], own, rtol=0.02)
