"""The second half of a record from the first, where laws may hold approximately: against dense normal distributions of
all samples with SciPy's motions, and their conditional ones."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
import pytest
from scipy import stats
from scipy.special import logsumexp

import bayesdamp as bd
from bayesdamp.inference.checks.checks import Ahead
from bayesdamp.inference.deviation.linear import grid_of
from bayesdamp.inference.deviation.single import Single, first_half
from bayesdamp.inference.evidence.methods.importance import Importance
from bayesdamp.inference.evidence.sensitivity import log_predictive, predict
from bayesdamp.types import Evidence, Refusal
from tests.inference.deviation.drifts import KNOTS, NOISE, SCALE, STARTS, STIFFNESS, TIMES, motion

HALF = TIMES.size // 2
GRID = np.linspace(0.035, 0.085, 101)
KNOWN = {"stiffness": STIFFNESS, "rest_angle": 0.0, "theta0": STARTS[0], "omega0": 0.0, "noise_sd": NOISE}
MODEL = bd.Model("viscous", deviation="law", known=KNOWN, priors={"viscous": bd.HalfNormal(SCALE)})
ROUNDED = 0.02
"""Nats, and sds, that ends of the solver's steps and the curvature of the deviations are worth."""


@lru_cache
def law() -> Single:
    """Viscous damping that rises by 12 % over the record, only the coefficient of which is inferred."""
    y = motion(0.05, STARTS[0], 0.12 * np.linspace(-0.5, 0.5, KNOTS.size), np.zeros(KNOTS.size))
    y = y + NOISE * np.random.default_rng(4).standard_normal(TIMES.size)
    found = bd.fit(bd.signal(TIMES, y, cleaned=False), MODEL).law
    assert found is not None
    return found


@lru_cache
def predicted() -> tuple[Evidence, Ahead]:
    half = first_half(law())
    return predict("viscous", half.mode, partial(law().carried_on, half, seed=1), 1)


class Dense(NamedTuple):
    """Log evidence of the first half, log density of the second given it, and that one's mean and sd, (n,) each."""

    first: float
    second: float
    mean: np.ndarray
    sd: np.ndarray


@lru_cache
def dense(exact: bool = False) -> Dense:
    """Sum over ζ and the grid of hyperparameters; slopes of the deviations are finite differences."""
    u, n, d = law().best[0], KNOTS.size, 1e-4
    u = np.zeros(1 + 2 * n) if exact else u
    g, h = u[1 : 1 + n], u[1 + n :]
    y, slopes = law().weighing.data.y, np.zeros((TIMES.size, 2 * n))
    if not exact:
        middle = float(law().values(law().best)[0, 0])
        for i, step in enumerate(d * np.eye(2 * n)):
            up, down = (motion(middle, STARTS[0], g + s * step[:n], h + s * step[n:]) for s in (1, -1))
            slopes[:, i] = (up - down) / (2 * d)
    at = np.array([motion(z, STARTS[0], g, h) for z in GRID]) - slopes @ np.r_[g, h]
    left = y - at
    prior = stats.halfnorm(scale=SCALE).logpdf(GRID) + np.log(GRID[1] - GRID[0])
    grid = grid_of(n, exact=exact, absorbed=(True, False))
    first, second, means, variances = [], [], [], []
    for mass, factor in zip(grid.log_prior, grid.factors, strict=True):
        spread = slopes @ factor
        whole = NOISE**2 * np.eye(TIMES.size) + spread @ spread.T
        own, across = whole[:HALF, :HALF], whole[HALF:, :HALF]
        carried = np.linalg.solve(own, across.T).T
        given = whole[HALF:, HALF:] - carried @ across.T
        mean = at[:, HALF:] + left[:, :HALF] @ carried.T
        first.append(mass + prior + stats.multivariate_normal(cov=own).logpdf(left[:, :HALF]))
        second.append(stats.multivariate_normal(cov=given).logpdf(y[HALF:] - mean))
        means.append(mean)
        variances.append(np.diag(given))
    log = np.array(first)
    total = float(np.asarray(logsumexp(log)))
    w = np.exp(log - total)
    centre = np.einsum("cz,czm->m", w, np.array(means))
    square = np.einsum("cz,czm->m", w, (np.array(means) - centre) ** 2) + w.sum(axis=1) @ np.array(variances)
    assert max(w[:, 0].sum(), w[:, -1].sum()) < 1e-6  # GRID is wide enough
    return Dense(total, float(np.asarray(logsumexp(log - total + np.array(second)))), centre, np.sqrt(square))


def test_halves_make_the_whole() -> None:
    """The evidence of the first half, and its difference from the whole's, agree within four standard errors.

    The difference is the density of the second half given the first. Control: under exact laws both differ.
    """
    whole, half = (
        Importance().evidence("viscous", law().mode.likelihood.target, law().mode, 2),
        predicted()[0],
    )
    assert whole.outcome == half.outcome == "ok"
    assert abs(half.log_evidence - dense().first) < 4 * half.stderr + ROUNDED
    density, error = log_predictive(whole, half)
    assert abs(density - dense().second) < 4 * error + ROUNDED
    exact = dense(exact=True)
    assert abs(exact.first - dense().first) > 0.5
    assert abs(exact.second - dense().second) > 1


def test_the_second_half_is_predicted_with_the_first_s_deviations() -> None:
    """Mean within four Monte Carlo errors and a fiftieth of an sd, sds within a tenth. Control: under exact laws both
    are others."""
    found, truth = predicted()[1], dense()
    centre = law().weighing.data.y[HALF:] - found.error
    limit = 4 / np.sqrt(500) + ROUNDED
    assert np.max(np.abs(centre - truth.mean) / truth.sd) < limit
    assert found.sd == pytest.approx(truth.sd, rel=0.1)
    exact = dense(exact=True)
    assert np.max(np.abs(exact.mean - truth.mean) / truth.sd) > 2 * limit
    assert np.min(exact.sd / truth.sd) < 0.8


def test_what_is_not_cut_in_halves_says_so() -> None:
    one = law()
    few = one.weighing.data.first(30)
    with pytest.raises(Refusal, match="half the record has 15 samples for 17 parameters and deviations"):
        first_half(replace(one, weighing=replace(one.weighing, data=few)))
