"""The simulated cases are what they say: against closed forms, and drawn the same from the same seed."""

from __future__ import annotations

import numpy as np
import pytest

from tests.physics.independent import viscous
from validation.misfit import records as rec
from validation.misfit.cases import SAMPLES, draw_case

T = np.linspace(0.0, 40.0, 401)


def test_viscous_damping_is_the_closed_form_and_leaves_what_was_asked() -> None:
    damping = rec.damping_of({"viscous": 1.0}, 40 / (2 * np.pi), 0.3)
    ratio = -np.log(0.3) / 40
    assert rec.single(damping, T) == pytest.approx(viscous(T, ratio, 1.0, 1.0), abs=1e-5)
    assert rec.fall(lambda v: 2 * ratio * np.asarray(v), 0.5) == pytest.approx(ratio * 0.5, rel=1e-9)


def test_dry_friction_takes_four_times_itself_a_cycle_and_holds() -> None:
    """Without a difference of static and kinetic friction: (1 − μ) cos t + μ at first, 1 − 4μ a cycle later."""
    found = rec.sticking(0.02, 0.02, 0.1, T)
    first = np.flatnonzero(np.pi >= T)
    assert found[first] == pytest.approx(0.98 * np.cos(T[first]) + 0.02, abs=1e-6)
    assert np.max(found[np.abs(T - 2 * np.pi) < 0.5]) == pytest.approx(0.92, abs=1e-3)
    held = rec.sticking(0.1, 0.25, 0.01, T)
    assert np.ptp(held[T > 25]) == 0.0
    assert abs(held[-1]) <= 0.25


def test_coupled_oscillators_hand_their_energy_over() -> None:
    """Equal ones with coupling κ: cos of the mean of √1 and √(1 + 2κ) times cos of half their difference."""
    found = rec.coupled(lambda v: 0.0, T, 0.1, 0.0)
    fast, slow = np.sqrt(1.2), 1.0
    assert found == pytest.approx(0.5 * (np.cos(fast * T) + np.cos(slow * T)), abs=1e-6)


@pytest.mark.parametrize("kind", ["gaps", "two_modes", "clipped"])
def test_cases_come_from_their_seed(kind: str) -> None:
    case, again, other = draw_case(kind, 0, 5), draw_case(kind, 0, 5), draw_case(kind, 1, 5)
    assert np.array_equal(case.signal.y, again.signal.y)
    assert not np.array_equal(case.signal.y, other.signal.y)
    assert case.signal.t.size == (SAMPLES - 48 if kind == "gaps" else SAMPLES)
