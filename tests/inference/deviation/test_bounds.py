"""Forms that are not in the answer, bounded one by one about the likeliest candidate's mode."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from bayesdamp.inference.deviation.numbers.bounds import bounds_of_others
from bayesdamp.inference.deviation.numbers.draws import probabilities
from bayesdamp.inference.deviation.quick import weighing_of
from bayesdamp.inference.deviation.weighing import CandidateResult, Weighing
from bayesdamp.physics.damping import others
from bayesdamp.types import Signal
from tests.inference.deviation.decays import A, W, decay
from tests.physics.independent import trajectory

ZETA = 0.04
P = {"zeta": ZETA, "stiffness": W**2, "rest_angle": 0.1, "theta0": 0.1 + A, "omega0": 0.0, "epsilon": 0.1}
TIMES = np.arange(1000) * 2 * math.pi / W / 40


def weighed(noise: float) -> tuple[Weighing, CandidateResult]:
    """Return a weighing of a viscous decay and its likeliest candidate."""
    y = trajectory("linear", P, TIMES)[:, 0]
    y += noise * np.random.default_rng(5).standard_normal(TIMES.size)
    weighing = weighing_of(Signal(TIMES, y), restoring=["linear"])
    each = probabilities(weighing, False)
    return weighing, max(weighing.results, key=lambda r: each[r.candidate])


def test_every_form_is_bounded_by_itself() -> None:
    weighing, result = weighed(0.002)
    found = bounds_of_others(weighing, result, True, np.random.default_rng(0))
    assert set(found) == set(others()) - {"power"}
    assert all(0 < share < 1 for share in found.values())
    # Rate independent damping has viscous damping's envelope: a record bounds it worst.
    assert max(found, key=lambda name: found[name]) == "structural"
    assert found["cubic"] < 0.1


def test_a_bound_holds_what_is_there() -> None:
    """A tenth of the loss in the middle of the record depends on the displacement, and only viscous damping is fitted.

    The bound is above the share that was put in and below three times of it.
    """
    share, middle = 0.1, 0.15
    c = share / (1 - share) * ZETA / W / (middle**2 / (8 * W))

    def more(x: Any, v: Any) -> Any:
        return c * x * x * v

    x, v = decay(lambda _, x, v: 2 * ZETA * v + more(x, v), TIMES)
    y = x + 0.001 * np.random.default_rng(2).standard_normal(TIMES.size)
    weighing = weighing_of(Signal(TIMES, y), damping=["viscous"], restoring=["linear"], approximate=False)
    found = bounds_of_others(weighing, weighing.results[0], False, np.random.default_rng(0))
    own, viscous = float(np.mean(more(x, v) * v)), float(np.mean(2 * ZETA * v * v))
    lost = own / (own + viscous)
    assert lost < found["displacement"] < 3 * lost
