"""Forms that are not in the answer, bounded one by one about the likeliest candidate's mode."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from bayesdamp.inference.deviation import forms as other_forms
from bayesdamp.inference.deviation.draws import probabilities
from bayesdamp.inference.deviation.forms import bounds_of_others
from bayesdamp.inference.deviation.quick import weighing_of
from bayesdamp.inference.deviation.weighing import CandidateResult, Weighing
from bayesdamp.physics.damping import TERMS, others
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


@pytest.mark.parametrize("name", ["cubic", "stribeck", "dry_position"])
def test_a_tangent_is_the_change_of_the_motion_with_a_little_of_the_form(name: str) -> None:
    """The motions with a little more and a little less of the form are solved by SciPy, with the form's own force."""
    y = decay(lambda t, x, v: 2 * ZETA * v, TIMES)[0]
    weighing = weighing_of(
        Signal(TIMES, y + 1e-4 * np.random.default_rng(1).standard_normal(y.size)),
        damping=["viscous"], restoring=["linear"], approximate=False,
    )  # fmt: skip
    result, term = weighing.results[0], TERMS.get(name)
    forms = list(other_forms._forms(weighing, result, name))
    tangents = other_forms._tangents(weighing, result, forms)
    assert tangents is not None
    epsilon = weighing.solvers["linear"].epsilon
    for form, tangent in zip(forms, tangents.T, strict=True):
        more = term.at(form.values)
        less = term.at(form.less) if form.less else lambda x, v, e: 0.0
        c = 1e-3 / max(abs(more(A, W * A, epsilon)), 1e-3)

        def with_form(size: float, more: Any = more, less: Any = less) -> np.ndarray:
            return decay(
                lambda t, x, v: 2 * ZETA * v + size * (more(x, v, epsilon) - less(x, v, epsilon)), TIMES
            )[0]

        truth = (with_form(c) - with_form(-c)) / (2 * c)
        assert truth.shape == tangent.shape
        np.testing.assert_allclose(tangent, truth, atol=1e-2 * np.abs(truth).max())
        assert np.abs(tangent - 1.03 * truth).max() > 1e-2 * np.abs(truth).max()  # control


def test_every_form_is_bounded_by_itself() -> None:
    weighing, result = weighed(0.002)
    found = bounds_of_others(weighing, result, np.random.default_rng(0))
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
    found = bounds_of_others(weighing, weighing.results[0], np.random.default_rng(0))
    own, viscous = float(np.mean(more(x, v) * v)), float(np.mean(2 * ZETA * v * v))
    lost = own / (own + viscous)
    assert lost < found["displacement"] < 3 * lost
