"""Evidence from draws against evidence from a fit."""

import math

import bayesdamp as bd
from tests.interface.problems import fit, posterior


def test_evidence_from_draws_is_that_from_a_fit() -> None:
    """Bridge sampling from NUTS draws agrees with importance sampling within five joint errors: one false alarm in a
    million seeds."""
    bridge, importance = bd.evidence(posterior(), "bridge"), bd.evidence(fit(), "importance")
    assert bridge.outcome == importance.outcome == "ok"
    assert abs(bridge.log_evidence - importance.log_evidence) < 5 * math.hypot(
        bridge.stderr, importance.stderr
    )
