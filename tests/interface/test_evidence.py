"""Evidence from draws against evidence from a fit."""

import bayesdamp as bd
from tests.interface.problems import fit, posterior


def test_evidence_from_draws_is_that_from_a_fit() -> None:
    """Bridge sampling from NUTS draws agrees with importance sampling within five joint errors: one false alarm in a
    million seeds."""
    own, other = bd.evidence(posterior(), "bridge"), bd.evidence(fit(), "importance")
    assert own.outcome == other.outcome == "ok"
    assert abs(own.log_evidence - other.log_evidence) < 5 * (own.stderr**2 + other.stderr**2) ** 0.5
