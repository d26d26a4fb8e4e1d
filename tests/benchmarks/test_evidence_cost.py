"""Likelihoods that an evidence costs at equal error: importance sampling, its mode search counted, against nested."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from bayesdamp.inference.evidence import EVIDENCES, nested
from bayesdamp.inference.mode import Mode
from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.search import find_mode
from bayesdamp.types import Seed
from tests.benchmarks import test_sampler
from tests.benchmarks.ledger import ratio
from tests.benchmarks.timing import table
from tests.inference import problems

RATIO = 10.0


def searched(target: Target, start: dict[str, float], level: float) -> tuple[Mode, int]:
    """The mode, and likelihoods its search took; one with tangents counts as one for each tangent more."""
    count, real = [0], Likelihood.curvature

    def counting(likelihood: Likelihood, z: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        count[0] += 1 + target.moving.size
        return real(likelihood, z)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Likelihood, "curvature", counting)
        at = find_mode(target, {Seed("start"): start}, noise_level=level)
    assert count[0]
    return at, count[0]


@lru_cache
def measured() -> dict[str, dict[str, float]]:
    viscous = test_sampler.problem()[0]
    friction = problems.target("viscous_coulomb")
    truth = problems.reference("viscous_coulomb")["truth"]
    found = {}
    for name, target, start, level in (
        ("the paper's viscous pendulum", viscous, test_sampler.TRUTH, 0.003),
        ("viscous + Coulomb", friction, {n: 1.1 * v for n, v in truth.items()}, truth["noise_sd"]),
    ):
        at, search = searched(target, start, level)
        ours = EVIDENCES.get("importance").evidence("m", target, at, 1)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(nested, "EFFECTIVE_DRAWS", ours.stderr**-2)
            patch.setattr(nested, "MAX_LIKELIHOODS", 10**7)
            other = EVIDENCES.get("nested").evidence("m", target, at, 1)
        found[name] = {
            "search": search,
            "importance": search + ours.evaluations,
            "nested": other.evaluations,
            "importance error": ours.stderr,
            "nested error": other.stderr,
            "apart": abs(ours.log_evidence - other.log_evidence) / np.hypot(ours.stderr, other.stderr),
        }
    return found


def test_importance_takes_ten_times_fewer_likelihoods():
    rows = []
    for name, m in measured().items():
        counts = [f"{m[k]:.0f}" for k in ("search", "importance", "nested")]
        errors = [f"{m[k]:.4f}" for k in ("importance error", "nested error")]
        ratio(f"likelihoods of an evidence, {name}: nested / ours", m["nested"] / m["importance"])
        rows.append([name, *counts, *errors, f"{m['nested'] / m['importance']:.1f}"])
    header = ["record", "mode search", "importance", "nested", "its error", "nested's", "ratio"]
    table("Likelihoods for one evidence", header, rows)
    for m in measured().values():
        assert m["nested"] > RATIO * m["importance"]
        assert m["nested error"] > 0.9 * m["importance error"]
        assert m["apart"] < 5
