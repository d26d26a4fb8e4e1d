"""Simulated cases keep their rules, come from their seed, and differ from the family as they say."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bayesdamp.types import InputError, Provenance
from validation.truth import discrepancies as odd
from validation.truth.drawing import Draw
from validation.truth.oscillator import COEFFICIENTS, LAWS, SUMS, Oscillator
from validation.truth.records import FAMILY, KINDS, Case, case, in_turn


def oscillator_of(made: Case) -> Oscillator:
    damping = {term: made.parameters[COEFFICIENTS[term]] for term in made.damping.split("+")}
    law = {name: made.parameters[name] for name in LAWS[made.restoring]}
    return Oscillator(made.restoring, law, damping, made.parameters["epsilon"])


def test_every_sum_meets_every_law() -> None:
    for kind in KINDS:
        sums = [s for s in SUMS if kind not in odd.COULOMB or "coulomb" in s]
        pairs = {in_turn(kind, number) for number in range(4 * len(sums))}
        assert pairs == {(s, law) for s in sums for law in LAWS}


def test_the_family_keeps_its_rules() -> None:
    cases = [case(FAMILY, 3, number) for number in range(8)]
    assert {c.damping for c in cases} == set(SUMS)
    assert {c.restoring for c in cases} == set(LAWS)
    for made in cases:
        assert min(made.shares[term] for term in made.damping.split("+")) >= 0.15
        assert sum(made.shares.values()) == pytest.approx(1.0)
        assert 8 <= made.cycles <= 60
        assert made.nats >= 12
        high, middle, low = made.amplitudes
        assert 0.09 < low / high < 0.8
        assert middle == pytest.approx(np.sqrt(low * high))
        assert 0.0025 < made.noise_sd / high < 0.04
        assert 14 < made.signal.t.size / made.cycles < 230
        assert made.signal.t[0] == 0.0
        assert made.signal.uniform
        assert all(1e-4 < made.ratio(a) < 0.2 for a in made.amplitudes)
        assert made.signal.provenance == Provenance()


@pytest.mark.parametrize("number", [0, 10])
def test_a_record_is_its_motion_with_white_noise_of_its_size(number: int) -> None:
    """Released at rest or not, the motion from the stated start misses it by noise: its variance is within 5 sd."""
    made = case(FAMILY, 5, number)
    state = [made.parameters["theta0"], made.parameters["omega0"]]
    acceleration = oscillator_of(made).acceleration()
    found = solve_ivp(
        lambda t, s: [s[1], acceleration(t, s[0], s[1], np.sign(s[1]))], (0.0, made.signal.t[-1]), state,
        t_eval=made.signal.t, rtol=1e-7, atol=1e-9, max_step=0.1 * made.signal.t[-1] / made.cycles,
    )  # fmt: skip
    residual = (made.signal.y - found.y[0]) / made.noise_sd
    n = residual.size
    assert abs(np.mean(residual**2) - 1) < 5 * np.sqrt(2 / n)
    assert abs(np.mean(residual[1:] * residual[:-1])) < 5 / np.sqrt(n)


def test_cases_come_from_their_seed() -> None:
    made, again, other = case("jitter", 5, 2), case("jitter", 5, 2), case("jitter", 6, 2)
    assert np.array_equal(made.signal.y, again.signal.y)
    assert made.amplitudes == again.amplitudes
    assert not np.array_equal(made.signal.y[:50], other.signal.y[:50])
    copy = pickle.loads(pickle.dumps(made))
    assert copy.ratio(made.amplitudes[1]) == made.ratio(made.amplitudes[1])


W, A, ZETA = 5.0, 0.3, 0.1


def a_draw() -> Draw:
    """A linear spring at a rest angle of 0.2 rad with viscous and Coulomb damping, 20 cycles from its release on."""
    spring = {"stiffness": W * W, "rest_angle": 0.2}
    oscillator = Oscillator("linear", spring, {"viscous": ZETA, "coulomb": 0.02})
    return Draw(oscillator, -A, W, 20.0, 50.0, 0.0, 0.1, 0.01)


def test_changes_of_the_damping_are_as_large_as_they_say() -> None:
    draw, rng = a_draw(), np.random.default_rng(1)
    drift = odd.drift(rng, draw).scale
    assert abs(drift(draw.duration) - drift(0.0)) == pytest.approx(0.05)
    many = [odd.jitter(np.random.default_rng(i), draw).scale for i in range(300)]
    values = [scale(2 * np.pi / W * 2 * 3) for scale in many]  # at a knot: sd 0.03, within 5 of its own sd
    assert np.std(values) == pytest.approx(0.03, rel=5 / np.sqrt(600))
    friction = odd.angle_friction(rng, draw).damping
    assert max(abs(friction(x, 1.0, 1.0)) for x in np.linspace(-A, A, 400)) == pytest.approx(
        0.1 * 0.02, rel=1e-3
    )
    stribeck = odd.stribeck(rng, draw).damping
    assert stribeck(0.0, 0.0, 1.0) == pytest.approx(0.5 * 0.02)
    assert stribeck(0.0, 0.3 * A * W, 1.0) == pytest.approx(0.5 * 0.02 / np.e)


def test_discrepant_records_name_their_family_part() -> None:
    for kind in odd.KINDS:
        for made in (case(kind, 4, number) for number in range(2)):
            terms = made.damping.split("+")
            assert set(terms) <= set(made.shares)
            extra = 1 - sum(made.shares[t] for t in terms)
            if kind in odd.TAKING:
                assert 0.1 < extra < 0.35
            else:
                assert abs(extra) < 0.15
            assert min(made.shares[t] for t in terms) >= 0.15
            if kind in odd.COULOMB:
                assert "coulomb" in terms


def test_an_unknown_kind_is_refused() -> None:
    with pytest.raises(InputError, match="unknown: it must be one of family, cubic_sensor"):
        case("cubic", 1, 0)
