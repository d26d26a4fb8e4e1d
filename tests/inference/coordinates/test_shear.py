"""A curved ridge: found, straightened without changing volumes, and worth it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import dblquad
from scipy.interpolate import PchipInterpolator

from bayesdamp.estimators.shared import decay_start, start_parameters
from bayesdamp.inference.coordinates.noise_map import NoiseMap
from bayesdamp.inference.coordinates.whitening import Shear, shear_of
from bayesdamp.inference.evidence import Draws
from bayesdamp.inference.evidence.methods import bridge, importance
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.fit.search import find_mode
from bayesdamp.inference.model.target import Target, build_target
from bayesdamp.inference.samplers import Settings, nuts
from bayesdamp.records.oscillation.features import features
from bayesdamp.types import OK, Problem, Reference, Seed, Signal, System

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


def near(curvature: Callable) -> Any:
    """The density with this value, gradient and information in place of a record's."""
    return SimpleNamespace(
        curvature=curvature,
        gradient=lambda z: curvature(z)[:2],
        target=SimpleNamespace(reflected=FOLDED),
    )


@pytest.fixture
def banana(monkeypatch) -> tuple[Any, Any]:
    """A target and its mode with that density in place of a record's."""
    target = SimpleNamespace(
        names=NAMES,
        noise="gaussian",
        reflected=FOLDED,
        oscillator=SimpleNamespace(parameters=NAMES),
    )
    at = np.zeros(4)
    information = slopes(at)[2]
    factor = np.linalg.cholesky(np.linalg.inv(information))
    sds = np.sqrt(np.diag(factor @ factor.T))
    return target, SimpleNamespace(
        z=at,
        information=information,
        factor=factor,
        sd=lambda: sds,
        linear=None,
        likelihood=SimpleNamespace(folded=height),
        near=near(slopes),
    )


def test_a_bend_keeps_volumes_and_mirror_images() -> None:
    rng = np.random.default_rng(0)
    curve = rng.standard_normal((5, 2, 2))
    curve[[0, 2, 4]] = 0.0  # a reflected score and the wide ones
    knots = np.linspace(-90, 90, 400)
    noise = NoiseMap(
        1, 3, PchipInterpolator(knots, np.stack([knots + np.sin(0.5 * knots), knots**2], axis=1))
    )
    shear = Shear(rng.standard_normal(5), np.array([2, 4]), curve + np.swapaxes(curve, 1, 2), noise)
    z = rng.standard_normal((7, 5))
    np.testing.assert_allclose(shear.straight(shear.scores(z)), z, atol=1e-9)
    np.testing.assert_allclose(shear.scores(z)[:, [0, 2, 4]], z[:, [0, 2, 4]])
    steps = 1e-6 * np.eye(5)
    measured = (shear.scores(z[0] + steps) - shear.scores(z[0] - steps)).T / 2e-6
    np.testing.assert_allclose(shear.slope(z[0]), measured, atol=1e-8)
    assert np.log(np.linalg.det(shear.slope(z[0]))) == pytest.approx(shear.log_volume(z[0]))
    rises = (shear.log_volume(z[0] + steps) - shear.log_volume(z[0] - steps)) / 2e-6
    np.testing.assert_allclose(shear.volume_slope(z[0]), rises, atol=1e-6)
    bare = replace(shear, noise=NoiseMap())
    assert np.linalg.det(bare.slope(z[0])) == pytest.approx(1.0)
    np.testing.assert_array_equal(Shear.none(5).scores(z), z)


def test_the_ridge_of_a_product_is_found(banana) -> None:
    ridge = shear_of(*banana)
    assert ridge is not None
    assert sorted(NAMES[i] for i in ridge.wide) == ["g", "s"]
    exact = np.zeros((4, 2, 2))
    exact[1] = [[0.0, TILT], [TILT, 0.0]]
    np.testing.assert_allclose(ridge.curve, exact, atol=1e-6)


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

    moved = {**vars(mode), "z": np.array([1.0, 0.0, 0.0, 0.0]), "near": near(at)}
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

    straight = SimpleNamespace(**{**vars(mode), "near": near(flat)})
    assert shear_of(target, straight) is None  # type: ignore[arg-type]


def test_the_closed_form_itself() -> None:
    """Along k the density is a normal's; over g and s by quadrature."""
    ridge = dblquad(lambda g, s: np.exp(-0.5 * (g**2 + s**2)), -9, 9, -9, 9)[0]
    assert np.log(ridge * WIDTH * SCALE[0] * np.pi) == pytest.approx(AREA, abs=1e-6)


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


def test_the_bent_frame_has_the_gradient_of_its_own_coordinates() -> None:
    """The force of the linearised trajectory, by differences of the density along the whitened axes near its centre."""
    target, mode = shaken()
    at = nuts.whitening_of(target, mode, shear_of(target, mode))
    u = 0.3 * np.random.default_rng(0).standard_normal((6, mode.z.size))
    np.testing.assert_allclose(at.whitened(at.scores(u)), u, atol=1e-8)
    bare = replace(at, shear=Shear.none(mode.z.size))
    assert np.max(np.abs(at.scores(u) - bare.scores(u)) / mode.sd()) > 1e-3
