"""The free decay in simulated records with a hand, rest, friction or noise, whose limits are known."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from bayesdamp.records.cleaning import window as window_module
from bayesdamp.records.cleaning.clean import recording_step
from bayesdamp.records.cleaning.swings import best_stretch
from bayesdamp.records.cleaning.window import DecayWindow, free_decay
from bayesdamp.records.oscillation.features import TurningPoints
from bayesdamp.records.oscillation.noise import coarse_periods
from tests.records.hands import Record, W, driven, held_then_released, kicked, released_twice, rig, sticking

SEEDS = range(100, 106)
EARLY = 0.1
"""Cycles by which the start may precede the release, because the last contact of the hand is light."""


def window(t: np.ndarray, y: np.ndarray, step: float = 0.0) -> DecayWindow:
    return free_decay(t, y, coarse_periods(t, y), step, True, True, "x")


def ends(record: Record) -> tuple[float, float]:
    """Return start and stop in s, which are cycles here."""
    decay = window(record.t, record.y, recording_step(record.y))
    return float(record.t[decay.first]), float(record.t[decay.last])


def with_faults(record: Record, rng: np.random.Generator) -> Record:
    """Return the record with an offset, a random sign, and noise and rounding of up to a hundredth."""
    size = 0.5 * np.ptp(record.y)
    y = rng.choice([-1, 1]) * record.y + size * (
        rng.uniform(-1, 1) + rng.choice([0, 1e-3, 1e-2]) * rng.standard_normal(record.y.size)
    )
    quantum = size * rng.choice([0, 3e-3, 1e-2])
    return Record(record.t, np.round(y / quantum) * quantum if quantum else y, record.start, record.stop)


@pytest.mark.parametrize(("then", "used"), [(0.3, (0, 13)), (2.0, (12, 25))])
def test_the_tail_of_a_decay_is_not_used_instead_of_its_start(then: float, used: tuple[int, int]) -> None:
    """Twelve half cycles are followed by twelve that fall faster, either smaller ones or those of another release."""
    ranges = np.concatenate([0.9 ** np.arange(12), then * 0.88 ** np.arange(12)])
    values = np.concatenate([[0.0], np.cumsum(ranges * (-1.0) ** np.arange(24))])
    turns = TurningPoints(np.arange(25.0), values, np.ones(25))
    assert best_stretch(turns, [(0, 13), (12, 25)]) == used


U = np.random.Generator.uniform
KINDS: dict[str, tuple[Callable[[np.random.Generator], Record], float]] = {
    "held away from zero": (lambda g: held_then_released(g, U(g, 0.3, 5), 0.0, U(g, 25, 100)), 0.6),
    "tilted slowly": (lambda g: held_then_released(g, U(g, 0, 2), U(g, 3, 12), U(g, 25, 100)), 0.6),
    "tilted, sampled coarsely": (lambda g: held_then_released(g, 1.0, U(g, 3, 12), U(g, 9, 16)), 0.7),
    "struck": (kicked, 0.7),
    "struck, velocity": (lambda g: kicked(g, 1), 0.8),
    "struck, acceleration": (lambda g: kicked(g, 2), 0.8),
    "released twice": (released_twice, 0.6),
    "driven": (driven, 1.1),
}
"""Kinds of records, and the largest number of cycles between release and start."""


@pytest.mark.parametrize(("make", "late"), KINDS.values(), ids=KINDS)
def test_the_start_is_within_about_a_cycle_of_the_release(make, late: float) -> None:
    off = []
    for rng in map(np.random.default_rng, SEEDS):
        record = with_faults(make(rng), rng)
        off.append(ends(record)[0] - record.start)
    assert -EARLY <= np.min(off) <= np.max(off) <= late, off


def test_the_start_does_not_depend_on_the_clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """On the second clock, a turning point just before the start is at 0 s, exactly because of the rounding."""
    exact = window_module.turning_points

    def rounded(*args) -> TurningPoints:
        return replace(exact(*args), times=np.round(exact(*args).times, 9))

    monkeypatch.setattr(window_module, "turning_points", rounded)
    record = kicked(np.random.default_rng(100), 2)
    assert len({window(record.t - shift, record.y).first for shift in (0.0, 3.510120898)}) == 1


@pytest.mark.parametrize(("zeta", "hold"), [(0.06, 0.15), (0.1, 0.3), (0.2, 0.25), (0.2, 0.0)])
def test_a_body_that_is_held_for_a_moment_is_used_from_its_release(zeta: float, hold: float) -> None:
    """A viscous decay in closed form after `hold` periods at rest."""
    t = np.arange(0, 5, 0.05)
    free, decay = np.maximum(t - hold, 0), zeta * W
    w = np.sqrt(W**2 - decay**2)
    y = np.exp(-decay * free) * (np.cos(w * free) + decay / w * np.sin(w * free))
    first = window(t, y + 0.01 * np.random.default_rng(1).standard_normal(t.size)).first
    assert hold - 0.01 <= t[first] <= hold + 0.1


@pytest.mark.parametrize("long", [17, 25])
def test_a_slow_pull_that_is_larger_than_the_decay_does_not_hide_it(long: int) -> None:
    """For many periods a hand pulls the body away, slowly and not evenly; it is released and rests for a while."""
    t = np.arange(0, long + 40, 0.04)
    free, z = np.maximum(t - long, 0), 0.06
    pull = np.clip(t / (0.6 * long), 0, 1) ** 2 + 0.03 * np.sin(t) * np.sin(np.pi * t / long)
    y = np.where(t < long, pull, np.exp(-z * W * free) * np.cos(W * free))
    first = window(t, y + 0.002 * np.random.default_rng(1).standard_normal(t.size)).first
    assert long - 0.1 < t[first] < long + 0.7


def test_the_decay_ends_before_friction_stops_the_motion() -> None:
    for rng in map(np.random.default_rng, SEEDS):
        record = with_faults(sticking(rng), rng)
        start, stop = ends(record)
        assert start <= 0.05
        assert record.stop - 1.3 <= stop <= record.stop + 0.02


def test_the_decay_ends_where_noise_hides_the_turning_points() -> None:
    """Viscous decays in closed form: at the stop the amplitude is one to six times the noise."""
    for rng in map(np.random.default_rng, SEEDS):
        noise, zeta = rng.choice([0.01, 0.03, 0.1]), rng.uniform(0.1, 0.4)
        t = np.arange(0, 8 / zeta, 1 / rng.uniform(12, 60))
        y = np.exp(-zeta * t) * np.cos(W * t + rng.uniform(0, 6)) + noise * rng.standard_normal(t.size)
        decay = window(t, y)
        assert (decay.first, len(decay.decays)) == (0, 1)
        assert noise <= np.exp(-zeta * t[decay.last]) <= 6 * noise


def test_a_free_decay_is_not_cut() -> None:
    """Negative control of all cuts: many damping laws and sampling rates, also with a drifting midline."""
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


def test_other_strikes_are_counted_and_what_remains_in_the_noise_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A plate at 100 Hz that is struck every 2 s. Negative control: without a threshold also noise counts as decay."""
    for strikes, note in ((2, "Another free decay"), (7, "6 other free decays")):
        t = np.arange(0, 2 * strikes + 1, 1 / 2000)
        y = 0.003 * np.random.default_rng(11).standard_normal(t.size)
        begins = 0.5 + 2.0 * np.arange(strikes)
        for begin in begins:
            since = np.maximum(t - begin, 0)
            y += np.exp(-4 * since) * np.sin(2 * np.pi * 100 * since)
        decay = window(t, y)
        assert [other.start for other in decay.decays] == pytest.approx(begins, abs=0.02)
        (unused,) = (text for text in decay.notes if "not used" in text)
        assert unused.startswith(note)
        assert unused.count(" to ") == min(strikes - 1, 3)
    monkeypatch.setattr(window_module, "OTHER_INFORMATION", 0.0)
    assert len(window(t, y).decays) > 7
