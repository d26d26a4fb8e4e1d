"""Forms of damping beside the sums that are compared: a record of theirs is not named a sum without reservation."""

from __future__ import annotations

import numpy as np
import pytest

from bayesdamp.interface.answer import answer
from bayesdamp.types import Signal
from bayesdamp.verdict import thresholds
from bayesdamp.verdict.types import Verdict
from tests.misfit import records as rec

CYCLES = 9.0
TIMES = np.linspace(0.0, 2 * np.pi * CYCLES, 240)
LEFT = 0.3


def said(y: np.ndarray, noise: float = 0.004, seed: int = 5) -> Verdict:
    rng = np.random.default_rng(seed)
    noisy = y + noise * rng.standard_normal(y.size)
    return answer(Signal(TIMES, noisy), restoring=["linear"], sample=False).verdict


def spring(x: float) -> float:
    return x


def power(exponent: float) -> np.ndarray:
    """Return the motion under this power alone, in closed form apart from its scale."""
    eps = 1e-3

    def unit(v):
        return v * (v * v + eps * eps) ** (0.5 * (exponent - 1))

    grid = np.geomspace(LEFT, 1.0, 200)
    turned = np.trapezoid(1 / np.array([rec.fall(unit, a) for a in grid]), grid)
    scale = turned / (2 * np.pi * CYCLES)
    return rec.free(lambda v: scale * unit(v), spring, TIMES)


@pytest.mark.parametrize(
    ("form", "y"),
    [
        ("stribeck", rec.sticking(0.7 / (4 * CYCLES), 2.1 * 0.7 / (4 * CYCLES), 0.15, TIMES)),
        ("power", power(0.5)),
        ("power", power(3.0)),
    ],
)
def test_a_form_is_a_rival_and_no_sum_is_named_outright(form: str, y: np.ndarray) -> None:
    """The form is the likeliest rival, and probable enough for the sentence to name it.

    For |v|^0.5 over nine cycles the record contains little information even with 0.2 % of noise, and all forms
    together have a tenth of a sum's prior.
    """
    v = said(y, 0.002)
    assert not v.decided
    assert v.rivals[0].damping == form
    assert v.rivals[0].probability > thresholds.NAMED


@pytest.mark.parametrize("term", ["coulomb", "viscous", "quadratic"])
def test_a_sum_of_the_three_is_named(term: str) -> None:
    """Control: no other form is preferred where the truth is dry friction, viscous damping or drag."""
    v = said(rec.free(rec.damping_of({term: 1.0}, CYCLES, LEFT, 0.01), spring, TIMES))
    assert v.decided
    assert v.damping == term
