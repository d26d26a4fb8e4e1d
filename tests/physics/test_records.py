"""Records as functions of the parameters: quantities, batches, tangents, escapes."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bayesdamp.physics import integrate
from bayesdamp.physics.integrate import make_plan, plan_with_error, simulate
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.solver.plan import compiled_record
from tests.physics.independent import LAWS, PAPER, trajectory

TIMES = np.linspace(0.0, 10.0, 401)
LAW = "horizontal_pendulum"
OSC = Oscillator(("viscous", "coulomb", "quadratic"), LAW)
P = {**PAPER, **LAWS[LAW], "omega0": 0.2}
VALUES = {n: jnp.asarray(P[n]) for n in OSC.parameters}


@pytest.fixture(scope="module")
def plan():
    return make_plan(OSC, P, TIMES, tolerance=1e-5)


@pytest.mark.parametrize(("quantity", "column"), [("velocity", 1), ("acceleration", 2)])
def test_quantities(quantity, column):
    """Within the tolerance, in the unit of the quantity."""
    truth = trajectory(LAW, P, TIMES)[:, column]
    assert np.max(np.abs(simulate(OSC, P, TIMES, quantity, tolerance=1e-6) - truth)) < 2e-6


@pytest.mark.parametrize(("quantity", "column"), [("angle", 0), ("velocity", 1)])
@pytest.mark.parametrize("epsilon", [P["epsilon"], 0.0])
def test_of_very_many_samples_some_say_how_fine_the_steps_are(monkeypatch, quantity, column, epsilon):
    """The others are read off the same steps."""
    p = {**P, "epsilon": epsilon}
    every = simulate(OSC, p, TIMES, quantity, tolerance=1e-6)
    monkeypatch.setattr(integrate, "ENOUGH", 60)
    some = simulate(OSC, p, TIMES, quantity, tolerance=1e-6)
    assert some.shape == TIMES.shape
    assert np.max(np.abs(some - every)) < 1e-5
    if epsilon:
        assert np.max(np.abs(some - trajectory(LAW, P, TIMES)[:, column])) < 1e-5


@pytest.mark.parametrize("tolerance", [1e-5, 1e-8])
def test_tolerance_is_kept_and_the_stated_error_is_honest(tolerance):
    plan, stated = plan_with_error(OSC, P, TIMES, tolerance=tolerance)
    truth = trajectory(LAW, P, TIMES, longest=0.01)[:, 0]
    error = np.max(np.abs(np.asarray(compiled_record(OSC)(plan, VALUES)) - truth))
    assert stated <= tolerance
    assert error <= 1.5 * stated + 1e-11


def test_batch_equals_loop(plan):
    rng = np.random.default_rng(0)
    many = {n: v * (1 + 0.01 * jnp.asarray(rng.standard_normal(8))) for n, v in VALUES.items()}
    batch = np.asarray(jax.jit(jax.vmap(lambda q: plan.record(OSC, q)))(many))
    run = compiled_record(OSC)
    loop = np.stack([np.asarray(run(plan, {n: v[i] for n, v in many.items()})) for i in range(8)])
    np.testing.assert_allclose(batch, loop, atol=1e-12)


@pytest.mark.parametrize("epsilon", [P["epsilon"], 0.0])
@pytest.mark.parametrize("count", [1, 40])
def test_side_by_side_equals_one_by_one(epsilon, count):
    """On a plan that is set right at its parameters, and with exact friction, which has no plan of the kind."""
    p = {**P, "epsilon": epsilon}
    coarse = make_plan(OSC, p, TIMES, tolerance=1e-3)
    plan = coarse.anchored(OSC, coarse.finer(OSC, p, 3, TIMES, "angle"), p)
    rng = np.random.default_rng(1)
    many = {n: v * (1 + 0.01 * rng.standard_normal(count)) for n, v in p.items()}
    batch = plan.many_at_samples(OSC, many)
    loop = [plan.at_samples(OSC, {n: v[i] for n, v in many.items()}) for i in range(count)]
    np.testing.assert_allclose(batch, loop, atol=1e-12)
    assert batch.shape == (count, TIMES.size)
    if count > 1:
        assert np.ptp(batch, axis=0).max() > 1e-3  # the control: they differ


def test_tangents_are_differences(plan):
    """All parameters, ε among them, in one batch of forward tangents against central differences."""
    names = list(OSC.parameters)
    run = compiled_record(OSC)

    def of(vector):
        return run(plan, dict(zip(names, vector)))

    at = jnp.asarray([P[n] for n in names])
    tangents = np.asarray(jax.jit(jax.jacfwd(of))(at)).T
    for i, name in enumerate(names):
        d = 1e-5 * max(1.0, abs(P[name]))
        difference = (of(at.at[i].add(d)) - of(at.at[i].add(-d))) / (2 * d)
        scale = float(jnp.max(jnp.abs(difference)))
        np.testing.assert_allclose(tangents[i], difference, atol=1e-6 * scale + 1e-8, err_msg=name)
    assert not np.allclose(tangents[0], tangents[1], rtol=0.01)  # negative control: two terms, two shapes


def test_escape_is_not_finite():
    """A softening Duffing released beyond its hilltop, and one shot over it."""
    osc = Oscillator(("viscous",), "duffing")
    p = {"zeta": 0.05, "stiffness": 20.0, "rest_angle": 0.0, "cubic": -60.0, "theta0": 0.7, "omega0": 0.0}
    for start in ({}, {"theta0": 0.3, "omega0": 4.0}):
        y = simulate(osc, {**p, **start}, TIMES)
        assert np.isfinite(y[0])
        assert not np.all(np.isfinite(y))
    assert np.all(np.isfinite(simulate(osc, {**p, "theta0": 0.3}, TIMES)))


def test_escape_from_a_plan_that_did_not_expect_it():
    """A plan made inside the well, used at parameters that leave it: not finite, or absurdly large."""
    osc = Oscillator(("viscous",), "duffing")
    p = {"zeta": 0.05, "stiffness": 20.0, "rest_angle": 0.0, "cubic": -60.0, "theta0": 0.3, "omega0": 0.0}
    plan = make_plan(osc, p, TIMES)
    y = compiled_record(osc)(plan, {n: jnp.asarray({**p, "theta0": 0.8}[n]) for n in osc.parameters})
    assert not np.all(np.isfinite(np.asarray(y)))
