"""Simulated records that no law fits: they agree with closed forms and are reproducible."""

from __future__ import annotations

import numpy as np
import pytest

from tests.physics.independent import viscous
from validation.misfit import records as rec
from validation.misfit.cases import SAMPLES, draw_case

T = np.linspace(0.0, 40.0, 401)


def test_viscous_damping_is_that_of_the_closed_form_and_leaves_the_given_amplitude() -> None:
    damping = rec.damping_of({"viscous": 1.0}, 40 / (2 * np.pi), 0.3)
    ratio = -np.log(0.3) / 40
    assert rec.single(damping, T) == pytest.approx(viscous(T, ratio, 1.0, 1.0), abs=1e-5)
    assert rec.fall(lambda v: 2 * ratio * np.asarray(v), 0.5) == pytest.approx(ratio * 0.5, rel=1e-9)


def test_dry_friction_reduces_the_amplitude_linearly_and_stops_the_body() -> None:
    """With equal static and kinetic friction: (1 − μ) cos t + μ at first, and an amplitude of 1 − 4μ after a cycle."""
    y = rec.sticking(0.02, 0.02, 0.1, T)
    first = np.flatnonzero(np.pi >= T)
    assert y[first] == pytest.approx(0.98 * np.cos(T[first]) + 0.02, abs=1e-6)
    assert np.max(y[np.abs(T - 2 * np.pi) < 0.5]) == pytest.approx(0.92, abs=1e-3)
    stopped = rec.sticking(0.1, 0.25, 0.01, T)
    assert np.ptp(stopped[T > 25]) == 0.0
    assert abs(stopped[-1]) <= 0.25


def test_coupled_oscillators_exchange_their_energy() -> None:
    """Equal oscillators with coupling κ: the mean of two cosines of frequencies 1 and √(1 + 2κ)."""
    y = rec.coupled(lambda v: 0.0, T, 0.1, 0.0)
    assert y == pytest.approx(0.5 * (np.cos(np.sqrt(1.2) * T) + np.cos(T)), abs=1e-6)


@pytest.mark.parametrize("kind", ["gaps", "two_modes", "clipped"])
def test_cases_come_from_their_seed(kind: str) -> None:
    case, again, other = draw_case(kind, 0, 5), draw_case(kind, 0, 5), draw_case(kind, 1, 5)
    assert np.array_equal(case.signal.y, again.signal.y)
    assert not np.array_equal(case.signal.y, other.signal.y)
    assert case.signal.t.size == (SAMPLES - 48 if kind == "gaps" else SAMPLES)
