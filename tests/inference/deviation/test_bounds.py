"""Bounds of the share of the loss that forms of damping outside the answer can have."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from bayesdamp.inference.deviation.compare import compare_signal
from bayesdamp.inference.deviation.forms import bound_other_forms
from bayesdamp.types import Signal
from tests.inference.deviation.decays import A, W, decay

ZETA, MIDDLE = 0.04, 0.15
TIMES = np.arange(1000) * 2 * math.pi / W / 40
LOST = {
    "displacement": MIDDLE**2 / (8 * W),
    "cubic": 3 / 8 * W * MIDDLE**2,
    "coulomb": 2 / (math.pi * W**2 * MIDDLE),
}
"""Equivalent damping ratio per unit of each coefficient at the middle amplitude, in closed form."""
Force = Callable[[float, float], float]
FORMS: dict[str, Force] = {
    "displacement": lambda x, v: x * x * v,
    "cubic": lambda x, v: v**3,
    "dry_position": lambda x, v: (1 + 0.5 * (x / A) ** 2) * math.tanh(v / 0.01),
}


def record(c: float, form: Force, times: np.ndarray) -> tuple[np.ndarray, float]:
    """Return a record without noise of viscous damping and so much of a form, and the share of the form in the loss."""
    x, v = decay(lambda _, x, v: 2 * ZETA * v + c * form(x, v), times)
    own = float(np.mean([c * form(*state) * state[1] for state in zip(x, v, strict=True)]))
    return x, own / (own + float(np.mean(2 * ZETA * v * v)))


def bounds_of(times: np.ndarray, y: np.ndarray) -> dict[str, float]:
    signal = Signal(times, y)
    comparison = compare_signal(signal, damping=["viscous"], restoring=["linear"], approximate=False)
    return bound_other_forms(comparison, comparison.results[0], np.random.default_rng(0))


@pytest.mark.parametrize("name", FORMS)
def test_a_bound_is_above_the_true_share(name: str) -> None:
    """A tenth of the loss in the middle of the record is of a form, and only viscous damping is fitted.

    The bound of that form is above its true share and below three times of it. Every other form has a bound between 0
    and 1.
    """
    x, share = record(0.1 / 0.9 * ZETA / W / LOST.get(name, LOST["coulomb"]), FORMS[name], TIMES)
    bounds = bounds_of(TIMES, x + 0.001 * np.random.default_rng(2).standard_normal(TIMES.size))
    assert share < bounds[name] < 3 * share
    assert all(0 < other <= 1 for other in bounds.values())


def test_bounds_are_above_the_true_share_in_95_of_100_records() -> None:
    """In 13 of 16 records or more: fewer are a false alarm in 1,400. With the median instead of the 95 % point, 13 or
    more would be above it once in 90."""
    times = TIMES[::4]
    x, share = record(0.03 / 0.97 * ZETA / W / LOST["cubic"], FORMS["cubic"], times)
    noises = (0.01 * np.random.default_rng([8, seed]).standard_normal(times.size) for seed in range(16))
    assert sum(bounds_of(times, x + noise)["cubic"] > share for noise in noises) >= 13
