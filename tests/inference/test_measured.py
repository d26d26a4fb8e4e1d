"""The paper's rig: correlated residuals decide, and the table of the notes comes out."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.fit.search import find_mode
from bayesdamp.inference.model.target import Target, build_target
from bayesdamp.records.oscillation.features import features
from bayesdamp.records.read import read_record
from bayesdamp.types import Reference, Seed, Signal, System

FILE = Path(__file__).resolve().parents[2] / ".." / "shared" / "data" / "horizontal_pendulum" / "80P.txt"
FIRST, COUNT = 100, 5000
FREE = ("stiffness", "gravity", "spring_angle", "theta0", "omega0", "noise_sd", "noise_time")

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not FILE.exists(), reason="the measured decays are not here"),
]


@lru_cache
def signal() -> Signal:
    """Samples 100 to 5,099, as they were recorded, on a clock of the mean step."""
    raw = read_record(FILE, time="Time_Elapsed(s)", value="Angle(deg)")
    stamps = np.asarray(raw.t, float)
    step = (stamps[-1] - stamps[0]) / (stamps.size - 1)
    return Signal(step * np.arange(COUNT), np.radians(raw.y[FIRST : FIRST + COUNT]), name="80P")


@lru_cache
def fitted(*damping: str) -> tuple[Target, Mode]:
    record = signal()
    result = features(record)
    system = System("horizontal_pendulum", {"epsilon": 0.05}, dict.fromkeys(FREE))
    reference = Reference(result.amplitude, result.frequency)
    target = build_target(record, damping, system, result, reference, noise="correlated")
    start = target.oscillator.law.start(result.frequency, result.rest, {})
    seed = {**start, "zeta": 0.1, "mu_c": 0.2, "theta0": float(record.y[0]), "omega0": 0.0}
    # Gravity of either sign, so that the answer is not in the start.
    half = 0.5 * result.frequency**2
    up, down = (
        {**seed, **target.oscillator.law.start(result.frequency, result.rest, {"gravity": g})}
        for g in (half, -half)
    )
    return target, find_mode(
        target, {Seed("none"): seed, Seed("up"): up, Seed("down"): down}, noise_level=result.roughness
    )


def log_likelihood(*damping: str) -> float:
    _, mode = fitted(*damping)
    return mode.likelihood.log_likelihood(mode.z)


def test_viscous_and_coulomb_beat_viscous():
    """The notes: 29,362 against 28,560."""
    assert log_likelihood("viscous", "coulomb") == pytest.approx(29362, abs=30)
    assert log_likelihood("viscous", "coulomb") - log_likelihood("viscous") == pytest.approx(802, abs=30)


def test_values_of_the_notes():
    """ρ 0.940, ζ 0.1292 ± 0.0005, μ_c 0.134 ± 0.003 within three of their sds; gravity minus half the stiffness."""
    target, mode = fitted("viscous", "coulomb")
    p = {n: float(v) for n, v in target.values(mode.z).items()}
    step = float(target.signal.t[1])
    assert np.exp(-step / p["noise_time"]) == pytest.approx(0.94, abs=0.005)
    assert p["zeta"] == pytest.approx(0.1292, abs=3 * 0.0005)
    assert p["mu_c"] == pytest.approx(0.134, abs=3 * 0.003)
    assert -0.6 < p["gravity"] / p["stiffness"] < -0.4
    assert p["stiffness"] == pytest.approx(491, rel=0.05)


def test_sds_of_the_notes():
    target, mode = fitted("viscous", "coulomb")
    covariance = np.linalg.inv(mode.information)
    for name, sd in (("zeta", 0.0005), ("mu_c", 0.003)):
        i = target.names.index(name)
        result = float(np.sqrt(covariance[i, i])) * float(target.priors[name].rate(1.0))
        assert result == pytest.approx(sd, rel=0.35)


def test_viscous_alone_is_more_correlated():
    target, mode = fitted("viscous")
    p = {n: float(v) for n, v in target.values(mode.z).items()}
    assert np.exp(-float(target.signal.t[1]) / p["noise_time"]) == pytest.approx(0.989, abs=0.003)
    assert p["zeta"] == pytest.approx(0.1534, abs=0.001)


def test_residual():
    """At most 0.13° (the notes: 0.115° where the noise is white)."""
    _, mode = fitted("viscous", "coulomb")
    r = mode.likelihood.residual(mode.z)
    assert np.degrees(np.sqrt(np.mean(r**2))) < 0.13
