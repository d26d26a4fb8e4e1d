"""Draw random test cases: records that no law of the family fits, and records of the family with poor data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from validation.misfit import records as rec
from validation.truth.drawing import log_uniform
from validation.truth.oscillator import SUMS

SAMPLES = 240
OUTSIDE = (
    "beats", "two_modes", "driven", "clipped", "stiction", "drift", "wander", "cubic", "root", "damping_changes",
    "stiffness_changes",
)  # fmt: skip
"""Kinds of records that no law of the family fits."""
INSIDE = ("clean", "two_cycles", "coarse", "quantised", "outliers", "gaps", "slight_drift")
"""Kinds of records of the family, most of them with poor data."""


@dataclass(frozen=True)
class Case:
    """A simulated record.

    Attributes
    ----------
    name : str
        Name of the record.
    kind : str
        A kind in OUTSIDE or INSIDE.
    damping : str
        The true damping sum; or the true damping, if it is not in the family.
    noise : float
        Standard deviation of the noise relative to the amplitude.
    t, y : (n,) array
        Times in s and angles in rad.
    clean : (n,) array
        Angles without noise, rounding and outliers.
    amplitude : float
        Amplitude at the start in rad.
    """

    name: str
    kind: str
    damping: str
    noise: float
    t: np.ndarray
    y: np.ndarray
    clean: np.ndarray
    amplitude: float

    @property
    def inside(self) -> bool:
        """Whether a law of the family fits the record."""
        return self.kind in INSIDE


def draw_case(kind: str, number: int, seed: int) -> Case:
    """Simulate a random record of a kind. The record is determined by its kind, its number and the seed."""
    rng = np.random.default_rng([seed, (*OUTSIDE, *INSIDE).index(kind), number])
    cycles = float(rng.uniform(6, 12))
    if kind == "two_cycles":
        cycles = float(rng.uniform(2.1, 2.4))
    if kind == "coarse":
        cycles = (SAMPLES - 1) / 16
    times = np.linspace(0.0, 2 * np.pi * cycles, SAMPLES)
    left = float(rng.uniform(0.15, 0.8))
    eps = log_uniform(rng, 0.003, 0.03)
    noise = log_uniform(rng, 0.003, 0.05)
    damping = str(rng.choice(SUMS))
    terms = damping.split("+")
    shares = dict(
        zip(terms, 0.25 + (1 - 0.25 * len(terms)) * rng.dirichlet(np.ones(len(terms))), strict=True)
    )

    def spring(x: float) -> float:
        return x

    def family() -> rec.Force:
        return rec.damping_of(shares, cycles, left, eps)

    def free() -> np.ndarray:
        return rec.free(family(), spring, times)

    make: dict[str, Callable[[], tuple[np.ndarray, str]]] = {
        "beats": lambda: (_beats(rng, times, cycles, family()), damping),
        "two_modes": lambda: (free() + _second(rng, times, cycles), damping),
        "driven": lambda: (_driven(rng, times, family(), spring), damping),
        "stiction": lambda: (_sticking(rng, times, cycles), "stiction"),
        "drift": lambda: (free() + _sign(rng) * log_uniform(rng, 0.1, 1.0) * times / times[-1], damping),
        "wander": lambda: (free() + _wander(rng, times), damping),
        "cubic": lambda: (rec.free(rec.damping_of({"cubic": 1.0}, cycles, left), spring, times), "cubic"),
        "root": lambda: (rec.free(rec.damping_of({"root": 1.0}, cycles, left), spring, times), "root"),
        "damping_changes": lambda: (
            rec.changing(family(), times, damping_grows=_sign(rng) * rng.uniform(1.0, 2.5)), damping,
        ),
        "stiffness_changes": lambda: (
            rec.changing(family(), times, stiffness_grows=_sign(rng) * log_uniform(rng, 0.01, 0.1)), damping,
        ),
        "slight_drift": lambda: (free() + _sign(rng) * log_uniform(rng, 0.01, 0.1) * times / times[-1], damping),
    }  # fmt: skip
    clean, truth = make[kind]() if kind in make else (free(), damping)
    y = clean + noise * rng.standard_normal(SAMPLES)
    if kind == "clipped":
        y = _clipped(rng, y)
    if kind == "quantised":
        y = 0.1 * np.round(y / 0.1)
    if kind == "outliers":
        at = rng.choice(SAMPLES, round(SAMPLES * rng.uniform(0.01, 0.05)), replace=False)
        y[at] += rng.choice([-1.0, 1.0], at.size) * rng.uniform(0.3, 1.0, at.size)
    keep = np.ones(SAMPLES, bool)
    if kind == "gaps":  # their total length is constant, so that all these records have equally many samples
        for begin in rng.choice(7, 3, replace=False):
            first = 10 + 30 * int(begin) + int(rng.integers(0, 12))
            keep[first : first + 16] = False
    amplitude, frequency = log_uniform(rng, 0.05, 1.5), log_uniform(rng, 0.5, 40.0)
    rest = float(rng.normal(0.0, amplitude))
    t = times[keep] / frequency
    y, clean = (rest + amplitude * values[keep] for values in (y, clean))
    return Case(f"{kind}-{seed}-{number}", kind, truth, noise, t, y, clean, amplitude)


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _beats(rng: np.random.Generator, times: np.ndarray, cycles: float, damping: rec.Force) -> np.ndarray:
    coupling = rng.uniform(1.0, 4.0) / cycles
    return rec.coupled(damping, times, coupling, coupling * rng.uniform(-1.0, 1.0))


def _second(rng: np.random.Generator, times: np.ndarray, cycles: float) -> np.ndarray:
    ratio = -np.log(rng.uniform(0.15, 0.8)) / (2 * np.pi * cycles)
    amplitude, frequency = log_uniform(rng, 0.05, 0.5), rng.uniform(1.3, 5.0)
    return rec.second_mode(times, amplitude, frequency, ratio / frequency, rng.uniform(0, 2 * np.pi))


def _driven(
    rng: np.random.Generator, times: np.ndarray, damping: rec.Force, spring: rec.Restoring
) -> np.ndarray:
    amplitude, phase = log_uniform(rng, 0.05, 0.4), rng.uniform(0, 2 * np.pi)
    return rec.driven(damping, spring, times, rng.uniform(0.5, 1.6), amplitude, phase)


def _sticking(rng: np.random.Generator, times: np.ndarray, cycles: float) -> np.ndarray:
    over, speed = rng.uniform(1.5, 3.0), rng.uniform(0.03, 0.15)
    # Kinetic friction reduces the amplitude by 4 × kinetic in each cycle: the motion does not stop within the record.
    kinetic = rng.uniform(0.6, 0.95) / (4 * cycles)
    return rec.sticking(kinetic, over * kinetic, speed, times)


def _wander(rng: np.random.Generator, times: np.ndarray) -> np.ndarray:
    turns, phase = rng.uniform(0.4, 3.0), rng.uniform(0, 2 * np.pi)
    return log_uniform(rng, 0.03, 0.4) * np.sin(2 * np.pi * turns * times / times[-1] + phase)


def _clipped(rng: np.random.Generator, y: np.ndarray) -> np.ndarray:
    level = rng.uniform(0.4, 0.9)
    low, high = (-level, level) if rng.random() < 0.5 else (-np.inf, level)
    return np.clip(y, low, high)
