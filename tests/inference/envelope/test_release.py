"""The constant level before the release, while the drive is still on."""

from collections.abc import Callable

import numpy as np
import pytest

from bayesdamp.inference.envelope.candidates import Blocks
from bayesdamp.inference.envelope.decay import held_blocks


def viscous_with_friction(t: np.ndarray) -> np.ndarray:
    """Return ln A for dA/dt = -0.15 A - 0.05."""
    return np.log((np.e + 1 / 3) * np.exp(-0.15 * t) - 1 / 3)


def blocks(decay: Callable[[np.ndarray], np.ndarray], until: int, seed: int) -> Blocks:
    """Return 100 readings whose decay begins at number `until`. decay: ln A as a function of time since then."""
    t = np.linspace(0.0, 10.0, 100)
    x = decay(np.maximum(t - t[until], 0.0)) + 0.03 * np.random.default_rng(seed).standard_normal(100)
    return Blocks(t, x, 10.0, float(x[0] - x[-1]) / 10.0)


@pytest.mark.parametrize(("until", "decay"), [(8, lambda t: 1.0 - 0.3 * t), (35, viscous_with_friction)])
def test_the_end_of_a_constant_level_is_detected(until, decay):
    assert until - 1 <= held_blocks(blocks(decay, until, 1)) <= until + 5


@pytest.mark.parametrize("decay", [lambda t: 1.0 - np.log1p(0.2 * np.e * t), viscous_with_friction])
def test_a_decay_from_the_start_has_no_constant_level(decay):
    """Negative control. It is curved by its law, or by a drift of 5 % in its rate."""
    for seed in range(5):
        b = blocks(decay, 0, seed)
        assert held_blocks(b) == 0
        bent = Blocks(b.t, b.x - 0.05 * (b.x - b.x[0]) * b.t / 10.0, 10.0, b.mean_rate)
        assert held_blocks(bent) == 0
