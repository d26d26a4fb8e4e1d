"""A curved ridge: found, straightened without changing volumes, and worth it."""

from __future__ import annotations

from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bayesdamp.estimators.shared import decay_start, start_parameters
from bayesdamp.inference.coordinates.whitening import shear_of
from bayesdamp.inference.evidence import Draws
from bayesdamp.inference.evidence.methods import bridge, importance
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.fit.search import find_mode
from bayesdamp.inference.model.target import Target, build_target
from bayesdamp.inference.samplers import Settings, nuts
from bayesdamp.records.oscillation.features import features
from bayesdamp.types import OK, Problem, Reference, Seed, Signal, System
from tests.inference.coordinates.densities import near, posterior_of

NAMES = ("mu", "k", "g", "s")
FOLDED = np.array([True, False, False, False])
WIDTH, TILT = 0.02, 0.6
"""The ridge k = TILT·g·s, so wide; g and s have their priors, mu is a reflected normal of sd 0.3."""
SCALE = np.array([0.3, 1.0, 1.0, 1.0])


def height(z: np.ndarray) -> np.ndarray:
    """Log density of scores z, (..., 4), all of whose integral over the reflected side is known."""
    mu, k, g, s = np.moveaxis(z, -1, 0)
    return -0.5 * ((mu / SCALE[0]) ** 2 + g**2 + s**2 + ((k - TILT * g * s) / WIDTH) ** 2)


AREA = np.log(SCALE[0] * WIDTH / 2) + 2 * np.log(2 * np.pi)


