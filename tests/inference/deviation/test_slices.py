"""Draws and evidence of Stribeck friction, which use slices of its velocity, against quadrature."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import bayesdamp as bd
from bayesdamp.inference.deviation import sampling
from bayesdamp.inference.deviation.compare import compare_signal
from bayesdamp.inference.deviation.model_comparison import CandidateResult, ModelComparison
from bayesdamp.inference.deviation.slices import SlicedProposal
from validation.experiments.laws import case


def compared(signal: bd.Signal, **known: float) -> tuple[ModelComparison, CandidateResult]:
    comparison = compare_signal(signal, damping=["stribeck"], restoring=["linear"], known=known)
    return comparison, comparison.results[0]


@cache
def compared_case(**known: float) -> tuple[ModelComparison, CandidateResult]:
    simulated = case("stribeck", 8035)
    return compared(simulated.signal, noise_sd=simulated.noise_sd, **known)


def under_exact_laws(result: CandidateResult) -> CandidateResult:
    return replace(result, linearisation=None, approximate_posterior=None, variance=result.exact_variance)


def test_draws_and_evidence_are_those_of_quadrature_over_the_velocity(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """If the Stribeck velocity is known, the motion is nearly linear in all other parameters.

    The evidence agrees within a tenth of a nat, the sd of the static excess within 20 %, and its mean within a fifth
    of an sd (300 draws: false alarms below 1 in 1,000). Control: draws along the tangent have half of that sd.
    """
    comparison, result = compared_case()
    names, priors = result.fit.parameters.free_names, result.fit.parameters.priors
    place = names.index("static_excess")

    def drawn() -> tuple[np.ndarray, float]:
        sampled = sampling.sampled_result(comparison, under_exact_laws(result)).sampled
        return sampled.draws[:, place], sampled.log_evidence

    values, evidence = drawn()
    logs, means, squares, scores = [], [], [], np.linspace(0.0, 1.3, 14)
    prior = priors["stribeck_velocity"]
    for z in scores:
        _, given = compared_case(stribeck_velocity=float(prior.value(np.asarray(z))))
        posterior, parameters = given.exact_posterior, given.fit.parameters
        at = parameters.free_names.index("static_excess")
        rows = posterior.draws(2000, np.random.default_rng(0))[0][:, at]
        logs.append(posterior.log_evidence - 0.5 * z**2 - 0.5 * np.log(2 * np.pi))
        means.append(rows.mean())
        squares.append(np.mean(rows**2))
    density = np.exp(np.array(logs) - max(logs))
    whole = np.trapezoid(density, scores)
    mean = np.trapezoid(density * means, scores) / whole
    sd = np.sqrt(np.trapezoid(density * squares, scores) / whole - mean**2)
    assert evidence == pytest.approx(np.log(whole) + max(logs), abs=0.1)
    assert values.std() == pytest.approx(sd, rel=0.2)
    assert values.mean() == pytest.approx(mean, abs=0.2 * sd)
    monkeypatch.setattr(sampling, "slice_proposal", lambda *_: None)
    assert drawn()[0].std() < 0.8 * sd


def test_evidence_on_a_record_of_dry_friction_is_that_of_quadrature(monkeypatch: pytest.MonkeyPatch) -> None:
    """The best static excess is zero, so that the velocity has an effect only on draws.

    The evidence of five seeds has an sd of 0.02 and agrees with the quadrature within a tenth of a nat (false alarms
    below 1 in 100). Control: without slices it is more than a nat too low.
    """
    # With dry friction f the half cycles are cosines about -f and f, 2f smaller each time.
    t, frequency, loss, sd = np.linspace(0.0, 30.0, 1200), 2 * np.pi * 0.5, 0.008, 0.004
    half = np.floor(frequency * t / np.pi)
    clean = (0.5 - (2 * half + 1) * loss) * np.cos(frequency * t) + loss * (-1.0) ** half
    signal = bd.Signal(t, clean + sd * np.random.default_rng(8040).standard_normal(t.size))
    known = {"noise_sd": sd, "epsilon": 0.01}
    comparison, result = compared(signal, **known)
    result = under_exact_laws(result)

    def evidence() -> np.ndarray:
        results = (sampling.sampled_result(comparison, result, seed).sampled for seed in range(5))
        return np.array([sampled.log_evidence for sampled in results])

    prior = result.fit.parameters.priors["stribeck_velocity"]
    logs, scores = [], np.linspace(-4.0, 4.0, 17)
    for z in scores:
        fixed, own = compared(signal, **known, stribeck_velocity=float(prior.value(np.asarray(z))))
        sampled = sampling.sampled_result(fixed, under_exact_laws(own)).sampled
        logs.append(sampled.log_evidence - 0.5 * z**2 - 0.5 * np.log(2 * np.pi))
    whole = max(logs) + np.log(np.trapezoid(np.exp(np.array(logs) - max(logs)), scores))
    sliced = evidence()
    assert sliced.std(ddof=1) < 0.1
    assert sliced.mean() == pytest.approx(whole, abs=0.1)
    monkeypatch.setattr(sampling, "slice_proposal", lambda *_: None)
    assert abs(evidence().mean() - whole) > 0.5


def test_the_volume_of_redrawn_scores_is_that_of_their_jacobian() -> None:
    """By central differences, at draws moved within slices. Control: it is not one. `draw_solver` uses scores too."""
    comparison, result = compared_case()
    proposal = sampling.proposal_of(comparison, under_exact_laws(result))
    assert isinstance(proposal, SlicedProposal)
    solver, middle = sampling.draw_solver(result, proposal), proposal.scores(proposal.middle[None])
    usual = replace(solver, tolerance=sampling.TOLERANCE, correction=0.0)
    np.testing.assert_allclose(solver.at_each(middle, np.copy), usual.at_each(middle, np.copy), 0, 1e-14)
    rng = np.random.default_rng(3)
    w = proposal.redraw_within_slice(proposal.draws(5, rng)[0], rng)
    steps = 1e-6 * np.eye(w.shape[1])
    volume = proposal._scores(w)[1]
    for row, log in zip(w, volume, strict=True):
        columns = (proposal.scores(row + steps) - proposal.scores(row - steps)) / 2e-6
        assert np.linalg.slogdet(columns)[1] == pytest.approx(log, abs=1e-4)
    assert np.abs(volume).max() > 0.01
