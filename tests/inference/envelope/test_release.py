"""The constant level before the release, while the drive is still on."""

from __future__ import annotations

import numpy as np
import pytest

from bayesdamp.inference.envelope.candidates import Blocks
from bayesdamp.inference.envelope.decay import held_blocks
from bayesdamp.physics.amplitude import decay


def blocks(terms: tuple[str, ...], rates: list[float], until: int, seed: int) -> Blocks:
    """Return 100 readings whose decay begins at number `until`."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 10.0, 100)
    x = decay(np.maximum(t - t[until], 0.0), 1.0, terms, np.array(rates)) + 0.03 * rng.standard_normal(100)
    return Blocks(t, x, 10.0, float(x[0] - x[-1]) / 10.0)


@pytest.mark.parametrize(
    ("until", "terms", "rates"), [(8, ("viscous",), [0.3]), (35, ("viscous", "coulomb"), [0.15, 0.05])]
)
def test_the_end_of_a_constant_level_is_detected(until, terms, rates):
    assert until - 1 <= held_blocks(blocks(terms, rates, until, 1)) <= until + 5


@pytest.mark.parametrize(
    ("terms", "rates"), [(("quadratic",), [0.2]), (("viscous", "coulomb"), [0.15, 0.05])]
)
def test_a_decay_from_the_start_has_no_constant_level(terms, rates):
    """Negative control. It is curved by its law, or by a drift of 5 % in its rate."""
    for seed in range(5):
        b = blocks(terms, rates, 0, seed)
        assert held_blocks(b) == 0
        bent = Blocks(b.t, b.x - 0.05 * (b.x - b.x[0]) * b.t / 10.0, 10.0, b.mean_rate)
        assert held_blocks(bent) == 0
