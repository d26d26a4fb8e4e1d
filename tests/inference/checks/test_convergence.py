"""R̂, effective sample sizes, intervals and Pareto shapes: ArviZ's own to rounding, without its imports."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable

import numpy as np
import pytest
from arviz_stats.base.array import array_stats

from bayesdamp.inference.checks import diagnostics
from bayesdamp.numerics.pareto import pareto_k

SAME = 1e-10
SHAPES = [(4, 1000), (4, 1001), (2, 40), (3, 7), (1, 500), (5, 5), (4, 4)]
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
    if kind in ("slow", "swinging"):
        for i in range(1, shape[1]):
            x[:, i] += (0.9 if kind == "slow" else -0.7) * x[:, i - 1]
    if kind == "apart":
        x += 3.0 * np.arange(shape[0])[:, None]
    if kind == "stretched":
        x *= 1.0 + np.arange(shape[0])[:, None]
    if kind == "heavy":
        x = rng.standard_cauchy(shape)
    return np.round(x) if kind == "ties" else x


@pytest.mark.parametrize("shape", SHAPES, ids=str)
@pytest.mark.parametrize("kind", ["white", "slow", "swinging", "walk", "apart", "stretched", "heavy", "ties"])
def test_the_same_as_arviz(kind: str, shape: tuple[int, int]) -> None:
    x = chains(kind, shape)
    for name, (ours, theirs) in NUMBERS.items():
        if name == "rhat" and shape[0] == 1:
            assert np.isnan(ours(x))
            continue
        with np.errstate(all="ignore"):
            expected = float(theirs(x))
        np.testing.assert_allclose(ours(x), expected, rtol=SAME, err_msg=name)


def test_they_differ_where_chains_do() -> None:
    """Negative control: chains apart are told from chains alike, and slow ones are worth less."""
    alike, apart, slow = (chains(kind, (4, 1000)) for kind in ("white", "apart", "slow"))
    assert diagnostics.rhat(alike) < 1.01 < 1.5 < diagnostics.rhat(apart)
    assert diagnostics.ess_bulk(slow) < 0.2 * diagnostics.ess_bulk(alike)


@pytest.mark.parametrize("function", [ours for ours, _ in NUMBERS.values()])
def test_what_has_no_number_is_nan(function: Callable[[np.ndarray], float]) -> None:
    broken = chains("white", (4, 100))
    broken[1, 3] = np.nan
    assert np.isnan(function(broken))
    assert np.isnan(function(chains("white", (4, 3))))


def test_draws_that_never_move() -> None:
    x = np.ones((4, 100))
    assert diagnostics.ess_bulk(x) == diagnostics.effective_mean(x) == 400
    assert np.isnan(diagnostics.rhat(x))


@pytest.mark.parametrize("size", [30, 100, 226, 5000])
@pytest.mark.parametrize("degrees", [1.2, 3.0, 30.0])
def test_the_same_pareto_shape_as_arviz(size: int, degrees: float) -> None:
    rng = np.random.default_rng(size)
    for weights in (rng.exponential(size=size) / degrees, -0.5 * rng.chisquare(degrees, size)):
        with np.errstate(all="ignore"):
            expected = float(array_stats.psislw(-weights)[1])
        assert pareto_k(weights) == pytest.approx(expected, rel=SAME, abs=SAME)


@pytest.mark.parametrize("size", [40, 401, 4000])
def test_the_same_interval_as_arviz(size: int) -> None:
    x = np.random.default_rng(size).gamma(2.0, size=(2, size // 2))
    low, high = array_stats.hdi(x.reshape(-1), prob=0.95)
    summary = diagnostics.summarise(x)
    assert (summary["hdi_low"], summary["hdi_high"]) == (low, high)


def test_nothing_of_arviz_is_imported() -> None:
    code = (
        "import sys, numpy as np\nfrom bayesdamp.inference.checks import diagnostics\n"
        "diagnostics.summarise(np.random.default_rng(0).standard_normal((4, 100)))\n"
        "diagnostics.verdict({})\n"
        "found = {'arviz_stats', 'arviz_base', 'xarray', 'pandas'} & set(sys.modules)\n"
        "sys.exit(f'imported {found}' if found else 0)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
