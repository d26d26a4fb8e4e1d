"""Several records in one study: repeats joined, specimens summarised, in tables, report and terminal."""

from __future__ import annotations

from pathlib import Path

import pytest

from bayesdamp.config import load_study
from bayesdamp.pipeline.run import run_study
from bayesdamp.pipeline.specimens import LOCATION_SCALE
from bayesdamp.store import Store, read_table
from bayesdamp.store.contents import JointContent
from tests.pipeline.test_specimens import write

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """Run once. Not to be changed by a test."""
    folder = tmp_path_factory.mktemp("many")
    assert run_study(load_study(write(folder)), folder / "out", workers=1) == 0
    return folder / "out"


def rows(run: Path, **wanted) -> list[dict]:
    return [r for r in read_table(run / "specimens.csv") if all(r[k] == v for k, v in wanted.items())]


def joint(run: Path, specimen: str) -> JointContent:
    return JointContent.of(Store(run).read(f"joint/{specimen}"))


def test_records_that_differ_are_said_to_differ(run):
    assert joint(run, "b").differ
    assert joint(run, "b").no_spread < -20
    # Negative control of each other: those of a are compatible.
    assert not joint(run, "a").differ
    assert joint(run, "a").no_spread > 0


def test_the_population_has_a_row_for_mean_spread_and_each_specimen(run):
    found = [r for r in read_table(run / "population.csv") if r["over"] == "specimens"]
    assert [(r["what"], r["of"]) for r in found] == [
        ("mean", ""), ("spread", ""), ("own value", "a"), ("own value", "b"), ("own value", "c")
    ]  # fmt: skip
    mean, spread = found[:2]
    assert mean["q2.5"] < 0.0575 < mean["q97.5"]
    assert spread["q2.5"] > 0.002
    assert "only 3" in mean["outcome"]
    assert mean["prior_scale"] == pytest.approx(
        LOCATION_SCALE * max(r["mean"] for r in rows(run, record="") if r["parameter"] == "zeta"), rel=1e-6
    )
    assert {r["over"] for r in read_table(run / "population.csv")} == {
        "repeats of a", "repeats of b", "specimens"
    }  # fmt: skip
