"""Checks of a fit: tests of the residuals, and fits to parts of the record.

The spectrum of the residuals shows structure near the frequency of the oscillation, at its overtones, and at low
frequencies. The fit removes from the residuals whatever a change of the fitted parameters can explain; the tests of the
spectrum take this into account by projecting these directions out.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.inference.coordinates import truncated_near
from bayesdamp.inference.mode import ROUGH_LAST_STEP, Mode, covariance_factor, maximise_posterior, value_sds
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.noise import NoiseModel
from bayesdamp.types import P_LIMIT, FitCheck, FitStatus, Refusal

OVERTONES = (2, 3)
"""Overtones at which the spectrum of the residuals is tested, as multiples of the frequency of the oscillation."""
BAND_NEIGHBOURS = 2
"""The test of the residuals' spectrum at one frequency includes up to this number of neighbouring frequencies on either
side, in steps of 1/duration. If the damping law is wrong, the residual is an oscillation with slowly changing
amplitude, and its peak in the spectrum is spread over these neighbours."""
SLOW_TURNS = (0.5, 1.0, 1.5)
"""Low frequencies at which the spectrum of the residuals is tested, in cycles per duration of the record."""
LEAST_REMAINING_NORM = 0.3
"""The spectrum of the residuals is tested by projections on test waves (sines and cosines). The changes of the
residuals by the fitted parameters are first projected out of these waves. A combination of waves is left out if at most
this fraction of its norm remains."""
MOST_SAMPLES = 20_000
"""The search for the largest peak of the residuals' spectrum uses at most this number of values; a longer record is
averaged in blocks. This loses only frequencies that are far above the tested overtones."""

# Clauses on the largest peak in the spectrum of the residuals; they follow "structure remains in the residuals: ".
AT_OSCILLATION = "at the frequency of the oscillation, as if damping or stiffness had another form or changed"
AT_OVERTONES = (
    "at overtones of the oscillation, as if the restoring force or the recorder's scale were nonlinear"
)
SLOW_STRUCTURE = "at low frequencies, as if the record's zero drifted"
OTHER_OSCILLATION = "another oscillation, {ratio:.2g} times as fast, such as a second mode or a drive"


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

    Bands of frequencies are tested at the oscillation, at its overtones and, unless the record has few cycles, at low
    frequencies. Without a misfit, the squared projection of the residuals on the waves of a band is chi-square
    distributed; the directions in which the fit changes the residuals (`absorbed`) are first projected out of the
    waves. The largest peak of the whole periodogram is tested too: the largest of m ordinates exceeds x with
    probability 1−(1−e^−x)^m (Fisher 1929).

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times in s.
    scores : ndarray, shape (n,)
        The whitened residuals.
    period : float
        Period of the oscillation in s.
    absorbed : ndarray, shape (n, k)
        Orthonormal basis of the derivatives of the residuals by the fitted parameters.

    Returns
    -------
    SpectralLine
        The peak with the smallest p value, corrected for the number of tests.
    """
    length, cycles, across = _extent(t, period)
    fastest = 0.5 * t.size / length
    around = np.arange(-across, across + 1) / length
    overtones = np.concatenate([k / period + around for k in OVERTONES])
    bands = [(AT_OSCILLATION, 1 / period + around), (AT_OVERTONES, overtones)]
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
    """Return the duration of a record in s, its number of cycles, and the half-width of the tested frequency bands.

    The half-width is a number of frequency steps of 1/duration: a third of the number of cycles, rounded down, but at
    most `BAND_NEIGHBOURS`. The duration includes one sampling interval after the last sample. t: times in s, (n,).
    period: period of the oscillation in s.
    """
    length = float(t[-1] - t[0]) * t.size / (t.size - 1)
    return length, length / period, int(np.clip(length / period / 3, 0, BAND_NEIGHBOURS))


