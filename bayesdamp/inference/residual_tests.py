"""Tests of the residuals at a mode: peaks of their spectrum.

The spectrum shows structure near the frequency of the oscillation, at its overtones, and at low frequencies. The fitted
directions (changes of the motion by fitted parameters) are projected out of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy  # loads its modules when they are used

OVERTONES = (2, 3)
"""Overtones at which the spectrum of the residuals is tested, as multiples of the frequency of the oscillation."""
BAND_NEIGHBOURS = 2
"""In the test of the residuals' spectrum, number of neighbouring frequencies on either side that are tested together
with a frequency, in steps of 1/duration. The residual of an oscillation under a wrong damping law is modulated slowly,
which spreads its peak over them."""
SLOW_TURNS = (0.5, 1.0, 1.5)
"""Low frequencies at which the spectrum of the residuals is tested, in cycles per duration of the record."""
LEAST_REMAINING_NORM = 0.3
"""The spectrum of the residuals is tested by projections on test waves (sines and cosines). A combination of them is
left out if at most this fraction of its norm remains after the changes of the residuals by fitted parameters are
projected out."""
MOST_SAMPLES = 20_000
"""Greatest number of values in the search for the largest peak of the residuals' spectrum; a longer record is averaged
in blocks. The frequencies that are lost are far above the tested overtones."""

# Clauses on the largest peak in the spectrum of the residuals; they follow "structure remains in the residuals: ".
AT_OSCILLATION = "at the frequency of the oscillation, as if damping or stiffness had another form or changed"
AT_OVERTONES = (
    "at overtones of the oscillation, as if the restoring force or the recorder's scale were nonlinear"
)
SLOW_STRUCTURE = "at low frequencies, as if the record's zero drifted"
OTHER_OSCILLATION = "another oscillation, {ratio:.2g} times as fast, as of a second mode or a drive"


@dataclass(frozen=True)
class SpectralLine:
    """The most significant peak of the residuals' spectrum.

    Attributes
    ----------
    chance : float
        p value of the peak under white noise. `find_spectral_line` corrects it for the number of its tests.
    words : str
        Description of the peak, to follow "structure remains in the residuals: ".
    """

    chance: float
    words: str


def find_spectral_line(
    t: np.ndarray, scores: np.ndarray, period: float, absorbed: np.ndarray
) -> SpectralLine:
    """Find the most significant peak in the spectrum of whitened residuals.

    It tests bands of frequencies at the oscillation, at its overtones and, unless the record has few cycles, at low
    frequencies; and the largest peak of the periodogram. In a band, the squared projection of the residuals on waves,
    from which the fitted directions are projected out, is chi-square distributed. The largest of m ordinates of the
    periodogram exceeds x with probability 1−(1−e^−x)^m (Fisher 1929).

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times in s.
    scores : ndarray, shape (n,)
        The whitened residuals.
    period : float
        Period of the oscillation in s.
    absorbed : ndarray, shape (n, k)
        Orthonormal basis of the fitted directions, which are the derivatives of the residuals by the fitted parameters.

    Returns
    -------
    SpectralLine
        The peak with the smallest p value, corrected for the number of tests.
    """
    length, cycles, across = _extent(t, period)
    fastest = 0.5 * t.size / length
    around = np.arange(-across, across + 1) / length
    bands = [
        (AT_OSCILLATION, 1 / period + around),
        (AT_OVERTONES, np.concatenate([k / period + around for k in OVERTONES])),
    ]
    if cycles > 2 * (across + 1):
        bands.append((SLOW_STRUCTURE, np.array(SLOW_TURNS) / length))
    lines = []
    for words, frequencies in bands:
        phase = 2 * np.pi * np.outer(t - t[0], frequencies[frequencies < fastest])
        waves = orthonormal(np.hstack([np.cos(phase), np.sin(phase)]))
        u, s, _ = np.linalg.svd(waves - absorbed @ (absorbed.T @ waves), full_matrices=False)
        remaining = u[:, s > LEAST_REMAINING_NORM]
        power = 0.5 * np.sum((remaining.T @ scores) ** 2)
        chance = float(scipy.special.gammaincc(0.5 * remaining.shape[1], power)) if remaining.size else 1.0
        lines.append(SpectralLine(chance, words))
    lines.append(find_largest_peak(t, scores, period))
    best = min(lines, key=lambda line: line.chance)
    return SpectralLine(min(1.0, len(lines) * best.chance), best.words)


def _extent(t: np.ndarray, period: float) -> tuple[float, float, int]:
    """Return the duration of a record in s, its number of cycles, and the half-width of a band of frequencies.

    The half-width is a number of steps of 1/duration: a third of the number of cycles, rounded down, but at most
    `BAND_NEIGHBOURS`. The duration includes one sampling interval after the last sample. period: period of the
    oscillation in s.
    """
    length = float(t[-1] - t[0]) * t.size / (t.size - 1)
    return length, length / period, int(np.clip(length / period / 3, 0, BAND_NEIGHBOURS))


def orthonormal(columns: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis, (n, r), of the space that columns, (n, k), span.

    The columns are first scaled to unit length. Negligible columns and directions are left out, so that r may be below
    k.
    """
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 1e-9 * max(float(size.max(initial=0.0)), 1e-300)]
    if columns.shape[1] == 0:
        return columns
    u, s, _ = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
    return u[:, s > 1e-6 * s[0]]


def find_largest_peak(t: np.ndarray, scores: np.ndarray, period: float) -> SpectralLine:
    """Return the largest peak of the periodogram; its p value is corrected for the number of frequencies.

    t: times in s, (n,), taken as evenly spaced; gaps broaden a peak, which then is only less significant. scores:
    whitened residuals, (n,); of other residuals only the words of the result have a meaning. period: period of the
    oscillation in s.
    """
    _, cycles, across = _extent(t, period)
    block = -(-scores.size // MOST_SAMPLES)
    many = scores.size // block
    blocks = scores[: many * block].reshape(many, block).sum(axis=1) / np.sqrt(block)
    power = np.abs(np.fft.rfft(blocks - blocks.mean()))[1:] ** 2 / many
    top = int(np.argmax(power))
    chance = -np.expm1(power.size * np.log1p(-np.exp(-power[top]))) if power[top] < 700 else 0.0
    turns, words = top + 1, OTHER_OSCILLATION.format(ratio=(top + 1) / cycles)
    if turns < 0.5 * cycles:
        words = SLOW_STRUCTURE
    elif abs(turns - cycles) < across + 1:
        words = AT_OSCILLATION
    elif any(abs(turns - k * cycles) < across + 1 for k in OVERTONES):
        words = AT_OVERTONES
    return SpectralLine(float(chance), words)
