"""Searches for modes from several starting points, and chains that start from several modes."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from bayesdamp.inference.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.samplers._sampler import compare_chains
from bayesdamp.inference.search import find_mode, group_searches
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.priors import HalfNormal, LogNormal, Normal
from bayesdamp.types import ChainStart, Seed, Signal

STEP, FREQUENCY, RATE, SD = 0.35, 4.5, 0.06, 0.005
ALIAS = 2 * np.pi / STEP - FREQUENCY
"""A damped cosine at this frequency has the same values at all multiples of STEP."""


@lru_cache
def searched(jitter: float) -> tuple[Target, Mode]:
    """Return the target of a linear oscillator, sampled four times a period with so much jitter (s), and its mode."""
    rng = np.random.default_rng(5)
    t = STEP * np.arange(60) + np.concatenate([[0.0], jitter * rng.uniform(-1, 1, 59)])
    y = 0.3 * np.exp(-RATE * t) * np.cos(FREQUENCY * t) + SD * rng.standard_normal(t.size)
    priors = {
        "zeta": HalfNormal(scale=0.5),
        "stiffness": LogNormal(median=50.0, sigma=1.0),
        "theta0": Normal(mean=0.0, sd=0.6),
        "omega0": Normal(mean=0.0, sd=3.0),
    }
    known = {"rest_angle": 0.0, "noise_sd": SD, "epsilon": 0.1}
    target = Target(Signal(t, y), Oscillator(("viscous",), "linear"), "gaussian", priors, known)
    starts = {"slow": FREQUENCY, "slow again": FREQUENCY, "fast": ALIAS}
    common = {"zeta": RATE, "theta0": 0.3, "omega0": 0.0}
    seeds = {Seed(name): {**common, "stiffness": w**2} for name, w in starts.items()}
    return target, find_mode(target, seeds, noise_level=SD)


def test_an_aliased_frequency_is_a_second_mode_of_the_same_likelihood():
    """The modes differ in their prior only. Of two searches with the same end one is kept."""
    target, mode = searched(0.0)
    modes, where = group_searches(mode)
    assert [c.seed.source for c in mode.searches] == ["slow", "fast"]
    assert mode.searches[0].same == (Seed("slow again"),)
    assert len(modes) == 2
    assert sorted(where) == [0, 1]
    stiffness = sorted(float(target.values(search.z)["stiffness"]) for search, _ in modes)
    np.testing.assert_allclose(stiffness, [FREQUENCY**2 + RATE**2, ALIAS**2 + RATE**2], rtol=0.01)
    prior = [-0.5 * float(search.z @ search.z) for search, _ in modes]
    assert modes[0][0].end - modes[1][0].end == pytest.approx(prior[0] - prior[1], abs=0.02)
    assert sum(share for _, share in modes) == pytest.approx(1.0)
    assert min(share for _, share in modes) > 0.02


def test_without_aliasing_other_modes_have_no_probability():
    _, mode = searched(0.1)
    modes, where = group_searches(mode)
    assert where[0] == 0
    assert all(share < 1e-6 for _, share in modes[1:])


def test_a_chain_that_remains_apart_is_detected():
    rng = np.random.default_rng(0)
    draws = rng.standard_normal((4, 1000, 2))
    starts = [ChainStart(Seed(f"seed {i}"), 3.0, 2.0, np.nan) for i in range(4)]
    assert all(row.shift < 0.15 for row in compare_chains(starts, draws))
    draws[2] += 3.0
    shifts = [row.shift for row in compare_chains(starts, draws)]
    assert shifts[2] == max(shifts) > 1.0
