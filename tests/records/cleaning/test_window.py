"""The free decay in records that a hand, rest, friction or noise have a part in, against what is known of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from bayesdamp.records.cleaning import window as window_module
from bayesdamp.records.cleaning.clean import recording_step
from bayesdamp.records.cleaning.window import DecayWindow, free_decay
from bayesdamp.records.oscillation.spectrum import coarse_periods
from tests.records.hands import (
    Record,
    driven,
    held_then_released,
    kicked,
    released_twice,
    rig,
    sticking,
)

SEEDS = range(100, 106)
EARLY = 0.1
"""Cycles by which a start may come before the hand has let go: its last touch is a light one."""


def window(record: Record) -> DecayWindow:
    periods = coarse_periods(record.t, record.y)
    return free_decay(record.t, record.y, periods, recording_step(record.y), True, True, "x")


def ends(record: Record) -> tuple[float, float]:
    """(start, stop) in s, which are cycles here."""
    found = window(record)
    return float(record.t[found.first]), float(record.t[found.last])


def with_faults(record: Record, rng: np.random.Generator) -> Record:
    """The record off zero, upside down or not, with noise and rounding of up to a hundredth."""
    size = 0.5 * np.ptp(record.y)
    y = rng.choice([-1, 1]) * record.y + size * (
        rng.uniform(-1, 1) + rng.choice([0, 1e-3, 1e-2]) * rng.standard_normal(record.y.size)
    )
    quantum = size * rng.choice([0, 3e-3, 1e-2])
    return Record(record.t, np.round(y / quantum) * quantum if quantum else y, record.start, record.stop)


U = np.random.Generator.uniform
KINDS: dict[str, tuple[Callable[[np.random.Generator], Record], float]] = {
    "at rest away from zero": (
        lambda rng: held_then_released(rng, U(rng, 0.3, 5), 0.0, U(rng, 25, 100)),
        0.6,
    ),
    "a slow tilt": (lambda rng: held_then_released(rng, U(rng, 0, 2), U(rng, 3, 12), U(rng, 25, 100)), 0.6),
    "a tilt, sampled coarsely": (lambda rng: held_then_released(rng, 1.0, U(rng, 3, 12), U(rng, 9, 16)), 0.7),
    "a kick": (kicked, 0.7),
    "a kick, its velocity": (lambda rng: kicked(rng, 1), 0.8),
    "a kick, its acceleration": (lambda rng: kicked(rng, 2), 0.8),
    "released twice": (released_twice, 0.6),
    "driven": (driven, 1.1),
}


@pytest.mark.parametrize(("make", "late"), KINDS.values(), ids=KINDS)
def test_the_start_is_after_the_hand_and_within_a_cycle_of_it(make, late: float) -> None:
    off = []
    for rng in map(np.random.default_rng, SEEDS):
        record = with_faults(make(rng), rng)
        off.append(ends(record)[0] - record.start)
    assert np.max(off) <= late, off
    assert np.min(off) >= -EARLY, off


def test_friction_stops_before_it_sticks() -> None:
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        record = with_faults(sticking(rng), rng)
        start, stop = ends(record)
        assert start <= 0.05
        assert record.stop - 1.3 <= stop <= record.stop + 0.02


def test_noise_stops_it_where_turning_points_no_longer_stand_out() -> None:
    """Viscous, in closed form: at the stop the amplitude is between one and six times the noise."""
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        noise, zeta = rng.choice([0.01, 0.03, 0.1]), rng.uniform(0.1, 0.4)
        t = np.arange(0, 8 / zeta, 1 / rng.uniform(12, 60))
        y = np.exp(-zeta * t) * np.cos(W * t + rng.uniform(0, 6)) + noise * rng.standard_normal(t.size)
        found = free_decay(t, y, coarse_periods(t, y), 0.0, True, True, "x")
        assert found.first == 0
        assert noise <= np.exp(-zeta * t[found.last]) <= 6 * noise
        assert len(found.decays) == 1


W = 2 * np.pi


def test_a_record_that_is_free_throughout_is_kept_whole() -> None:
    """Negative control of all cuts: light and heavy, coarse and fine, with a midline that drifts."""
    for seed in SEEDS:
        rng = np.random.default_rng(seed)
        cycles = rng.uniform(8, 30)
        t = np.arange(0, cycles, 1 / rng.uniform(12, 100))
        free = rig(rng, 1.3 * cycles).run(t, np.cos(seed), W * np.sin(seed))[0]
        drift = 0.1 * np.sin(W * t / cycles * rng.uniform(0.3, 1.0) + seed)
        for y in (free, free + drift, free + 0.01 * rng.standard_normal(t.size)):
            start, stop = ends(Record(t, y, 0.0, float(t[-1])))
            assert start <= 0.05
            assert stop >= t[-1] - 1.0


def test_a_hole_does_not_cut_what_follows_it() -> None:
    """A hole of a whole number of cycles, across which the record does not swing.

    The control: where the noise is as large as the last swings, these are left out.
    """
    t = np.arange(0, 400, 0.06)
    t = t[(t < 160) | (t > 180)]
    y, noise = np.exp(-t / 130) * np.cos(W * t), np.random.default_rng(0).standard_normal(t.size)
    stops = [ends(Record(t, y + sd * noise, 0.0, 400.0))[1] for sd in (0.001, 0.03)]
    assert stops[0] > 399
    assert stops[1] < 390


def struck(strikes: int) -> tuple[np.ndarray, np.ndarray]:
    """A plate that is struck every 2 s and hums on in the noise until it is struck again."""
    t = np.arange(0, 2 * strikes + 1, 1 / 2000)
    y = 0.003 * np.random.default_rng(11).standard_normal(t.size)
    for begin in 0.5 + 2.0 * np.arange(strikes):
        y += np.where(t >= begin, np.exp(-4 * (t - begin)) * np.sin(2 * np.pi * 100 * (t - begin)), 0.0)
    return t, y


def test_other_strikes_are_counted_and_what_hums_in_the_noise_is_not(monkeypatch: pytest.MonkeyPatch) -> None:
    """Negative control: with no least worth the hum counts."""
    for strikes, told in ((2, "Another free decay"), (7, "6 other free decays")):
        found = free_decay(*(record := struck(strikes)), coarse_periods(*record), 0.0, True, True, "x")
        begins = [decay.start for decay in found.decays]
        assert begins == pytest.approx(0.5 + 2.0 * np.arange(strikes), abs=0.02)
        (said,) = (note for note in found.notes if "not used" in note)
        assert said.startswith(told)
        assert said.count(" to ") == min(strikes - 1, 3)
    monkeypatch.setattr(window_module, "OTHER_INFORMATION", 0.0)
    record = struck(7)
    assert len(free_decay(*record, coarse_periods(*record), 0.0, True, True, "x").decays) > 7
