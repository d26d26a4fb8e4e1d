"""Likelihoods that an evidence costs at equal error: importance sampling, its mode search counted, against nested, and
dynesty beside importance sampling."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scipy.special import ndtri

from bayesdamp.inference.evidence import EVIDENCES, nested
from bayesdamp.inference.mode import Mode
from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.search import find_mode
from bayesdamp.types import Seed
from tests.benchmarks import test_samplers
from tests.benchmarks.ledger import ratio, table
from tests.inference import problems

RATIO = 10.0


def searched(target: Target, start: dict[str, float]) -> tuple[Mode, int]:
    """The mode, and likelihoods its search took; one with tangents counts as one for each tangent more."""
    count, real = [0], Likelihood.curvature

    def counting(likelihood: Likelihood, z: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        count[0] += 1 + target.moving.size
        return real(likelihood, z)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Likelihood, "curvature", counting)
        return find_mode(target, {Seed("start"): start}, noise_level=start["noise_sd"]), count[0]


def test_importance_takes_ten_times_fewer_likelihoods(monkeypatch: pytest.MonkeyPatch) -> None:
    truth, rows = problems.reference("viscous_coulomb")["truth"], []
    for name, target, start in (
        ("the paper's viscous pendulum", test_samplers.problem()[0], test_samplers.TRUTH),
        ("viscous + Coulomb", problems.target("viscous_coulomb"), {n: 1.1 * v for n, v in truth.items()}),
    ):
        at, search = searched(target, start)
        ours = EVIDENCES.get("importance").evidence("m", target, at, 1)
        monkeypatch.setattr(nested, "EFFECTIVE_DRAWS", ours.stderr**-2)
        monkeypatch.setattr(nested, "MAX_LIKELIHOODS", 10**7)
        theirs = EVIDENCES.get("nested").evidence("m", target, at, 1)
        taken = search + ours.evaluations
        ratio(f"likelihoods of an evidence, {name}: nested / ours", theirs.evaluations / taken)
        counts = [str(n) for n in (search, taken, theirs.evaluations)]
        errors = [f"{e.stderr:.4f}" for e in (ours, theirs)]
        rows.append([name, *counts, *errors, f"{theirs.evaluations / taken:.1f}"])
        assert theirs.evaluations > RATIO * taken
        assert theirs.stderr > 0.9 * ours.stderr
        assert abs(ours.log_evidence - theirs.log_evidence) < 5 * np.hypot(ours.stderr, theirs.stderr)
    header = ["record", "mode search", "importance", "nested", "its error", "nested's", "ratio"]
    table("Likelihoods for one evidence", header, rows)


def test_evidence_beside_dynesty() -> None:
    """Likelihoods for an evidence of equal error: those of dynesty times the square of the errors' ratio."""
    dynesty = pytest.importorskip("dynesty")
    posterior, mode = test_samplers.problem()
    mine = EVIDENCES.get("importance").evidence("m", posterior, mode, 1)
    sampler = dynesty.NestedSampler(
        mode.likelihood.log_likelihood,
        lambda u: ndtri(np.where(posterior.reflected, 0.5 * (1.0 + u), u)),
        mode.z.size,
        nlive=100,
        sample="rwalk",  # of a needle in the prior's box its ellipsoids alone hardly draw
        rstate=np.random.default_rng(1),
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of ellipsoids that are enlarged much
        sampler.run_nested(print_progress=False, dlogz=0.1)
    theirs = sampler.results
    log, error, count = float(theirs.logz[-1]), float(theirs.logzerr[-1]), int(np.sum(theirs.ncall))
    equal = count * (error / mine.stderr) ** 2
    ratio("likelihoods of an evidence: dynesty / ours, at equal error", equal / mine.evaluations)
    header = ["method", "log evidence", "error", "likelihoods", "at the first's error, by its square"]
    own = ["importance", f"{mine.log_evidence:.3f}", f"{mine.stderr:.4f}", *[str(mine.evaluations)] * 2]
    other = ["dynesty", f"{log:.3f}", f"{error:.4f}", str(count), f"{equal:.0f}"]
    table("An evidence beside dynesty (the mode's search not counted)", header, [own, other])
    assert abs(log - mine.log_evidence) < 4 * np.hypot(error, mine.stderr)
