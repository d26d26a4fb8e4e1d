"""Checks of a fit: tests of the residuals, and fits to parts of the record."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.inference.coordinates.truncated_normal import truncated_near
from bayesdamp.inference.mode import ROUGH_LAST_STEP, Mode, covariance_factor, maximise_posterior, value_sds
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.noise import NoiseModel
from bayesdamp.inference.residual_tests import (
    SpectralLine,
    find_largest_peak,
    find_spectral_line,
    orthonormal,
)
from bayesdamp.outcomes import P_LIMIT, FitStatus
from bayesdamp.types import FitCheck, Refusal

PREDICTIVE_DRAWS = 200
"""Number of posterior draws in the predictive check. Their statistics are compared with those of the same number of
series of simulated white noise."""
MOST_RESIDUALS = 2_000_000
"""Approximate greatest number of residuals (draws times samples) that the predictive check holds in memory at a time;
16 MB for each array."""
DIFFERENCE_STEP = 0.1
"""Step of the finite differences of the residuals with respect to a parameter, in posterior standard deviations."""
ZERO_SCORE = 1e-6
"""A damping coefficient counts as zero if the absolute value of its score is at most this. (A score is a transformed
parameter with a standard normal prior; a score of 0 is a coefficient of 0.)"""
LINE_LIMIT = 0.005
"""The residuals have a misfit if the largest peak of their spectrum has a p value below this. Together with `P_LIMIT`
and `WINDOW_LIMIT`, 2 % of true models are rejected (conventional)."""
NAMED_PEAK_LIMIT = 0.1
"""If the largest peak of the whitened residuals' spectrum has a p value of at most this, the verdict names it as the
remaining structure; otherwise the verdict names the largest peak of the residuals themselves."""
OUTLIER_KURTOSIS = 1.0
"""Outliers are reported only if the excess kurtosis of the whitened residuals is larger than this. A Student t
distribution with ten degrees of freedom has the excess kurtosis 1."""
WINDOW_LIMIT = 0.005
"""A model has a misfit if the largest shift of a damping coefficient between a half of the record and the whole record
has a p value below this, after correction for the number of shifts (conventional)."""


def autocorrelation(x: np.ndarray, lags: int) -> np.ndarray:
    """Return the autocorrelation of series x, (..., n), at lags 0 to `lags`, (..., lags + 1); it is 1 at lag 0.

    The mean of each series is subtracted first. The lags are in samples. Sums at larger lags have fewer terms, which is
    not corrected. A constant series gives 0 at all lags.
    """
    x = x - x.mean(axis=-1, keepdims=True)
    size = scipy.fft.next_fast_len(x.shape[-1] + lags, real=True)
    power = np.abs(np.fft.rfft(x, size, axis=-1)) ** 2
    raw = np.fft.irfft(power, size, axis=-1)[..., : lags + 1]
    return raw / np.maximum(raw[..., :1], 1e-300)


def laplace_draws(mode: Mode, count: int, seed: int) -> np.ndarray:
    """Draw scores from Laplace's approximation of the posterior, (count, d).

    A score is a parameter transformed to a standard normal prior; the d columns are in the order of `Target.names`. The
    approximation is a normal distribution with the gradient of the log posterior at the mode and the Gauss–Newton
    covariance of `Mode.factor`. Scores of coefficients that cannot be negative (reflected scores) are truncated at
    zero.
    """
    normal = truncated_near(mode.near, mode.z, mode.factor)
    return normal.draw(np.random.default_rng(seed), count)


def kurtosis(x: np.ndarray) -> np.ndarray:
    """Return the excess kurtosis of x, (..., n), along its last axis: 0 if normal, large with outliers.

    It is −3 for a constant series.
    """
    x = x - x.mean(axis=-1, keepdims=True)
    square = x**2
    return np.mean(square**2, axis=-1) / np.maximum(np.mean(square, axis=-1) ** 2, 1e-300) - 3.0


def _statistics(scores: np.ndarray, lags: int) -> np.ndarray:
    """Return two statistics of series of whitened residuals, `scores` (..., n), for the predictive check: (2, ...).

    The first is the Box–Pierce statistic n Σ ρ_l², where ρ_l is the autocorrelation at a lag of l samples and the sum
    is over the lags 1 to `lags`. The second is the excess kurtosis.
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

    They are finite differences, per posterior standard deviation of the parameter's standard normal score. Two kinds of
    parameters have no row: coefficients that are zero at the mode, because they are at their bound and do not adapt to
    the residuals, and parameters whose derivative is not finite. The rows are in the order of `target.names`. Under
    heavy-tailed noise the residuals are not whitened, but in the unit of the record: whitening is not linear there, and
    would distort the directions of the derivatives.
    """
    at_zero = target.reflected & (np.abs(mode.z) <= ZERO_SCORE)
    free = [i for i in target.moving if not at_zero[i]]
    steps = DIFFERENCE_STEP * mode.sd()
    shifted = mode.z + np.diag(steps)[free]
    residuals = mode.likelihood.residuals(np.stack([mode.z, *shifted]))
    if not target.noise_model.heavy_tailed:
        residuals = [mode.likelihood.whitened(r, mode.z) for r in residuals]
    here, *scores = residuals
    slopes = (np.array(scores).reshape(len(free), here.size) - here) / DIFFERENCE_STEP
    return slopes[np.all(np.isfinite(slopes), axis=1)]


def check_fit(target: Target, mode: Mode, period: float, seed: int) -> tuple[FitCheck, dict[str, np.ndarray]]:
    """Check how well a model fits: test its residuals, and fit halves of the record.

    Parameters
    ----------
    target : Target
        The model with its record and priors.
    mode : Mode
        Mode of its posterior.
    period : float
        Period of the oscillation in s. The predictive check uses autocorrelations at lags up to one period, but at
        least up to 4 samples and at most up to n/5.
    seed : int
        Seed of the random draws.

    Returns
    -------
    check : FitCheck
        The numbers of fits.csv, and the verdict.
    arrays : dict of str to ndarray
        `fit` and `residual`, (n,), in the unit of the record; `whitened`: the whitened residuals, (n,), which should be
        independent and standard normal; `autocorrelation`: that of the whitened residuals, (l,), from lag 0 to three
        times the largest lag of the predictive check, but at most n/2.
    """
    t, n, r = target.signal.t, target.signal.t.size, mode.likelihood.residual(mode.z)
    white = mode.likelihood.whitened(r, mode.z)
    lags = int(np.clip(period / np.median(np.diff(t)), 4, max(n // 5, 4)))
    # Posterior predictive p values of the autocorrelation and of the kurtosis of whitened residuals.
    parts = np.array_split(
        laplace_draws(mode, PREDICTIVE_DRAWS, seed), max(4, PREDICTIVE_DRAWS * n // MOST_RESIDUALS)
    )
    scores = (
        np.stack([mode.likelihood.whitened(mode.likelihood.residual(z), z) for z in part]) for part in parts
    )
    observed = np.concatenate([_statistics(s, lags) for s in scores], axis=1)
    # A draw with an unbounded motion gives nan, which counts as more extreme than any noise.
    beyond = np.sum(_null_statistics(n, lags, seed) >= np.nan_to_num(observed, nan=np.inf), axis=1)
    p, p_tails = ((1 + beyond) / (PREDICTIVE_DRAWS + 1)).tolist()
    tails = float(kurtosis(white))
    line = find_spectral_line(t, white, period, orthonormal(tangents(target, mode).T))
    # Whitening has removed the peaks: name that of the residuals themselves.
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
        verdict=_verdict(
            target.noise_model, p, line, window_p, p_tails < P_LIMIT and tails > OUTLIER_KURTOSIS
        ),
    )
    return check, arrays


def _verdict(noise: NoiseModel, p: float, line: SpectralLine, window_p: float, outliers: bool) -> str:
    """Return the verdict as text: that the model fits, or that it does not and the first reason that applies.

    The reasons are tried in this order: structure in the residuals, coefficients that change during the record,
    outliers. The limits are `P_LIMIT` for p, `LINE_LIMIT` and `WINDOW_LIMIT`; outliers do not count if the noise model
    allows for them.

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

    The motion of every fit starts at the record's first sample.

    Returns
    -------
    largest : float
        Largest difference of a damping coefficient between a half and the whole record, in standard deviations of this
        difference (taken as at least half of the sd in the whole record); 0 without halves or coefficients. A half
        without a finite posterior is left out.
    count : int
        Number of differences of which this is the largest. A difference whose standard deviation is nan, because the
        information of a fit is not positive definite, does not count.
    """
    names, n = target.oscillator.coefficients, target.signal.t.size

    def values_and_sds(z: np.ndarray, information: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the damping coefficients at scores z, (d,), and their standard deviations."""
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
