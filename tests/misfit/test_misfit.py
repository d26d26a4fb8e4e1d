"""Does the verdict warn where no law fits? Over the table that is kept, and anew on a few of its cases.

`python -m tests.misfit.run reports/misfit/scored.csv --seed 8 ...` makes the table; reports/misfit/README.md says what
is in it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binomtest

from tests.misfit.cases import INSIDE, drawn
from tests.misfit.run import LAWS
from tests.misfit.scoring import FORMS, names_the_truth, read_rows, score, unwarned

TABLE = Path(__file__).resolve().parents[2] / "reports" / "misfit" / "scored.csv"
SEEN = 20.0
"""Nats by which the truth is ahead of the best candidate's fit, from which a test that does not know it should see."""

pytestmark = pytest.mark.slow


def rows() -> list[dict[str, str]]:
    return read_rows(TABLE)


def test_no_law_that_is_seen_to_be_wrong_goes_without_a_misfit() -> None:
    """Where that much is hidden, that the record leaves it open is no excuse."""
    silent = [r for r in rows() if r["warned"] in ("no", "beside") and r["wrong"] == "1"]
    assert not [r["case"] for r in silent if float(r["nats_hidden"]) > SEEN]


def test_no_wrong_law_goes_unwarned() -> None:
    """The bar, over 200 cases: a misfit is said, or that the record does not decide."""
    assert len(rows()) >= 200
    assert not [r["case"] for r in rows() if unwarned(r)]
    # The controls: a wrong one that is named outright would be found, and, but for the other forms of damping that are
    # set beside a candidate, there would be some.
    assert unwarned({"warned": "no", "wrong": "1"})
    assert [r["case"] for r in rows() if r["warned"] == "beside" and r["wrong"] == "1"]


@pytest.mark.parametrize(("table", "least"), [("sampled.csv", 200), ("all_laws.csv", 150)])
def test_no_wrong_law_goes_unwarned_with_samplers_or_under_all_restoring_laws(table: str, least: int) -> None:
    """Fewer cases under all laws: each has four times the candidates."""
    found = read_rows(TABLE.with_name(table))
    assert len(found) >= least
    assert not [r["case"] for r in found if unwarned(r)]
    assert [r["case"] for r in found if r["wrong"] == "1"]  # the control


def test_the_form_that_is_left_open_first_is_the_true_one_more_often_than_by_chance() -> None:
    """Five are tried: of the wrong ones that are left open, more than a fifth name the truth (1 % of false alarms)."""
    wrong = [r for r in rows() if r["warned"] == "beside" and r["wrong"] == "1" and r["kind"] in FORMS]
    assert binomtest(sum(map(names_the_truth, wrong)), len(wrong), 0.2, "greater").pvalue < 0.01


def test_sums_of_the_family_are_wrong_as_often_as_their_probabilities_say() -> None:
    """Among records of the family that are named, with or without a word on other forms, the wrong sums are no more
    than the shares that were given away allow: by the exact distribution of their number, a false alarm in 1,000."""
    named = [r for r in rows() if r["kind"] in INSIDE and r["warned"] in ("no", "beside")]
    given = [1.0 - float(r["damping_probability"]) for r in named]
    wrong = sum(r["relation"] != "right" for r in named)
    assert at_least(wrong, given) > 1e-3
    assert at_least(6, given) < 1e-3  # the control: so many would be too many


def at_least(count: int, chances: list[float]) -> float:
    """The chance of so many hits or more, each of its own chance."""
    found = np.array([1.0])
    for chance in chances:
        found = np.convolve(found, [1.0 - chance, chance])
    return float(found[count:].sum())


def test_good_records_are_hardly_ever_warned_of() -> None:
    """Clean ones, two cycles, 16 samples a cycle and gaps: at most three of twenty, or 15 % of more."""
    good = [r for r in rows() if r["kind"] in ("clean", "two_cycles", "coarse", "gaps")]
    assert sum(r["warned"] == "misfit" for r in good) <= max(3, 0.15 * len(good))


@pytest.mark.parametrize(("kind", "number"), [("clean", 0), ("two_cycles", 0), ("stiction", 1)])
def test_the_table_is_what_the_program_says(kind: str, number: int, tmp_path: Path) -> None:
    case = drawn(kind, number, 8)
    kept = next(r for r in rows() if r["case"] == case.name)
    found = score(case, LAWS, tmp_path)
    assert found["best"] == kept["best"]
    assert found["warned"] == kept["warned"]
    assert float(str(found["probability"])) == pytest.approx(float(kept["probability"]), abs=0.02)
