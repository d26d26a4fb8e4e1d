"""Free decays of whole oscillators by another solver, and the envelopes that their turning points make."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

from bayesdamp.records.envelope.record import EnvelopeRecord, made_record

OMEGA = 2 * np.pi * 3.0
START = 0.2
"""rad."""
SHARP = 1e-4
"""rad/s within which friction turns over."""
FLOOR = 1e-3
"""Of the amplitude at the start."""
Force = Callable[[float, float], float]


def _sign(v: float) -> float:
    return float(np.tanh(v / SHARP))


# Written here from the equations of their sources, for decays by some 20 dB in 40 s.
FORCES: dict[str, Force] = {
    "viscous": lambda x, v: 2 * 0.06 * v,
    "coulomb": lambda x, v: 0.13 * _sign(v),
    "quadratic": lambda x, v: 0.11 * v * abs(v),
    "cubic": lambda x, v: 0.15 * v**3,
    "displacement": lambda x, v: 150.0 * x * x * v,
    "structural": lambda x, v: 3.2 * abs(x) * _sign(v),
    "power": lambda x, v: 0.11 * abs(v) ** 1.5 * np.sign(v),
    "stribeck": lambda x, v: 0.07 * (1 + 3.0 * np.exp(-((v / 1.2) ** 2))) * _sign(v),
    "dry_position": lambda x, v: 0.09 * (1 + 2.0 * (x / START) ** 2) * _sign(v),
    "thinning": lambda x, v: 0.5 * v / (1 + abs(v) / 0.35),
}


def turning_points(force: Force, cycles: int = 120, least: float = 0.04) -> tuple[np.ndarray, np.ndarray]:
    """Times and amplitudes (half the distance of two turning points, rad) of θ̈ + F(θ, θ̇) + ω²θ = 0 from rest at START,
    until the amplitude is `least` of that."""

    def turns(t, y):
        return y[1]

    whole = solve_ivp(
        lambda t, y: [y[1], -(OMEGA**2) * y[0] - force(y[0], y[1])], (0.0, 2 * np.pi / OMEGA * cycles), [START, 0.0],
        method="LSODA", rtol=1e-8, atol=1e-10, events=turns, max_step=0.03,
    )  # fmt: skip
    t, x = whole.t_events[0], whole.y_events[0][:, 0]
    middle, sizes = 0.5 * (t[1:] + t[:-1]), 0.5 * np.abs(np.diff(x))
    rested = np.flatnonzero(sizes < least * START)
    behind = int(rested[0]) if rested.size else sizes.size
    return middle[:behind], sizes[:behind]


def envelope(
    force: Force,
    seed: int,
    unit: str = "rad",
    frequency: float | None = OMEGA / (2 * np.pi),
    noise: float = 0.004,
) -> EnvelopeRecord:
    """The envelope as a record, its readings with 0.4 % of scatter and a floor of a thousandth of the start."""
    t, a = turning_points(force)
    rng = np.random.default_rng(seed)
    floor = FLOOR * START * rng.standard_normal((2, a.size)) / np.sqrt(2)
    read = np.hypot(a * np.exp(noise * rng.standard_normal(a.size)) + floor[0], floor[1])
    readings = 20 * np.log10(read) if unit in ("dB", "dBm") else read * {"deg": 180 / np.pi}.get(unit, 1.0)
    return made_record("x", t, readings, unit, frequency)
