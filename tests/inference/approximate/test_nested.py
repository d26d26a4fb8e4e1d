"""Nested sampling where laws may hold approximately: against a sum over the parameter, and importance sampling."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bayesdamp.inference.approximate import evidence
from bayesdamp.inference.approximate.evidence import by_importance, by_nested
from bayesdamp.inference.deviation.single import under
from bayesdamp.inference.evidence.methods import nested
from bayesdamp.priors import HalfNormal
from tests.interface.test_chains import by_sum, marginal, without_deviations
from tests.interface.test_deviation import fit, one_parameter


@pytest.mark.parametrize("around", [False, True], ids=["from the prior", "around the mode"])
def test_nested_sampling_against_a_sum(around: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Four standard errors and 0.002 nats. Control: a density without the deviations is five nats behind."""
    law = one_parameter().law
    assert law is not None
    if around:
        monkeypatch.setattr(nested, "LEG", 1)  # it asks at once
        monkeypatch.setattr(
            evidence, "linear", lambda *_: nested.Evidence("", "", -1e9)
        )  # a billion nats to go
    found = by_nested(law, "viscous", "nested", 3)
    assert found.outcome == "ok"
    assert ("around the mode" in found.diagnostic) is around
    assert abs(found.log_evidence - by_sum()[2]) < 4 * found.stderr + 0.002
    alone = without_deviations(marginal(one_parameter()))
    monkeypatch.setattr(evidence, "marginal_of", lambda *_: alone)
    assert by_sum()[2] - by_nested(law, "viscous", "nested", 3).log_evidence > 5


@pytest.mark.slow
def test_nested_sampling_of_more_parameters_against_importance() -> None:
    """Four standard errors. Control: under a prior twice as wide it is farther off."""
    law = fit().law
    assert law is not None
    assert len(law.names) > 3
    found, other = by_nested(law, "viscous", "nested", 3), by_importance(law, "viscous", "importance", 3)
    assert found.outcome == other.outcome == "ok"
    error = (found.stderr**2 + other.stderr**2) ** 0.5
    assert abs(found.log_evidence - other.log_evidence) < 4 * error
    priors = law.single.found.priors
    prior = priors["zeta"]
    assert isinstance(prior, HalfNormal)
    twice = {**priors, "zeta": HalfNormal(scale=2 * prior.scale)}
    wider = by_importance(replace(law, single=under(law.single, twice)), "viscous", "importance", 3)
    assert abs(found.log_evidence - wider.log_evidence) > 8 * error
