"""A record of very light damping, weighed under the default prior: against quadrature that uses nothing of the package.

The reference integrates the scale that the coefficients share continuously; the package sums over 25 scales, which
differs by less than 0.02 nats.
"""

from __future__ import annotations

import json
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from bayesdamp.inference.evidence import EVIDENCES, Draws
from bayesdamp.inference.evidence.sensitivity import savage_dickey
from bayesdamp.inference.fit.mode import Mode, log_evidence_near
from bayesdamp.inference.fit.search import find_mode
from bayesdamp.inference.model.target import Target, build_target
from bayesdamp.inference.samplers import SAMPLERS, Settings
from bayesdamp.priors import SHARED_SCALES
from bayesdamp.records.oscillation.features import features
from bayesdamp.types import Posterior, Reference, Seed, Signal, System
from tests.inference.problems import REFERENCES

BOTH = ("viscous", "coulomb")
SUMS = (("viscous",), ("coulomb",), BOTH)
CLOSE = 0.03
"""Nats: the error of the sum over scales, and three standard errors of the methods."""


@lru_cache
def reference() -> dict:
    return json.loads((REFERENCES / "light.json").read_text())


@lru_cache
def problem(damping: tuple[str, ...], separate: bool = False) -> tuple[Target, Mode]:
    """The target of a sum of terms, and its mode; separate: half-normal priors of scale 0.1, each by
    itself, as a control."""
    given = reference()
    built = given["problem"]
    signal = Signal(np.array(given["record"]["t"]), np.array(given["record"]["y"]))
    known = {
        "stiffness": built["omega"] ** 2, "rest_angle": 0.0, "theta0": built["amplitude"], "omega0": 0.0,
        "epsilon": 0.0, "noise_sd": built["noise_sd"],
    }  # fmt: skip
    system = System("linear", known, {})
    scale = Reference(built["amplitude"], built["omega"])
    target = build_target(signal, damping, system, features(signal), scale)
    if separate:
        target = replace(target, scales=(1.0,) * SHARED_SCALES.size)
    start = {Seed("near the truth"): {n: 1.1 * v for n, v in given["truth"].items()}}
    return target, find_mode(target, start, noise_level=built["noise_sd"])


@lru_cache
def posterior() -> Posterior:
    target, mode = problem(BOTH)
    return SAMPLERS.get("nuts").sample(target, mode, Settings(draws=1000, seed=3))


def exact(damping: tuple[str, ...]) -> float:
    return reference()["sums"]["+".join(damping)]["log_evidence"]


def test_importance_and_laplace_against_quadrature() -> None:
    for damping in SUMS:
        target, mode = problem(damping)
        evidence = EVIDENCES.get("importance").evidence("m", target, mode, 1)
        assert evidence.outcome == "ok"
        assert evidence.log_evidence == pytest.approx(exact(damping), abs=CLOSE)
        assert log_evidence_near(mode.likelihood, mode.z) == pytest.approx(exact(damping), abs=2 * CLOSE)


@pytest.mark.parametrize("method", ["bridge", pytest.param("nested", marks=pytest.mark.slow)])
def test_other_methods_against_quadrature(method) -> None:
    target, mode = problem(BOTH)
    draws = Draws.of(target, posterior().draws)
    evidence = EVIDENCES.get(method).evidence("m", target, mode, 1, draws)
    assert evidence.outcome == "ok"
    assert evidence.log_evidence == pytest.approx(exact(BOTH), abs=CLOSE + 3 * evidence.stderr)


def test_independent_priors_of_a_fixed_scale_fail() -> None:
    """Negative control: with a scale of 0.1 for each term by itself, the second term costs several nats more."""
    logs = {}
    for damping in SUMS:
        target, mode = problem(damping, separate=True)
        logs[damping] = EVIDENCES.get("importance").evidence("m", target, mode, 1).log_evidence
    for single in SUMS[:2]:
        assert abs((logs[BOTH] - logs[single]) - (exact(BOTH) - exact(single))) > 3.0


def test_nuts_against_quadrature() -> None:
    """Means within five Monte Carlo errors, sds within 5 %."""
    result, wanted = posterior(), reference()["sums"]["viscous+coulomb"]
    assert result.outcome == "ok"
    for i, name in enumerate(result.names):
        draws, sd = result.draws[..., i], wanted["sd"][name]
        size = result.summaries[name]["ess_bulk"]
        assert draws.mean() == pytest.approx(wanted["mean"][name], abs=5 * sd / np.sqrt(size))
        assert draws.std() == pytest.approx(sd, rel=0.05)


def test_savage_dickey_with_a_shared_scale() -> None:
    """Within four standard errors of quadrature. Negative control: the plain ratio of posterior to prior density at
    zero, which takes the other coefficient's prior for that of the smaller model."""
    without, left = "mu_c", "viscous"
    target, _ = problem(BOTH)
    z = Draws.of(target, posterior().draws).z
    scores = dict(zip(target.names, np.moveaxis(z, -1, 0), strict=True))
    ratio = savage_dickey(target.priors, without, scores)
    wanted = exact((left,)) - exact(BOTH)
    assert ratio.outcome == "ok"
    assert ratio.stderr < 0.2
    assert ratio.log_bayes_factor == pytest.approx(wanted, abs=4 * ratio.stderr + CLOSE)
    alone = savage_dickey({without: target.priors[without]}, without, scores)
    assert abs(alone.log_bayes_factor - wanted) > 4 * ratio.stderr + CLOSE
