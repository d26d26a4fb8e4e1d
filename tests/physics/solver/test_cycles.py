"""Very many cycles, by their map: against steps of an independent solver's tolerance, and against a closed form."""

from __future__ import annotations

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bayesdamp.inference.checks.checks import check_fit
from bayesdamp.inference.evidence.methods import importance
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.fit.search import find_mode
from bayesdamp.inference.model.build import build_target
from bayesdamp.inference.model.compiled import compiled
from bayesdamp.inference.model.defaults import Reference
from bayesdamp.inference.model.density import log_posterior
from bayesdamp.inference.model.target import Target
from bayesdamp.physics.integrate import plan_of, plan_with_error
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.solver import cycles
from bayesdamp.physics.solver.cycles import CyclePlan
from bayesdamp.physics.solver.steps import MeshPlan
from bayesdamp.physics.solver.tangents import with_slopes
from bayesdamp.records.oscillation.features import features
from bayesdamp.types import Seed, Signal, System

RATE = 2 * np.pi
TIMES = np.linspace(0.3, 300.3, 3001)
START = {"stiffness": RATE**2, "theta0": 0.3, "omega0": 0.4}
CASES = {
    "viscous linear": ("viscous", "linear", {"zeta": 0.004, "rest_angle": 0.02}),
    "three terms, duffing": (
        "viscous+coulomb+quadratic", "duffing",
        {"zeta": 0.002, "mu_c": 0.001, "mu_q": 0.004, "epsilon": 0.03, "cubic": 20.0, "rest_angle": 0.0},
    ),
    "large swings": ("viscous+quadratic", "pendulum", {"zeta": 0.002, "mu_q": 0.002, "rest_angle": 0.1, "theta0": 1.5}),
    "horizontal": ("viscous", "horizontal_pendulum", {"zeta": 0.003, "gravity": 3.0, "spring_angle": 0.05}),
}  # fmt: skip


def case(name: str) -> tuple[Oscillator, dict[str, float]]:
    damping, law, values = CASES[name]
    osc = Oscillator(tuple(damping.split("+")), law)
    return osc, {n: float({**START, **values}[n]) for n in osc.parameters}


def moved(p: dict[str, float]) -> dict[str, float]:
    """Parameters about as far away as a record of a percent of noise leaves them open."""
    factors = {"zeta": 1.02, "mu_c": 0.97, "stiffness": 1.0001, "theta0": 1.002}
    return {n: v * factors.get(n, 1.0) + 0.003 * (n == "rest_angle") for n, v in p.items()}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("quantity", ["angle", "acceleration"])
def test_the_map_follows_the_motion(name, quantity):
    """Within the tolerance at the reference, and near it once it is set right there. Negative control: a map that is
    solved at the reference's amplitudes alone does not follow another start."""
    osc, p = case(name)
    fine, _ = plan_with_error(osc, p, TIMES, quantity, 1e-9)
    truth = fine.at_samples(osc, p)
    size = np.max(np.abs(truth))
    plan, stated = plan_of(osc, p, TIMES, quantity, 1e-4 * size)
    assert isinstance(plan, CyclePlan)
    assert stated <= 1e-4 * size
    assert np.max(np.abs(plan.at_samples(osc, p) - truth)) < 1.5 * stated
    right = plan.corrected(osc, plan.finer(osc, p, 5, TIMES, quantity), p)
    assert np.max(np.abs(right.at_samples(osc, p) - truth)) < 0.2 * stated
    q = moved(p)
    away = fine.at_samples(osc, q)
    assert np.max(np.abs(away - truth)) > 0.005 * size
    assert np.max(np.abs(right.at_samples(osc, q) - away)) < 0.3 * stated
    narrow = replace(right, span=jnp.mean(right.span) + 0.01 * (right.span - jnp.mean(right.span)))
    assert not np.all(np.isfinite(narrow.at_samples(osc, q)))


def test_an_independent_solver_agrees():
    osc, p = case("large swings")
    plan, _ = plan_of(osc, p, TIMES, "angle", 1e-5)

    def motion(_, s):
        drag = 2 * p["zeta"] * s[1] + p["mu_q"] * s[1] * abs(s[1])
        return [s[1], -drag - p["stiffness"] * np.sin(s[0] - p["rest_angle"])]

    begun = [p["theta0"], p["omega0"]]
    times = TIMES - TIMES[0]
    truth = solve_ivp(motion, (0, times[-1]), begun, "DOP853", times, rtol=1e-11, atol=1e-13).y[0]
    assert isinstance(plan, CyclePlan)
    assert np.max(np.abs(plan.at_samples(osc, p) - truth)) < 2e-5


