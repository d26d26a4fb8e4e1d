"""Scores of rows that were made by hand."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from validation.contest.rows import COLUMNS
from validation.contest.scoring import (
    coverage,
    holds_more,
    paired,
)


def row(
    record: str, peer: str, error: float, *, half: float = 0.0, outcome: str = "ok", **more: object
) -> dict:
    """A row whose ratio is 0.01 and whose answer is off by a relative error, with a relative half width."""
    made: dict[str, object] = dict.fromkeys(COLUMNS, np.nan) | {
        "record": record, "group": record.split("-")[0], "kind": "family", "damping": "viscous", "restoring": "linear",
        "peer": peer, "outcome": outcome, "seconds": 0.5, "named": "", "relation": "",
    }  # fmt: skip
    for i in (1, 2, 3):
        made |= {f"amplitude_{i}": 1.0 / i, f"ratio_{i}": 0.01}
        if outcome == "ok":
            value = 0.01 * (1 + error)
            made[f"value_{i}"] = value
            if half:
                made |= {f"low_{i}": value - 0.01 * half, f"high_{i}": value + 0.01 * half}
    return made | more


def table(*rows: dict) -> pd.DataFrame:
    return pd.DataFrame(list(rows), columns=list(COLUMNS))


def test_coverage_counts_only_stated_intervals():
    made = table(
        row("family-1-0", "a", 0.1, half=0.2), row("family-1-1", "a", 0.1, half=0.05), row("family-1-2", "a", 0.0)
    )  # fmt: skip
    held, stated = coverage(made)
    assert (held.value, stated) == (0.5, 2)
    assert held.low < 0.5 < held.high


def test_a_peer_is_beside_ours_on_the_records_of_both():
    made = [row(f"family-1-{i}", "ours", 0.01 * (1 + i)) for i in range(20)]
    made += [row(f"family-1-{i}", "half", 0.005 * (1 + i)) for i in range(20)]
    made += [row(f"family-1-{i}", "few", 9.0, outcome="ok" if i == 3 else "no") for i in range(20)]
    found, count = paired(table(*made), "half", "ours")
    assert count == 20
    assert (found.value, found.low, found.high) == pytest.approx((0.5, 0.5, 0.5))
    assert paired(table(*made), "few", "ours")[1] == 1
    assert paired(table(*made), "nobody", "ours")[1] == 0


def test_intervals_that_hold_the_truth_more_often():
    """Negative control: a record that one of them refused, or states no interval for, counts for neither."""
    made = [row(f"family-1-{i}", "ours", 0.1, half=0.2 if i < 15 else 0.05) for i in range(20)]
    made += [row(f"family-1-{i}", "peer", 0.1, half=0.2 if i < 5 else 0.05) for i in range(20)]
    found = holds_more(table(*made), "peer", "ours")
    assert found.value == pytest.approx(-0.5)
    assert found.low < found.value < found.high < 0
    made += [row("family-1-20", "ours", 0.0, half=0.1), row("family-1-20", "peer", 0.0, outcome="no")]
    made += [row("family-1-21", "ours", 0.0), row("family-1-21", "peer", 0.0, half=0.1)]
    assert holds_more(table(*made), "peer", "ours").value == found.value