def orthonormal(columns: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis, (n, r), of the space that columns, (n, k), span.

    The columns are first scaled to unit length. Negligible columns and directions are left out, so r may be smaller
    than k.
    """
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 1e-9 * max(float(size.max(initial=0.0)), 1e-300)]
    if columns.shape[1] == 0:
        return columns
    u, s, _ = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
    return u[:, s > 1e-6 * s[0]]


def find_largest_peak(t: np.ndarray, scores: np.ndarray, period: float) -> SpectralLine:
    """Return the largest peak of the periodogram of residuals; its p value is corrected for the number of frequencies.

    t: times in s, (n,), assumed evenly spaced; interruptions broaden a peak, which makes it less significant. scores:
    whitened residuals, (n,). If other residuals are given, the description of the peak is right but its p value has no
    meaning. period: period of the oscillation in s.
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


PREDICTIVE_DRAWS = 200
"""Number of posterior draws in the predictive check. Their statistics are compared with those of the same number of
series of simulated white noise."""
MOST_RESIDUALS = 2_000_000
"""Approximate greatest number of residuals (draws times samples) that the predictive check holds in memory at a time;
16 MB for each array."""
DIFFERENCE_STEP = 0.1
"""Step of the finite differences of the residuals with respect to a parameter, in posterior standard deviations."""
ZERO_SCORE = 1e-6
"""A damping coefficient counts as zero if the absolute value of its score is at most this. (A score is a parameter
transformed so that its prior is standard normal; a score of 0 is a coefficient of 0.)"""
LINE_LIMIT = 0.005
"""A model has a misfit if the largest peak in the spectrum of its residuals has a p value below this. The limits
`LINE_LIMIT`, `P_LIMIT` and `WINDOW_LIMIT` together reject 2 % of true models (conventional)."""
NAMED_PEAK_LIMIT = 0.1
"""If a model does not fit, the verdict describes the structure that remains: the largest peak in the spectrum of the
whitened residuals if its p value is at most this, otherwise the largest peak in that of the residuals themselves."""
OUTLIER_KURTOSIS = 1.0
"""Outliers are reported only if the excess kurtosis of the whitened residuals is larger than this. A Student t
distribution with ten degrees of freedom has the excess kurtosis 1."""
WINDOW_LIMIT = 0.005
"""A model has a misfit if the largest shift of a damping coefficient between a half of the record and the whole record
has a p value below this, after correction for the number of shifts (conventional)."""


def autocorrelation(x: np.ndarray, lags: int) -> np.ndarray:
    """Return the autocorrelation of series x, (..., n), at lags of 0 to `lags` samples, (..., lags + 1).

    It is 1 at lag 0. The mean of each series is subtracted first. Sums at larger lags have fewer terms, which is not
    corrected. A constant series gives 0 at all lags.
    """
    x = x - x.mean(axis=-1, keepdims=True)
    size = scipy.fft.next_fast_len(x.shape[-1] + lags, real=True)
    power = np.abs(np.fft.rfft(x, size, axis=-1)) ** 2
    raw = np.fft.irfft(power, size, axis=-1)[..., : lags + 1]
    return raw / np.maximum(raw[..., :1], 1e-300)


def laplace_draws(mode: Mode, count: int, seed: int) -> np.ndarray:
    """Draw scores from Laplace's approximation of the posterior, (count, d).

    A score is a parameter transformed so that its prior is standard normal; the d columns are in the order of
    `Target.names`. The approximation is a normal distribution with the gradient of the log posterior at the mode and
    the Gauss–Newton covariance of `Mode.factor`. Scores of coefficients that cannot be negative (reflected scores) are
    truncated at zero.
    """
    return truncated_near(mode.near, mode.z, mode.factor).draw(np.random.default_rng(seed), count)


def kurtosis(x: np.ndarray) -> np.ndarray:
    """Return the excess kurtosis of x, (..., n), along its last axis: (...).

    It is about 0 for normal values, large if there are outliers, and −3 for a constant series.
    """
    x = x - x.mean(axis=-1, keepdims=True)
    square = x**2
    return np.mean(square**2, axis=-1) / np.maximum(np.mean(square, axis=-1) ** 2, 1e-300) - 3.0


def _statistics(scores: np.ndarray, lags: int) -> np.ndarray:
    """Return the two statistics that the predictive check uses, (2, ...), for series of whitened residuals, (..., n).

    The first is the Box–Pierce statistic n Σ ρ_l², where ρ_l is the autocorrelation at a lag of l samples and the sum
    is over the lags 1 to `lags`. The second is the excess kurtosis. scores: the whitened residuals.
    """
    squares = np.sum(autocorrelation(scores, lags)[..., 1:] ** 2, axis=-1)
    return np.stack([scores.shape[-1] * squares, kurtosis(scores)])


@lru_cache(maxsize=4)
def _null_statistics(n: int, lags: int, seed: int) -> np.ndarray:
    """Return the two statistics of `_statistics` for simulated white noise, (2, PREDICTIVE_DRAWS).

    The noise consists of PREDICTIVE_DRAWS series of n standard normal values. lags: greatest lag of the first
    statistic. The result is cached, because it is the same for all models.
    """
    noise = np.random.default_rng(seed + 1)
    return np.stack([_statistics(noise.standard_normal(n), lags) for _ in range(PREDICTIVE_DRAWS)], axis=1)


def tangents(target: Target, mode: Mode) -> np.ndarray:
    """Return the derivatives of the whitened residuals by the parameters of the motion, one row for each, (k, n).

    They span what a fit removes from the residuals, which `find_spectral_line` allows for. The rows are in the order of
    `target.names`. They are finite differences, per posterior standard deviation of the parameter's standard normal
    score. Two kinds of parameters have no row: coefficients that are zero at the mode, because they are at their bound
    and do not adapt to the residuals, and parameters whose derivative is not finite. Under heavy-tailed noise the
    residuals are in the unit of the record instead of whitened, because whitening is not linear for this noise and
    would distort the derivatives.
    """
    at_zero = target.reflected & (np.abs(mode.z) <= ZERO_SCORE)
    free = [i for i in target.moving if not at_zero[i]]
    shifted = mode.z + np.diag(DIFFERENCE_STEP * mode.sd())[free]
    residuals = mode.likelihood.residuals(np.stack([mode.z, *shifted]))
    if not target.noise_model.heavy_tailed:
        residuals = [mode.likelihood.whitened(r, mode.z) for r in residuals]
    here, *scores = residuals
    slopes = (np.array(scores).reshape(len(free), here.size) - here) / DIFFERENCE_STEP
    return slopes[np.all(np.isfinite(slopes), axis=1)]


def check_fit(target: Target, mode: Mode, period: float, seed: int) -> tuple[FitCheck, dict[str, np.ndarray]]:
    """Check how well a model fits: test its residuals, and fit halves of the record.

    The predictive check compares the whitened residuals for draws from Laplace's approximation of the posterior with
    simulated white noise. It uses their autocorrelation up to a largest lag, and their kurtosis.

    Parameters
    ----------
    target : Target
        The model with its record and priors.
    mode : Mode
        Mode of its posterior.
    period : float
        Period of the oscillation in s. It is the largest lag of the predictive check, limited to the range from 4 to
        n/5 samples (4 if n < 20).
    seed : int
        Seed of the random draws.

    Returns
    -------
    check : FitCheck
        Rms (in the unit of the record) and autocorrelation at lag one of the residuals, not whitened; p value of the
        predictive check of the autocorrelation; largest change of a damping coefficient between a half and the whole
        record, in sds; and the verdict: a text that says whether the model fits and, if not, why. These values are
        columns of fits.csv.
    arrays : dict of str to ndarray
        `fit` (the motion at the mode) and `residual`, (n,), in the unit of the record; `whitened`: the whitened
        residuals, (n,), which should be independent and standard normal; `autocorrelation`: that of the whitened
        residuals, (l,), from lag 0 to three times the largest lag of the predictive check, but at most n/2.
    """
    likelihood, t, n = mode.likelihood, target.signal.t, target.signal.t.size
    r = likelihood.residual(mode.z)
    white = likelihood.whitened(r, mode.z)
    lags = int(np.clip(period / np.median(np.diff(t)), 4, max(n // 5, 4)))
    # Posterior predictive p values of the autocorrelation and of the kurtosis of whitened residuals.
    draws = laplace_draws(mode, PREDICTIVE_DRAWS, seed)
    parts = np.array_split(draws, max(4, PREDICTIVE_DRAWS * n // MOST_RESIDUALS))
    scores = (np.stack([likelihood.whitened(likelihood.residual(z), z) for z in part]) for part in parts)
    observed = np.concatenate([_statistics(s, lags) for s in scores], axis=1)
    # A draw with an unbounded motion gives nan, which counts as more extreme than any noise.
    beyond = np.sum(_null_statistics(n, lags, seed) >= np.nan_to_num(observed, nan=np.inf), axis=1)
    p, p_tails = ((1 + beyond) / (PREDICTIVE_DRAWS + 1)).tolist()
    outliers = p_tails < P_LIMIT and float(kurtosis(white)) > OUTLIER_KURTOSIS
    line = find_spectral_line(t, white, period, orthonormal(tangents(target, mode).T))
    # Whitening has removed the peaks, so describe the largest peak of the residuals themselves.
    if line.chance > NAMED_PEAK_LIMIT:
        line = replace(line, words=find_largest_peak(t, r, period).words)
    shift, count = _largest_shift(target, mode)
    window_p = min(1.0, count * math.erfc(shift / math.sqrt(2)))
    arrays = {
        "fit": target.signal.y - r,
        "residual": r,
        "whitened": white,
        "autocorrelation": autocorrelation(white, min(3 * lags, n // 2)),
    }
    check = FitCheck(
        rms=float(np.sqrt(np.mean(r**2))),
        residual_autocorrelation=float(autocorrelation(r, 1)[1]),
        predictive_p=p,
        window_spread=shift,
        verdict=_verdict(target.noise_model, p, line, window_p, outliers),
    )
    return check, arrays


def _verdict(noise: NoiseModel, p: float, line: SpectralLine, window_p: float, outliers: bool) -> str:
    """Return the verdict as text: that the model fits, or that it does not and the first reason that applies.

    The reasons are tried in this order: structure in the residuals, coefficients that change during the record,
    outliers. The limits are `P_LIMIT` for p, `LINE_LIMIT` and `WINDOW_LIMIT`; outliers do not count if the noise model
    allows for them. If the model fits with correlated noise, the text says so.

    noise: the noise model of the fit. p: p value of the predictive check of the autocorrelation. line: largest peak of
    the residuals' spectrum. window_p: p value of the shifts of coefficients between parts of the record. outliers:
    whether the residuals have significant outliers.
    """
    correlated, no = noise.name == "correlated", FitStatus.DOES_NOT_FIT
    if p < P_LIMIT or line.chance < LINE_LIMIT:
        under = "" if correlated else " under independent noise"
        return no.because(f"structure remains in the residuals{under}: {line.words}")
    if window_p < WINDOW_LIMIT:
        return no.because("the coefficients change from one part of the record to another")
    if outliers and not noise.heavy_tailed:
        return no.because("outliers in the residuals, which this noise model does not allow for")
    return f"{FitStatus.FITS.value}, with correlated noise" if correlated else FitStatus.FITS.value


def _largest_shift(target: Target, mode: Mode) -> tuple[float, int]:
    """Fit the first, the middle and the last half of the record, and compare their damping coefficients with the mode.

    The motion of every fit starts at the record's first sample. A half whose fit has no finite posterior is left out.

    Returns
    -------
    largest : float
        Largest difference of a damping coefficient between a half and the whole record, in standard deviations of this
        difference (taken as at least half of the sd in the whole record); 0 if there are no differences.
    count : int
        Number of differences that were compared. A difference whose standard deviation is nan does not count: the
        information matrix of a fit is then not positive definite.
    """
    names, n = target.oscillator.coefficients, target.signal.t.size

    def values_and_sds(z: np.ndarray, information: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the damping coefficients at standard normal scores z, (d,), and their standard deviations.

        The standard deviations follow from the information of the scores, (d, d); they are nan if it is not positive
        definite.
        """
        try:
            factor = covariance_factor(information)
        except Refusal:  # the information is too ill-conditioned
            factor = np.full_like(information, np.nan)
        values, sds = target.values(z), value_sds(target, z, factor @ factor.T)
        return np.array([float(values[name]) for name in names]), np.array([sds[name] for name in names])

    whole, whole_sd = values_and_sds(mode.z, mode.information)
    shifts = [np.empty(0)]
    for start in (0, (n - n // 2) // 2, n - n // 2):
        part = replace(mode.likelihood, part=slice(start, start + n // 2))
        top = maximise_posterior(part, mode.z, close=ROUGH_LAST_STEP)
        if np.isfinite(top.value):
            values, sd = values_and_sds(top.x, top.information)
            # A half is part of the whole record, so the variance of the shift is the difference (Hausman 1978).
            variance = np.maximum(sd**2 - whole_sd**2, 0.25 * whole_sd**2)
            shifts.append(np.abs(values - whole) / np.sqrt(variance))
    every = np.concatenate(shifts)
    finite = every[~np.isnan(every)]
    return float(finite.max(initial=0.0)), finite.size
