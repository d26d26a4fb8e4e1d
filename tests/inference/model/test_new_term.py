"""A new damping term is one class: simulated, inferred, compared, with nothing else to write."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bayesdamp.inference.evidence import EVIDENCES
from bayesdamp.inference.fit.search import find_mode
from bayesdamp.inference.model.target import build_target
from bayesdamp.inference.samplers import SAMPLERS, Settings
from bayesdamp.physics.damping import TERMS, DampingTerm, parse_model
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.trajectories import simulate
from bayesdamp.records.oscillation.features import features
from bayesdamp.types import InputError, Reference, Seed, Signal, System
from tests.physics.independent import trajectory


class Cubic(DampingTerm):
    """F = μ₃ θ̇³."""

    name = "cubed"
    parameter = "mu_cubed"
    unit = "s/rad²"

    @staticmethod
    def kernel(x, v, epsilon):
        return v**3

    def ratio_per_unit(self, amplitude, frequency):
        return 3 / 8 * amplitude**2 * frequency


TRUTH = 0.08
P = {"mu_cubed": TRUTH, "stiffness": 20.0, "gravity": 1.0, "spring_angle": 0.0, "theta0": 0.3, "omega0": 0.0}
TIMES = np.linspace(0.0, 10.0, 400)


@pytest.fixture(scope="module", autouse=True)
def cubic():
    TERMS.add("cubed", Cubic())
    yield
    TERMS.remove("cubed")


def clean() -> np.ndarray:
    return trajectory("horizontal_pendulum", P, TIMES, force=lambda v, sign: TRUTH * v**3)[:, 0]


def test_simulated():
    osc = Oscillator(parse_model("cubed"), "horizontal_pendulum")
    assert osc.coefficients == ("mu_cubed",)
    assert np.max(np.abs(simulate(osc, P, TIMES) - clean())) < 1e-6


def test_ratio():
    """Energy lost in a cycle: μ₃ A⁴ω³ ∫sin⁴ = 3π/4 μ₃ A⁴ω³."""
    a, w = 0.3, 4.5
    phase = np.linspace(0, 2 * math.pi, 2001)[:-1]
    lost = a * w * np.mean(np.sin(phase) ** 4) * (a * w) ** 3 * 2 * math.pi / w
    assert Cubic().ratio_per_unit(a, w) == pytest.approx(lost / (2 * math.pi * w**2 * a**2))


def test_inferred():
    """The truth lies in the 99.9 % interval, and the evidence prefers the true term to the viscous one."""
    y = clean() + 0.003 * np.random.default_rng(2).standard_normal(TIMES.size)
    signal = Signal(TIMES, y, name="cubed")
    result = features(signal)
    known = {n: P[n] for n in ("stiffness", "gravity", "spring_angle", "theta0", "omega0")}
    system = System("horizontal_pendulum", known, {"noise_sd": None})
    reference = Reference(0.3, 4.5)
    log_evidence = {}
    for term, seed in (("cubed", {"mu_cubed": 0.05}), ("viscous", {"zeta": 0.05})):
        target = build_target(signal, (term,), system, result, reference)
        mode = find_mode(target, {Seed("s"): seed}, noise_level=result.roughness)
        evidence = EVIDENCES.get("importance").evidence(term, target, mode, 1)
        assert evidence.outcome == "ok"
        log_evidence[term] = evidence.log_evidence
        if term == "cubed":
            posterior = SAMPLERS.get("nuts").sample(target, mode, Settings(draws=500, warmup=300, seed=1))
            assert posterior.outcome == "ok"
            low, high = np.quantile(posterior.draws[..., 0], [0.0005, 0.9995])
            assert low < TRUTH < high
            assert high - low < 0.02
    assert log_evidence["cubed"] > log_evidence["viscous"] + 20


def test_forgotten_again():
    TERMS.remove("cubed")
    assert "cubed" not in TERMS.names()
    with pytest.raises(InputError, match="unknown damping term 'cubed'"):
        parse_model("cubed")
