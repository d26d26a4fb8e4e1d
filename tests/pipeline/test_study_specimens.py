"""Several records in one study: joint fits of repeats, and the population of specimens."""

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
    """Run the study once; tests must not change its folder."""
    folder = tmp_path_factory.mktemp("many")
    assert run_study(load_study(write(folder)), folder / "out", workers=1) == 0
    return folder / "out"


def test_records_that_differ_are_told_from_records_that_agree(run):
    a, b = (JointContent.of(Store(run).read(f"joint/{specimen}")) for specimen in "ab")
    assert (a.differ, b.differ) == (False, True)
    assert a.no_spread > 0
    assert b.no_spread < -20


def test_the_population_has_a_row_for_mean_spread_and_each_specimen(run):
    population = read_table(run / "population.csv")
    assert {r["over"] for r in population} == {"repeats of a", "repeats of b", "specimens"}
    mean, spread, *own = (r for r in population if r["over"] == "specimens")
    assert (mean["what"], spread["what"]) == ("mean", "spread")
    assert [(r["what"], r["of"]) for r in own] == [("own value", specimen) for specimen in "abc"]
    assert mean["q2.5"] < 0.0575 < mean["q97.5"]
    assert spread["q2.5"] > 0.002
    assert "only 3" in mean["outcome"]
    specimens = [
        r for r in read_table(run / "specimens.csv") if (r["record"], r["parameter"]) == ("", "zeta")
    ]
    assert mean["prior_scale"] == pytest.approx(LOCATION_SCALE * max(r["mean"] for r in specimens), rel=1e-6)
