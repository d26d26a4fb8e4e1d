"""A model in the program of all dampings is that model."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from bayesdamp.inference.model.build import build_target
from bayesdamp.inference.model.defaults import Reference
from bayesdamp.inference.model.density import log_posterior
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.records.oscillation.features import features
from bayesdamp.records.simulate import simulate_signal
from bayesdamp.types import System


def test_absent_terms_add_nothing_but_a_prior_that_integrates_to_one() -> None:
    truth = {"zeta": 0.05, "stiffness": 20.0, "rest_angle": 0.0, "theta0": 0.3, "omega0": 0.0}
    signal = simulate_signal(
        Oscillator(("viscous",), "linear"), truth, duration=5.0, samples=200, noise_sd=0.003,
        rng=np.random.default_rng(0),
    )  # fmt: skip
    seen = features(signal)
    system = System("linear", {}, dict.fromkeys(("stiffness", "rest_angle", "theta0", "omega0", "noise_sd")))
    reference = Reference(seen.amplitude, seen.frequency)
    every = ("viscous", "coulomb", "quadratic")
    own = build_target(signal, ("viscous",), system, seen, reference)
    shared = build_target(signal, ("viscous",), system, seen, reference, beside=every)
    other = build_target(signal, every, system, seen, reference)
    z = own.scores({**truth, "noise_sd": 0.003})
    wide = shared.scores({**truth, "noise_sd": 0.003})
    plan = own.plan(z, 1e-7)[0]

    def height(target, at) -> float:
        return float(log_posterior(target.layout, target.context(plan), jnp.asarray(at)))

    absent = [i for i, name in enumerate(shared.names) if name in ("mu_c", "mu_q")]
    wide[absent] = 0.0
    assert shared.layout == other.layout  # one program
    expected = height(own, z) - len(absent) * 0.5 * np.log(2 * np.pi)
    assert height(shared, wide) == pytest.approx(expected, abs=1e-6)
    moved = wide.copy()
    moved[absent] = 1.3
    assert height(shared, moved) == pytest.approx(expected - len(absent) * 0.5 * 1.3**2, abs=1e-6)
    assert abs(height(other, moved) - expected) > 10  # where the terms are there, they count