def test_slopes_are_those_of_the_motion():
    """Forward tangents against differences of the map, by every parameter; parts and batches are of the whole."""
    osc, p = case("three terms, duffing")
    plan, _ = plan_of(osc, p, TIMES, "velocity", 1e-3)
    names = ("zeta", "mu_c", "mu_q", "stiffness", "cubic", "rest_angle", "theta0", "omega0")
    values = {n: jnp.asarray(v) for n, v in p.items()}
    assert isinstance(plan, CyclePlan)
    found, slopes = jax.jit(lambda q: with_slopes(lambda r: plan.record(osc, r), names, q))(values)
    np.testing.assert_allclose(found, plan.at_samples(osc, p), atol=1e-10)
    for name, slope in zip(names, slopes, strict=True):
        h = 1e-6 * max(abs(p[name]), 1.0) * (0.01 if name == "stiffness" else 1.0)
        up, down = (plan.at_samples(osc, {**p, name: p[name] + s * h}) for s in (1, -1))
        np.testing.assert_allclose(slope, (up - down) / (2 * h), atol=2e-4 * np.max(np.abs(slope)))
    middle = plan.of(slice(500, 2500)).of(slice(100, 1100))
    np.testing.assert_array_equal(middle.at_samples(osc, p), plan.at_samples(osc, p)[600:1600])
    np.testing.assert_allclose(middle.record(osc, values), found[600:1600], atol=1e-10)
    several = {n: np.array([v, moved(p)[n]]) for n, v in p.items()}
    both = middle.many_at_samples(osc, several)
    np.testing.assert_allclose(both[1], middle.at_samples(osc, moved(p)), atol=1e-10)


@pytest.mark.parametrize(
    ("change", "times"),
    [
        ({}, TIMES[:1500]),  # few cycles
        ({}, np.linspace(0.0, 300.0, 30_000)),  # so many samples that these would be what costs
        ({"zeta": 0.05}, TIMES),  # it ends long before the record does
        ({"zeta": 8.0}, TIMES),  # it does not oscillate
    ],
)
def test_other_records_are_solved_in_steps(change, times):
    osc, p = case("viscous linear")
    plan, _ = plan_of(osc, p | change, times, "angle", 1e-4)
    assert isinstance(plan, MeshPlan)


@pytest.fixture(scope="module")
def ring() -> tuple[Target, Mode]:
    """A ring-down of 300 cycles with a percent of noise, by its velocity: where zero is does not show."""
    osc, p = case("viscous linear")
    y = plan_with_error(osc, p, TIMES, "velocity", 1e-9)[0].at_samples(osc, p)
    signal = Signal(TIMES, y + 0.02 * np.random.default_rng(7).standard_normal(TIMES.size), "velocity")
    seen = features(signal)
    target = build_target(
        signal, ("viscous",), System("linear"), seen, Reference(seen.amplitude, seen.frequency)
    )
    near = {"zeta": 0.0042, "stiffness": RATE**2 * 1.0002, "theta0": 0.3, "omega0": 0.4}
    return target, find_mode(target, {Seed("near"): near}, noise_level=seen.roughness)


def test_mode_and_evidence_are_those_of_the_steps(ring, monkeypatch):
    """The same mode, log posterior and checks, and the evidence by importance sampling within four standard errors, as
    where the record is solved in steps."""
    target, mode = ring
    assert isinstance(mode.context.plan, CyclePlan)
    assert mode.likelihood_error < 0.01
    monkeypatch.setattr(cycles, "FEWEST", 10_000)
    plain = find_mode(
        target, {Seed("near"): {n: float(v) for n, v in target.values(mode.z).items()}}, noise_level=0.02
    )
    assert isinstance(plain.context.plan, MeshPlan)
    assert np.max(np.abs(mode.z - plain.z) / plain.sd()) < 0.02
    assert abs(mode.log_posterior - plain.log_posterior) < 0.01
    monkeypatch.undo()
    fits = [check_fit(target, m, 1.0, seed=1) for m in (mode, plain)]
    assert fits[0].verdict == fits[1].verdict == "fits"
    for one, other in zip(fits[0].rivals, fits[1].rivals, strict=True):
        assert abs(one.log_bayes - other.log_bayes) < 0.01
    assert abs(fits[0].window_spread - fits[1].window_spread) < 0.02
    one, other = (importance.PLUGIN.evidence("m", target, m, 3) for m in (mode, plain))
    assert one.outcome == other.outcome == "ok"
    assert abs(one.log_evidence - other.log_evidence) < 4 * np.hypot(one.stderr, other.stderr)


def test_a_batch_in_parts_is_the_batch(ring):
    """However many, and in their order; each as by itself."""
    target, mode = ring
    z = mode.z + 0.5 * np.random.default_rng(2).standard_normal((37, mode.z.size)) @ mode.factor.T
    z = np.where(np.asarray(target.layout.reflected), np.abs(z), z)
    found = np.asarray(compiled(target.layout).batch(mode.context, z))
    alone = [float(log_posterior(target.layout, mode.context, jnp.asarray(one))) for one in z[[0, 16, 36]]]
    np.testing.assert_allclose(found[[0, 16, 36]], alone, atol=1e-6)
    assert found.shape == (37,)
