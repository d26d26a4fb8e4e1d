"""Trajectories at default settings against an independent solver at 1e-11."""

from __future__ import annotations

import numpy as np
import pytest

from bayesdamp.physics.damping import TERMS, all_sums
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS as LAW_PLUGINS
from bayesdamp.physics.trajectories import simulate
from tests.physics.independent import LAWS, PAPER, SUMS, trajectory

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
    for model in SUMS if law == "linear" else SUMS[-1:]:
        p = parameters(model, law)
        y = simulate(Oscillator(tuple(model.split("+")), law), p, TIMES)
        assert np.max(np.abs(y - trajectory(law, p, TIMES)[:, 0])) < LIMIT, model


PEAK = 0.3 * 20**0.5
"""Peak velocity of the paper's pendulum, rad/s."""


@pytest.mark.parametrize(("model", "share"), [("coulomb", 0.02), ("viscous+coulomb+quadratic", 0.002)])
def test_sharp_friction(model, share):
    """ε down to 0.2 % of the peak velocity, and friction strong enough to stop the pendulum."""
    p = parameters(model, "horizontal_pendulum", epsilon=share * PEAK, mu_c=0.2)
    y = simulate(Oscillator(tuple(model.split("+")), "horizontal_pendulum"), p, TIMES)
    truth = trajectory("horizontal_pendulum", p, TIMES, longest=0.01)[:, 0]
    assert np.max(np.abs(y - truth)) < LIMIT


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


def test_irregular_times():
    """Samples anywhere, several in a step, one twice, the first not at 0: the motion starts there."""
    times = 3.0 + np.sort(np.concatenate([[0.0], np.random.default_rng(1).uniform(0, 4, 300), [2.0, 2.0]]))
    p = parameters("viscous+coulomb", "horizontal_pendulum")
    y = simulate(Oscillator(("viscous", "coulomb"), "horizontal_pendulum"), p, times)
    assert np.max(np.abs(y - trajectory("horizontal_pendulum", p, times)[:, 0])) < LIMIT


def test_negative_control():
    """The comparison sees a coefficient that is off by one part in ten thousand."""
    p = parameters("viscous", "linear")
    y = simulate(Oscillator(("viscous",), "linear"), p, TIMES)
    other = trajectory("linear", {**p, "zeta": p["zeta"] * 1.0001}, TIMES)[:, 0]
    assert np.max(np.abs(y - other)) > LIMIT


def test_missing_parameter_and_unknown_quantity():
    osc = Oscillator(("viscous",), "linear")
    p = parameters("viscous", "linear")
    with pytest.raises(ValueError, match="'zeta' is missing"):
        simulate(osc, {k: v for k, v in p.items() if k != "zeta"}, TIMES)
    with pytest.raises(ValueError, match="quantity"):
        simulate(osc, p, TIMES, quantity="angel")