def slopes(z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The density at scores z, (4,), its gradient and its Gauss–Newton information."""
    mu, k, g, s = z
    off = (k - TILT * g * s) / WIDTH
    row = np.array([0.0, 1.0, -TILT * s, -TILT * g]) / WIDTH
    gradient = -np.array([mu / SCALE[0] ** 2, 0.0, g, s]) - off * row
    return height(z), gradient, np.diag([SCALE[0] ** -2, 0.0, 1.0, 1.0]) + np.outer(row, row)


@pytest.fixture
def banana() -> tuple[Any, Any]:
    return posterior_of(NAMES, FOLDED, np.zeros(4), height, slopes)


def test_the_ridge_of_a_product_and_a_square_is_found(banana) -> None:
    """The reflected score follows gravity too, which a bend may not say of it."""
    target, mode = banana

    def at(z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        mu, k, g, s = z
        off = np.array([(mu - 1.0 - 0.3 * g**2) / SCALE[0], (k - TILT * g * s - 0.2 * g**2) / WIDTH, g, s])
        slope = np.array(
            [
                [1.0 / SCALE[0], 0.0, -0.6 * g / SCALE[0], 0.0],
                [0.0, 1.0 / WIDTH, -(TILT * s + 0.4 * g) / WIDTH, -TILT * g / WIDTH],
                [0.0, 0.0, 1.0, 0.0],
                [0.0, 0.0, 0.0, 1.0],
            ]
        )
        return -0.5 * off @ off, -slope.T @ off, slope.T @ slope

    moved = {**vars(mode), "z": np.array([1.0, 0.0, 0.0, 0.0]), "near": near(at, FOLDED)}
    ridge = shear_of(target, SimpleNamespace(**moved))  # type: ignore[arg-type]
    assert ridge is not None
    g, s = (list(ridge.wide).index(NAMES.index(n)) for n in ("g", "s"))
    assert ridge.curve[1, g, g] == pytest.approx(0.4, abs=1e-6)
    assert ridge.curve[1, g, s] == ridge.curve[1, s, g] == pytest.approx(TILT, abs=1e-6)
    assert ridge.curve[1, s, s] == pytest.approx(0.0, abs=1e-6)
    assert np.all(ridge.curve[0] == 0.0)


def test_a_straight_ridge_is_left_alone(banana) -> None:
    target, mode = banana

    def flat(z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return -0.5 * z @ mode.information @ z, -mode.information @ z, mode.information

    straight = SimpleNamespace(**{**vars(mode), "near": near(flat, FOLDED)})
    assert shear_of(target, straight) is None  # type: ignore[arg-type]


def test_importance_along_a_curved_ridge_has_the_closed_form(banana, monkeypatch) -> None:
    """Four standard errors: a false alarm in 16,000. Negative control: with the ridge left curved the weights have no
    finite variance."""
    evidence = importance.PLUGIN.evidence("m", *banana, seed=3)
    assert evidence.outcome == OK
    assert evidence.stderr < 0.03
    assert abs(evidence.log_evidence - AREA) < 4 * evidence.stderr
    z = evidence.arrays["y"]
    assert np.corrcoef(z[:, 1], z[:, 2] * z[:, 3])[0, 1] > 0.9  # draws are scores, not straightened ones
    monkeypatch.setattr(importance, "shear_of", lambda target, mode: None)
    crooked = importance.PLUGIN.evidence("m", *banana, seed=3)
    assert crooked.outcome != OK or crooked.stderr > 3 * evidence.stderr


def test_bridge_along_a_curved_ridge_has_the_closed_form(banana, monkeypatch) -> None:
    """From exact draws; four standard errors. Negative control: with the ridge left curved the fit hardly meets
    it."""
    z = np.random.default_rng(5).standard_normal((4, 1000, 4)) * [SCALE[0], WIDTH, 1.0, 1.0]
    z[..., 0] = np.abs(z[..., 0])
    z[..., 1] += TILT * z[..., 2] * z[..., 3]
    evidence = bridge.PLUGIN.evidence("m", *banana, seed=3, draws=Draws(z))
    assert evidence.outcome == OK
    assert abs(evidence.log_evidence - AREA) < 4 * evidence.stderr
    assert evidence.stderr < 0.03
    monkeypatch.setattr(bridge, "shear_of", lambda target, mode: None)
    assert bridge.PLUGIN.evidence("m", *banana, seed=3, draws=Draws(z)).stderr > 3 * evidence.stderr


@lru_cache
def shaken() -> tuple[Target, Mode]:
    """A small swing seen by its acceleration: neither the angle's zero nor gravity beside a spring shows, only the
    frequency, in which the two are a product."""
    rng = np.random.default_rng(11)
    t, w, rate = np.arange(0, 60, 0.1), 2 * np.pi * 0.3, 0.02
    y = 0.05 * np.exp(-rate * t) * np.cos(w * t) + 0.003 * rng.standard_normal(t.size)
    signal = Signal(t, y, "acceleration")
    observed, system = features(signal), System("horizontal_pendulum", {"epsilon": 0.0005})
    target = build_target(
        signal, ("viscous",), system, observed, Reference(observed.amplitude, observed.frequency)
    )
    problem = Problem(("viscous",), system)
    start = start_parameters(signal, problem, observed) | decay_start(problem, observed)
    return target, find_mode(target, {Seed("seen"): start}, noise_level=observed.roughness)


@pytest.mark.slow
def test_nuts_follows_a_curved_ridge() -> None:
    """Against importance sampling, whose draws are independent: the quartiles of gravity and the spring's angle, the
    ridge's own coordinates, and of the stiffness. A quartile of 1,000 effective draws has an error of 4 % of the sd, of
    which the limit is five; the stiffness, far from normal, has fewer.
    """
    target, mode = shaken()
    settings = Settings(chains=4, warmup=100, draws=1500, seed=2)
    ridge = shear_of(target, mode)
    assert ridge is not None
    posterior = nuts.PLUGIN.sample(target, mode, settings)
    assert posterior.outcome == OK
    assert not nuts.poor(posterior)
    # The force of the linearised trajectory is good enough once the ridge is straight.
    assert not posterior.diagnostics["exact_force"]
    every = [importance.PLUGIN.evidence("m", target, mode, seed).arrays for seed in range(4)]
    values = target.values(np.concatenate([a["y"] for a in every]))
    log_weights = np.concatenate([a["log_weights"] for a in every])
    weights = np.exp(log_weights - log_weights.max())
    for name in ("gravity", "spring_angle", "stiffness"):
        drawn = posterior.draws[..., posterior.names.index(name)]
        order = np.argsort(values[name])
        share = np.cumsum(weights[order]) / weights.sum()
        quartiles = values[name][order][np.searchsorted(share, [0.25, 0.5, 0.75])]
        sd = (quartiles[2] - quartiles[0]) / 1.35
        np.testing.assert_allclose(np.quantile(drawn, [0.25, 0.5, 0.75]), quartiles, atol=0.2 * sd)
    # Negative control: without straightening the force is no good here.
    plain = nuts.PLUGIN.attempt(mode, nuts.whitening_of(target, mode), settings).posterior(mode)
    assert nuts.poor(plain) or plain.outcome != OK


def test_the_exact_force_is_that_of_the_bent_coordinates() -> None:
    """Energy is kept, so that most steps of half the usual length are accepted: 0.78 of them; the control, the force of
    coordinates that are not shear, keeps 0.26."""
    target, mode = shaken()
    at = nuts.whitening_of(target, mode, shear_of(target, mode))
    settings = Settings(chains=4, warmup=50, draws=50, seed=1)
    posterior = nuts.PLUGIN.attempt(mode, at, settings, True, 0.5).posterior(mode)
    assert np.mean(posterior.stats["acceptance_rate"]) > 0.6
