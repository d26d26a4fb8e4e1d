"""Sums of damped sinusoids are distinguished from one oscillator, also from a nonlinear one."""

from itertools import islice

import numpy as np
import pytest
from scipy.signal import lfilter

from bayesdamp.records.cleaning.clean import clean
from bayesdamp.records.oscillation.features import features
from bayesdamp.records.oscillation.modes import damped_modes, find_excited, find_other_motion
from bayesdamp.records.record import RawRecord
from tests.physics.independent import trajectory
from validation.truth.records import KINDS, case

OMEGA = 4.0


PERIOD = 2 * np.pi / OMEGA


def sum_of(*parts: tuple[float, float, float], noise: float = 0.003) -> tuple[np.ndarray, np.ndarray]:
    """Return 40 s of sinusoids with noise; each part is (amplitude, frequency over OMEGA, damping ratio)."""
    t = np.arange(0, 40, 0.02)
    y = sum(a * np.exp(-z * OMEGA * r * t) * np.cos(OMEGA * r * t + r) for a, r, z in parts)
    return t, y + noise * np.random.default_rng(3).standard_normal(t.size)


def test_frequencies_and_damping_ratios_of_modes_are_right() -> None:
    """Within five standard errors: false alarm 1e-5. The standard errors are below 5 %."""
    t, y = sum_of((0.3, 1.0, 0.01), (0.1, 1.12, 0.02))
    _, modes = islice(damped_modes(t, y), 2)
    rates = np.array([0.01, 0.02 * 1.12]) * OMEGA
    assert 2 * np.pi * modes.frequencies == pytest.approx(OMEGA * np.array([1.0, 1.12]), rel=1e-3)
    assert np.all(np.abs(modes.rates - rates) < 5 * modes.errors)
    assert np.all(modes.errors < 0.05 * rates)
    assert modes.first == pytest.approx([0.3, 0.1], rel=0.02)
    # In a long record, errors are those of the samples of the search.
    t = np.linspace(0, 40, 24_000)
    y = np.exp(-0.04 * t) * np.cos(4 * t) + 0.003 * np.random.default_rng(3).standard_normal(t.size)
    errors = [next(damped_modes(t[::n], y[::n])).errors for n in (1, 4)]
    assert errors[0] == pytest.approx(errors[1], rel=0.1)


def test_a_drive_close_to_the_frequency_is_recognised_if_its_amplitude_is_constant() -> None:
    """Less than a beat apart. Negative control: the second sinusoid decays, too."""
    motion = find_other_motion(*sum_of((0.3, 1.0, 0.05), (0.05, 1.01, 0.0)), PERIOD)
    assert motion.kind == "driven"
    assert motion.modes.ratios[0] == pytest.approx(0.05, rel=0.02)
    assert find_other_motion(*sum_of((0.3, 1.0, 0.05), (0.05, 1.01, 0.003)), PERIOD) is None


@pytest.mark.parametrize(
    "parts",
    [((0.3, 1.0, 0.01),), ((0.3, 1.0, 0.01), (0.03, 3.0, 0.03)), ((0.3, 1.0, 0.0002),)],
    ids=["one mode", "with its third harmonic", "hardly decays"],
)
def test_one_oscillation_is_not_several(parts: tuple[tuple[float, float, float], ...]) -> None:
    assert find_other_motion(*sum_of(*parts), PERIOD) is None


def test_a_rounded_record_of_a_body_that_stops_is_one_oscillation() -> None:
    """At rest all values are equal, so that the noise seems to be zero."""
    t = np.arange(0, 40, 0.02)
    y = np.maximum(0.3 * np.exp(-0.05 * t) - 0.01 * t, 0) * np.cos(OMEGA * t)
    assert find_other_motion(t, np.round(y, 2), PERIOD) is None


