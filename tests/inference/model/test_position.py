"""Damping that depends on the position is sampled like the paper's: likelihood, gradient and posterior by SciPy."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bayesdamp.inference.fit.search import find_mode
from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.inference.model.target import Target, build_target
from bayesdamp.inference.samplers import SAMPLERS, Settings
from bayesdamp.records.oscillation.features import features
from bayesdamp.types import Reference, Seed, Signal, System

T = np.linspace(0.0, 8.0, 160)
START = {"stiffness": 20.0, "gravity": 3.0, "spring_angle": 0.05, "theta0": 0.5, "omega0": 0.1}
EPSILON, NOISE, REFERENCE = 0.05, 0.002, Reference(0.3, 4.4)
TRUTH = {
    "displacement": {"c_xxv": 3.0},
    "structural": {"kappa": 1.2},
    "dry_position": {"mu_p": 0.12, "friction_slope": 0.3, "friction_curvature": 0.6},
}


def drag(term: str, p: dict[str, float], u: float, v: float) -> float:
    """The force at a distance u from rest, written out once more."""
    turn = math.tanh(v / EPSILON)
    if term == "displacement":
        return p["c_xxv"] * u * u * v
    if term == "structural":
        return p["kappa"] * abs(u) * turn
    s = u / REFERENCE.amplitude
    return p["mu_p"] * max(1 + p["friction_slope"] * s + p["friction_curvature"] * s * s, 0.0) * turn


def motion(term: str, p: dict[str, float]) -> np.ndarray:
    """θ at T, the rest position by bisection."""

    def pull(x: float) -> float:
        return p["stiffness"] * (x - p["spring_angle"]) - p["gravity"] * math.cos(x)

    low, high = -1.0, 1.5
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if pull(middle) > 0 else (middle, high)

    def slope(_: float, s: np.ndarray) -> tuple[float, float]:
        return s[1], -drag(term, p, s[0] - low, s[1]) - pull(s[0])

    run = solve_ivp(
        slope, (0.0, T[-1]), (p["theta0"], p["omega0"]), "DOP853", T, rtol=1e-10, atol=1e-12, max_step=0.01
    )
    return run.y[0]


@lru_cache
def record(term: str) -> Signal:
    noise = NOISE * np.random.default_rng(6).standard_normal(T.size)
    return Signal(T, motion(term, {**START, **TRUTH[term]}) + noise, name=term)


def target(term: str, free: tuple[str, ...] = tuple(START)) -> Target:
    known = {n: v for n, v in START.items() if n not in free} | {"epsilon": EPSILON, "noise_sd": NOISE}
    system = System("horizontal_pendulum", known, dict.fromkeys(free))
    return build_target(record(term), (term,), system, features(record(term)), REFERENCE)


def density(term: str, p: dict[str, float]) -> float:
    return -0.5 * float(np.sum((record(term).y - motion(term, p)) ** 2)) / NOISE**2


@pytest.mark.parametrize("term", TRUTH)
def test_likelihood_and_gradient(term):
    """Against SciPy's: the rest position, on which the force depends, moves with stiffness and gravity."""
    p = {**START, **TRUTH[term]}
    built = target(term)
    likelihood = Likelihood.near(built, built.scores(p), 1e-9)
    here = {**built.known, **p}
    other = {**here, "stiffness": 1.001 * p["stiffness"]}
    ours = likelihood.log_likelihood_of(other) - likelihood.log_likelihood_of(here)
    theirs = density(term, {n: other[n] for n in p}) - density(term, p)
    assert ours == pytest.approx(theirs, abs=2e-2, rel=1e-3)
    value, slopes = likelihood.slopes_of(here)
    assert value == likelihood.log_likelihood_of(here)
    for i, name in enumerate(built.names):
        h = 5e-4 * max(abs(p[name]), 0.1)
        up, down = (density(term, {**p, name: p[name] + sign * h}) for sign in (1, -1))
        expected, curved = (up - down) / (2 * h), abs(up + down - 2 * density(term, p)) / h
        assert float(slopes[i]) == pytest.approx(expected, rel=1e-3, abs=2e-3 * curved), name
        assert abs(float(slopes[i]) - 1.1 * expected) > 1e-3 * abs(expected)  # control


@pytest.mark.slow
@pytest.mark.parametrize("sampler", ["nuts", "emcee"])
def test_posterior_is_that_of_quadrature(sampler):
    """One unknown: mean and sd by trapezia over SciPy's motions, within five Monte Carlo errors (a false alarm in a
    million)."""
    built = target("displacement", ())
    assert built.names == ("c_xxv",)
    mode = find_mode(built, {Seed("s"): {"c_xxv": 2.0}}, noise_level=NOISE)
    centre = float(built.values(mode.z)["c_xxv"])
    grid = centre + np.linspace(-0.25, 0.25, 81)
    height = np.array([density("displacement", {**START, "c_xxv": c}) for c in grid])
    height += built.priors["c_xxv"].log_density(grid)
    weight = np.exp(height - height.max())
    weight /= weight.sum()
    mean = float(weight @ grid)
    sd = float(np.sqrt(weight @ (grid - mean) ** 2))
    assert 6 * sd < 0.25
    posterior = SAMPLERS.get(sampler).sample(built, mode, Settings(draws=1000, warmup=300, seed=2))
    assert posterior.outcome == "ok"
    draws = posterior.draws[..., 0].ravel()
    summary = posterior.summaries
    count = summary["c_xxv"]["ess_bulk"]
    assert abs(draws.mean() - mean) < 5 * sd / math.sqrt(count)
    assert abs(draws.std() / sd - 1) < 5 / math.sqrt(count)
    assert abs(draws.mean() - mean - 0.5 * sd) > 5 * sd / math.sqrt(count)  # control
