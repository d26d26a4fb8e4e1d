"""Evidence of three runs of one damper against quadrature that uses nothing of the package."""

from __future__ import annotations

import json
from functools import lru_cache

import numpy as np
import pytest

from bayesdamp.inference.deviation.quick import weighing_of
from bayesdamp.inference.deviation.repeats import RunLikelihood, joined
from bayesdamp.inference.deviation.specimen import damping_run
from bayesdamp.inference.model.target import damping_priors
from bayesdamp.types import Reference, Signal
from tests.inference.problems import REFERENCES


@lru_cache
def reference() -> dict:
    return json.loads((REFERENCES / "repeats.json").read_text())


@lru_cache
def runs(damping: str) -> tuple[list[RunLikelihood], list[float], Reference]:
    """Each run's likelihood of its damping, and its own log evidence."""
    problem, records = reference()["problem"], reference()["records"]
    scale = Reference(problem["amplitude"], problem["omega"])
    known = {
        "stiffness": problem["omega"] ** 2, "rest_angle": 0.0, "theta0": problem["amplitude"], "omega0": 0.0,
        "epsilon": 0.0, "noise_sd": problem["noise_sd"],
    }  # fmt: skip
    found, logs = [], []
    for y in records["y"]:
        weighing = weighing_of(
            Signal(np.array(records["t"]), np.array(y)), damping=[damping], restoring=["linear"], known=known,
            reference=scale, approximate=False,
        )  # fmt: skip
        result = weighing.results[0]
        run = damping_run(result, np.array([0.2, 0.1]))
        assert run is not None
        found.append(run)
        logs.append(result.exact_weighed.log_evidence)
    return found, logs, scale


@pytest.mark.parametrize("damping", ["viscous", "viscous+coulomb"])
def test_joint_evidence_is_that_of_quadrature(damping: str) -> None:
    """They agree within the effect of motions that are not linear in the damping.

    Control: the product of the runs' own evidences, which are right by themselves, differs.
    """
    wanted = reference()["sums"][damping]
    likelihoods, logs, scale = runs(damping)
    assert logs == pytest.approx([wanted[f"run {j}"] for j in (1, 2, 3)], abs=0.05)
    priors = damping_priors(damping.split("+"), scale)
    found = joined(likelihoods, priors, np.zeros(1))
    assert found.log_evidence == pytest.approx(wanted["together"], abs=0.05)
    assert abs(sum(logs) - wanted["together"]) > 1.0