def test_few_samples_in_a_period_are_not_beats() -> None:
    """The largest sample of a period rises and falls if the period has 4.1 samples; the amplitude only falls."""
    t, rate = np.arange(0, 600, 1 / 4.1), 2 * np.pi * 0.0007
    amplitude = np.exp(-rate * t) / np.sqrt(1 + 1.5 * (1 - np.exp(-2 * rate * t)))
    y = amplitude * np.cos(2 * np.pi * t) + 0.002 * np.random.default_rng(1).standard_normal(t.size)
    assert find_other_motion(t, y, 1.0) is None


@pytest.mark.parametrize(
    ("second", "clear"), [((0.2, 1.013), [True]), ((0.3, 1.013), [False]), ((0.2, 1.005), [])]
)
def test_equal_or_very_close_ones_look_like_one(second: tuple[float, float], clear: list[bool]) -> None:
    """The sum of equal ones, cos(ct) cos(ωt) exp(-rt), has a constant frequency, as with an eddy-current brake."""
    t, y = sum_of((0.3, 1.0, 0.01), (*second, 0.01), noise=0.001)
    others = [find_other_motion(t, y, PERIOD, unexplained=left) for left in (0.01, 0.0)]
    assert [other.clear for other in others if other is not None] == clear


@pytest.mark.parametrize(
    ("second", "several"),
    [((0.006, 2.9), True), ((0.006, 3.0), False), ((0.02, 3.0), True), ((0.2, 2.9, 0.6), False)],
)
def test_an_exact_harmonic_or_a_creep_is_no_second_mode(second: tuple[float, ...], several: bool) -> None:
    t, y = sum_of((0.3, 1.0, 0.01), (*second, 0.003)[:3], noise=1e-4)
    assert (find_other_motion(t, y, PERIOD, no_law_fits=True) is not None) is several


@pytest.mark.parametrize("noise", [0.001, 0.05])
@pytest.mark.parametrize(("law", "angle", "damping"), [("pendulum", 1.4, "zeta"), ("duffing", 0.3, "mu_q")])
def test_a_nonlinear_oscillator_is_not_several_even_if_no_law_fits(
    law: str, angle: float, damping: str, noise: float
) -> None:
    """Two sinusoids can explain it within a noise of 5 %, but they do not beat."""
    t = np.arange(0, 40, 0.02)
    start = {"theta0": angle, "omega0": 0.0, damping: 0.1}
    p = {"stiffness": OMEGA**2, "rest_angle": 0.0, "cubic": 30.0, **start}
    y = trajectory(law, p, t)[:, 0] + noise * angle * np.random.default_rng(1).standard_normal(t.size)
    assert find_other_motion(t, y, PERIOD, no_law_fits=True) is None


@pytest.mark.parametrize("every", [4, pytest.param(1, marks=pytest.mark.slow)])
def test_no_record_of_the_validation_is_several(every: int) -> None:
    """When the thresholds were set, there was no false alarm in 120 records with another seed."""
    for kind in list(KINDS)[::every]:
        signal = case(kind, 79, 0).signal
        assert find_other_motion(signal.t, signal.y, 2 * np.pi / features(signal).frequency) is None, kind


def test_modes_of_a_long_record_are_recognised() -> None:
    """4,000 cycles at 5 Hz, which are searched in parts. Negative control: one mode."""
    t = np.linspace(0.0, 800.0, 52_000)
    first, second = (np.exp(-r * t / 800) * np.cos(2 * np.pi * f * t) for f, r in ((5.0, 2.0), (7.3, 1.0)))
    y = first + np.random.default_rng(4).normal(0, 0.02, t.size)
    assert find_other_motion(t, y, 0.2) is None
    motion = find_other_motion(t, y + 0.2 * second, 0.2)
    assert motion.kind == "two modes"
    assert motion.modes.frequencies == pytest.approx([5.0, 7.3], abs=1e-4)
    assert motion.modes.rates * 800 == pytest.approx([2.0, 1.0], abs=0.1)


