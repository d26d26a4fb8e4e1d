"""Does the answer warn where no law fits? The scoring, and the table that ships.

`make reports ARGS=misfit` makes the table; reports/misfit/README.md says what is in it.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest
from scipy.stats import binom

from validation.misfit.cases import INSIDE
from validation.misfit.scoring import page
from validation.rows import read_rows
from validation.scoring import named

TABLE = Path(__file__).resolve().parents[2] / "reports" / "misfit" / "scored.csv"
BAR = 0.05
"""At most this share of all records may be named a wrong damping outright."""


def test_the_page_counts_what_is_wrong_and_unwarned():
    made = [("clean", 1, 1), ("cubic", 1, 0), ("cubic", 0, 0)]
    said = page(pd.DataFrame(made, columns=["group", "decided", "right"]).assign(outcome="ok"))
    assert "in 1 of 2 (" in said
    assert "named outright in 1 of 1 (" in said
    assert "| cubic | 2 | 2 | 0 of 2 (0.00–0.66) | 1 of 2 (0.09–0.91) |" in said


def too_many(wrong: int, count: int) -> bool:
    """Whether so many wrong ones would be, under the bar, a chance of one in a thousand."""
    return binom.sf(wrong - 1, count, BAR) < 1e-3


@pytest.mark.slow
def test_wrong_and_unwarned_is_rare():
    rows = read_rows(TABLE)
    for part in (rows, rows[rows["group"].isin(INSIDE)]):
        assert len(part) >= 20
        assert not too_many(named(part, right=0), len(part))
        assert too_many(len(part) // 3, len(part))  # the control
