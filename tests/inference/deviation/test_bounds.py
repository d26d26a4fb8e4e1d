"""Forms that are not in the answer, bounded one by one about the likeliest candidate's mode."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bayesdamp.inference.deviation.numbers import bounds
from bayesdamp.inference.deviation.numbers.bounds import bounds_of_others
from bayesdamp.inference.deviation.numbers.draws import probabilities
from bayesdamp.inference.deviation.quick import weighing_of
from bayesdamp.inference.deviation.weighing import CandidateResult, Weighing
from bayesdamp.physics.damping import TERMS, others
from bayesdamp.types import Signal
from tests.physics.independent import trajectory

Force = Callable[[Any, Any], Any]
W, A, ZETA = 4.5, 0.3, 0.04
P = {"zeta": ZETA, "stiffness": W**2, "rest_angle": 0.1, "theta0": 0.1 + A, "omega0": 0.0, "epsilon": 0.1}
TIMES = np.arange(1000) * 2 * math.pi / W / 40


@lru_cache
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
    y = _decay(lambda x, v: 0.0)[0]
    weighing = weighing_of(
        Signal(TIMES, y + 1e-4 * np.random.default_rng(1).standard_normal(y.size)),
        damping=["viscous"], restoring=["linear"], approximate=False,
    )  # fmt: skip
    result, term = weighing.results[0], TERMS.get(name)
    forms = list(bounds._forms(weighing, result, name))
    tangents = bounds._tangents(weighing, result, forms, False)
    assert tangents is not None
    epsilon = weighing.solvers["linear"].epsilon
    for form, tangent in zip(forms, tangents.T, strict=True):
        more = term.at(form.values)
        less = term.at(form.less) if form.less else lambda x, v, e: 0.0
        c = 1e-3 / max(abs(more(A, W * A, epsilon)), 1e-3)

        def with_form(size: float, more: Any = more, less: Any = less) -> np.ndarray:
            return _decay(lambda x, v: size * (more(x, v, epsilon) - less(x, v, epsilon)))[0]

        truth = (with_form(c) - with_form(-c)) / (2 * c)
        assert truth.shape == tangent.shape
        np.testing.assert_allclose(tangent, truth, atol=1e-2 * np.abs(truth).max())
        assert np.abs(tangent - 1.03 * truth).max() > 1e-2 * np.abs(truth).max()  # control


def test_every_form_is_bounded_by_itself() -> None:
    weighing, result = weighed(0.002)
    found = bounds_of_others(weighing, result, True, np.random.default_rng(0))
    assert set(found) == set(others()) - {"power"}
    assert all(0 < share < 1 for share in found.values())
    # Rate independent damping has viscous damping's envelope: a record bounds it worst.
    assert max(found, key=lambda name: found[name]) == "structural"
    assert found["cubic"] < 0.1


def test_less_noise_bounds_more() -> None:
    """With noise eight times as large, bounds of a form that the amplitude distinguishes are larger by at least two."""
    small, large = (
        bounds_of_others(*weighed(noise), False, np.random.default_rng(0)) for noise in (0.0005, 0.004)
    )
    for name in ("cubic", "displacement"):
        assert large[name] > 2 * small[name]


@pytest.mark.parametrize("scale", [1e-4, 1e3])
def test_a_bound_does_not_depend_on_the_unit(scale: float) -> None:
    """A record in metres or in tenths of a millimetre has the same bound for a form whose unit differs from the
    others'."""
    signal = weighed(0.002)[0].data
    y = np.asarray(signal.y)
    found, other = (
        bounds_of_others(
            each, max(each.results, key=lambda r: p[r.candidate]), False, np.random.default_rng(0)
        )
        for each, p in (_probable(y), _probable(y * scale))
    )
    assert set(found) == set(other)
    for name, share in found.items():
        assert other[name] == pytest.approx(share, rel=0.02), name
        assert share > 0.001  # control: there is something to bound


def _probable(y: np.ndarray) -> tuple[Weighing, dict[Any, float]]:
    weighing = weighing_of(Signal(TIMES, y), damping=["viscous"], restoring=["linear"], approximate=False)
    return weighing, probabilities(weighing, False)


@pytest.mark.parametrize("name", ["cubic", "displacement"])
def test_a_bound_holds_what_is_there(name: str) -> None:
    """A tenth of the loss in the middle of the record is cubic, and only viscous damping is fitted.

    The bound is above the share that was put in and below three times of it.
    """
    share, middle = 0.1, 0.15
    unit = 3 / 8 * middle**2 * W if name == "cubic" else middle**2 / (8 * W)
    c = share / (1 - share) * ZETA / W / unit
    forces: dict[str, Force] = {"cubic": lambda x, v: c * v**3, "displacement": lambda x, v: c * x * x * v}
    more = forces[name]
    x, v = _decay(more)
    y = x + 0.001 * np.random.default_rng(2).standard_normal(TIMES.size)
    weighing = weighing_of(Signal(TIMES, y), damping=["viscous"], restoring=["linear"], approximate=False)
    found = bounds_of_others(weighing, weighing.results[0], False, np.random.default_rng(0))
    own, viscous = float(np.mean(more(x, v) * v)), float(np.mean(2 * ZETA * v * v))
    lost = own / (own + viscous)
    assert lost < found[name] < 3 * lost


def _decay(more: Force) -> tuple[np.ndarray, np.ndarray]:
    """Return displacement and velocity under viscous damping and one more force."""
    run = solve_ivp(
        lambda _, s: [s[1], -2 * ZETA * s[1] - more(s[0], s[1]) - W**2 * s[0]], (0, TIMES[-1]), [A, 0.0],
        t_eval=TIMES, rtol=1e-10, atol=1e-12,
    )  # fmt: skip
    return run.y[0], run.y[1]
