"""Parameters beside coefficients: integrals by adaptive importance sampling, against closed forms and a grid."""

from __future__ import annotations

import numpy as np
import pytest

from bayesdamp.inference.envelope.candidates import Blocks, weigh
from bayesdamp.inference.envelope.noise import Noise
from bayesdamp.inference.envelope.sums import Sum, explore, weighed
from bayesdamp.physics.amplitude import Scale
from bayesdamp.physics.damping import TERMS


@pytest.mark.parametrize(("count", "mean", "sd"), [(1, 0.7, 0.004), (3, 0.5, 0.05)])
def test_a_normal_likelihood_has_the_integral_of_its_closed_form(count, mean, sd):
    explored = explore(lambda z: -0.5 * sum((score - mean) ** 2 / sd**2 for score in z), count)
    v = sd**2 / (1 + sd**2)
    truth = count * (0.5 * np.log(v) - 0.5 * mean**2 / (1 + sd**2))
    assert explored.log_integral == pytest.approx(truth, abs=0.1)
    drawn = explored.resampled(64)
    assert drawn.mean(axis=0) == pytest.approx(np.full(count, mean / (1 + sd**2)), abs=0.4 * np.sqrt(v))
    assert drawn.std(axis=0) == pytest.approx(np.full(count, np.sqrt(v)), rel=0.4)


def stribeck_decay() -> tuple[Blocks, Sum]:
    """Friction that is 1 + 2 times larger near rest, with 2 % of white noise."""
    stribeck = Sum(("stribeck",), 1.0, -1.0, (TERMS.get("stribeck"),), Scale())
    t = np.linspace(0.0, 10.0, 60)
    fit = stribeck.law((1.0, 0.5)).decay(t, 1.0, np.array([0.2]))
    x = fit + 0.02 * np.random.default_rng(3).standard_normal(60)
    noises = ((Noise(1e-4, 1.0, 1e-8, 1.0, 0.02), 0.02**2 * np.eye(60)),)
    rate = float(x[0] - x[-1]) / 10.0
    return Blocks(t, x, 10.0, rate, noises=noises, inverse=np.eye(60) / 0.02), stribeck


@pytest.mark.slow
def test_the_evidence_of_a_term_with_two_parameters_is_its_integral_over_a_grid():
    b, stribeck = stribeck_decay()
    candidates = weighed(b, [stribeck])
    total = np.logaddexp.reduce([c.total + c.log_share for c in candidates])

    def at(z: tuple[float, float]) -> float:
        return weigh(b, stribeck.law(z)).total

    nodes, weights = np.linspace(-4.0, 4.0, 33), np.full(33, 0.25)
    grid = np.array([[at((z1, z2)) for z2 in nodes] for z1 in nodes])
    density = np.exp(-0.5 * nodes**2) / np.sqrt(2 * np.pi) * weights
    most = grid.max()
    truth = most + np.log(density @ np.exp(grid - most) @ density)
    assert total == pytest.approx(truth, abs=0.15)
    # Negative control: the best point's own evidence is another number.
    assert abs(most - truth) > 1.0
    # The grid's own error: with every second node.
    half = most + np.log(4 * density[::2] @ np.exp(grid - most)[::2, ::2] @ density[::2])
    assert half == pytest.approx(truth, abs=0.1)
