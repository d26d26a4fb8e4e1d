"""Draws along the ridge of Stribeck friction's own parameters, on a record of another solver."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import norm

from bayesdamp.inference.deviation import sampling
from bayesdamp.inference.deviation.quick import weighing_of
from bayesdamp.inference.deviation.ridge import Ridge
from bayesdamp.inference.deviation.sampling import SamplingStart, reference_of
from bayesdamp.inference.deviation.weighing import CandidateResult, Weighing
from bayesdamp.priors import SHARED_SIGMAS
from validation.experiments.laws import Case, case


@cache
def record() -> Case:
    found = case("stribeck", 8035)
    assert found.damping == "stribeck"
    return found


@cache
def weighed(**known: float) -> tuple[Weighing, CandidateResult]:
    signal, noise = record().signal, record().noise
    weighing = weighing_of(
        signal, damping=["stribeck"], restoring=["linear"], known={"noise_sd": noise, **known}
    )
    return weighing, weighing.results[0]


def under_exact_laws(result: CandidateResult) -> CandidateResult:
    return replace(result, about=None, weighed=None, variance=result.exact_variance)


@cache
def started(approximate: bool) -> tuple[Ridge, SamplingStart]:
    weighing, result = weighed()
    found = reference_of(weighing, result if approximate else under_exact_laws(result))
    assert isinstance(found.parameters, Ridge)
    return found.parameters, found


@pytest.mark.parametrize("approximate", [False, True])
def test_it_is_the_linear_model_at_the_mode_to_first_order(approximate: bool) -> None:
    ridge, start = started(approximate)
    z = ridge.base_scores(ridge.mode)
    np.testing.assert_allclose(z, ridge.mode, atol=1e-3)
    steps = 1e-4 * np.eye(z.size)
    ends = [(ridge.base_scores(ridge.mode + e), ridge.base_scores(ridge.mode - e)) for e in steps]
    slopes = np.array([(above - below) / 2e-4 for above, below in ends]).T
    sds = np.linalg.norm(start.weighed.factors[int(np.argmax(start.weighed.log_each))], axis=1)[: z.size]
    np.testing.assert_allclose(slopes * sds / sds[:, None], np.eye(z.size), atol=0.05)


def log_of_scales(z: np.ndarray, ridge: Ridge) -> float:
    """Return the log density of normal scores without constants, with the shared scale summed over."""
    shared = ridge.base.shared
    each = np.array([norm.logpdf(z[shared], 0.0, s).sum() for s in SHARED_SIGMAS])
    return float(logsumexp(each)) - 0.5 * float(np.sum(z[~shared] ** 2))


def test_the_prior_keeps_its_density() -> None:
    """The determinant agrees with differences of the scores; every positive score that is moved counts twice, as it
    is not cut off in u."""
    ridge, start = started(False)
    moved = int(np.sum(ridge.base.positive[ridge.moved]))
    assert moved == 2
    rows = start.weighed.draws(ridge.positive, 6, np.random.default_rng(3))[0]
    sizes = []
    for u in rows:
        z = ridge.plain(u)
        columns = [(ridge.plain(u + e) - ridge.plain(u - e)) / 2e-5 for e in 1e-5 * np.eye(u.size)]
        sizes.append(float(np.linalg.slogdet(np.array(columns).T)[1]))
        wanted = moved * np.log(2) + sizes[-1] + log_of_scales(z, ridge) - log_of_scales(u, ridge)
        assert ridge.log_prior_ratio(u) == pytest.approx(wanted, abs=1e-4)
    assert max(map(abs, sizes)) > 0.05  # else it would be none
    below = rows[0].copy()
    below[ridge.base.free_names.index("static_excess")] -= 5.0
    assert ridge.log_prior_ratio(below) == -np.inf


def test_posterior_is_that_of_quadrature_over_the_velocity(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the Stribeck velocity known the motion is nearly linear in everything else; the quadrature is over its
    prior.

    The evidence agrees within a tenth of a nat, the sd of the static excess within 20 %, and its mean within a fifth
    of an sd (300 draws: false alarms below 1 in 1,000). Control: draws along the tangent have half of that sd.
    """
    weighing, result = weighed()
    names, priors = result.fit.parameters.free_names, result.fit.parameters.priors
    place = names.index("static_excess")

    def drawn() -> tuple[np.ndarray, float]:
        found = sampling.sampled_result(weighing, under_exact_laws(result)).sampled
        assert found is not None
        return found.draws[:, place], found.log_evidence

    values, evidence = drawn()
    logs, means, squares, scores = [], [], [], np.linspace(0.0, 1.3, 14)
    prior = priors["stribeck_velocity"]
    for z in scores:
        _, one = weighed(stribeck_velocity=float(prior.value(np.asarray(z))))
        own = one.exact_weighed
        at = one.fit.parameters.free_names.index("static_excess")
        rows = own.draws(one.fit.parameters.positive, 2000, np.random.default_rng(0))[0][:, at]
        logs.append(own.log_evidence - 0.5 * z**2 - 0.5 * np.log(2 * np.pi))
        means.append(rows.mean())
        squares.append(np.mean(rows**2))
    density = np.exp(np.array(logs) - max(logs))
    whole = np.trapezoid(density, scores)
    mean = np.trapezoid(density * means, scores) / whole
    sd = np.sqrt(np.trapezoid(density * squares, scores) / whole - mean**2)
    assert evidence == pytest.approx(np.log(whole) + max(logs), abs=0.1)
    assert values.std() == pytest.approx(sd, rel=0.2)
    assert values.mean() == pytest.approx(mean, abs=0.2 * sd)
    monkeypatch.setattr(sampling, "ridge_of", lambda *_: None)
    narrow, _ = drawn()
    assert narrow.std() < 0.6 * sd
