"""Simulate ring-downs as an analyser records them: a drive, first tuned, then constant; a decay; a noise floor.

The amplitude A follows dA/dt = -Σ c_i A^(p_i), where p_i is 1, 0 and 2 for viscous, Coulomb and quadratic damping
(Nayfeh & Mook, Nonlinear Oscillations, 1979, ch. 3). SciPy integrates this equation.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid, solve_ivp
from scipy.signal import lfilter

NEPER = 20.0 / np.log(10.0)
"""Decibels in one neper."""
POWERS: Mapping[str, float] = {"viscous": 1.0, "coulomb": 0.0, "quadratic": 2.0}
"""Power p of the amplitude in the decay rate dA/dt = −c Aᵖ of each damping term."""
TOP, RELEASE = -40.0, 0.1
"""Level in dB at the start of the decay; and time in s within which the direct signal of the drive vanishes after the
release."""
RESTED = np.exp(-60.0)
"""Smallest amplitude, relative to that at the start of the decay; smaller amplitudes are replaced by it, so that their
logarithm is finite."""


@dataclass(frozen=True)
class Ringdown:
    """The parameters of a ring-down.

    Attributes
    ----------
    rates : mapping
        Decay rate of each damping term in 1/s, at the amplitude at the start of the decay.
    fall : float
        Level of the noise floor below the level at the start of the decay, in dB.
    step : float
        Time between readings in s.
    before, behind : float
        Durations in s of the drive, and of the record after the decay has reached the floor.
    drop : float
        Fall of the reading in dB after the release, when the signal of the drive vanishes.
    hold : float
        Standard deviation in dB of the level during the drive.
    scatter, scatter_time : float
        Standard deviation in dB and correlation time in s of the multiplicative noise of the readings.
    drift : float
        Standard deviation in dB of the slow drift of the gain.
    floor_time : float
        Correlation time of the fast part of the noise floor, in s.
    slow_share : float
        Fraction of the power of the noise floor that is slow: thermal motion of the oscillator, with the correlation
        time of its decay.
    wander : float
        Standard deviation in dB of the slow changes of the level of the noise floor.
    constant : float
        Fraction of the power of the noise floor that does not fluctuate.
    deviation, deviation_length : float
        Standard deviation and correlation time of the relative deviation of the decay rate from the damping law. The
        correlation time is a fraction of the duration of the decay.
    """

    rates: Mapping[str, float]
    fall: float = 45.0
    step: float = 0.012
    before: float = 10.0
    behind: float = 20.0
    drop: float = 0.0
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


CASES = ("viscous", "coulomb", "quadratic", "viscous+coulomb", "viscous+quadratic")
"""Damping sums of simulated ring-downs; `draw_ringdown` draws one of them at random."""


def draw_ringdown(rng: np.random.Generator) -> Ringdown:
    """Draw the parameters of a ring-down with many faults of real records.

    The decay may deviate from the damping law, the gain may drift, and the noise floor is partly slow and may change
    its level. The sensor may also pick up the drive directly, which ends at the release. The decay lasts 20 to 60 s,
    falls by 20 to 50 dB to the noise floor, and has 100 to 4,000 readings.
    """
    duration, fall = float(rng.uniform(20, 60)), float(rng.uniform(20, 50))
    terms = CASES[rng.integers(len(CASES))].split("+")
    fall = min(fall, 30.0) if terms == ["quadratic"] else fall
    share = 1.0 if len(terms) == 1 else float(rng.uniform(0.3, 0.7))
    mean = fall / NEPER / duration
    # The fraction of the decay rate that a term causes depends on the amplitude; `share` applies at half of the fall in
    # dB.
    middle = float(np.exp(-0.5 * fall / NEPER))
    size = {"viscous": 1.0, "coulomb": middle, "quadratic": 1 / middle}
    step = duration / float(np.exp(rng.uniform(np.log(100), np.log(4000))))
    return Ringdown(
        rates={t: mean * part * size[t] for t, part in zip(terms, (share, 1 - share))},
        fall=fall,
        step=step,
        before=0.3 * duration,
        behind=0.5 * duration,
        scatter=float(np.exp(rng.uniform(np.log(0.01), np.log(0.1)))),
        scatter_time=float(rng.uniform(2 * step, 0.02 * duration + 2 * step)),
        floor_time=float(rng.uniform(step, 0.01 * duration + step)),
        deviation=float(rng.choice([0.0, 0.01, 0.03, 0.06])),
        deviation_length=float(rng.choice([0.1, 0.3, 1.0])),
        drift=float(rng.choice([0.0, 0.1])),
        slow_share=float(rng.uniform(0, 1)),
        wander=float(rng.choice([0.0, 1.0])),
        constant=float(rng.choice([0.0, 0.5])),
        drop=float(rng.choice([0.0, 4.0, 10.0])),
        hold=float(rng.uniform(0.1, 1.0)),
    )


@dataclass(frozen=True, eq=False)
class Simulated:
    """A simulated ring-down.

    Attributes
    ----------
    t, level : (n,) array
        Times in s and readings in dB.
    release : float
        Time of the start of the decay in s.
    x : (n,) array
        ln(A/A_start) of the amplitude A of the oscillator alone, without noise; NaN before the release.
    """

    t: np.ndarray
    level: np.ndarray
    release: float
    x: np.ndarray


def wandering(n: int, step: float, time: float, rng: np.random.Generator) -> np.ndarray:
    """Draw n values of an Ornstein-Uhlenbeck process with standard deviation 1, shape (n,).

    step: time between the values. time: correlation time of the process, in the unit of `step`.
    """
    a = np.exp(-step / time)
    noise = rng.standard_normal(n) * np.sqrt(1 - a * a)
    noise[0] = rng.standard_normal()
    return np.asarray(lfilter([1.0], [1.0, -a], noise))


def simulate(ringdown: Ringdown, rng: np.random.Generator) -> Simulated:
    """Simulate the readings in dB of a spectrum analyser or a lock-in amplifier during a ring-down.

    The record contains the drive, the decay, and the noise floor after it. ringdown: its parameters. rng: source of all
    random numbers.
    """
    n_fall, terms = ringdown.fall / NEPER, [(POWERS[term], c) for term, c in ringdown.rates.items()]
    # `duration`: time that the decay takes to reach the noise floor, according to the damping law.
    x = np.linspace(0.0, -n_fall, 4000)
    duration = float(np.trapezoid(1.0 / sum(c * np.exp((power - 1.0) * x) for power, c in terms), -x))
    t = np.arange(0.0, ringdown.before + duration + ringdown.behind, ringdown.step)

    def process(time: float, n: int = t.size) -> np.ndarray:
        return wandering(n, ringdown.step, time, rng)

    after = t >= ringdown.before
    since = t[after] - ringdown.before
    deviation = np.zeros(since.size)
    if ringdown.deviation:
        length = ringdown.deviation_length
        deviation = ringdown.deviation * wandering(since.size, ringdown.step / duration, length, rng)
    passed = cumulative_trapezoid(1.0 + deviation, since, initial=0.0)

    def slope(_: float, a: np.ndarray) -> np.ndarray:
        return -sum((c * np.maximum(a, 0.0) ** power for power, c in terms), np.zeros(1))

    a = solve_ivp(slope, (0.0, passed[-1]), (1.0,), "DOP853", passed, rtol=1e-12, atol=1e-14).y[0]
    free = np.log(np.maximum(a, RESTED))
    signal = np.ones(t.size, complex)
    signal[after] = np.exp(free)

    floor = 10.0 ** (-ringdown.fall / 10.0)
    noise = np.zeros(t.size, complex)
    fast, slow = 1 - ringdown.slow_share, ringdown.slow_share
    for share, time in ((fast, ringdown.floor_time), (slow, duration / n_fall)):
        if share > 0:
            noise += np.sqrt(share / 2) * (process(time) + 1j * process(time))
    level = 10.0 ** (ringdown.wander * process(duration / 3) / 20.0)
    noise *= np.sqrt(floor * (1 - ringdown.constant)) * level
    y = 10.0 * np.log10(np.abs(signal + noise) ** 2 + floor * ringdown.constant)

    # During the drive the level varies slowly, and strongly while the drive is tuned. The direct signal of the drive is
    # added.
    tuned = t < 0.4 * ringdown.before
    y[~after] += ringdown.hold * process(0.2 * ringdown.before + 0.05 * duration, int((~after).sum()))
    y[tuned] += -10.0 + 6.0 * process(0.3, int(tuned.sum()))
    y += ringdown.drop * np.clip(1.0 - (t - ringdown.before) / RELEASE, 0.0, 1.0)
    y += ringdown.scatter * process(ringdown.scatter_time)
    y += ringdown.drift * process(duration * 2)
    true = np.full(t.size, np.nan)
    true[after] = free
    return Simulated(t, y + TOP, ringdown.before, true)
