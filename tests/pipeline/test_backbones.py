"""Candidates' damping and frequency against amplitude, over those that are read from a record."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bayesdamp.pipeline.candidates.backbones import compute_curve
from bayesdamp.records.oscillation.features import features
from bayesdamp.records.oscillation.law_free import Curves, amplitude_curves
from bayesdamp.store import CellResult
from bayesdamp.types import OK, Signal

STIFFNESS, ZETA, MU_Q, START = 14.0, 0.02, 0.05, 1.2
T = np.linspace(0.0, 40.0, 4000)


def swing(quantity: str) -> np.ndarray:
    """A pendulum with viscous and quadratic damping, by an independent solver."""

    def force(x, v):
        return -STIFFNESS * np.sin(x) - 2 * ZETA * v - MU_Q * np.abs(v) * v

    solved = solve_ivp(
        lambda _, s: [s[1], force(*s)], (0, T[-1]), [START, 0.0], t_eval=T, rtol=1e-9, atol=1e-12
    )
    x, v = solved.y
    return {"angle": x, "velocity": v, "acceleration": force(x, v)}[quantity]


def scores(quantity: str, mu_q: float = MU_Q, fit: np.ndarray | None = None) -> np.ndarray:
    """How many of their sds the record's points lie from the candidate's curves: of the true values, or with another
    coefficient, or where what is read from the fit is that of another record."""
    quiet = swing(quantity)
    noise = 0.01 * np.abs(quiet).max() * np.random.default_rng(11).standard_normal(T.size)
    signal = Signal(T, quiet + noise, quantity, "rad", "swing")
    seen = features(signal)
    record = amplitude_curves(signal, seen)
    values = {
        "stiffness": STIFFNESS,
        "rest_angle": 0.0,
        "theta0": START,
        "omega0": 0.0,
        "zeta": ZETA,
        "mu_q": mu_q,
    }
    mode = CellResult("mode", "", {"known": {}, "values": values}, {"fit": quiet if fit is None else fit}, OK)
    branch: Any = SimpleNamespace(
        store=SimpleNamespace(read=lambda _: mode),
        path="swing/0/viscous+quadratic",
        record=SimpleNamespace(signal=signal, seen=seen),
        terms=("viscous", "quadratic"),
        restoring="pendulum",
    )
    return off(record, compute_curve(branch).arrays)


def off(record: Curves, curve: dict[str, np.ndarray]) -> np.ndarray:
    found = []
    for what in ("ratio", "frequency"):
        there = np.interp(record.amplitude, curve["amplitude"], curve[what])
        found.append((getattr(record, what) - there) / getattr(record, f"{what}_sd"))
    return np.array(found)


@pytest.mark.parametrize("quantity", ["angle", "velocity", "acceleration"])
def test_the_true_model_lies_on_what_is_read_from_its_record(quantity):
    """Eighteen scores of nearly normal errors: all within 4 but for one record in 900."""
    assert np.abs(scores(quantity)).max() < 4.0


def test_a_wrong_coefficient_does_not():
    assert np.abs(scores("velocity", mu_q=0.8 * MU_Q, fit=np.zeros(T.size))[0]).max() > 8.0


def test_without_swings_to_read_the_curve_is_that_of_the_motion_without_losses():
    """Of a velocity this is off where the swings are large: that is what the reading sets right."""
    quiet = scores("velocity", fit=np.zeros(T.size))
    assert np.all(np.isfinite(quiet))
    assert np.abs(quiet[0]).max() > 5.0
