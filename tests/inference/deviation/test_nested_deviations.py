"""Nested sampling where laws may hold approximately: against a sum over the parameter, and importance sampling."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bayesdamp.inference.deviation.single import under
from bayesdamp.inference.evidence import EVIDENCES
from bayesdamp.inference.evidence.methods import nested
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.priors import LogNormal
from bayesdamp.types import Evidence
from tests.interface.test_chains import by_sum, without_deviations
from tests.interface.test_deviation import fit, one_parameter


def evidence(method: str, mode: Mode) -> Evidence:
    return EVIDENCES.get(method).evidence("viscous", mode.likelihood.target, mode, 3)


@pytest.mark.parametrize("around", [False, True], ids=["from the prior", "around the mode"])
def test_nested_sampling_against_a_sum(around: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Four standard errors and 0.002 nats. Control: a density without the deviations is five nats behind."""
    law = one_parameter().law
    assert law is not None
    if around:
        monkeypatch.setattr(nested, "LEG", 1)  # it asks at once
        monkeypatch.setattr(nested, "log_evidence_about", lambda _: -1e9)  # a billion nats to go
    found = evidence("nested", law.mode)
    assert found.outcome == "ok"
    assert ("around the mode" in found.diagnostic) is around
    assert abs(found.log_evidence - by_sum()[2]) < 4 * found.stderr + 0.002
    alone = replace(law.mode, likelihood=without_deviations(law.mode.likelihood))
    assert by_sum()[2] - evidence("nested", alone).log_evidence > 5


@pytest.mark.slow
def test_nested_sampling_of_more_parameters_against_importance() -> None:
    """Four standard errors. Control: under a prior twice as wide it is farther off."""
    law = fit().law
    assert law is not None
    assert len(law.names) > 3
    found, other = evidence("nested", law.mode), evidence("importance", law.mode)
    assert found.outcome == other.outcome == "ok"
    error = (found.stderr**2 + other.stderr**2) ** 0.5
    assert abs(found.log_evidence - other.log_evidence) < 4 * error
    priors = law.found.priors
    prior = priors["stiffness"]
    assert isinstance(prior, LogNormal)
    twice = {**priors, "stiffness": LogNormal(median=prior.median, sigma=2 * prior.sigma)}
    wider = evidence("importance", under(law, twice).mode)
    assert abs(found.log_evidence - wider.log_evidence) > 8 * error
