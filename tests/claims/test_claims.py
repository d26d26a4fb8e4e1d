"""The paper's claims: judgements and the page."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from bayesdamp.claims import CLAIMS
from bayesdamp.claims.judge import Claim, Judgement, Runs, page_of_verdicts, verdict_of
from bayesdamp.claims.paper import (
    PRINTED_TIMES,
    _best_clean,
    _nonlinearity_is_the_cause,
    _regression_is_accurate,
    _topological_fails,
)
from bayesdamp.report.results.estimators import EstimatorComparison

NONE = Runs()


def test_every_claim_occurs_once_and_has_its_place_in_the_paper():
    assert len({c.text for c in CLAIMS}) == len(CLAIMS) > 30
    assert all(c.where for c in CLAIMS)


def test_the_failure_of_the_topological_method_is_a_wrong_unit():
    """The error is 77.67 % on the pendulum, as printed, and on a linear spring too: 1 − 1/ω_n."""
    assert _topological_fails(NONE).verdict == "does not hold"
    assert _nonlinearity_is_the_cause(NONE).verdict == "does not hold"
    assert "is 77.67 % on the pendulum and 77.6" in _nonlinearity_is_the_cause(NONE).measured


def test_a_claim_about_a_missing_run_cannot_be_judged():
    of_runs = [c for c in CLAIMS if c.where == "Table 3"]
    assert {c.judge(NONE).verdict for c in of_runs} == {"cannot be judged"}


def test_a_time_is_judged_against_the_printed_range():
    cases = [
        (90.0, "pinn", "holds"),
        (30.0, "pinn", "holds"),
        (130.0, "pinn", "does not hold"),
        (1.5, "koopman", "better than claimed"),
        (0.01, "sindy", "holds"),
        (float("nan"), "sindy", "cannot be judged"),
    ]
    for own, method, verdict in cases:
        assert verdict_of(own, *PRINTED_TIMES[method][1:]) == verdict


def test_an_error_far_below_the_printed_one_does_not_confirm_it():
    assert _regression_is_accurate(NONE).verdict == "better than claimed"


def test_the_page_counts_judgements_and_escapes_bars():
    claims = [
        Claim("a | b", "1", lambda _: Judgement("holds", "x")),
        Claim("c", "2", lambda _: Judgement("does not hold", "y")),
    ]
    page = page_of_verdicts(claims, NONE)
    assert "holds 1, does not hold 1." in page
    assert "a \\| b" in page
    assert "**does not hold**" in page


@pytest.mark.parametrize(
    ("error", "seconds", "expected"),
    [
        (0.001, 0.1, "holds"),
        (0.001, 3.0, "holds in part"),
        (0.1, 0.1, "holds in part"),
        (0.1, 3.0, "does not hold"),
    ],
)
def test_least_squares_must_be_the_fastest_and_accurate(error: float, seconds: float, expected: str) -> None:
    """The other method takes 1 s for an error of 0.05 %; the fastest one has no estimate, so it does not count."""
    methods = ["least_squares", "sindy", "envelope"]
    errors = pd.DataFrame({("a", "initial"): [error, 0.05, np.nan]}, methods)
    errors = errors.rename_axis(columns=["signal", "stage"])
    times = pd.DataFrame({"initial": [seconds, 1.0, 0.01]}, methods)
    compared = EstimatorComparison(errors, set(), times, pd.DataFrame(), {})
    judgement = _best_clean(SimpleNamespace(compared=compared))
    assert judgement.verdict == expected
    assert ("the fastest is least squares" in judgement.measured) == (seconds < 1)
