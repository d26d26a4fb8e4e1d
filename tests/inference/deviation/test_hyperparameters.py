"""The grid over sizes and lengths of deviations: prior masses and covariances."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.stats import expon

from bayesdamp.inference.deviation.linear import (
    JITTER,
    LENGTHS,
    MEAN_G,
    MEAN_H,
    PROBABILITY_EXACT,
    grid_of,
    knots_of,
)


@pytest.mark.parametrize(("exact", "coarse"), [(False, True), (True, False)])
def test_masses_sum_to_one(exact: bool, coarse: bool) -> None:
    grid = grid_of(5, exact=exact, coarse=coarse)
    mass, p = np.exp(grid.log_prior), 1.0 if exact else PROBABILITY_EXACT
    assert mass.sum() == pytest.approx(1.0, abs=1e-12)
    assert mass[grid.size_g == 0].sum() == pytest.approx(p)
    assert mass[grid.size_h == 0].sum() == pytest.approx(p)
    assert mass[(grid.size_g == 0) & (grid.size_h == 0)].sum() == pytest.approx(p**2)
    assert grid.factors.shape == (mass.size, 10, 10)


def test_sizes_are_exponential() -> None:
    """Masses below each edge between neighbouring sizes are those of the exponential distribution."""
    grid = grid_of(4)
    mass = np.exp(grid.log_prior)
    for size, mean in ((grid.size_g, MEAN_G), (grid.size_h, MEAN_H)):
        for low, high in pairwise(np.unique(size[size > 0])):
            edge = np.sqrt(low * high)
            below = mass[(size > 0) & (size < edge)].sum() / (1 - PROBABILITY_EXACT)
            assert below == pytest.approx(expon.cdf(edge, scale=mean))
            assert abs(below - expon.cdf(edge, scale=1.2 * mean)) > 1e-4  # control


def test_covariances_are_exponential_in_the_distance() -> None:
    n = 6
    grid, s = grid_of(n), np.linspace(0, 1, n)
    kernels = np.array([np.exp(-np.abs(s[:, None] - s) / length) for length in LENGTHS])
    lengths = set()
    for size_g, size_h, factor in zip(grid.size_g, grid.size_h, grid.factors):
        whole = factor @ factor.T
        assert not np.any(whole[:n, n:])
        for size, part in ((size_g, whole[:n, :n]), (size_h, whole[n:, n:])):
            off = np.abs(part - size**2 * kernels).max(axis=(1, 2))
            assert off.min() <= 2 * JITTER * size**2
            lengths |= {int(off.argmin())} if size else set()
    assert lengths == set(range(len(LENGTHS)))


def test_there_is_a_knot_for_every_two_cycles_between_4_and_16() -> None:
    for cycles, knots in ((1.0, 4), (6.0, 4), (8.2, 5), (20.0, 11), (31.0, 16), (300.0, 16)):
        assert knots_of(12.5, cycles) == pytest.approx(np.linspace(0.0, 12.5, knots))


def test_deviations_have_no_mean_if_a_parameter_contains_it() -> None:
    """By the trapezoidal rule. Control: other deviations have a mean."""
    knots = 6
    weights = np.ones(knots)
    weights[[0, -1]] = 0.5
    for absorbed in ((True, False), (False, True), (True, True)):
        factors = grid_of(knots, coarse=True, absorbed=absorbed).factors
        means = np.stack([weights @ factors[:, :knots, :knots], weights @ factors[:, knots:, knots:]])
        for size, is_absorbed in zip(np.abs(means).max(axis=(1, 2)), absorbed, strict=True):
            assert (size < 1e-12) == is_absorbed
