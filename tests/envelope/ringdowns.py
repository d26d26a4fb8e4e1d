"""Simulated ring-downs: a drive that is searched and held, a decay, a noise floor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.signal import lfilter

from bayesdamp.physics.amplitude.laws import POWERS, decay, rate

NEPER = 20.0 / np.log(10.0)


@dataclass(frozen=True)
class Ringdown:
    """How a ring-down is made.

    rates: of each term in 1/s at the amplitude at the start; fall: dB that it falls to the floor; step: s between
    readings; before: s of drive; behind: s after it reaches the floor; drop: dB that the reading falls at the release
    within `release` s (the drive's own signal, not the oscillator's); hold: dB of its wandering while driven. scatter,
    scatter_time: multiplicative scatter in dB and s; drift: dB of slow drift of the gain over the record. floor_time:
    correlation time (s) of the floor's fast part; slow_share: of its power that is thermal motion, correlated over the
    decay; wander: dB by which its level wanders; constant: share of the floor that does not fluctuate.
    deviation, deviation_length: sd of the law's relative deviation, and its correlation length in durations.
    residual_drive: dB below the start at which a drive stays on (its amplitude, in quadrature).
    """

    rates: Mapping[str, float]
    fall: float = 45.0
    step: float = 0.012
    before: float = 10.0
    behind: float = 20.0
    drop: float = 0.0
    release: float = 0.1
    hold: float = 0.5
    scatter: float = 0.03
    scatter_time: float = 1.0
    drift: float = 0.0
    floor_time: float = 0.1
    slow_share: float = 0.5
    wander: float = 0.0
    constant: float = 0.0
    deviation: float = 0.0
    deviation_length: float = 0.3
    residual_drive: float | None = None
    top: float = -40.0


@dataclass(frozen=True, eq=False)
class Simulated:
    """t in s, level in dB, shape (n,); release: time of the start of the decay; rate_at(x): the true -dx/dt where
    ln(A/A_start) is x, and decay: x of the oscillator alone at t, nan before the release."""

    t: np.ndarray
    level: np.ndarray
    release: float
    x: np.ndarray
    speed: np.ndarray


def wandering(n: int, step: float, time: float, rng: np.random.Generator) -> np.ndarray:
    """An Ornstein-Uhlenbeck process of sd 1, shape (n,)."""
    a = np.exp(-step / time)
    noise = rng.standard_normal(n) * np.sqrt(1 - a * a)
    noise[0] = rng.standard_normal()
    return np.asarray(lfilter([1.0], [1.0, -a], noise))


def simulate(ringdown: Ringdown, rng: np.random.Generator) -> Simulated:
    """A ring-down as a spectrum analyser or a lock-in shows it, in dB."""
    terms = tuple(term for term in POWERS if term in ringdown.rates)
    rates = np.array([ringdown.rates[term] for term in terms])
    # Time that the decay itself takes to the floor, by its own law.
    x = np.linspace(0.0, -ringdown.fall / NEPER, 4000)
    took = float(np.trapezoid(1.0 / rate(x, terms, rates), -x))
    t = np.arange(0.0, ringdown.before + took + ringdown.behind, ringdown.step)
    after = t >= ringdown.before
    s = (t[after] - ringdown.before) / took
    g = np.zeros(s.size)
    if ringdown.deviation:
        g = ringdown.deviation * wandering(s.size, ringdown.step / took, ringdown.deviation_length, rng)
    clock = cumulative_trapezoid(1.0 + g, t[after], initial=0.0)
    free = decay(clock, 0.0, terms, rates)
    speed = rate(np.maximum(free, -40), terms, rates) * (1.0 + g)
    amplitude = np.ones(t.size)
    amplitude[after] = np.exp(free)
    floor = 10.0 ** (-ringdown.fall / 10.0)
    mean_rate = ringdown.fall / NEPER / took
    complex_noise = np.zeros(t.size, complex)
    for share, time in (
        (1 - ringdown.slow_share, ringdown.floor_time),
        (ringdown.slow_share, 1.0 / mean_rate),
    ):
        if share > 0:
            part = wandering(t.size, ringdown.step, time, rng) + 1j * wandering(
                t.size, ringdown.step, time, rng
            )
            complex_noise += np.sqrt(share / 2) * part
    level = 10.0 ** (ringdown.wander * wandering(t.size, ringdown.step, took / 3, rng) / 20.0)
    complex_noise *= np.sqrt(floor * (1 - ringdown.constant)) * level
    whole = amplitude.astype(complex)
    if ringdown.residual_drive is not None:
        whole += 1j * 10.0 ** (-ringdown.residual_drive / 20.0)
    power = np.abs(whole + complex_noise) ** 2 + floor * ringdown.constant
    y = 10.0 * np.log10(power)
    before = ~after
    # The drive: searched (a wild level), then held (a slow wandering), with its own signal on top.
    searched = t < 0.4 * ringdown.before
    y[before] += ringdown.hold * wandering(
        int(before.sum()), ringdown.step, 0.2 * ringdown.before + 0.05 * took, rng
    )
    y[searched] += -10.0 + 6.0 * wandering(int(searched.sum()), ringdown.step, 0.3, rng)
    passing = np.clip(1.0 - (t - ringdown.before) / max(ringdown.release, 1e-9), 0.0, 1.0)
    y += ringdown.drop * passing
    y += ringdown.scatter * wandering(t.size, ringdown.step, ringdown.scatter_time, rng)
    y += ringdown.drift * wandering(t.size, ringdown.step, took * 2, rng)
    left = np.full(t.size, np.nan)
    left[after] = free
    gone = np.full(t.size, np.nan)
    gone[after] = speed
    return Simulated(t, y + ringdown.top, ringdown.before, left, gone)
