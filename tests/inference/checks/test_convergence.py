"""R̂, effective sample sizes, errors and Pareto shapes against those of ArviZ."""

import numpy as np
import pytest
from arviz_stats.base.array import array_stats

from bayesdamp.inference import diagnostics
from bayesdamp.numerics.weights import pareto_k

SAME = 1e-10
NUMBERS = {
    "rhat": (diagnostics.rhat, lambda x: array_stats.rhat(x)),
    "bulk": (diagnostics.ess_bulk, lambda x: array_stats.ess(x, method="bulk")),
    "tail": (diagnostics.ess_tail, lambda x: array_stats.ess(x, method="tail", prob=(0.05, 0.95))),
    "mean": (diagnostics.effective_mean, lambda x: array_stats.ess(x, method="mean")),
    "error": (diagnostics.monte_carlo_error, lambda x: array_stats.mcse(x, method="mean")),
}


def chains(kind: str, shape: tuple[int, int]) -> np.ndarray:
    rng = np.random.default_rng(shape[1])
    x = rng.standard_normal(shape)
    if kind == "walk":
        return np.cumsum(x, axis=1)
    if kind == "slow":
        for i in range(1, shape[1]):
            x[:, i] += 0.9 * x[:, i - 1]
    if kind == "apart":
        x += 3.0 * np.arange(shape[0])[:, None]
    if kind == "heavy":
        x = rng.standard_cauchy(shape)
    return np.round(x) if kind == "ties" else x


@pytest.mark.parametrize("kind", ["white", "slow", "walk", "apart", "heavy", "ties"])
def test_diagnostics_are_those_of_arviz(kind: str) -> None:
    for shape in ((4, 1000), (4, 1001), (3, 7), (1, 500)):
        x = chains(kind, shape)
        for name, (ours, theirs) in NUMBERS.items():
            if name == "rhat" and shape[0] == 1:
                assert np.isnan(ours(x))
                continue
            with np.errstate(all="ignore"):
                expected = float(theirs(x))
            np.testing.assert_allclose(ours(x), expected, rtol=SAME, err_msg=f"{name} of {shape}")


def test_diagnostics_of_missing_or_too_few_draws_are_nan() -> None:
    broken = chains("white", (4, 100))
    broken[1, 3] = np.nan
    for function, _ in NUMBERS.values():
        assert np.isnan(function(broken))
        assert np.isnan(function(chains("white", (4, 3))))
    assert np.isnan(diagnostics.rhat(np.ones((4, 100))))
    assert diagnostics.ess_bulk(np.ones((4, 100))) == 400


@pytest.mark.parametrize(("size", "degrees"), [(30, 1.2), (226, 3.0), (5000, 30.0)])
def test_the_pareto_shape_is_that_of_arviz(size: int, degrees: float) -> None:
    rng = np.random.default_rng(size)
    for weights in (rng.exponential(size=size) / degrees, -0.5 * rng.chisquare(degrees, size)):
        with np.errstate(all="ignore"):
            expected = float(array_stats.psislw(-weights)[1])
        assert pareto_k(weights) == pytest.approx(expected, rel=SAME, abs=SAME)
    assert pareto_k(np.full(size, -1299.27)) == -np.inf  # no tail
    assert pareto_k(np.r_[np.zeros(3), np.full(997, -1000.0)]) == np.inf  # too few for a shape
