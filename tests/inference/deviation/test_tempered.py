"""The sampler against quadrature on a problem whose linear model is wrong."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import dblquad

from bayesdamp.inference.deviation import tempered
from bayesdamp.inference.deviation.linear import Grid, Weighed, condensed, weigh
from bayesdamp.inference.deviation.tempered import Sampled, sample_posterior

SD, SIZE = 0.5, 0.4
X = np.linspace(0.2, 1.0, 12)
Y = 2.2 * X + SD * np.sin(7 * np.arange(X.size))
GRID = Grid(
    np.array([0.0, SIZE]), np.zeros(2), np.log([0.3, 0.7]), np.array([np.zeros((2, 2)), np.diag([SIZE, 0.0])])
)
"""A coefficient z ≥ 0 with a half-normal prior, and a log deviation g of it, which is 0 or N(0, SIZE²)."""


def log_likelihood(z: np.ndarray | float, g: np.ndarray | float) -> np.ndarray:
    motion = np.multiply.outer(z * np.exp(g), X)
    return -0.5 * np.sum(((Y - motion) / SD) ** 2, axis=-1) - 0.5 * X.size * np.log(2 * np.pi * SD**2)


def linear(at: float = 2.0) -> tuple[Weighed, np.ndarray]:
    """Return the model that is linear about z = at, g = 0."""
    columns = np.column_stack([X, at * X, np.zeros(X.size)])
    model = condensed(columns, Y, np.array([True]))
    return weigh(model, GRID, SD**2, X.size), columns


def by_quadrature() -> tuple[float, float, float]:
    """Return the log evidence, and mean and sd of the product z exp(g)."""

    def moment(power: int) -> float:
        def density(z: float, g: float) -> float:
            prior = np.exp(-0.5 * z**2 - 0.5 * (g / SIZE) ** 2) / (np.pi * SIZE)
            return float(prior * np.exp(log_likelihood(z, g)) * (z * np.exp(g)) ** power)

        wide = dblquad(density, -6 * SIZE, 6 * SIZE, 0, 9, epsabs=1e-13)[0]
        narrow = np.linspace(0, 9, 20001)
        exact = np.sqrt(2 / np.pi) * np.exp(-0.5 * narrow**2 + log_likelihood(narrow, 0.0)) * narrow**power
        return 0.7 * wide + 0.3 * float(np.trapezoid(exact, narrow))

    whole = moment(0)
    mean = moment(1) / whole
    return float(np.log(whole)), mean, float(np.sqrt(moment(2) / whole - mean**2))


def drawn(seed: int) -> Sampled:
    weighed, columns = linear()

    def ratio(u: np.ndarray) -> np.ndarray:
        straight = -0.5 * np.sum(((Y - u @ columns.T) / SD) ** 2, axis=1)
        return log_likelihood(u[:, 0], u[:, 1]) + 0.5 * X.size * np.log(2 * np.pi * SD**2) - straight

    return sample_posterior(ratio, weighed, np.array([True]), draws=2000, seed=seed)


@pytest.mark.parametrize("few", [tempered.FEW, 2.0], ids=["at once", "tempered"])
def test_evidence_and_posterior_are_those_of_quadrature(few: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """They agree within four standard errors (false alarm 1 in 5,000 at a fixed seed), with at least half of the
    draws as effective sample size.

    Negative control: the linear model's own evidence and spread are further off.
    """
    log_evidence, mean, sd = by_quadrature()
    monkeypatch.setattr(tempered, "FEW", few)
    found = drawn(2)
    assert (found.acceptance < 1) == (few > 1)  # moves are made only where it is tempered
    assert found.trusted
    assert abs(found.log_evidence - log_evidence) < 4 * found.stderr
    assert found.stderr < 0.1
    product = found.draws[:, 0] * np.exp(found.draws[:, 1])
    assert product.mean() == pytest.approx(mean, abs=4 * sd / np.sqrt(1000))
    assert product.std() == pytest.approx(sd, rel=4 / np.sqrt(2 * 1000))
    weighed, _ = linear()
    assert abs(weighed.log_evidence - log_evidence) > 4 * found.stderr


def test_a_linear_model_that_is_right_costs_one_look_at_each_draw() -> None:
    weighed, _ = linear()
    found = sample_posterior(lambda u: np.zeros(len(u)), weighed, np.array([True]), draws=300)
    assert found.temperatures == 1
    assert found.log_evidence == pytest.approx(weighed.log_evidence, abs=1e-12)


def test_a_likelihood_that_no_draw_reaches_is_not_trusted() -> None:
    """Where every motion escapes there is no posterior to sample."""
    weighed, _ = linear()
    found = sample_posterior(lambda u: np.full(len(u), -np.inf), weighed, np.array([True]), draws=100)
    assert not found.trusted
