"""Forms that are not in the answer, bounded one by one about the likeliest candidate's mode."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from bayesdamp.inference.deviation.forms import bounds_of_others
from bayesdamp.inference.deviation.quick import weighing_of
from bayesdamp.physics.damping import others
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


@pytest.mark.parametrize("name", FORMS)
def test_a_bound_holds_what_is_there(name: str) -> None:
    """A tenth of the loss in the middle of the record is of a form, and only viscous damping is fitted.

    The bound of that form is above the share that was put in and below three times of it, and that of every other
    form is a share.
    """
    c = 0.1 / 0.9 * ZETA / W / LOST.get(name, LOST["coulomb"])
    form = FORMS[name]
    x, v = decay(lambda _, x, v: 2 * ZETA * v + c * form(x, v), TIMES)
    y = x + 0.001 * np.random.default_rng(2).standard_normal(TIMES.size)
    weighing = weighing_of(Signal(TIMES, y), damping=["viscous"], restoring=["linear"], approximate=False)
    bounds = bounds_of_others(weighing, weighing.results[0], np.random.default_rng(0))
    own = float(np.mean([c * form(*state) * state[1] for state in zip(x, v, strict=True)]))
    share = own / (own + float(np.mean(2 * ZETA * v * v)))
    assert share < bounds[name] < 3 * share
    assert set(bounds) == set(others()) - {"power"}
    assert all(0 < other <= 1 for other in bounds.values())