@pytest.mark.parametrize("power", [2.0, 3.0])
def test_a_slow_decay_is_not_driven(power: float) -> None:
    """A force that grows with |v|^p makes A^(1 - p) - A0^(1 - p) grow linearly with time: the slowest decays."""
    t = np.arange(0, 200, 0.05)
    y = 0.3 * (1 + 0.1 * t) ** (-1 / (power - 1)) * np.cos(OMEGA * t)
    noise = 1e-4 * np.random.default_rng(2).standard_normal(t.size)
    assert find_other_motion(t, y + noise, PERIOD) is None


@pytest.mark.parametrize("ratio", [0.005, 0.05])
def test_an_oscillator_under_random_forces_is_excited(ratio: float) -> None:
    """200 cycles at 1 Hz under white noise, by the exact recursion of the sampled motion (a Gaussian AR(2)).

    When the thresholds were set, 12 of 12 with other seeds were recognised.
    """
    step, omega = 0.02, 2 * np.pi
    force = np.random.default_rng(8).standard_normal(13_000)
    fall, turn = np.exp(-ratio * omega * step), omega * np.sqrt(1 - ratio**2) * step
    y = lfilter([1.0], [1.0, -2 * fall * np.cos(turn), fall**2], force)[3000:]
    t = np.arange(y.size) * step
    assert find_other_motion(t, y, 1.0).kind == "excited"
    assert clean(RawRecord(t, y), name="ambient").t.size == t.size


@pytest.mark.parametrize("pumped", [0.0, 4.0])
def test_repeated_releases_are_not_continuous_excitation(pumped: float) -> None:
    """Eight decays after a blow, or after four periods of pushing; only one is used."""
    t = np.arange(0, 8 * 25, 0.02)
    since = t % 25
    rise, fall = np.exp(-0.126 * 21) + since / max(pumped, 1), np.exp(-0.126 * (since - pumped))
    y = np.where(since < pumped, rise, fall) * np.cos(2 * np.pi * t)
    y += 0.002 * np.random.default_rng(1).standard_normal(t.size)
    assert find_other_motion(t, y, 1.0) is None
    assert clean(RawRecord(t, y), name="runs").t[-1] < 30


def test_exact_rest_before_a_release_is_not_excitation() -> None:
    t = np.arange(0, 90, 0.1)
    y = np.where(t < 35, 0.0, np.exp(-0.02 * (t - 35)) * np.cos(2 * np.pi * (t - 35)))
    assert find_excited(t, y, 1.0) is None
    assert find_excited(t, y[::-1], 1.0) is None


@pytest.mark.parametrize("friction", [0.07, 0.09, 0.12])
def test_friction_that_stops_the_body_after_a_few_cycles_is_not_two_modes(friction: float) -> None:
    """In closed form: in each half cycle the amplitude falls by twice the friction, and then the body rests."""
    t = np.arange(0, 8, 0.01)
    swing = np.minimum(np.floor(2 * t), np.ceil((1 / friction - 1) / 2))
    size = 1 - 2 * friction * swing
    free = (size - friction) * np.cos(2 * np.pi * (t - swing / 2)) + friction
    y = (-1) ** swing * np.where(size > friction, free, size)
    assert find_other_motion(t, y + 0.001 * np.random.default_rng(1).standard_normal(t.size), 1.0) is None


def test_a_decay_that_stands_out_of_random_vibration_is_not_excited() -> None:
    """Control: without the decay."""
    t = np.arange(0, 100, 0.02)
    fall = np.exp(-0.05 * 2 * np.pi * 0.02)
    force = 1e-4 * np.random.default_rng(8).standard_normal(t.size)
    ambient = lfilter([1.0], [1.0, -2 * fall * np.cos(2 * np.pi * 0.02), fall**2], force)
    decay = np.where(t < 40, 0.0, 0.1 * np.exp(-0.1 * (t - 40)) * np.sin(2 * np.pi * (t - 40)))
    assert find_excited(t, ambient, 1.0) is not None
    assert find_excited(t, ambient + decay, 1.0) is None
