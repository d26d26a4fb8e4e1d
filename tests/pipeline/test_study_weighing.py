"""A study with two methods for the evidence, and a referee."""

import shutil
from pathlib import Path

import pytest

from bayesdamp.inference.evidence import nested
from bayesdamp.pipeline.jobs import task_names
from bayesdamp.pipeline.run import run_study
from bayesdamp.store.files import read_table
from bayesdamp.store.results import Store
from tests.pipeline.test_study import SMALL
from tests.studies import finish_study, write_study

pytestmark = pytest.mark.slow

EVIDENCE = 'evidence = { methods = ["importance", "bridge"], referee = "always" }'
TEXT = SMALL.replace("[[signal]]", f"{EVIDENCE}\n[[signal]]")


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """Run once, with few live points of nested sampling; tests must not change the folder."""
    folder = tmp_path_factory.mktemp("weighing")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(nested, "LIVE_POINTS", 100)
        patch.setattr(nested, "EFFECTIVE_DRAWS", 300)
        return finish_study(folder, TEXT)


def test_every_method_has_rows_and_the_referee_counts(run):
    rows = {(r["model"], r["method"]): r for r in read_table(run / "evidence.csv")}
    assert {method for _, method in rows} == {"importance", "bridge", "nested", "combined", "smc"}
    for model in ("viscous", "quadratic"):
        logs = {m: rows[model, m]["log_evidence"] for m in ("importance", "bridge", "nested", "combined")}
        assert logs["combined"] == logs["nested"]
        assert rows[model, "combined"]["diagnostic"].startswith("by nested sampling")
        assert abs(logs["importance"] - logs["bridge"]) < 0.05
    assert rows["viscous", "combined"]["probability"] > 0.99


def test_if_the_methods_agree_the_referee_is_not_used(run, tmp_path):
    """The same results with `auto`: the mean of both methods counts."""
    never = write_study(tmp_path, TEXT.replace('"always"', '"never"'))
    assert not any("nested" in name for name in task_names(never))
    study = write_study(tmp_path, TEXT.replace('"always"', '"auto"'))
    assert "evidence/noisy/0/viscous/nested" in task_names(study)
    shutil.copytree(run, tmp_path / "out")
    assert run_study(study, tmp_path / "out", workers=1) == 0
    assert Store(tmp_path / "out").read("evidence/noisy/0/viscous/nested").meta["evidence"] is None
    rows = {r["method"]: r for r in read_table(tmp_path / "out" / "evidence.csv") if r["model"] == "viscous"}
    assert set(rows) == {"importance", "bridge", "combined", "smc"}
    assert rows["combined"]["diagnostic"] == "importance and bridge agree"
