"""Nested sampling where laws may hold approximately: against a sum over the parameter, and importance sampling."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bayesdamp.inference.evidence import EVIDENCES, nested
from bayesdamp.inference.mode import Mode
from bayesdamp.types import Evidence
from tests.interface.test_chains import by_sum, without_deviations
from tests.interface.test_deviation import one_parameter


def evidence(method: str, mode: Mode) -> Evidence:
    return EVIDENCES.get(method).evidence("viscous", mode.likelihood.target, mode, 3)


@pytest.mark.parametrize("around", [pytest.param(False, marks=pytest.mark.slow), True])
def test_nested_sampling_against_a_sum(around: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Four standard errors and 0.002 nats. Control: a density without the deviations is five nats behind."""
    law = one_parameter().law
    if around:
        monkeypatch.setattr(nested, "LIKELIHOODS_PER_CHECK", 1)  # it asks at once
        monkeypatch.setattr(nested, "log_evidence_about", lambda _: -1e9)  # a billion nats to go
    found = evidence("nested", law.mode)
    assert found.outcome == "ok"
    assert ("around the mode" in found.diagnostic) is around
    assert abs(found.log_evidence - by_sum()[2]) < 4 * found.stderr + 0.002
    alone = replace(law.mode, likelihood=without_deviations(law.mode.likelihood))
    assert by_sum()[2] - evidence("nested", alone).log_evidence > 5
