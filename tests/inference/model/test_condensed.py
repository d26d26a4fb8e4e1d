"""Condensed records: the same likelihood as the plain sum over all samples, at a cost without the samples in it."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import lru_cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import lfilter

from bayesdamp.inference.model.compiled import _solver, compiled
from bayesdamp.inference.model.condensed import Condensed, Singles, condense, room_of
from bayesdamp.inference.model.density import log_posterior, moving_values, parameters, reading
from bayesdamp.inference.model.gradient import value_and_gradient
from bayesdamp.inference.model.linearised import linearise, moving_names
from bayesdamp.inference.model.target import Context, Target
from bayesdamp.inference.noise import NOISES
from bayesdamp.physics.integrate import make_plan
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.solver.plan import compiled_record
from bayesdamp.physics.solver.steps import MeshPlan, nodes
from bayesdamp.priors import HalfNormal, LogNormal, Normal, Prior
from bayesdamp.types import Signal
from tests.inference import problems

COUNT = 20_011
"""Samples: a prime, to be known again among the shapes of a compiled program."""
TIMES = np.linspace(0.0, 10.0, COUNT)
NOISE, NOISE_TIME = 0.003, 0.05
KNOWN = {"gravity": 1.0, "spring_angle": 0.0, "epsilon": 0.1}
TRUTHS = {
    "viscous": {"zeta": 0.05},
    "coulomb": {"mu_c": 0.03},
    "viscous+quadratic": {"zeta": 0.03, "mu_q": 0.05},
}
MOTION = {"stiffness": 20.0, "theta0": 0.3, "omega0": 0.1}
NORMAL = ("gaussian", "correlated")


def noise_of(kind: str) -> np.ndarray:
    white = np.random.default_rng(3).standard_normal(COUNT)
    if kind == "gaussian":
        return NOISE * white
    rho = np.exp(-TIMES[1] / NOISE_TIME)
    white[1:] *= np.sqrt(1 - rho**2)
    return NOISE * lfilter([1.0], [1.0, -rho], white)


def target(damping: str, noise: str, quantity: str) -> tuple[Target, dict[str, float]]:
    """A target on a record of its own kind, and the truth."""
    osc = Oscillator(tuple(damping.split("+")), "horizontal_pendulum")
    truth = {**TRUTHS[damping], **MOTION, "noise_sd": NOISE, "noise_time": NOISE_TIME}
    p = {**truth, **KNOWN}
    y = make_plan(osc, p, TIMES, quantity, 1e-7).at_samples(osc, p) + noise_of(noise)
    priors: dict[str, Prior] = {n: HalfNormal(scale=10 * v) for n, v in TRUTHS[damping].items()}
    priors |= {"stiffness": LogNormal(median=20.0, sigma=0.5)}
    priors |= {"theta0": Normal(mean=0.0, sd=0.6), "omega0": Normal(mean=0.0, sd=2.0)}
    for name in NOISES.get(noise).parameters:
        priors[name] = LogNormal(median=truth.get(name, 6.0), sigma=1.0)
    return Target(Signal(TIMES, y, quantity), osc, noise, priors, KNOWN), truth


@lru_cache
def case(damping: str, noise: str, quantity: str = "angle") -> tuple[Target, np.ndarray, MeshPlan, Context]:
    """A target, scores of its truth, a coarse plan set right there, and its context."""
    found, truth = target(damping, noise, quantity)
    p = {**truth, **KNOWN}
    coarse = make_plan(found.oscillator, p, TIMES, quantity, 1e-4)
    plan = coarse.anchored(found.oscillator, coarse.finer(found.oscillator, p, 4, TIMES, quantity), p)
    assert isinstance(plan, MeshPlan)
    return found, found.scores(truth), plan, found.context(plan)


def condensed_of(context: Context) -> Condensed:
    assert context.condensed is not None
    return context.condensed


def moving(found: Target) -> list[int]:
    return [i for i, n in enumerate(found.names) if n in found.oscillator.parameters]


def fit(found: Target, plan: MeshPlan, z: np.ndarray) -> np.ndarray:
    return plan.at_samples(found.oscillator, found.all_values(z))


def white(found: Target, r: np.ndarray, p: dict[str, float]) -> np.ndarray:
    """Residuals as independent scores, in extended precision, by the definition of the noise."""
    r = r.astype(np.longdouble)
    if found.noise == "gaussian":
        return r / p["noise_sd"]
    rho = np.exp(-np.longdouble(TIMES[-1]) / (COUNT - 1) / p["noise_time"])
    return np.concatenate([r[:1], (r[1:] - rho * r[:-1]) / np.sqrt(1 - rho**2)]) / p["noise_sd"]


def plain(found: Target, plan: MeshPlan, z: np.ndarray) -> float:
    """Log posterior by the plain sum over all samples, in extended precision."""
    p = found.all_values(z)
    density = -0.5 * np.sum(white(found, found.signal.y - fit(found, plan, z), p) ** 2)
    density -= COUNT * (np.log(np.longdouble(p["noise_sd"])) + 0.5 * np.log(2 * np.pi))
    if found.noise == "correlated":
        rho = np.exp(-np.longdouble(TIMES[-1]) / (COUNT - 1) / p["noise_time"])
        density -= 0.5 * (COUNT - 1) * np.log(1 - rho**2)
    return density - 0.5 * np.sum(z**2) - 0.5 * z.size * np.log(2 * np.pi)


def information(found: Target, plan: MeshPlan, z: np.ndarray) -> np.ndarray:
    """Gauss–Newton information about the scores that move the trajectory, from differences and the plain sum."""
    slopes = []
    for i in moving(found):
        step = 1e-5 * np.eye(z.size)[i]
        slope = (fit(found, plan, z + step) - fit(found, plan, z - step)) / 2e-5
        slopes.append(white(found, slope, found.all_values(z)).astype(float))
    return np.array(slopes) @ np.array(slopes).T + np.eye(len(slopes))


def far(found: Target, plan: MeshPlan, z: np.ndarray) -> np.ndarray:
    """Four points ten posterior sds away in scores of motion and of noise, shape (4, d)."""
    rng = np.random.default_rng(1)
    factor = np.linalg.cholesky(np.linalg.inv(information(found, plan, z)))
    sds = {"noise_sd": (2 * COUNT) ** -0.5, "noise_time": (2 * NOISE_TIME / TIMES[-1]) ** 0.5}
    points = np.tile(z, (4, 1))
    for point in points:
        u = rng.standard_normal(z.size)
        u *= 10 / np.linalg.norm(u)
        point[moving(found)] += factor @ u[: len(factor)]
        for i, name in enumerate(found.names):
            point[i] += sds.get(name, 0.0) * u[i]
    return points


def disagreement(found: Target, plan: MeshPlan, context: Context, z: np.ndarray) -> tuple[float, float]:
    """Largest difference of log posterior differences, condensed and plain, and the smallest drop, over `far`."""
    run = problems.height(found.layout)
    points = [z, *far(found, plan, z)]
    ours = np.array([float(run(context, jnp.asarray(x))) for x in points])
    theirs = np.array([plain(found, plan, x) for x in points])
    apart = (ours[1:] - ours[0]) - (theirs[1:] - theirs[0])
    return float(np.max(np.abs(apart))), float(theirs[0] - np.max(theirs[1:]))


@pytest.mark.parametrize("noise", NORMAL)
@pytest.mark.parametrize("damping", TRUTHS)
@pytest.mark.parametrize("quantity", ["angle", "velocity"])
def test_agrees_with_the_plain_sum(noise, damping, quantity):
    """Within 1e-6 ten posterior sds from the truth, where the posterior is lower by tens of nats."""
    found, z, plan, context = case(damping, noise, quantity)
    assert isinstance(context.condensed, Condensed)
    apart, drop = disagreement(found, plan, context, z)
    assert apart < 1e-6
    assert drop > 10


def test_acceleration_too():
    found, z, plan, context = case("viscous", "gaussian", "acceleration")
    assert disagreement(found, plan, context, z)[0] < 1e-6


def without_straddling(context: Context) -> Context:
    """Pairs of samples on two sides of a node left out."""
    inside, pairs = condensed_of(context).sums["differences"]
    assert isinstance(pairs, Singles)
    none = replace(pairs, present=jnp.zeros_like(pairs.present))
    sums = {**condensed_of(context).sums, "differences": (inside, none)}
    return replace(context, condensed=replace(condensed_of(context), sums=sums))


def wrong_trajectory(context: Context) -> Context:
    """Counted from another trajectory than the one that was taken off the record."""
    near = condensed_of(context).near
    return replace(context, condensed=replace(condensed_of(context), near=near.at[5, 0].add(1e-7)))


@pytest.mark.parametrize("spoilt", [without_straddling, wrong_trajectory])
def test_negative_controls(spoilt):
    found, z, plan, context = case("viscous", "correlated")
    assert disagreement(found, plan, spoilt(context), z)[0] > 1e-6


@pytest.mark.parametrize("noise", NORMAL)
def test_gradient_and_information(noise):
    """The gradient is that of differences, off the truth; the information that of the plain sum."""
    found, z, plan, context = case("viscous", noise)
    at = z + 0.01 * np.linspace(-1, 1, z.size)
    value, gradient, found_information = map(
        np.asarray, compiled(found.layout).curvature(context, jnp.asarray(at))
    )
    run = problems.height(found.layout)
    d = 1e-6
    differences = np.array(
        [
            (run(context, jnp.asarray(at + s)) - run(context, jnp.asarray(at - s))) / (2 * d)
            for s in d * np.eye(z.size)
        ]
    )
    assert float(value) == pytest.approx(float(run(context, jnp.asarray(at))), abs=1e-6)
    scale = np.max(np.abs(differences))
    np.testing.assert_allclose(gradient, differences, atol=1e-5 * scale)
    assert scale > 10  # negative control: the gradient does not vanish here
    block = found_information[np.ix_(moving(found), moving(found))]
    np.testing.assert_allclose(block, information(found, plan, at), rtol=1e-4, atol=1e-4 * np.max(block))


@pytest.mark.parametrize("noise", NORMAL)
def test_sums_along_a_trajectory_are_those_of_all_its_nodes(noise):
    """And their tangents: what a sampler needs has no trajectory kept, what Gauss and Newton need has."""
    found, z, _, context = case("viscous+quadratic", noise)
    lean, sums = context.lean, condensed_of(context)
    assert isinstance(lean.plan, MeshPlan)
    at = jnp.asarray(z + 0.02)
    value, gradient = jax.jit(partial(value_and_gradient, found.layout))(lean, at)
    by_nodes = compiled(found.layout).curvature(context, at)
    assert float(value) == pytest.approx(float(by_nodes[0]), rel=1e-11)
    np.testing.assert_allclose(gradient, by_nodes[1], rtol=1e-8)
    p = {n: jnp.asarray(v) for n, v in found.all_values(np.asarray(at)).items()}
    kept = sums.split(sums.misfit(nodes(found.oscillator, lean.plan.steps, lean.plan.count, p)))
    streamed = sums.sums_along(found.oscillator, lean.plan.steps, lean.plan.count, p)
    for name, part in kept.items():
        assert float(streamed[name]) == pytest.approx(float(jnp.sum(part**2)), rel=1e-11)
    short = sums.sums_along(found.oscillator, lean.plan.steps, lean.plan.count - 1, p)
    assert float(short["squares"]) < 0.999 * float(streamed["squares"])  # negative control: a step too few


@pytest.mark.parametrize("noise", NORMAL)
def test_a_tight_line_is_the_linearised_posterior(noise):
    found, z, _, context = case("viscous", noise)
    functions, at = compiled(found.layout), jnp.asarray(z)
    points = jnp.asarray(far(found, case("viscous", noise)[2], z))
    wide = functions.linearised_batch(context, functions.linearise(context, at), points)
    tight = functions.linearised_batch(context, functions.tight(context, at), points)
    np.testing.assert_allclose(tight, wide, rtol=1e-10)
    elsewhere = functions.linearised_batch(context, functions.tight(context, at + 1e-3), points)
    assert not np.allclose(elsewhere, wide, rtol=1e-10)  # negative control


@pytest.mark.parametrize("noise", [*NORMAL, "student_t"])
def test_one_solver_program_serves_all_noises(noise):
    """What is read off its nodes is the derivative of the misfit itself, and an own coefficient's is not another's."""
    found, z, _, context = case("viscous", noise)
    at = jnp.asarray(z)
    e, slopes, x = compiled(found.layout).linearise(context, at)
    index = jnp.asarray(moving(found))
    direct = jax.jit(
        lambda z: reading(found.layout, context.lean).misfit(parameters(found.layout, context.lean, z))
    )
    np.testing.assert_allclose(e, direct(at), rtol=1e-9, atol=1e-9 * float(jnp.abs(e).max()))
    by_z = jax.jit(jax.jacfwd(direct))(at)[:, index].T
    values = lambda z: moving_values(found.layout, context.lean, z)  # noqa: E731
    by_value = by_z / jax.jvp(values, (at,), (jnp.ones_like(at),))[1][:, None]
    size = float(jnp.abs(by_value).max())
    np.testing.assert_allclose(slopes, by_value, rtol=1e-7, atol=1e-9 * size)
    np.testing.assert_array_equal(x, values(at))
    assert not np.allclose(slopes[::-1], by_value, rtol=1e-7, atol=1e-9 * size)  # negative control
    assert _solver(found.oscillator, moving_names(found.layout)) is _solver(
        found.oscillator, moving_names(found.layout)
    )


@pytest.mark.parametrize("noise", NORMAL)
def test_no_shape_of_the_program_is_that_of_the_record(noise):
    """Posterior and its tangents; the plain sum's program has it."""
    found, z, _, context = case("viscous", noise)
    at = jnp.asarray(z)
    length = re.compile(rf"\b({COUNT}|{COUNT - 1})x")
    for fun in (log_posterior, linearise):
        run = jax.jit(partial(fun, found.layout))
        assert not length.search(run.lower(context.lean, at).as_text())
        assert length.search(run.lower(replace(context, condensed=None), at).as_text())
    e, slopes, _ = linearise(found.layout, context, at)
    assert context.condensed is not None
    assert e.size <= 14 * context.condensed.room + 2, "fourteen numbers a step, and what is left over"
    assert e.size < COUNT
    assert slopes.shape == (len(moving(found)), e.size)


