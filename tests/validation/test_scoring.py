"""Scores of answers that are always right, always wrong, or overconfident."""

from unittest.mock import Mock

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binomtest

from bayesdamp.types import Refusal
from bayesdamp.verdict.parts import DampingRatio, Grade, Rival
from bayesdamp.verdict.types import Verdict
from tests.validation.answering import a_case, peer_of, verdict_of
from validation.contest.page import paired
from validation.scoring import SCORES, coverage, errors, named, probability_of, row_of, score_table, share


def table_of(count: int = 200, **how) -> pd.DataFrame:
    rng = np.random.default_rng(1)
    return pd.DataFrame([row_of(case, peer_of(case, rng, **how)) for case in map(a_case, range(count))])


def test_intervals_of_right_answers_cover_the_truth_in_95_percent() -> None:
    rows = table_of()
    assert (named(rows), named(rows, right=1), named(rows, right=0)) == (200, 200, 0)
    part = coverage(rows)
    assert part.low < 0.95 < part.high  # false alarm: below 1 in 20, seed fixed
    assert SCORES["mean P(truth)"](rows) == "0.980 ± 0.000"
    assert SCORES["median half width"](rows) == "9.8 %"
    assert np.median(errors(rows)) == pytest.approx(0.6745 * 0.001 / 0.02, rel=5 * 1.2 / np.sqrt(600))


def test_a_wrong_answer_counts_only_if_it_is_decided() -> None:
    rows = table_of(right=False)
    assert (named(rows), named(rows, right=1), named(rows, right=0)) == (200, 0, 200)
    assert rows["true_probability"].to_numpy() == pytest.approx(0.02 / 6)
    cautious = table_of(right=False, decided=False)
    assert named(cautious) == 0
    assert SCORES["of these correctly"](cautious) == "–"


def test_an_overconfident_answer_does_not_cover() -> None:
    """Intervals of a third of the width contain the truth with probability 1 − 2Φ(−1.96/3) = 0.486."""
    part = coverage(table_of(sure=3.0))
    assert part.value == pytest.approx(0.486, abs=5 * 0.5 / np.sqrt(600))
    assert part.high < 0.95


def test_coverage_is_the_mean_over_records_that_have_intervals() -> None:
    """Of one record two of three intervals contain the truth, of another the only one does not, a third has none."""
    replies = (
        verdict_of([0.02] * 3, [0.01, 0.01, 0.03], [0.03, 0.03, 0.04]),
        verdict_of([0.03], [0.025], [0.04]),
        verdict_of([0.02] * 3),
    )
    rows = pd.DataFrame([row_of(a_case(i), lambda *_, r=r: r) for i, r in enumerate(replies)])
    assert coverage(rows).value == pytest.approx((2 / 3 + 0) / 2)
    assert np.isnan(coverage(rows.iloc[2:]).value)


def test_a_refusal_decides_nothing_and_has_no_coverage() -> None:
    refuses = Mock(side_effect=Refusal("three samples in a period"))
    rows = pd.concat([pd.DataFrame([row_of(a_case(n), refuses) for n in range(5)]), table_of(5, sure=0.1)])
    assert rows.iloc[0]["outcome"] == "three samples in a period"
    table = score_table({"all": rows}, "records", "answered", "named outright", "coverage")
    assert table.splitlines()[-1] == "| all | 10 | 5 | 5 of 10 (0.24–0.76) | 1.00 (0.57–1.00) |"


def test_errors_of_a_peer_are_compared_on_the_records_that_both_answer() -> None:
    def rows_of(error: float, count: int = 20) -> pd.DataFrame:
        replies = [verdict_of([0.02 * (1 + error * (1 + i))] * 3) for i in range(count)]
        return pd.DataFrame([row_of(a_case(i), lambda *_, r=r: r) for i, r in enumerate(replies)])

    ours = rows_of(0.01)
    assert paired(rows_of(0.005), ours) == "0.5 (0.5–0.5)"
    assert paired(rows_of(0.02, 5), ours) == "2 (2–2)"
    assert paired(rows_of(9.0, 1), ours) == "–"


def test_the_interval_of_a_share_is_wilsons_of_scipy() -> None:
    for hits, count in ((0, 10), (7, 10), (190, 200), (200, 200)):
        exact = binomtest(hits, count).proportion_ci(method="wilson")
        part = share(hits, count)
        assert (part.low, part.high) == pytest.approx((exact.low, exact.high), abs=1e-12)


def test_a_row_has_the_numbers_of_its_verdict() -> None:
    at, rivals = DampingRatio(0.2, "rad", 0.02, 0.0, 0.0, 0.01, 0.03), (Rival("viscous", 0.2),)
    verdict = Verdict("a", Grade.EXACT, True, "coulomb+viscous", 0.7, rivals, damping_ratio=(at,))
    assert probability_of(verdict, "viscous+coulomb") == 0.7
    assert probability_of(verdict, "viscous") == 0.2
    assert probability_of(verdict, "quadratic") == pytest.approx(0.1 / 5)
    row = row_of(a_case(3), lambda *_: verdict)
    assert (row["right"], row["decided"], row["amplitude_1"]) == (1, 1, 0.2)
    assert (row["low_1"], row["high_1"]) == (0.01, 0.03)
    nothing = Verdict("a", Grade.NOT_WEIGHED, False, "", float("nan"), sentence="not enough cycles")
    row = row_of(a_case(3), lambda *_: nothing)
    assert (row["outcome"], row["right"], row["decided"]) == ("not enough cycles", 0, 0)
