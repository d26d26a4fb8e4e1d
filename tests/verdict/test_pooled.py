"""A quantity over several records: mean, spread, and what one more record would give."""

from dataclasses import astuple

import numpy as np
import pytest
from scipy.stats import norm

from bayesdamp.verdict.specimen import pool_records


def test_the_spread_of_a_single_record_is_zero() -> None:
    p = pool_records(np.array([2.0]), np.array([0.1]))
    assert (p.mean, p.sd, p.spread) == (2.0, 0.1, 0.0)
    assert (p.spread_low, p.spread_high) == (0.0, 0.0)
    assert (p.low, p.high) == pytest.approx((2.0 - 0.1959963984540054, 2.0 + 0.1959963984540054))


VALUES, SDS = np.array([0.30, 0.36, 0.29, 0.45]), np.array([0.02, 0.03, 0.01, 0.05])


def summed(values: np.ndarray, sds: np.ndarray, scale: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the posterior of mean and spread on a fine grid, shape (m, s), by normal densities alone; and the axes."""
    mean = np.linspace(values.mean() - 1.0, values.mean() + 1.0, 1601)
    spread = np.concatenate([np.linspace(0, 0.5, 1000, endpoint=False), np.linspace(0.5, 20 * scale, 3000)])
    log = np.zeros((mean.size, spread.size))
    for value, sd in zip(values, sds, strict=True):
        log += norm.logpdf(value, mean[:, None], np.sqrt(sd**2 + spread**2))
    density = np.exp(log - log.max()) / (1 + (spread / scale) ** 2) * np.gradient(spread)
    return density / density.sum(), mean, spread


@pytest.mark.parametrize("sds", [SDS, np.full(4, 0.02)], ids=["unequal", "equal"])
def test_mean_spread_and_prediction_are_those_of_a_sum_in_two_dimensions(sds: np.ndarray) -> None:
    """Mean, standard deviation, and the quantiles of the spread and of one more record, to 3 %."""
    density, mean, spread = summed(VALUES, sds, 2.0 * max(float(np.std(VALUES)), float(np.median(sds))))
    p = pool_records(VALUES, sds)
    middle = float(density.sum(axis=1) @ mean)
    assert p.mean == pytest.approx(middle, rel=3e-3)
    assert p.sd == pytest.approx(np.sqrt(density.sum(axis=1) @ (mean - middle) ** 2), rel=0.03)
    of_spread = np.cumsum(density.sum(axis=0))
    for quantile, q in ((p.spread_low, 0.025), (p.spread, 0.5), (p.spread_high, 0.975)):
        assert quantile == pytest.approx(np.interp(q, of_spread, spread), rel=0.03, abs=1e-3)
    width = np.sqrt(spread**2 + np.median(sds) ** 2)
    for end, q in ((p.low, 0.025), (p.high, 0.975)):
        assert np.sum(density * norm.cdf(end, mean[:, None], width)) == pytest.approx(q, abs=0.003)


def test_the_unit_does_not_matter() -> None:
    large, small = (np.array(astuple(pool_records(VALUES * unit, SDS * unit))) for unit in (1.0, 1e-6))
    assert small == pytest.approx(large * 1e-6, rel=1e-9)
