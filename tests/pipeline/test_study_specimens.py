"""Several records in one study: the verdicts on specimens, and the population of specimens."""

from pathlib import Path

import pytest

from bayesdamp.store.files import read_table
from bayesdamp.verdict.types import load_verdicts
from tests.pipeline.test_specimens import text_of
from tests.studies import finish_study

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """Run the study once; tests must not change its folder."""
    return finish_study(tmp_path_factory.mktemp("many"), text_of())


def test_records_that_differ_have_a_larger_spread_than_records_that_agree(run):
    a, b = load_verdicts(run / "verdict.json")[-2:]
    assert (a.record, b.record, a.records, b.records) == ("a", "b", 2, 2)
    assert a.spread.low < 0.01
    assert b.spread.low > 0.05
    ((zeta,), (other,)) = (a.coefficients, b.coefficients)
    assert (zeta.name, zeta.unit, other.name) == ("zeta", "1/s", "zeta")
    assert zeta.low < 0.05 < zeta.high
    assert other.low < 0.075 < other.high


def test_the_population_has_a_row_for_each_coefficient(run):
    (row,) = read_table(run / "population.csv")
    assert (row["model"], row["restoring"], row["parameter"]) == ("viscous", "linear", "zeta")
    assert (row["unit"], row["specimens"]) == ("1/s", 3)
    assert row["mean_low"] < 0.0575 < row["mean_high"]
    assert row["mean"] - row["mean_low"] == pytest.approx(row["mean_high"] - row["mean"])
    assert row["spread_low"] > 0.002
    page = (run / "report.html").read_text(encoding="utf-8")
    assert "Population of the specimens" in page
    assert "over the 3 specimens" in page
