"""The online filter against NUTS, against reference posteriors, and what it refuses."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.fit.search import find_mode
from bayesdamp.inference.model.target import Target, build_target
from bayesdamp.inference.samplers import SAMPLERS, Settings
from bayesdamp.inference.samplers.kalman import natural
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.trajectories import simulate
from bayesdamp.priors import HalfNormal, LogNormal
from bayesdamp.records.oscillation.features import features
from bayesdamp.types import Posterior, Reference, Refusal, Seed, Signal, System
from tests.inference import problems

SETTINGS = Settings(chains=4, warmup=300, draws=1000, seed=6)
FREE = ("stiffness", "theta0", "omega0")


@lru_cache
def problem() -> tuple[Target, Mode]:
    """A pendulum with 1 % of noise over eight periods; stiffness and start are inferred with the damping."""
    rng = np.random.default_rng(1)
    osc = Oscillator(("viscous",), "horizontal_pendulum")
    w, a = rng.uniform(3, 8), rng.uniform(0.2, 0.6)
    truth = {
        "stiffness": w**2,
        "gravity": rng.uniform(-0.3, 0.3) * w**2,
        "spring_angle": rng.uniform(-0.2, 0.2),
    }
    truth |= {"theta0": a, "omega0": rng.uniform(-0.3, 0.3) * a * w, "epsilon": 0.02 * a * w}
    truth["zeta"] = rng.uniform(0.005, 0.02) / osc.terms[0].ratio_per_unit(a, w)
    t = np.linspace(0.0, 16 * np.pi / w, 400)
    signal = Signal(t, simulate(osc, truth, t) + 0.01 * a * rng.standard_normal(t.size))
    observed = features(signal)
    known = {n: v for n, v in truth.items() if n not in (*FREE, *osc.coefficients)}
    system = System("horizontal_pendulum", known, dict.fromkeys((*FREE, "noise_sd")))
    target = build_target(
        signal, ("viscous",), system, observed, Reference(observed.amplitude, observed.frequency)
    )
    start = {n: 1.05 * v for n, v in truth.items()}
    return target, find_mode(target, {Seed("s"): start}, noise_level=observed.roughness)


@lru_cache
def filtered() -> Posterior:
    return SAMPLERS.get("kalman").sample(*problem(), SETTINGS)


def apart(posterior: Posterior, mean: float, sd: float, name: str) -> tuple[float, float]:
    """Difference of the means in sds, and the ratio of the sds."""
    x = posterior.draws[..., posterior.names.index(name)]
    return abs(float(x.mean()) - mean) / sd, float(x.std()) / sd


@pytest.mark.parametrize("name", ["viscous_coulomb", "touching_zero"])
def test_against_the_references(name):
    """Also where friction touches zero: means within 0.3 sd and sds within a quarter."""
    posterior = problems.posterior(name, "kalman")
    for parameter, s in problems.reference(name)["posterior"].items():
        away, ratio = apart(posterior, s["mean"], s["sd"], parameter)
        assert away < 0.3, parameter
        assert 0.75 < ratio < 1.25, parameter


def test_its_weights_against_the_posterior():
    """By importance weights the draws are worth nearly their number; those of a shifted answer are not."""
    posterior = filtered()
    assert posterior.diagnostics["pareto_k"] < 0.5  # type: ignore[operator]
    assert posterior.effective > 3000
    # Negative control: a quarter of the noise makes the same filter overconfident, and its weights say so.
    target, mode = problem()
    z = mode.z.copy()
    i = target.names.index("noise_sd")
    z[i] -= np.log(4.0) / target.priors["noise_sd"].sigma  # type: ignore[union-attr]
    wrong = SAMPLERS.get("kalman").sample(target, replace(mode, z=z), SETTINGS)
    assert wrong.outcome.startswith("a poor approximation")


def test_running_estimates():
    """They start at the prior and end at the posterior; later samples narrow the band, and it holds the end."""
    posterior = filtered()
    arrays = posterior.arrays
    i = posterior.running.index("zeta")
    mean, sd = (arrays[f"running/restarted/{what}"][:, i] for what in ("mean", "sd"))
    target, mode = problem()
    unit, scale = target.priors["zeta"].value(1.0), mode.near.scales[0]  # where it is held
    assert mean[0] == pytest.approx(unit * scale * np.sqrt(2 / np.pi), rel=1e-3)
    away, ratio = apart(posterior, mean[-1], sd[-1], "zeta")
    assert away < 0.1
    assert ratio == pytest.approx(1.0, abs=0.1)
    late = slice(mean.size // 4, None)
    assert np.all(np.diff(sd[late]) <= 1e-6 * sd[late][1:])
    assert np.all(np.abs(mean[late] - mean[-1]) < 4 * sd[late])
    first = arrays["running/online/mean"][:, i], arrays["running/online/sd"][:, i]
    assert abs(first[0][-1] - mean[-1]) < 3 * sd[-1]
    assert first[1][-1] < 0.1 * first[1][0]


def test_what_it_refuses():
    mode = problem()[1]
    kalman = SAMPLERS.get("kalman")
    with pytest.raises(Refusal, match="independent and normal"):
        kalman.sample(problems.target("coulomb_correlated"), mode, SETTINGS)
    touching = problems.target("touching_zero")
    exact = replace(touching, known={**touching.known, "epsilon": 0.0})
    with pytest.raises(Refusal, match="ε above 0"):
        kalman.sample(exact, mode, SETTINGS)


def test_natural_moments():
    """Against a million draws, cut off or not."""
    rng = np.random.default_rng(0)
    z = rng.standard_normal(1_000_000)
    for prior, mean, sd in ((HalfNormal(scale=2.0), 0.5, 1.0), (LogNormal(median=3.0, sigma=0.5), 0.5, 0.8)):
        u = mean + sd * z
        x = np.asarray(prior.value(u[u > 0] if prior.reflected else u))
        result = natural(prior, np.array([mean]), np.array([sd]))
        assert result[0][0] == pytest.approx(x.mean(), rel=0.01)
        assert result[1][0] == pytest.approx(x.std(), rel=0.02)
