"""Which log evidence counts, and when nested sampling is called."""

from __future__ import annotations

import math

import pytest

from bayesdamp.inference.evidence.referee import counted, quarrel
from bayesdamp.types import Evidence


def of(method: str, value: float, stderr: float = 0.01, outcome: str = "ok") -> Evidence:
    return Evidence("m", method, value, stderr, "d", outcome=outcome)


def test_agreement_needs_no_referee():
    found = [of("importance", -3.0), of("bridge", -3.04)]
    assert quarrel(found) == ""
    one = counted(found)
    assert (one.method, one.outcome, one.diagnostic) == ("combined", "ok", "importance and bridge agree")
    assert one.log_evidence == pytest.approx(-3.02)
    assert one.stderr == pytest.approx(0.01 / math.sqrt(2))


def test_the_mean_is_by_inverse_variance():
    one = counted([of("importance", -3.0, 0.01), of("bridge", -3.03, 0.02)])
    assert one.log_evidence == pytest.approx((-3.0 * 4 - 3.03) / 5)


def test_three_standard_errors_call_it():
    assert quarrel([of("importance", -3.0), of("bridge", -3.043)]).startswith("importance and bridge are 3.0")
    assert quarrel([of("importance", -3.0), of("bridge", -3.041)]) == ""


def test_a_poor_diagnostic_calls_it():
    found = [of("importance", -3.0, outcome="not to be trusted"), of("bridge", -3.0)]
    assert quarrel(found) == "the diagnostic of importance is poor"
    assert counted(found).diagnostic == "by bridge"
    assert counted([*found, of("nested", -2.9)]).log_evidence == -2.9


def test_the_referee_counts_and_says_why():
    one = counted([of("importance", -3.0), of("bridge", -3.5), of("nested", -3.4, 0.02)])
    assert (one.log_evidence, one.stderr, one.outcome) == (-3.4, 0.02, "ok")
    assert one.diagnostic.startswith("nested sampling counts: importance and bridge are 35.4 standard errors")


def test_without_a_referee_a_quarrel_is_not_settled():
    for more in ([], [of("nested", -3.4, outcome="not to be trusted: not finished")]):
        one = counted([of("importance", -3.0), of("bridge", -3.5), *more])
        assert one.outcome.startswith("not settled: importance and bridge are")
    poor = [
        of("importance", -3.0, outcome="not to be trusted"),
        of("bridge", -3.1, outcome="not to be trusted"),
    ]
    assert counted(poor).outcome == "not settled: the diagnostic of importance and bridge is poor"


def test_where_there_is_no_posterior_the_sentence_stays():
    none = Evidence("m", "importance", outcome="not applicable: no noise")
    assert counted([none]).outcome == "not applicable: no noise"
    assert math.isnan(counted([none]).log_evidence)
