"""Repeats whose laws hold approximately, each with deviations of its own: their joint posterior against dense normal
distributions with SciPy's motions, and what tells that they are no repeats."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import solve_ivp
from scipy.special import logsumexp

import bayesdamp as bd
from bayesdamp.inference.approximate.joined import Joined
from bayesdamp.inference.curves.weighted import shares, summarise
from bayesdamp.inference.deviation.gaussian.hyperparameters import grid_of
from bayesdamp.inference.deviation.sampled.marginal import Marginal, marginal_of
from bayesdamp.inference.many.joint import Joint, JointMode, find_joint_mode
from bayesdamp.inference.many.joint_evidence import Weighed, weigh

STIFFNESS, NOISE, SCALE = 20.0, 0.002, 0.5
TIMES = np.linspace(0.0, 20.0, 160)
KNOTS = np.linspace(0.0, 20.0, 8)
WAVE = np.sin(np.linspace(0.0, 2 * np.pi, KNOTS.size))
STARTS = (0.3, 0.25)
CASES = {"repeats": ((0.05, 0.1), (0.05, -0.1)), "two specimens": ((0.05, 0.0), (0.058, 0.0))}
"""Of each record its damping (1/s), and by how much that rises and falls once over the record."""


def motion(zeta: float, start: float, g: np.ndarray, h: np.ndarray) -> np.ndarray:
    """SciPy's solution with damping times exp(g) and the spring times 1 + 2h; the factors straight between knots."""

    def slope(t: float, s: np.ndarray) -> tuple[float, float]:
        factor = 1 + np.interp(t, KNOTS, np.expm1(g))
        return s[1], -2 * zeta * factor * s[1] - STIFFNESS * (1 + 2 * np.interp(t, KNOTS, h)) * s[0]

    found = solve_ivp(slope, (0, 20), (start, 0.0), t_eval=TIMES, rtol=1e-9, atol=1e-11, max_step=0.2)
    return found.y[0]


@lru_cache
def signals(case: str) -> tuple[bd.Signal, ...]:
    rng, nothing = np.random.default_rng(4), np.zeros(KNOTS.size)
    made = [
        motion(zeta, start, size * WAVE, nothing)
        for (zeta, size), start in zip(CASES[case], STARTS, strict=True)
    ]
    return tuple(bd.signal(TIMES, y + NOISE * rng.standard_normal(TIMES.size), cleaned=False) for y in made)


@lru_cache
def marginals(case: str) -> tuple[Marginal, ...]:
    found = []
    for signal, start in zip(signals(case), STARTS, strict=True):
        known = {"stiffness": STIFFNESS, "rest_angle": 0.0, "theta0": start, "omega0": 0.0, "noise_sd": NOISE}
        law = bd.fit(
            signal,
            bd.Model("viscous", deviation="law", known=known, priors={"viscous": bd.HalfNormal(SCALE)}),
        ).law
        assert law is not None
        found.append(marginal_of(law.single.weighing, law.single.result))
    return tuple(found)


@lru_cache
def shared(case: str) -> tuple[JointMode, Weighed]:
    records = [Joined(m) for m in marginals(case)]
    own = [m.result.fit.parameters.named(m.result.about.u[:1]) for m in marginals(case)]  # type: ignore[union-attr]
    mode = find_joint_mode(Joint(tuple(records), ("zeta",)), own)
    return mode, weigh(mode, seed=3)


GRID = np.linspace(0.047, 0.061, 113)


@lru_cache
def logs(case: str, record: int, exact: bool = False) -> np.ndarray:
    """Log likelihood of one record over GRID: normal distributions of all its samples, mixed over the grid of
    hyperparameters, whose covariances are made of SciPy's slopes by finite differences."""
    start, y, n, d = STARTS[record], signals(case)[record].y, KNOTS.size, 1e-4
    m = marginals(case)[record]
    u = np.zeros(1 + 2 * n) if exact else m.result.about.u  # type: ignore[union-attr]
    g, h = u[1 : 1 + n], u[1 + n :]
    left = np.array([y - motion(z, start, g, h) for z in GRID])
    slopes = np.zeros((TIMES.size, 2 * n))
    if not exact:
        middle = float(m.result.fit.parameters.values(u[:1])[0])
        for i, step in enumerate(d * np.eye(2 * n)):
            up, down = (motion(middle, start, g + s * step[:n], h + s * step[n:]) for s in (1, -1))
            slopes[:, i] = (up - down) / (2 * d)
        left += slopes @ np.r_[g, h]
    grid = grid_of(n, exact=exact, absorbed=(True, False))
    each = []
    for mass, factor in zip(grid.log_prior, grid.factors, strict=True):
        spread = slopes @ factor
        lower = np.linalg.cholesky(NOISE**2 * np.eye(TIMES.size) + spread @ spread.T)
        squares = np.sum(np.linalg.solve(lower, left.T) ** 2, axis=0)
        log_det = 2 * np.sum(np.log(np.diag(lower)))
        each.append(mass - 0.5 * (squares + log_det + TIMES.size * np.log(2 * np.pi)))
    return np.asarray(logsumexp(each, axis=0))


