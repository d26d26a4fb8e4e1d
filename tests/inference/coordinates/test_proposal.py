"""The reflected Student t that evidence is sampled from."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import dblquad, quad
from scipy.stats import kstest, multivariate_t

from bayesdamp.inference.evidence.methods.importance import DEGREES, Importance, ReflectedT
from tests.inference import problems

FACTOR = np.array([[0.7, 0.0], [0.4, 0.5]])


def reflected(centre: float) -> ReflectedT:
    return ReflectedT(np.array([centre]), np.array([[0.8]]), np.array([True]))


@pytest.mark.parametrize("centre", [0.0, 0.4, 3.0])
def test_one_direction_integrates_to_one(centre):
    q = reflected(centre)
    total = quad(lambda x: float(np.exp(q.log_density(np.array([[x]]))[0])), 0, np.inf, limit=200)[0]
    assert total == pytest.approx(1.0, abs=1e-7)


def test_two_directions_integrate_to_one():
    q = ReflectedT(np.array([0.3, -0.5]), FACTOR, np.array([True, False]))
    total = dblquad(
        lambda y, x: float(np.exp(q.log_density(np.array([[x, y]]))[0])), 0, 40, -40, 40, epsabs=1e-5
    )[0]
    assert total == pytest.approx(1.0, abs=1e-4)


def test_without_folds_it_is_the_student_t():
    q = ReflectedT(np.array([0.3, -0.5]), FACTOR, np.array([False, False]))
    x = np.random.default_rng(0).normal(size=(50, 2))
    law = multivariate_t([0.3, -0.5], FACTOR @ FACTOR.T, df=DEGREES)
    np.testing.assert_allclose(q.log_density(x), law.logpdf(x), atol=1e-12)


def test_all_images_of_a_fully_folded_one():
    """The density of |x| is the sum over the four sign patterns."""
    q = ReflectedT(np.array([0.3, 0.5]), FACTOR, np.array([True, True]))
    law = multivariate_t([0.3, 0.5], FACTOR @ FACTOR.T, df=DEGREES)
    y = np.abs(np.random.default_rng(1).normal(size=(20, 2)))
    images = sum(law.pdf(y * np.array(s)) for s in ((1, 1), (1, -1), (-1, 1), (-1, -1)))
    np.testing.assert_allclose(q.log_density(y), np.log(images), atol=1e-12)


def test_draws_follow_the_density():
    """Kolmogorov–Smirnov over 2,000 draws at a false-alarm rate of 1e-3."""
    q = reflected(0.4)
    draws = q.draw(np.random.default_rng(2), 2000)[:, 0]
    assert np.all(draws >= 0)
    grid = np.linspace(0, 60, 120_001)
    mass = np.exp(q.log_density(grid[:, None]))
    cdf = np.concatenate([[0.0], np.cumsum(0.5 * (mass[1:] + mass[:-1]))]) * (grid[1] - grid[0])
    assert kstest(draws, lambda x: np.interp(x, grid, cdf)).pvalue > 1e-3


def test_negative_control_one_side_alone():
    """Without the mirror image the density near zero does not integrate to one."""
    q = reflected(0.4)
    q._signs = q._signs[:1]
    total = quad(lambda x: float(np.exp(q.log_density(np.array([[x]]))[0])), 0, np.inf, limit=200)[0]
    assert total < 0.9


def test_a_refit_without_covariance_keeps_the_proposal(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where a few draws have all the weight the evidence is given with its diagnostic, no fault."""

    plain = Importance().evidence("m", problems.target("touching_zero"), problems.mode("touching_zero"), 1)
    monkeypatch.setattr(Importance, "_refit", staticmethod(lambda *_: None))
    monkeypatch.setattr("bayesdamp.inference.evidence.methods.importance.K_GOOD", -np.inf)
    evidence = Importance().evidence("m", problems.target("touching_zero"), problems.mode("touching_zero"), 1)
    assert abs(evidence.log_evidence - plain.log_evidence) < 5 * np.hypot(evidence.stderr, plain.stderr)


def test_a_few_draws_span_no_fit() -> None:
    """Of two directions: two draws with all the weight, or one; the control: all of them."""
    y, reflected = np.random.default_rng(3).standard_normal((1000, 2)), np.zeros(2, bool)
    weights = np.full(1000, -300.0)
    assert Importance._refit(y, weights, reflected) is not None
    for heavy in (1, 2):
        weights[:heavy] = 0.0
        assert Importance._refit(y, weights, reflected) is None


def test_a_remedy_that_makes_it_worse_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fit elsewhere, though the first one were poor; the control: with that fit alone nothing is found."""
    target, mode = problems.target("touching_zero"), problems.mode("touching_zero")
    plain = Importance().evidence("m", target, mode, 1)
    reflected = target.reflected
    elsewhere = ReflectedT(np.abs(mode.z) + 30 * mode.sd(), mode.factor, reflected)
    monkeypatch.setattr("bayesdamp.inference.evidence.methods.importance.K_GOOD", -np.inf)
    monkeypatch.setattr(Importance, "_refit", staticmethod(lambda *_: None))
    monkeypatch.setattr(
        Importance, "_truncated", staticmethod(lambda target, mode, fit, shear: (elsewhere, shear))
    )
    evidence = Importance().evidence("m", target, mode, 1)
    assert abs(evidence.log_evidence - plain.log_evidence) < 5 * np.hypot(evidence.stderr, plain.stderr)
    monkeypatch.setattr(
        "bayesdamp.inference.evidence.methods.importance.effective", lambda weights: -np.max(weights)
    )
    lost = Importance().evidence("m", target, mode, 1)
    assert abs(lost.log_evidence - plain.log_evidence) > 1
