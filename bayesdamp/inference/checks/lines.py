"""Where in the spectrum of whitened residuals structure is left: at the oscillation, its overtones, near zero."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaincc

OVERTONES = (2, 3)
ACROSS = 2
"""Frequencies on either side of one that count with it, in steps of one over the record's length: what is left of an
oscillation by a wrong law has an envelope of a few humps."""
SLOW_TURNS = (0.5, 1.0, 1.5)
"""Turns in the record's length of what is slow."""
ABSORBED = 0.3
"""A wave of which a fit leaves no more than this share is no longer looked at."""
MOST = 20_000
"""Samples among which a line is looked for; longer records are averaged in blocks, a line above them is far from any
overtone that matters."""

AT_OSCILLATION = (
    "they keep time with the oscillation, as where damping or stiffness is of another form or changes"
)
AT_OVERTONES = (
    "they hold overtones of the oscillation, as where the restoring force or the recorder's scale bends"
)
SLOW = "they are slow, as where the record's zero drifts"
LINE = "they hold another oscillation, {ratio:.2g} times as fast, as of a second mode or a drive"


@dataclass(frozen=True)
class Line:
    """The part of the spectrum that stands out most: its chance under white noise, for all parts looked at together,
    and where it is, in words that follow "structure is left in the residuals: "."""

    chance: float
    words: str


def standing_out(t: np.ndarray, scores: np.ndarray, period: float, absorbed: np.ndarray) -> Line:
    """Of whitened residuals (n,) at times t (s, (n,)): is there a part of the spectrum with more than white noise has?

    period: of the oscillation in s; absorbed: an orthonormal basis, (n, k), of what was fitted. The
    square of the residuals' projection on waves from which these are taken out is chi-square distributed; the largest
    ordinate of a periodogram exceeds x with a chance of 1 − (1 − e^−x)^m (Fisher 1929). A band holds so many waves
    whatever the record's length: for a small chance the power in it must be some three times that of the noise model,
    by which intervals would be too narrow by the root of that.
    """
    length, cycles, across = _extent(t, period)
    fastest = 0.5 * t.size / length
    bands = [
        (AT_OSCILLATION, _around(1, period, length, across)),
        (AT_OVERTONES, np.concatenate([_around(k, period, length, across) for k in OVERTONES])),
    ]
    if cycles > 2 * (across + 1):
        bands.append((SLOW, np.array(SLOW_TURNS) / length))
    found = [Line(_excess(t, scores, f[f < fastest], absorbed), words) for words, f in bands]
    found.append(_highest(scores, cycles, across))
    best = min(found, key=lambda line: line.chance)
    return Line(min(1.0, len(found) * best.chance), best.words)


def strongest(t: np.ndarray, residual: np.ndarray, period: float) -> str:
    """Where residuals (n,) have most power, not whitened, in the words of a `Line`."""
    _, cycles, across = _extent(t, period)
    return _highest(residual, cycles, across).words


def _extent(t: np.ndarray, period: float) -> tuple[float, float, int]:
    """(length in s, cycles, frequencies on either side that count with one) of a record."""
    length = float(t[-1] - t[0]) * t.size / (t.size - 1)
    return length, length / period, int(np.clip(length / period / 3, 0, ACROSS))


def _around(multiple: int, period: float, length: float, across: int) -> np.ndarray:
    return multiple / period + np.arange(-across, across + 1) / length


def orthonormal(columns: np.ndarray) -> np.ndarray:
    """An orthonormal basis, (n, r), of what columns (n, k) span, each of them scaled to the same length."""
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 1e-9 * max(float(size.max(initial=0.0)), 1e-300)]
    if columns.shape[1] == 0:
        return columns
    u, s, _ = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
    return u[:, s > 1e-6 * s[0]]


def _excess(t: np.ndarray, scores: np.ndarray, frequencies: np.ndarray, absorbed: np.ndarray) -> float:
    """The chance of as much power as scores (n,) have in waves of these frequencies (Hz)."""
    if frequencies.size == 0:
        return 1.0
    phase = 2 * np.pi * np.outer(t - t[0], frequencies)
    waves = orthonormal(np.hstack([np.cos(phase), np.sin(phase)]))
    u, s, _ = np.linalg.svd(waves - absorbed @ (absorbed.T @ waves), full_matrices=False)
    left = u[:, s > ABSORBED]
    return float(gammaincc(0.5 * left.shape[1], 0.5 * np.sum((left.T @ scores) ** 2))) if left.size else 1.0


def _highest(scores: np.ndarray, cycles: float, across: int) -> Line:
    """The highest of all ordinates; where gaps smear a line over some, it is only less easily seen."""
    block = -(-scores.size // MOST)
    many = scores.size // block
    blocks = scores[: many * block].reshape(many, block).sum(axis=1) / np.sqrt(block)
    power = np.abs(np.fft.rfft(blocks - blocks.mean()))[1:] ** 2 / many
    top = int(np.argmax(power))
    chance = -np.expm1(power.size * np.log1p(-np.exp(-power[top]))) if power[top] < 700 else 0.0
    turns, words = top + 1, LINE.format(ratio=(top + 1) / cycles)
    if turns < 0.5 * cycles:
        words = SLOW
    elif abs(turns - cycles) < across + 1:
        words = AT_OSCILLATION
    elif any(abs(turns - k * cycles) < across + 1 for k in OVERTONES):
        words = AT_OVERTONES
    return Line(float(chance), words)
