"""Evidence of the laws of an envelope: against quadrature, for smaller damping, and in another unit of time."""

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.special import logsumexp

from bayesdamp.inference.deviation import linear
from bayesdamp.inference.envelope.candidates import Blocks, EnvelopeCandidate, fit_candidate
from bayesdamp.inference.envelope.noise import Noise
from bayesdamp.inference.envelope.sums import Sum
from bayesdamp.interface.envelopes import analyse
from bayesdamp.physics.amplitude import SUMS, DecayLaw
from bayesdamp.priors import SCORE_RATIO
from bayesdamp.records.envelope.record import make_record
from validation.truth.ringdowns import Ringdown, simulate

OMEGA = 2 * np.pi * 50.0
STEP = (0.3 / 1e-8) ** (1 / 25)
"""Ratio of neighbouring scales of the prior."""


def blocks(slower: float = 1.0, noise: float = 0.05) -> Blocks:
    """Return 60 readings of viscous and Coulomb damping of 3e-4 at 50 Hz with white noise, slower by a factor."""
    t = np.linspace(0.0, 15.0, 60) * slower
    rest = 0.035 / 0.065
    x = np.log((np.exp(1.2) + rest) * np.exp(-0.065 / slower * t) - rest)
    x += noise * np.random.default_rng(4).standard_normal(60)
    noises = ((Noise(1e-4, 1.0, 1e-8, 1.0, noise), noise**2 * np.eye(60)),)
    rate = float(x[0] - x[-1]) / float(t[-1])
    return Blocks(t, x, float(t[-1]), rate, frequency=OMEGA, noises=noises, inverse=np.eye(60) / noise)


def law(b: Blocks, terms: tuple[str, ...]) -> DecayLaw:
    return Sum(terms, b.ends[0], float(b.x.min())).law()


def all_candidates(b: Blocks) -> list[EnvelopeCandidate]:
    return [fit_candidate(b, law(b, terms)) for terms in SUMS]


def probabilities(candidates: Sequence[EnvelopeCandidate]) -> np.ndarray:
    logs = np.array([c.total for c in candidates])
    return np.exp(logs - logsumexp(logs))


def test_the_evidence_of_two_terms_is_the_integral_over_rates_and_scale():
    """Without deviations and with the given noise, on a fine grid of the solution of dA/dt = −vA − c."""
    b = blocks(noise=0.02)
    candidate = fit_candidate(b, law(b, ("viscous", "coulomb")))
    # Without a deviation, and with the second of three factors of the noise, exp(-0.25), 1 and exp(0.25).
    given = candidate.posterior.combos == np.flatnonzero(candidate.about.size == 0.0)[1]
    log_z = logsumexp(candidate.posterior.log_each[given]) - np.log(0.8) + np.log(3.0)
    grid = np.linspace(0.0, 0.16, 161)
    starts = np.linspace(1.16, 1.24, 33)
    viscous, coulomb = np.maximum(grid, 1e-9)[:, None, None], grid[:, None]
    logs = np.empty((grid.size, grid.size, starts.size))
    for k, start in enumerate(starts):
        rest = coulomb / viscous
        amplitude = (np.exp(start) + rest) * np.exp(-viscous * b.t) - rest
        x = np.log(np.maximum(amplitude, 1e-20))
        logs[:, :, k] = -0.5 * np.sum((b.x - x) ** 2, axis=2) / 0.02**2
    logs = logsumexp(logs, axis=2) + np.log((starts[1] - starts[0]) / (100.0 * np.sqrt(2 * np.pi)))
    weight = np.full(grid.size, grid[1])
    weight[0] *= 0.5
    totals = []
    for scale in 1e-8 * STEP ** (np.arange(25) + 0.5) * OMEGA:
        prior = np.log(2.0 / (scale * np.sqrt(2 * np.pi)) * weight) - 0.5 * (grid / scale) ** 2
        totals.append(logsumexp(logs + prior[:, None] + prior))
    truth = logsumexp(totals) - np.log(25) - 60 * np.log(0.02 * np.sqrt(2 * np.pi))
    assert log_z == pytest.approx(truth, abs=0.03)


def test_probabilities_do_not_depend_on_how_small_the_damping_is(monkeypatch):
    """The damping is 7,700 times smaller at the same frequency, by thirteen steps of the scales, which have no ends.
    Negative control: half-normals with one fixed scale."""
    monkeypatch.setattr(linear, "SHARED_SIGMAS", 1e-8 * STEP ** np.arange(-40, 66) / SCORE_RATIO)
    here, other = (probabilities(all_candidates(blocks(STEP**steps, 0.02))) for steps in (0, 13))
    assert 0.05 < here.max() < 0.999
    assert other == pytest.approx(here, abs=1e-6)
    monkeypatch.setattr(linear, "SHARED_SIGMAS", np.array([1e-3]) / SCORE_RATIO)
    here, other = (probabilities(all_candidates(blocks(STEP**steps, 0.02))) for steps in (0, 13))
    assert np.abs(other - here).max() > 0.05


def test_an_answer_without_a_frequency_does_not_depend_on_the_unit_of_time():
    ringdown = Ringdown({"viscous": 0.13, "coulomb": 0.005}, scatter=0.3, scatter_time=0.5, behind=15.0)
    truth = simulate(ringdown, np.random.default_rng(3))
    records = (make_record("x", truth.t * unit, truth.level, "dBm") for unit in (1.0, 2.0**13))
    here, other = (analyse(record).verdict.probabilities for record in records)
    assert other == pytest.approx(here, abs=1e-6)
