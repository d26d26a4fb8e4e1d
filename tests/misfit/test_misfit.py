"""Does the verdict warn where no law fits? Over the table that is kept, and anew on a few of its cases.

`python -m tests.misfit.run reports/misfit/scored.csv --seed 2 ...` makes the table; reports/misfit/README.md says what
is in it.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.misfit.cases import INSIDE, drawn
from tests.misfit.run import LAWS
from tests.misfit.scoring import LIMIT, read_rows, score

TABLE = Path(__file__).resolve().parents[2] / "reports" / "misfit" / "scored.csv"
SEEN = 20.0
"""Nats by which the truth is ahead of the best candidate's fit, from which a test that does not know it should see."""

pytestmark = pytest.mark.slow


def rows() -> list[dict[str, str]]:
    return read_rows(TABLE)


def unwarned(row: dict[str, str]) -> bool:
    """Whether a wrong law has a probability above the limit and nothing was said."""
    return row["warned"] == "no" and row["wrong"] == "1" and float(row["damping_probability"]) > LIMIT


def test_no_law_that_is_seen_to_be_wrong_goes_unwarned() -> None:
    assert rows()
    assert not [r["case"] for r in rows() if unwarned(r) and float(r["nats_hidden"]) > SEEN]


@pytest.mark.xfail(
    strict=True,
    reason="fewer than 200 cases so far; of those outside the family some are within the noise of it",
)
def test_no_wrong_law_at_all_goes_unwarned() -> None:
    """The bar itself, over 200 cases."""
    assert len(rows()) >= 200
    assert not [r["case"] for r in rows() if unwarned(r)]


def test_no_wrong_law_of_the_family_goes_unwarned() -> None:
    """Neither another law nor one that misses a term; a reservation about the priors' width is a warning."""
    assert sum(r["kind"] in INSIDE for r in rows()) >= 40
    assert not [r["case"] for r in rows() if r["kind"] in INSIDE and unwarned(r)]


def test_good_records_are_hardly_ever_warned_of() -> None:
    """Clean ones, two cycles, 16 samples a cycle and gaps: at most three of twenty, or 15 % of more."""
    good = [r for r in rows() if r["kind"] in ("clean", "two_cycles", "coarse", "gaps")]
    assert sum(r["warned"] == "misfit" for r in good) <= max(3, 0.15 * len(good))


@pytest.mark.parametrize(("kind", "number"), [("clean", 0), ("two_cycles", 0)])
def test_the_table_is_what_the_program_says(kind: str, number: int, tmp_path: Path) -> None:
    case = drawn(kind, number, 2)
    kept = next(r for r in rows() if r["case"] == case.name)
    found = score(case, LAWS, tmp_path)
    assert found["best"] == kept["best"]
    assert found["warned"] == kept["warned"]
    assert float(str(found["probability"])) == pytest.approx(float(kept["probability"]), abs=0.02)
