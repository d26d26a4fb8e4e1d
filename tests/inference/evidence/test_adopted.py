"""Which log evidence is used, and when nested sampling is needed."""

import math

import pytest

from bayesdamp.inference.evidence._method import choose_evidence, disagreement
from bayesdamp.types import Evidence


def of(method: str, value: float, stderr: float = 0.01, outcome: str = "ok") -> Evidence:
    return Evidence("m", method, value, stderr, "d", outcome=outcome)


def test_evidences_that_agree_are_averaged_by_their_errors():
    results = [of("importance", -3.0), of("bridge", -3.04)]
    assert disagreement(results) == ""
    evidence = choose_evidence(results)
    assert (evidence.method, evidence.outcome) == ("combined", "ok")
    assert (evidence.log_evidence, evidence.stderr) == pytest.approx((-3.02, 0.01 / math.sqrt(2)))
    weighted = choose_evidence([results[0], of("bridge", -3.03, 0.02)])
    assert weighted.log_evidence == pytest.approx((-12 - 3.03) / 5)


def test_nested_sampling_is_needed_from_three_standard_errors_on():
    apart = disagreement([of("importance", -3.0), of("bridge", -3.043)])
    assert apart.startswith("importance and bridge are 3.0")
    assert disagreement([of("importance", -3.0), of("bridge", -3.041)]) == ""


def test_nested_sampling_is_needed_if_a_diagnostic_is_poor():
    results = [of("importance", -3.0, outcome="not to be trusted"), of("bridge", -3.0)]
    assert disagreement(results) == "the result of importance is unreliable"
    assert choose_evidence(results).diagnostic == "by bridge"
    assert choose_evidence([*results, of("nested", -2.9)]).log_evidence == -2.9


def test_nested_sampling_is_used_if_the_others_disagree():
    evidence = choose_evidence([of("importance", -3.0), of("bridge", -3.5), of("nested", -3.4, 0.02)])
    assert (evidence.log_evidence, evidence.stderr, evidence.outcome) == (-3.4, 0.02, "ok")
    words = "by nested sampling, because importance and bridge are 35.4 standard errors"
    assert evidence.diagnostic.startswith(words)


def test_a_disagreement_is_not_settled_without_nested_sampling():
    for more in ([], [of("nested", -3.4, outcome="not to be trusted: not finished")]):
        evidence = choose_evidence([of("importance", -3.0), of("bridge", -3.5), *more])
        assert evidence.outcome.startswith("not settled: importance and bridge are")
    poor = [of(method, -3.0, outcome="not to be trusted") for method in ("importance", "bridge")]
    assert choose_evidence(poor).outcome == "not settled: the result of importance and bridge is unreliable"


def test_an_evidence_that_is_not_finite_is_not_ok():
    none = choose_evidence([of("importance", math.nan, math.nan), of("bridge", -math.inf)])
    assert none.outcome == "the evidence is not finite"
    for broken in (of("importance", math.nan), of("nested", math.nan)):
        assert choose_evidence([broken, of("bridge", -3.0)]).log_evidence == -3.0
