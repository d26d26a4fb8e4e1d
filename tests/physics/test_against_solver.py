"""Trajectories at default settings against an independent solver at 1e-11."""

from __future__ import annotations

import numpy as np
import pytest

from bayesdamp.physics.damping import TERMS, all_sums
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS as LAW_PLUGINS
from bayesdamp.physics.trajectories import simulate
from tests.physics.independent import LAWS, PAPER, trajectory
from validation.truth.oscillator import SUMS

TIMES = np.linspace(0.0, 10.0, 501)
LIMIT = 1e-6
"""rad"""


def parameters(model: str, law: str, **changed: float) -> dict[str, float]:
    return {
        **{TERMS.get(t).parameter: PAPER[TERMS.get(t).parameter] for t in model.split("+")},
        **LAWS[law],
        **changed,
    }


def test_table_covers_every_law_and_sum():
    assert sorted(LAWS) == LAW_PLUGINS.names()
    assert list(SUMS) == all_sums()


@pytest.mark.parametrize("law", LAWS)
def test_every_law_and_damping(law):
    """The control: a coefficient that is off by one part in ten thousand."""
    for model in SUMS if law == "linear" else SUMS[-1:]:
        p = parameters(model, law)
        y = simulate(Oscillator(tuple(model.split("+")), law), p, TIMES)
        assert np.max(np.abs(y - trajectory(law, p, TIMES)[:, 0])) < LIMIT, model
        wrong = {n: v * (1.0001 if n in PAPER else 1.0) for n, v in p.items()}
        assert np.max(np.abs(y - trajectory(law, wrong, TIMES)[:, 0])) > LIMIT, model


@pytest.mark.parametrize(
    ("law", "changed"),
    [
        ("horizontal_pendulum", {"stiffness": 491.0, "gravity": -243.0, "spring_angle": 0.56, "theta0": 1.2}),
        ("pendulum", {"theta0": 3.2, "omega0": 0.0}),  # nearly upside down: slow, then fast
        ("duffing", {"cubic": 2000.0, "theta0": 0.4}),
        ("linear", {"theta0": 0.05, "omega0": -2.0, "zeta": 6.0}),  # overdamped
        ("linear", {"theta0": 100.0, "stiffness": 1e4, "rest_angle": 0.0}),  # other scales
    ],
)
def test_unusual_motions(law, changed):
    p = parameters("viscous+quadratic", law, **changed)
    y = simulate(Oscillator(("viscous", "quadratic"), law), p, TIMES)
    truth = trajectory(law, p, TIMES, longest=0.01)[:, 0]
    assert np.max(np.abs(y - truth)) < LIMIT * max(1.0, abs(p["theta0"]))


def test_missing_parameter_and_unknown_quantity():
    osc = Oscillator(("viscous",), "linear")
    p = parameters("viscous", "linear")
    with pytest.raises(ValueError, match="'zeta' is missing"):
        simulate(osc, {k: v for k, v in p.items() if k != "zeta"}, TIMES)
    with pytest.raises(ValueError, match="quantity"):
        simulate(osc, p, TIMES, quantity="angel")
