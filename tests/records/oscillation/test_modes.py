"""Sums of damped sinusoids, whose frequencies and damping ratios are set, are told from one oscillator, also from one
whose frequency and damping change with the amplitude."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest

from bayesdamp.records.cleaning.clean import clean
from bayesdamp.records.oscillation.features import features
from bayesdamp.records.oscillation.modes import damped_modes, find_excited, find_other_motion
from bayesdamp.records.record import RawRecord
from tests.physics.independent import trajectory
from validation.truth.records import KINDS, case

OMEGA = 4.0


def sum_of(
    *parts: tuple[float, float, float], noise: float = 0.003, seed: int = 3
) -> tuple[np.ndarray, np.ndarray]:
    """40 s of sinusoids, each (amplitude, frequency over that of the first, damping ratio), with noise."""
    t = np.arange(0, 40, 0.02)
    y = sum(a * np.exp(-z * OMEGA * r * t) * np.cos(OMEGA * r * t + r) for a, r, z in parts)
    return t, y + noise * np.random.default_rng(seed).standard_normal(t.size)


def test_modes_have_the_frequencies_and_ratios_they_were_made_with() -> None:
    """Within five standard errors: false alarm 1e-5."""
    t, y = sum_of((0.3, 1.0, 0.01), (0.1, 1.12, 0.02))
    _, found = islice(damped_modes(t, y), 2)
    omega = 2 * np.pi * found.frequencies
    rates = np.array([0.01, 0.02 * 1.12]) * OMEGA
    assert omega == pytest.approx(OMEGA * np.array([1.0, 1.12]), rel=1e-3)
    assert np.all(np.abs(found.rates - rates) < 5 * found.errors)
    assert np.all(found.errors < 0.05 * rates)
    assert found.first == pytest.approx([0.3, 0.1], rel=0.02)


@pytest.mark.parametrize(
    ("seen", "parts"),
    [
        ("beats", ((0.3, 1.0, 0.01), (0.1, 1.12, 0.01))),
        ("beats", ((0.3, 1.0, 0.02), (0.15, 0.9, 0.01))),
        ("two modes", ((0.3, 1.0, 0.01), (0.1, 2.7, 0.004))),
        ("two modes", ((0.3, 1.0, 0.01), (0.1, 0.6, 0.01))),
        ("driven", ((0.3, 1.0, 0.02), (0.08, 1.3, 0.0))),
        ("growing", ((0.02, 1.0, -0.012),)),
        ("steady", ((0.3, 1.0, 0.0),)),
    ],
)
def test_what_is_seen_has_its_name(seen: str, parts: tuple[tuple[float, float, float], ...]) -> None:
    found = find_other_motion(*sum_of(*parts), 2 * np.pi / OMEGA)
    assert found.kind == seen
    if seen in ("beats", "steady"):  # a window was once cut at the first beat
        cleaned = clean(RawRecord(*sum_of(*parts)), name=seen)
        assert cleaned.t[-1] > 39
        assert "not the free decay" in " ".join(map(str, cleaned.provenance.notes)) or seen == "steady"
    if len(parts) > 1:
        assert found.size == pytest.approx(parts[1][0] / parts[0][0], rel=0.1)


def test_a_drive_less_than_a_beat_apart_is_seen_where_the_amplitude_stays() -> None:
    """And is not where what is beside it decays, too."""
    period = 2 * np.pi / OMEGA
    found = find_other_motion(*sum_of((0.3, 1.0, 0.05), (0.05, 1.01, 0.0)), period)
    assert found.kind == "driven"
    assert found.modes.ratios[0] == pytest.approx(0.05, rel=0.02)
    assert find_other_motion(*sum_of((0.3, 1.0, 0.05), (0.05, 1.01, 0.003)), period) is None


def test_one_oscillation_is_one() -> None:
    for parts in (
        ((0.3, 1.0, 0.01),),  # one mode
        ((0.3, 1.0, 0.01), (0.03, 3.0, 0.03)),  # its third harmonic
        ((0.3, 1.0, 0.0002),),  # it hardly decays, and that is seen
    ):
        assert find_other_motion(*sum_of(*parts), 2 * np.pi / OMEGA) is None


@pytest.mark.parametrize("share", [0.001, 0.05])
@pytest.mark.parametrize(("law", "angle", "damping"), [("pendulum", 1.4, "zeta"), ("duffing", 0.3, "mu_q")])
def test_one_nonlinear_oscillator_is_one_although_no_law_fits(
    law: str, angle: float, damping: str, share: float
) -> None:
    """Two sinusoids explain it to its noise of 5 %, but they do not beat; the control does."""
    t = np.arange(0, 40, 0.02)
    p = {
        "stiffness": OMEGA**2,
        "rest_angle": 0.0,
        "cubic": 30.0,
        "theta0": angle,
        "omega0": 0.0,
        damping: 0.1,
    }
    noise = share * angle * np.random.default_rng(1).standard_normal(t.size)
    assert (
        find_other_motion(t, trajectory(law, p, t)[:, 0] + noise, 2 * np.pi / OMEGA, no_law_fits=True) is None
    )
    beating = sum_of((0.3, 1.0, 0.01), (0.02, 1.06, 0.01))
    assert find_other_motion(*beating, 2 * np.pi / OMEGA) is None
    found = find_other_motion(*beating, 2 * np.pi / OMEGA, no_law_fits=True)
    assert found is not None
    assert found.kind == "beats"
    third = sum_of((0.3, 1.0, 0.01), (0.02, 1.08, 0.01), (0.01, 2.0, 0.01), noise=0.001)
    assert find_other_motion(*third, 2 * np.pi / OMEGA, no_law_fits=True) is None, "more than two"


@pytest.mark.parametrize("every", [4, pytest.param(1, marks=pytest.mark.slow)])
def test_no_validation_record_is_taken_for_several(every: int) -> None:
    """None of 120 with another seed was, when thresholds were set; one of a kind here."""
    for kind in list(KINDS)[::every]:
        signal = case(kind, 79, 0).signal
        assert find_other_motion(signal.t, signal.y, 2 * np.pi / features(signal).frequency) is None, kind


def test_of_a_long_record_two_modes_are_two_and_one_is_one() -> None:
    """4,000 cycles at 5 Hz, which are searched by part."""
    t = np.linspace(0.0, 800.0, 52_000)
    first, second = (np.exp(-r * t / 800) * np.cos(2 * np.pi * f * t) for f, r in ((5.0, 2.0), (7.3, 1.0)))
    y = first + np.random.default_rng(4).normal(0, 0.02, t.size)
    assert find_other_motion(t, y, 0.2) is None
    found = find_other_motion(t, y + 0.2 * second, 0.2)
    assert found.kind == "two modes"
    assert found.modes.frequencies == pytest.approx([5.0, 7.3], abs=1e-4)
    assert found.modes.rates * 800 == pytest.approx([2.0, 1.0], abs=0.1)


def test_an_amplitude_that_no_law_keeps_up_is_no_drive() -> None:
    """A^(1 - p) - A0^(1 - p) grows with time of a force that goes with |v|^p: what falls most slowly."""
    t = np.arange(0, 200, 0.05)
    noise = 1e-4 * np.random.default_rng(2).standard_normal(t.size)
    for power in (2.0, 3.0):
        y = 0.3 * (1 + 0.1 * t) ** (-1 / (power - 1)) * np.cos(OMEGA * t) + noise
        assert find_other_motion(t, y, 2 * np.pi / OMEGA) is None


def shaken(ratio: float, cycles: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """An oscillator at 1 Hz under white noise, by its exact recursion (a Gaussian AR(2) of the sampled motion)."""
    step, omega = 0.02, 2 * np.pi
    drive = np.random.default_rng(seed).standard_normal(int(cycles / step) + 3000)
    fall, turn = np.exp(-ratio * omega * step), omega * np.sqrt(1 - ratio**2) * step
    y = np.zeros(drive.size)
    for i in range(2, y.size):
        y[i] = 2 * fall * np.cos(turn) * y[i - 1] - fall**2 * y[i - 2] + drive[i]
    y = y[3000:] / np.std(y[3000:])
    return np.arange(y.size) * step, y


@pytest.mark.parametrize("ratio", [0.005, 0.05])
def test_an_oscillator_under_random_forces_is_excited_all_along(ratio: float) -> None:
    """12 of 12 with other seeds were, when thresholds were set."""
    t, y = shaken(ratio, 200, 8)
    found = find_other_motion(t, y, 1.0)
    assert found.kind == "excited"
    assert clean(RawRecord(t, y), name="ambient").t.size == t.size


@pytest.mark.parametrize("pumped", [0.0, 4.0])
def test_many_releases_in_a_record_are_not_excited_all_along(pumped: float) -> None:
    """Eight decays, after a blow or four periods of pushing each: of them one is used, as before."""
    t = np.arange(0, 8 * 25, 0.02)
    since = t % 25
    rise, fall = np.exp(-0.126 * 21) + since / max(pumped, 1), np.exp(-0.126 * (since - pumped))
    y = np.where(since < pumped, rise, fall) * np.cos(2 * np.pi * t)
    y += 0.002 * np.random.default_rng(1).standard_normal(t.size)
    assert find_other_motion(t, y, 1.0) is None
    assert clean(RawRecord(t, y), name="runs").t[-1] < 30


def test_a_record_that_is_at_rest_to_the_last_digit_before_its_release_is_not_excited_all_along() -> None:
    t = np.arange(0, 90, 0.1)
    y = np.where(t < 35, 0.0, np.exp(-0.02 * (t - 35)) * np.cos(2 * np.pi * (t - 35)))
    assert find_excited(t, y, 1.0) is None
    assert find_excited(t, y[::-1], 1.0) is None
