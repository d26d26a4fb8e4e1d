"""Simulated cases keep their rules, come from their seed, and differ from the family as they say."""

from __future__ import annotations

import pickle
from dataclasses import fields

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from bayesdamp.provenance import Provenance
from bayesdamp.types import InputError
from validation.truth import discrepancies as odd
from validation.truth.drawing import Draw
from validation.truth.motion import solved
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
        assert min(made.shares.values()) >= 0.15
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


@pytest.mark.parametrize("kind", ["family", "jitter"])
def test_ten_times_the_samples_are_of_the_same_motion(kind: str) -> None:
    made, dense = case(kind, 1, 3), case(kind, 1, 3, oversample=10)
    assert dense.name == made.name + "-x10"
    assert dense.signal.t.size >= 10 * made.signal.t.size - 10
    assert dense.signal.t[::10][: made.signal.t.size] == pytest.approx(made.signal.t)
    same = {f.name for f in fields(Case)} - {"name", "signal", "oversample", "ratio"}
    assert all(getattr(dense, name) == getattr(made, name) for name in same)
    apart = dense.signal.y[::10][: made.signal.t.size] - made.signal.y
    assert np.std(apart) == pytest.approx(np.sqrt(2) * made.noise_sd, rel=5 / np.sqrt(2 * apart.size))


@pytest.mark.parametrize(("seed", "number"), [(3, 29), pytest.param(4, 15, marks=pytest.mark.slow)])
def test_nats_are_those_of_least_squares_on_the_true_motion(seed: int, number: int) -> None:
    """Coulomb friction's only full rival is viscous and quadratic: fitted here by SciPy alone to the noise-free record.

    Half its least χ² is the nats within 3 %: those count samples roughly, and compare 24 a cycle.
    """
    made = case(FAMILY, seed, number)
    assert (made.damping, made.parameters["omega0"], made.parameters["epsilon"]) == ("coulomb", 0.0, 0.0)
    truth = oscillator_of(made)
    t, zero = made.signal.t, truth.equilibrium()
    frequency = 2 * np.pi * made.cycles / t[-1]
    true = solved(truth, made.parameters["theta0"] - zero, frequency, t[-1]).at(t)[0]
    law, size = dict(truth.parameters), abs(made.parameters["theta0"] - zero)
    scales = [abs(v) for v in law.values()]

    def residual(x: np.ndarray) -> np.ndarray:
        moved = {n: v + s * d for (n, v), s, d in zip(law.items(), scales, x, strict=False)}
        ratio = made.ratio(made.amplitudes[1]) * x[-2:]
        damping = {"viscous": ratio[0] * frequency, "quadratic": ratio[1] / made.amplitudes[1]}
        pull = Oscillator(made.restoring, moved, damping).acceleration()
        start = [zero + size * (np.sign(true[0] - zero) + x[-4]), size * frequency * x[-3]]
        found = solve_ivp(
            lambda t, s: [s[1], pull(t, s[0], s[1], 0.0)], (0.0, t[-1]), start, method="DOP853", t_eval=t, rtol=1e-8,
            atol=1e-9 * size,
        )  # fmt: skip
        return (found.y[0] - true) / made.noise_sd

    x0 = np.append(np.zeros(len(law) + 2), [1.0, 0.1])
    low = np.append(np.full(len(law) + 2, -np.inf), [0.0, 0.0])

    def jacobian(x: np.ndarray) -> np.ndarray:
        return np.column_stack([(residual(x + h) - residual(x - h)) / 2e-4 for h in 1e-4 * np.eye(x.size)])

    fit = least_squares(residual, x0, jacobian, bounds=(low, np.inf), x_scale="jac")
    assert made.nats == pytest.approx(fit.cost, rel=0.03)


W, A, ZETA = 5.0, 0.3, 0.1


def a_draw() -> Draw:
    """A linear spring at a rest angle of 0.2 rad with viscous and Coulomb damping, 20 cycles from its release on."""
    spring = {"stiffness": W * W, "rest_angle": 0.2}
    oscillator = Oscillator("linear", spring, {"viscous": ZETA, "coulomb": 0.02})
    return Draw(oscillator, -A, W, 20.0, 50.0, 0.0, 0.1, 0.01)


def sensed(kind: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, what the sensor reads, and the displacements, from the release on."""
    draw, times = a_draw(), np.linspace(0.0, 10.0, 500)
    motion = solved(draw.oscillator, draw.displacement, W, draw.duration)
    observe = odd.KINDS[kind](np.random.default_rng(1), draw)
    return times, observe(motion, times), motion.at(times)[0] - motion.equilibrium


def test_a_cubic_sensor_is_off_by_half_a_percent_at_the_release() -> None:
    _, read, x = sensed("cubic_sensor")
    assert np.abs(read / x - 1) == pytest.approx(0.005 * (x / A) ** 2)


def test_a_second_mode_is_one_percent_and_decays() -> None:
    times, read, x = sensed("second_mode")
    added = np.abs(read - x)
    assert 0.8 * 0.003 < added[times < 1].max() <= 0.003
    assert added[times > 5].max() < 0.3 * 0.003


def test_a_lagging_sensor_is_a_filter_of_first_order() -> None:
    """τẏ = x − y from rest at the release, by another solver."""
    times, read, x = sensed("sensor_lag")
    motion = CubicSpline(times, x)
    found = solve_ivp(
        lambda t, y: (motion(t) - y) * W / 0.1,
        (0.0, 10.0),
        [-A],
        t_eval=times,
        rtol=1e-9,
        atol=1e-10,
        method="LSODA",
    )
    assert read == pytest.approx(found.y[0], abs=1e-5)
    assert np.max(np.abs(read - x)) > 0.02  # the control


def test_changes_of_the_damping_are_as_large_as_they_say() -> None:
    draw, rng = a_draw(), np.random.default_rng(1)
    drift = odd.drift(rng, draw).scale
    assert drift is not None
    assert abs(drift(draw.duration) - drift(0.0)) == pytest.approx(0.05)
    many = [odd.jitter(np.random.default_rng(i), draw).scale for i in range(300)]
    values = [
        scale(2 * np.pi / W * 2 * 3) for scale in many if scale
    ]  # at a knot: sd 0.03, within 5 of its own sd
    assert np.std(values) == pytest.approx(0.03, rel=5 / np.sqrt(600))
    friction, static = odd.angle_friction(rng, draw).damping, odd.angle_friction(rng, draw).static_friction
    assert friction is not None
    assert static is not None
    assert max(abs(friction(x, 1.0, 1.0)) for x in np.linspace(-A, A, 400)) == pytest.approx(
        0.1 * 0.02, rel=1e-3
    )
    stribeck = odd.stribeck(rng, draw).damping
    assert stribeck is not None
    assert stribeck(0.0, 0.0, 1.0) == pytest.approx(0.5 * 0.02)
    assert stribeck(0.0, 0.3 * A * W, 1.0) == pytest.approx(0.5 * 0.02 / np.e)


def test_a_stiffening_spring_has_its_potential() -> None:
    made = odd.missing_spring(np.random.default_rng(2), a_draw())
    assert made.spring is not None
    assert made.potential is not None
    assert abs(made.spring(A)) == pytest.approx(0.01 * W**2 * A)
    assert made.potential(0.2) == pytest.approx(quad(made.spring, 0.0, 0.2)[0])


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
