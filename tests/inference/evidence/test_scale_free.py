"""Bayes factors do not depend on how small the damping is, and sampled evidence is that of the linear model."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from bayesdamp.inference.deviation.candidate import exact_model
from bayesdamp.inference.deviation.compare import compare_signal
from bayesdamp.inference.deviation.linear import grid_of, linear_posterior
from bayesdamp.inference.evidence import EVIDENCES
from bayesdamp.inference.mode import find_mode
from bayesdamp.inference.model.target import build_target
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.priors import SHARED_SCALES
from bayesdamp.records.oscillation.features import features
from bayesdamp.records.simulate import simulate_signal
from bayesdamp.types import Reference, Signal, System

STIFFNESS, AMPLITUDE = 20.0, 0.3
FREQUENCY = STIFFNESS**0.5
KNOWN = {
    "stiffness": STIFFNESS, "rest_angle": 0.0, "theta0": AMPLITUDE, "omega0": 0.0,
    "epsilon": 0.02 * AMPLITUDE * FREQUENCY,
}  # fmt: skip
REFERENCE = Reference(AMPLITUDE, FREQUENCY)
SUMS = (("viscous",), ("coulomb",), ("viscous", "coulomb"))
NOISE = 0.003


@lru_cache
def record(factor: float) -> Signal:
    """Return a record whose damping and noise are both multiplied by a factor, with the same information."""
    truth, osc = {**KNOWN, "zeta": 0.04 * factor, "mu_c": 0.03 * factor}, Oscillator(SUMS[-1], "linear")
    noise = {"noise_sd": NOISE * factor, "rng": np.random.default_rng(3)}
    return simulate_signal(osc, truth, duration=8.0, samples=300, **noise)


@lru_cache
def sampled_evidence(damping: tuple[str, ...], factor: float, separate: bool = False) -> float:
    """Return the log evidence by importance sampling. separate: independent half-normal priors of scale 0.1."""
    signal = record(factor)
    system = System("linear", {**KNOWN, "noise_sd": NOISE * factor}, {})
    target = build_target(signal, damping, system, features(signal), REFERENCE)
    if separate:
        target = replace(target, scales=(1.0,) * SHARED_SCALES.size)
    mode = find_mode(target, [{"zeta": 0.04 * factor, "mu_c": 0.03 * factor}], noise_level=NOISE * factor)
    evidence = EVIDENCES.get("importance").evidence("m", target, mode, 1)
    assert evidence.outcome == "ok"
    assert evidence.stderr < 0.01
    return evidence.log_evidence


@pytest.mark.parametrize("factor", [1.0, 0.01])
def test_sampled_evidence_is_that_of_the_linear_model(factor) -> None:
    comparison = compare_signal(
        record(factor), damping=["+".join(s) for s in SUMS], restoring=["linear"], known=KNOWN,
        reference=REFERENCE, approximate=False,
    )  # fmt: skip
    grid = grid_of(0, exact=True)
    for item in comparison.results:
        linear = exact_model(item.fit)
        wanted = linear_posterior(linear, grid, (NOISE * factor) ** 2, linear.count).log_evidence
        assert sampled_evidence(item.candidate.damping, factor) == pytest.approx(wanted, abs=0.03)


def test_lighter_damping_leaves_bayes_factors_as_they_are() -> None:
    """A hundred and 10,000 times lighter, with the same information. The bounds are two standard errors, 0.01 nats for
    the sums over scales, and what the motion of the heaviest damping differs from a linear one (0.06 nats and more).
    Negative control: independent half-normals of scale 0.1."""

    def factors(size: float, separate: bool = False) -> np.ndarray:
        both = sampled_evidence(SUMS[-1], size, separate)
        return np.array([both - sampled_evidence(single, size, separate) for single in SUMS[:2]])

    heavy, light, lighter = factors(1.0), factors(0.01), factors(1e-4)
    assert light == pytest.approx(lighter, abs=0.1)
    assert heavy[0] == pytest.approx(light[0], abs=0.5)
    separate = factors(0.01, separate=True) - factors(1e-4, separate=True)
    assert separate == pytest.approx(np.log(100.0), abs=0.1)
