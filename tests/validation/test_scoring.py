"""Answers that are always right, always wrong, or too sure get the scores that they earn."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binomtest

from bayesdamp.types import Refusal, Signal
from bayesdamp.verdict.parts import Grade, Rival
from bayesdamp.verdict.types import Verdict
from tests.validation.answering import ratio_at
from validation.reports.deviation import page, row_of, scores
from validation.scoring import probability_of, relation, share
from validation.truth.oscillator import SUMS
from validation.truth.ratio import RatioCurve
from validation.truth.records import Case

AMPLITUDES = (0.3, 0.2, 0.1)


def a_case(number: int, kind: str = "family", oversample: int = 1) -> Case:
    size = np.geomspace(0.05, 0.5, 30)[::-1]
    signal = Signal(np.arange(3.0), np.zeros(3))
    return Case(
        f"{kind}-{number}", kind, signal, SUMS[number % 7], "linear", {}, 0.01,
        RatioCurve(np.arange(30.0), size, 0.02 + 0 * size), AMPLITUDES, {}, 20.0, 30.0, oversample,
    )  # fmt: skip


def said(
    case: Case,
    rng: np.random.Generator,
    right: bool = True,
    sure: float = 1.0,
    grade: Grade = Grade.EXACT,
    decided: bool = True,
) -> Verdict:
    """An answer whose intervals hold the truth with 95 % where sure = 1, and are narrower by that factor else."""
    sd = 0.001
    ratios = [
        ratio_at(a, case.ratio(a) + sd * rng.standard_normal(), 1.96 * sd / sure) for a in case.amplitudes
    ]
    named = case.damping if right else next(s for s in SUMS if s != case.damping)
    return Verdict(case.name, grade, decided, named, 0.98, damping_ratio=tuple(ratios))


def score(pairs: list[tuple[Case, Verdict]]) -> pd.Series:
    rows = [row_of(case, lambda signal, amplitudes, answer=answer: answer, "auto") for case, answer in pairs]
    return scores(pd.DataFrame(rows)).iloc[0]


def values(line: pd.Series, *shares: str) -> list[float]:
    return [line[name].value for name in shares]


def table_of(count: int = 200, **how) -> pd.Series:
    rng = np.random.default_rng(1)
    cases = [a_case(n) for n in range(count)]
    return score([(case, said(case, rng, **how)) for case in cases])


def test_an_honest_answer_is_right_and_covers() -> None:
    line = table_of()
    assert values(line, "decided", "right", "wrong", "deviates") == [1.0, 1.0, 0.0, 0.0]
    assert line["coverage"].low < 0.95 < line["coverage"].high  # false alarm: below 1 in 20, seed fixed
    assert line["log_probability"] == pytest.approx(np.log(0.98))
    assert line["half_width"] == pytest.approx(1.96 * 0.001 / 0.02)


def test_a_wrong_answer_is_wrong_outright() -> None:
    line = table_of(right=False)
    assert values(line, "decided", "right", "wrong") == [1.0, 0.0, 1.0]
    assert line["log_probability"] == pytest.approx(np.log(0.02 / 6))
    cautious = table_of(right=False, decided=False)
    assert values(cautious, "decided", "wrong") == [0.0, 0.0]
    assert np.isnan(cautious["right"].value)


def test_an_overconfident_answer_does_not_cover() -> None:
    """Intervals of a third of the width hold the truth with 1 − 2Φ(−1.96/3) = 0.486."""
    line = table_of(sure=3.0)
    assert line["coverage"].value == pytest.approx(0.486, abs=5 * 0.5 / np.sqrt(600))
    assert line["coverage"].high < 0.95


def test_grades_and_modes_are_told_apart() -> None:
    rng, rows = np.random.default_rng(2), []
    for mode, sure in (("none", 1.0), ("auto", 0.5)):
        for case in (a_case(n, kind) for n in range(20) for kind in ("family", "drift", "jitter")):
            answer = said(case, rng, sure=sure, grade=Grade.DEVIATES if case.kind == "drift" else Grade.EXACT)
            rows.append(row_of(case, lambda signal, amplitudes, answer=answer: answer, mode))
    table = scores(pd.DataFrame(rows)).set_index("group")
    deviates = table.loc[["drift/auto", "all discrepancies/auto"], "deviates"]
    assert [part.value for part in deviates] == [1.0, 0.5]
    assert table.loc[["family/none", "family/auto"], "relative_width"].tolist() == pytest.approx([1.0, 2.0])
    assert "| drift/auto | 20 | 20 | 1.00 (0.84–1.00) |" in page(pd.DataFrame(rows))


def test_a_refusal_decides_nothing_and_has_no_coverage() -> None:
    def refuses(signal: Signal, amplitudes: tuple[float, ...]) -> Verdict:
        raise Refusal("three samples in a period")

    rows = [row_of(a_case(n), refuses, "auto") for n in range(5)]
    assert rows[0]["outcome"] == "three samples in a period"
    nothing = Verdict("a", Grade.NOT_WEIGHED, False, "", float("nan"), sentence="not enough cycles")
    assert row_of(a_case(0), lambda signal, amplitudes: nothing, "auto")["outcome"] == "not enough cycles"
    rng = np.random.default_rng(3)
    rows += [
        row_of(a_case(n), lambda s, a, n=n: said(a_case(n), rng, sure=0.1), "auto") for n in range(5, 10)
    ]
    line = scores(pd.DataFrame(rows)).iloc[0]
    assert (line["records"], line["answered"]) == (10, 5)
    assert values(line, "decided", "coverage") == [0.5, 1.0]


def test_wilsons_interval_is_scipys() -> None:
    for hits, count in ((0, 10), (7, 10), (190, 200), (200, 200)):
        exact = binomtest(hits, count).proportion_ci(method="wilson")
        part = share(hits, count)
        assert (part.low, part.high) == pytest.approx((exact.low, exact.high), abs=1e-12)


def test_the_probability_of_the_truth_is_the_answers() -> None:
    answer = Verdict("a", Grade.EXACT, True, "coulomb+viscous", 0.7, (Rival("viscous", 0.2),))
    assert probability_of(answer, "viscous+coulomb") == 0.7
    assert probability_of(answer, "viscous") == 0.2
    assert probability_of(answer, "quadratic") == pytest.approx(0.1 / 5)
    assert [relation(n, "viscous+coulomb") for n in ("coulomb+viscous", "viscous", "quadratic", SUMS[6])] == [
        "right", "less", "other", "more",
    ]  # fmt: skip