def test_a_part_of_a_record():
    """The last half, as a window of the checks takes it: first and last pair included."""
    found, z, plan, _ = case("viscous", "correlated")
    part = slice(COUNT // 2, COUNT)
    context = found.context(plan.of(part), part)
    assert context.condensed is not None
    run = problems.height(found.layout)
    points = [jnp.asarray(x) for x in (z, z + 0.01)]
    ours, theirs = ([float(run(c, x)) for x in points] for c in (context, replace(context, condensed=None)))
    assert ours[1] - ours[0] == pytest.approx(theirs[1] - theirs[0], abs=1e-6)


def test_steps_without_samples():
    """A gap in the record that swallows whole steps: the pair across it belongs to two distant steps."""
    found, _, plan, context = case("viscous", "correlated")
    kept = np.flatnonzero((TIMES < 4.0) | (TIMES > 5.5))
    cut = replace(plan, interval=plan.interval[kept], weights=plan.weights[kept], anchor=None)
    y = found.signal.y[kept]
    # On a clock of its own: the pairs, not the times, are what is tested.
    sums = condense(NOISES.get("correlated"), cut, TIMES[: kept.size], y)
    assert sums is not None
    state = condensed_of(context).near * 1.001
    parts = sums.split(sums.misfit(state))
    wide = np.zeros((plan.steps.size + 1, 3))
    wide[: len(state)] = state
    pairs = np.concatenate([wide[np.asarray(cut.interval)], wide[np.asarray(cut.interval) + 1]], axis=1)
    r = y - np.sum(pairs * np.asarray(cut.weights), axis=1)
    for name, expected in {
        "squares": np.sum(r**2),
        "differences": np.sum(np.diff(r) ** 2),
        "ends": r[0] ** 2 + r[-1] ** 2,
    }.items():
        assert float(jnp.sum(parts[name] ** 2)) == pytest.approx(expected, rel=1e-11)


def test_samples_so_far_apart_that_no_step_has_two():
    """All differences straddle a node."""
    found, z, plan, _ = case("viscous", "correlated")
    kept = np.searchsorted(np.asarray(plan.interval), np.arange(3, int(plan.count), 3))
    times = np.arange(kept.size) * 0.1  # a clock of its own: the sums, not the times, are what is tested
    cut = replace(plan, interval=plan.interval[kept], weights=plan.weights[kept], anchor=None)
    y = found.signal.y[kept]
    sums = condense(NOISES.get("correlated"), cut, times, y)
    assert sums is not None
    p = {n: jnp.asarray(v) for n, v in found.all_values(z).items()}
    r = y - np.asarray(cut.record(found.oscillator, p))
    streamed = sums.sums_along(found.oscillator, plan.steps, plan.count, p)
    assert float(streamed["squares"]) == pytest.approx(np.sum(r**2), rel=1e-9)
    assert float(streamed["differences"]) == pytest.approx(np.sum(np.diff(r) ** 2), rel=1e-9)


def test_when_the_plain_sum_stays():
    """Another kind of noise, correlated noise on an uneven clock, exact friction."""
    found, _, plan, context = case("viscous", "gaussian")
    y, gaussian, correlated = found.signal.y, NOISES.get("gaussian"), NOISES.get("correlated")
    assert context.condensed is not None
    assert condense(NOISES.get("student_t"), plan, TIMES, y) is None
    jitter = TIMES + 1e-3 * TIMES[1] * np.random.default_rng(0).uniform(-1, 1, COUNT)
    assert condense(gaussian, plan, jitter, y) is not None
    assert condense(correlated, plan, TIMES, y) is not None
    assert condense(correlated, plan, jitter, y) is None
    sharp = Oscillator(("coulomb",), "linear")
    p = {"mu_c": 0.03, "stiffness": 20.0, "rest_angle": 0.0, "theta0": 0.3, "omega0": 0.0, "epsilon": 0.0}
    assert condense(gaussian, make_plan(sharp, p, TIMES, tolerance=1e-3), TIMES, y) is None


def test_anchored_plan():
    """Set right at its anchor a coarse plan is as good as one of a fifth of its steps, and near there too; far from
    there (negative control) it is not."""
    osc = Oscillator(("viscous",), "horizontal_pendulum")
    p = {**TRUTHS["viscous"], **MOTION, **KNOWN}
    times = TIMES[::20]
    coarse = make_plan(osc, p, times, tolerance=1e-4)
    finer = coarse.finer(osc, p, 5, times, "angle")
    plan = coarse.anchored(osc, finer, p)

    def error(of, share: float) -> float:
        q = {**p, "theta0": p["theta0"] * (1 + share), "stiffness": p["stiffness"] * (1 + share)}
        return float(np.max(np.abs(of.at_samples(osc, q) - finer.at_samples(osc, q))))

    assert error(coarse, 0.0) > 1e-6
    assert error(plan, 0.0) < 1e-14
    # Half of 1e-4 of the frequency is 0.002 rad of phase in ten seconds: that share of the error is left.
    assert error(plan, 1e-4) < 0.01 * error(coarse, 1e-4)
    assert error(plan, 0.3) > 0.1 * error(coarse, 0.3)
    values = {n: jnp.asarray(p[n]) for n in osc.parameters}
    np.testing.assert_allclose(compiled_record(osc)(plan, values), plan.at_samples(osc, p), atol=1e-13)


@pytest.mark.parametrize(("count", "most", "room"), [(512, 4096, 512), (513, 4096, 2048), (600, 1024, 1024)])
def test_all_steps_have_room(count, most, room):
    none = jnp.zeros(0)
    assert room_of(MeshPlan(jnp.zeros(most), jnp.asarray(count), none, none)) == room
