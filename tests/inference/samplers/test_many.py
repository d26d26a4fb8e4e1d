"""NUTS over many records in one call draws what it draws record by record."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache, partial

import jax
import numpy as np
import pytest
from jax import numpy as jnp

from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.fit.search import find_mode
from bayesdamp.inference.model.density import log_posterior
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.samplers import Settings, nuts
from bayesdamp.inference.samplers._many import axes, sample_many, stacked
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.priors import HalfNormal, LogNormal
from bayesdamp.records.simulate import simulate_signal
from bayesdamp.types import Seed
from tests.inference import problems

PRIORS = {"zeta": HalfNormal(scale=0.5), "noise_sd": LogNormal(median=0.01, sigma=1.0)}
KNOWN = {"rest_angle": 0.0, "theta0": 0.3, "omega0": 0.0}


@lru_cache
def problem(stiffness: float) -> tuple[Target, Mode]:
    """A record whose number of steps depends on its frequency, with its mode."""
    osc, known = Oscillator(("viscous",), "linear"), {**KNOWN, "stiffness": stiffness}
    rng = np.random.default_rng(int(stiffness))
    signal = simulate_signal(
        osc, {**known, "zeta": 0.1}, duration=8.0, samples=161, noise_sd=0.003, name="many", rng=rng
    )
    target = Target(signal, osc, "gaussian", PRIORS, known)
    return target, find_mode(target, {Seed("near"): {"zeta": 0.11}}, noise_level=0.003)


STIFFNESSES = (9.0, 16.0, 25.0, 36.0)


def test_records_of_other_lengths_share_a_call_and_keep_their_likelihoods():
    found = [problem(k) for k in STIFFNESSES]
    contexts = [mode.context for _, mode in found]
    assert len({int(c.plan.count) for c in contexts}) == len(contexts)
    layout, both = found[0][0].layout, stacked(contexts)
    z = jnp.asarray(np.array([mode.z for _, mode in found]) + 0.05)
    together = jax.vmap(partial(log_posterior, layout), in_axes=(axes(both), 0))(both, z)
    alone = [problems.height(layout)(c, one) for c, one in zip(contexts, z)]
    np.testing.assert_allclose(together, alone, rtol=1e-12)
    # negative control: with the steps of the shortest one the others end too early
    short = replace(both, plan=replace(both.plan, count=min(c.plan.count for c in contexts)))
    cut = jax.vmap(partial(log_posterior, layout), in_axes=(axes(short), 0))(short, z)
    assert np.sum(np.abs(np.asarray(cut) / np.asarray(alone) - 1) > 1e-3) == len(contexts) - 1


@pytest.mark.slow
def test_draws_are_those_of_one_record_at_a_time():
    targets, modes = zip(*(problem(k) for k in STIFFNESSES))
    # Long enough that none is sampled again: another attempt has random numbers of its own.
    settings, seeds = Settings(chains=4, warmup=100, draws=1000), [1, 2, 3, 4]
    many = sample_many(targets, modes, settings, seeds)
    for target, mode, seed, found in zip(targets, modes, seeds, many):
        alone = nuts.PLUGIN.sample(target, mode, replace(settings, seed=seed))
        # Rounding grows from draw to draw: the first ones are equal, all have one distribution.
        np.testing.assert_allclose(found.draws[:, :10], alone.draws[:, :10], rtol=1e-6)
        sd = alone.draws.std(axis=(0, 1))
        error = np.abs(found.draws.mean(axis=(0, 1)) - alone.draws.mean(axis=(0, 1))) / sd
        assert np.all(error < 4 * np.sqrt(2 / 600)), "four Monte Carlo errors"
        assert found.seconds > 0
    # negative control: another seed draws otherwise
    other = sample_many(targets, modes, settings, [5, 6, 7, 8])
    assert not np.allclose(other[0].draws[:, :10], many[0].draws[:, :10], rtol=1e-3)
