"""Decays that end because of a hit, a hand or a filter, and structures of which only the tail is one decay."""

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from bayesdamp.interface.first_words import first_words, no_free_decay
from bayesdamp.records.cleaning.clean import clean
from bayesdamp.records.cleaning.window import free_decay
from bayesdamp.records.oscillation.noise import coarse_periods
from bayesdamp.records.record import RawRecord
from bayesdamp.types import InputError
from tests.records.hands import Rig, W

RATE = 1000.0
HITS = (0.7, 2.6, 4.4)


def hits(seed: int, modes: dict[float, float], at: tuple[float, ...], noise: float, until=6.0) -> RawRecord:
    """Return a structure's response to hits: modes of equal size (frequency in Hz: damping ratio) and white noise."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, until, 1 / RATE)
    y = noise * rng.standard_normal(t.size)
    for begin in at:
        since = np.maximum(t - begin, 0)
        for f, zeta in modes.items():
            y += np.exp(-2 * np.pi * f * zeta * since) * np.sin(2 * np.pi * f * since)
    return RawRecord(t, y)


def test_a_decay_after_a_given_start_ends_before_the_next_hit() -> None:
    raw = hits(1, {21.0: 0.015}, HITS, 0.005)
    for start in (0.71, 2.0):
        signal = clean(raw, name="x", start=start)
        assert signal.provenance.start == pytest.approx(start)
        assert 2.4 < (signal.provenance.stop or 0.0) <= 2.6
        assert any("struck or released again" in note for note in signal.provenance.notes)
    later = clean(raw, name="x", start=4.45)  # negative control: after the last hit nothing ends it
    assert (later.provenance.stop or 0.0) > 5.5
    at_rest = r"hardly anything moves between the given start .* near 0\.7\d* s"
    with pytest.raises(InputError, match=at_rest):
        clean(raw, name="x", start=0.4)


def test_a_decay_begins_where_a_drive_of_constant_amplitude_ends() -> None:
    """20 s of drive, then a viscous decay. Controls: decays of viscous and of Coulomb damping from the start."""
    t = np.arange(0, 180, 1 / 20)
    noise = 0.005 * np.random.default_rng(4).standard_normal(t.size)
    since = np.maximum(t - 20.0, 0.0)
    for amplitude, start in ((np.exp(-0.02 * since), 20.0), (np.exp(-0.02 * t), 0.0), (1 - t / 200, 0.0)):
        signal = clean(RawRecord(t, amplitude * np.cos(10 * t) + noise), name="x")
        assert signal.provenance.start == pytest.approx(start, abs=1.0)
        assert any("until then it is nearly constant" in note for note in signal.provenance.notes) == (
            start > 0
        )


def test_a_decay_ends_where_a_hand_stops_it() -> None:
    """At 20 s the damping ratio increases from 0.01 to 0.5."""
    t = np.arange(0, 26, 1 / 50)

    def hand(time: float, x: float, v: float) -> float:
        return 0.0 if time < 20 else -2 * 0.49 * W * v

    y = Rig(0.01 * W).run(t, 1.0, force=hand)[0] + 1e-4 * np.random.default_rng(4).standard_normal(t.size)
    window = free_decay(t, y, coarse_periods(t, y), 0.0, True, True, "x")
    assert 18.5 <= t[window.last] <= 20.1


MODES = {12.0: 0.012, 25.0: 0.009, 37.0: 0.007}


@pytest.mark.parametrize(("order", "half", "at"), [(4, 0.2, (1.0,)), (2, 0.1, (0.8, 4.5))])
def test_a_band_passed_mode_is_one_decay(order: int, half: float, at: tuple[float, ...]) -> None:
    """Its damping ratio in the middle is within 5 % of the truth, and it begins after a hit."""
    raw = hits(5, MODES, at, 0.003, until=8.0)
    for mode in (12.0, 37.0):
        sos = butter(order, [mode * (1 - half), mode * (1 + half)], "bandpass", fs=RATE, output="sos")
        signal = clean(RawRecord(raw.t, sosfiltfilt(sos, raw.y)), name="x")
        assert no_free_decay(signal) is None
        since = np.array([(signal.provenance.start or 0.0) - begin for begin in at])
        assert np.min(np.abs(since)) < 1.2
        assert np.any(since >= 0)
        assert first_words(signal).ratio[1] == pytest.approx(MODES[mode], rel=0.05)


def test_a_structure_of_close_modes_is_refused() -> None:
    """No part of five modes with similar frequency and damping is one decay. Negative control: one of them alone."""
    modes = {75.2: 0.0141, 80.1: 0.0148, 81.2: 0.0093, 84.0: 0.012, 112.3: 0.0149}
    with pytest.raises(InputError, match=r"are not part of a free decay.* band-pass"):
        clean(hits(8, modes, (0.5,), 0.001), name="x")
    single = clean(hits(8, {75.2: 0.0141}, (0.5,), 0.001), name="x")
    assert single.provenance.start == pytest.approx(0.5, abs=0.05)
