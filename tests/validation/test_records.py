"""Simulated cases obey their rules, are determined by their seed, and deviate from the family by the stated amount."""

import pickle

import numpy as np
import pytest

from bayesdamp.types import Provenance
from tests.physics.independent import trajectory
from validation.truth import discrepancies as odd
from validation.truth.drawing import Draw
from validation.truth.oscillator import LAWS, SUMS, Oscillator
from validation.truth.records import FAMILY, KINDS, case, in_turn


def test_every_sum_of_dampings_is_combined_with_every_restoring_law() -> None:
    for kind in KINDS:
        sums = [s for s in SUMS if kind not in odd.COULOMB or "coulomb" in s]
        pairs = {in_turn(kind, number) for number in range(4 * len(sums))}
        assert pairs == {(s, law) for s in sums for law in LAWS}


def test_cases_of_the_family_obey_its_rules() -> None:
    cases = [case(FAMILY, 3, number) for number in range(8)]
    assert {c.damping for c in cases} == set(SUMS)
    assert {c.restoring for c in cases} == set(LAWS)
    for c in cases:
        assert min(c.shares[term] for term in c.damping.split("+")) >= 0.15
        assert sum(c.shares.values()) == pytest.approx(1.0)
        assert 8 <= c.cycles <= 60
        assert c.nats >= 12
        high, middle, low = c.amplitudes
        assert 0.09 < low / high < 0.8
        assert middle == pytest.approx(np.sqrt(low * high))
        assert 0.0025 < c.noise_sd / high < 0.04
        assert 14 < c.signal.t.size / c.cycles < 230
        assert c.signal.t[0] == 0.0
        assert c.signal.uniform
        assert all(1e-4 < c.ratio(a) < 0.2 for a in c.amplitudes)
        assert c.signal.provenance == Provenance()


@pytest.mark.parametrize("number", [0, 10])
def test_a_record_is_its_motion_with_white_noise_of_its_size(number: int) -> None:
    """Released at rest or not: the residual of SciPy's motion from the stated start is white noise of the stated size.

    Variance and first autocorrelation are within 5 standard deviations."""
    c = case(FAMILY, 5, number)
    residual = (c.signal.y - trajectory(c.restoring, c.parameters, c.signal.t)[:, 0]) / c.noise_sd
    n = residual.size
    assert abs(np.mean(residual**2) - 1) < 5 * np.sqrt(2 / n)
    assert abs(np.mean(residual[1:] * residual[:-1])) < 5 / np.sqrt(n)


def test_a_case_is_determined_by_its_seed_and_survives_pickling() -> None:
    c, again, other = case("jitter", 5, 2), case("jitter", 5, 2), case("jitter", 6, 2)
    assert np.array_equal(c.signal.y, again.signal.y)
    assert c.amplitudes == again.amplitudes
    assert not np.array_equal(c.signal.y[:50], other.signal.y[:50])
    assert pickle.loads(pickle.dumps(c)).ratio(c.amplitudes[1]) == c.ratio(c.amplitudes[1])


W, A, ZETA = 5.0, 0.3, 0.1


def test_discrepancies_of_the_damping_have_their_stated_size() -> None:
    """Of a linear spring at a rest angle of 0.2 rad with viscous and Coulomb damping, for 20 cycles."""
    spring = {"stiffness": W * W, "rest_angle": 0.2}
    oscillator = Oscillator("linear", spring, {"viscous": ZETA, "coulomb": 0.02})
    draw, rng = Draw(oscillator, -A, W, 20.0, 50.0, 0.0, 0.1, 0.01), np.random.default_rng(1)
    drift = odd.drift(rng, draw).scale
    assert abs(drift(draw.duration) - drift(0.0)) == pytest.approx(0.05)
    many = [odd.jitter(np.random.default_rng(i), draw).scale for i in range(300)]
    values = [scale(2 * np.pi / W * 2 * 3) for scale in many]  # at a knot: sd 0.03, within 5 of its own sd
    assert np.std(values) == pytest.approx(0.03, rel=5 / np.sqrt(600))
    friction = odd.angle_friction(rng, draw).damping
    largest = max(abs(friction(x, 1.0, 1.0)) for x in np.linspace(-A, A, 400))
    assert largest == pytest.approx(0.1 * 0.02, rel=1e-3)
    stribeck = odd.stribeck(rng, draw).damping
    assert stribeck(0.0, 0.0, 1.0) == pytest.approx(0.5 * 0.02)
    assert stribeck(0.0, 0.3 * A * W, 1.0) == pytest.approx(0.5 * 0.02 / np.e)


@pytest.mark.parametrize("kind", odd.KINDS)
def test_terms_of_the_family_dissipate_most_of_the_energy_of_a_discrepant_record(kind: str) -> None:
    for number in range(2):
        shares = case(kind, 4, number).shares
        terms = case(kind, 4, number).damping.split("+")
        extra = 1 - sum(shares[t] for t in terms)
        assert 0.1 < extra < 0.35 if kind in odd.TAKING else abs(extra) < 0.15
        assert min(shares[t] for t in terms) >= 0.15
        assert "coulomb" in terms or kind not in odd.COULOMB