def by_sum(case: str, records: tuple[int, ...], exact: bool = False) -> tuple[float, float, float]:
    """Log evidence, mean and sd of ζ of some records together, by a sum over GRID."""
    log = sum(logs(case, j, exact) for j in records) + np.log(2 * stats.norm.pdf(GRID, scale=SCALE))
    total = float(logsumexp(log))
    w = np.exp(log - total)
    mean = float(w @ GRID)
    return total + float(np.log(GRID[1] - GRID[0])), mean, float(np.sqrt(w @ (GRID - mean) ** 2))


@pytest.mark.parametrize("case", CASES)
def test_the_joint_posterior_is_that_of_dense_normal_distributions(case: str) -> None:
    """Evidence within four standard errors and 0.05 nats, mean and sd within four Monte Carlo errors and a fiftieth,
    which ends of the solver's steps are worth. Control: under exact laws the same sum is another."""
    log_evidence, mean, sd = by_sum(case, (0, 1))
    mode, found = shared(case)
    assert found.outcome == "ok"
    said = summarise(mode.joint.values(found.scores)["zeta"], shares(found.log_weights))
    error = 4 / np.sqrt(found.effective)
    assert said["mean"] == pytest.approx(mean, abs=(error + 0.02) * sd)
    assert said["sd"] == pytest.approx(sd, rel=error + 0.02)
    assert abs(found.log_evidence - log_evidence) < 4 * found.stderr + 0.05
    exact = by_sum(case, (0, 1), exact=True)
    assert abs(exact[0] - log_evidence) > 2


def test_one_damping_with_other_deviations_is_one_damping() -> None:
    """Both records have one mean damping; that of the first rises where the other's falls. Laws that hold exactly call
    them two, and their joint mean is five sds and more from what each says; approximate laws leave one, within two sds
    of each record's own, and its interval holds the truth. Control: two dampings 16 % apart are two here as well."""
    factor = {}
    for exact in (True, False):
        alone = [by_sum("repeats", (j,), exact) for j in (0, 1)]
        both = by_sum("repeats", (0, 1), exact)
        factor[exact] = both[0] - sum(one[0] for one in alone)
        away = [abs(one[1] - both[1]) / one[2] for one in alone]
        assert min(away) > 5 if exact else max(away) < 2
    assert factor[True] < -10
    assert factor[False] > 0
    mode, found = shared("repeats")
    own = sum(by_sum("repeats", (j,))[0] for j in (0, 1))
    assert found.log_evidence - own == pytest.approx(factor[False], abs=0.1)
    said = summarise(mode.joint.values(found.scores)["zeta"], shares(found.log_weights))
    assert said["q2.5"] < 0.05 < said["q97.5"]
    apart = sum(by_sum("two specimens", (j,))[0] for j in (0, 1))
    assert shared("two specimens")[1].log_evidence - apart < -3


def test_slopes_of_what_no_deviation_takes() -> None:
    """With the start inferred too, of which deviations take no part: the slope is that of differences of the log
    likelihood, in an sd's units."""
    known = {"stiffness": STIFFNESS, "rest_angle": 0.0, "omega0": 0.0, "noise_sd": NOISE}
    law = bd.fit(
        signals("repeats")[0],
        bd.Model("viscous", deviation="law", known=known, priors={"viscous": bd.HalfNormal(SCALE)}),
    ).law
    assert law is not None
    density = marginal_of(law.single.weighing, law.single.result)
    _, _, information = density.curvature(law.single.found.z)
    sds = np.sqrt(np.diag(np.linalg.inv(information)))
    z = law.single.found.z + 0.5 * sds
    slope = density.curvature(z)[1]
    for i, sd in enumerate(sds):
        step = np.zeros(sds.size)
        step[i] = 1e-2 * sd
        low, high = density.log_likelihood(np.array([z - step, z + step]))
        assert slope[i] * sd == pytest.approx((high - low) / 2e-2, rel=2e-3, abs=2e-3)
