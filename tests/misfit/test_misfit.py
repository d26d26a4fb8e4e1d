"""Does the answer warn where no law fits? The scoring, and the table that ships.

`make reports ARGS=misfit` makes the table; reports/misfit/README.md says what is in it.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pandas as pd
import pytest
from scipy.stats import binom

from bayesdamp.verdict.parts import Grade
from bayesdamp.verdict.types import Verdict
from validation.misfit.cases import INSIDE
from validation.misfit.scoring import OPEN, REFUSED, RIGHT, WRONG, outcome, page
from validation.rows import read_rows, where

TABLE = Path(__file__).resolve().parents[2] / "reports" / "misfit" / "scored.csv"
BAR = 0.05
"""At most this share of all records may be named a wrong damping outright."""
SAID = Verdict("a", Grade.APPROXIMATE, True, "viscous+coulomb", 0.97)


def test_what_comes_of_a_verdict():
    assert outcome(SAID, "coulomb+viscous") == RIGHT
    assert outcome(SAID, "viscous") == WRONG
    assert outcome(SAID, "cubic") == WRONG
    assert outcome(dataclasses.replace(SAID, decided=False), "viscous") == OPEN
    for grade in (Grade.NO_FREE_DECAY, Grade.NOT_WEIGHED):
        assert outcome(dataclasses.replace(SAID, grade=grade), "viscous") == REFUSED


def test_the_page_counts_what_is_wrong_and_unwarned():
    made = [("clean", RIGHT), ("cubic", WRONG), ("cubic", OPEN)]
    said = page(pd.DataFrame(made, columns=["kind", "outcome"]))
    assert "in 1 of 2 (" in said
    assert "named outright in 1 of 1 (" in said
    assert "| cubic | 2 | 0 | 1 | 0 | 1 |" in said


def too_many(wrong: int, count: int) -> bool:
    """Whether so many wrong ones would be, under the bar, a chance of one in a thousand."""
    return binom.sf(wrong - 1, count, BAR) < 1e-3


@pytest.mark.slow
def test_wrong_and_unwarned_is_rare():
    rows = read_rows(TABLE)
    for part in (rows, rows[rows["kind"].isin(INSIDE)]):
        assert len(part) >= 20
        assert not too_many(len(where(part, outcome=WRONG)), len(part))
        assert too_many(len(part) // 3, len(part))  # the control
