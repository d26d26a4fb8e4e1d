"""The report on records that no law fits: its scoring, and the share of wrong answers in the shipped table.

`make reports ARGS=misfit` computes the table; reports/misfit/README.md describes it.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binom

from validation.reports.misfit import INSIDE, draw_case, page
from validation.scoring import named, read_rows

TABLE = Path(__file__).resolve().parents[3] / "reports" / "misfit" / "scored.csv"
BAR = 0.05
"""Largest share of records that may have a wrong damping as a decided answer."""


def test_the_page_counts_wrong_answers_without_a_warning():
    rows = [("coarse", 1, 1), ("cubic", 1, 0), ("cubic", 0, 0)]
    text = page(pd.DataFrame(rows, columns=["group", "decided", "right"]).assign(outcome="ok"))
    assert "in 1 of 2 (" in text
    assert "named outright in 1 of 1 (" in text
    assert "| cubic | 2 | 2 | 0 of 2 (0.00–0.66) | 1 of 2 (0.09–0.91) |" in text


def test_a_case_is_determined_by_its_seed_and_has_its_disturbance():
    case, again, other = (draw_case("clipped", number, 5) for number in (0, 0, 1))
    assert np.array_equal(case.signal.y, again.signal.y)
    assert not np.array_equal(case.signal.y[:50], other.signal.y[:50])
    assert np.sum(case.signal.y == case.signal.y.max()) > 10


def too_many(wrong: int, count: int) -> bool:
    """Return whether so many wrong answers have a probability below 1e-3 if their share is BAR."""
    return binom.sf(wrong - 1, count, BAR) < 1e-3


@pytest.mark.slow
def test_wrong_answers_without_a_warning_are_rare():
    rows = read_rows(TABLE)
    for part in (rows, rows[rows["group"].isin(INSIDE)]):
        assert len(part) >= 20
        assert not too_many(named(part, right=0), len(part))
        assert too_many(len(part) // 3, len(part))  # the control
