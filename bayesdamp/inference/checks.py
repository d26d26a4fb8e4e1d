"""Checks of a fit: tests of the residuals, fits to parts of the record, and a forecast of the second half."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.inference.coordinates.truncated_normal import truncated_near
from bayesdamp.inference.mode import (
    ROUGH_LAST_STEP,
    Mode,
    covariance_factor,
    log_evidence_near,
    maximise_posterior,
    value_sds,
)
from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.noise import NoiseModel
from bayesdamp.inference.residual_tests import (
    SpectralLine,
    StrongestForm,
    find_missing_form,
    find_spectral_line,
    name_peak,
    orthonormal,
)
from bayesdamp.outcomes import P_LIMIT, FitStatus
from bayesdamp.types import NORMAL_95, FitCheck, Forecast, PartialFit, Refusal

PREDICTIVE_DRAWS = 200
"""Number of posterior draws for the predictive check, and number of series of noise that they are compared with."""
FORECAST_DRAWS = 50
"""Number of draws of Laplace's approximation for a forecast, and number of draws whose motions are computed at a time.
With 50, the part of the predictive standard deviation that comes from the parameters is accurate to a tenth."""
MOST_RESIDUALS = 2_000_000
"""Greatest number of residuals in memory at a time."""
DIFFERENCE_STEP = 0.1
"""Step of finite differences of the residuals by a parameter, in posterior sds."""
ZERO_SCORE = 1e-6
"""A coefficient counts as zero if the absolute value of its score is at most this."""
LINE_LIMIT = 0.005
"""p value below which a peak of the residuals' spectrum is a misfit. Together with `P_LIMIT` and `WINDOW_LIMIT`, 2 % of
true models are rejected (conventional)."""
FORM_LIMIT = 0.005
"""p value below which the residuals show a force that the model lacks (conventional)."""
NAMED_PEAK_LIMIT = 0.1
"""If the largest peak of the whitened residuals' spectrum has a p value of at most this, the verdict names it as the
remaining structure; otherwise the verdict names the largest peak of the residuals themselves."""
OUTLIER_KURTOSIS = 1.0
"""Outliers are reported only if the excess kurtosis of the whitened residuals is larger than this: that of a Student t
with ten degrees of freedom."""
WINDOW_LIMIT = 0.005
"""p value, for all shifts together, below which the largest shift of a coefficient between a window and the whole
record is a misfit (conventional)."""


def autocorrelation(x: np.ndarray, lags: int) -> np.ndarray:
    """Return the autocorrelation of x, (..., n), about its mean at lags 0 to `lags`, (..., lags + 1); 1 at lag 0."""
    x = x - x.mean(axis=-1, keepdims=True)
    size = scipy.fft.next_fast_len(x.shape[-1] + lags, real=True)
    power = np.abs(np.fft.rfft(x, size, axis=-1)) ** 2
    raw = np.fft.irfft(power, size, axis=-1)[..., : lags + 1]
    return raw / np.maximum(raw[..., :1], 1e-300)


def portmanteau(scores: np.ndarray, lags: int) -> np.ndarray:
    """Return the portmanteau statistic n Σ ρ_l², (...), of whitened residuals, (..., n), over lags 1 to `lags`."""
    return scores.shape[-1] * np.sum(autocorrelation(scores, lags)[..., 1:] ** 2, axis=-1)


def laplace_draws(target: Target, mode: Mode, count: int, seed: int) -> np.ndarray:
    """Draw scores, (count, d), from the normal distribution at the mode, restricted to reflected scores ≥ 0."""
    normal = truncated_near(mode.near, mode.z, mode.factor)
    return normal.draw(np.random.default_rng(seed), count)


def kurtosis(x: np.ndarray) -> np.ndarray:
    """Return the excess kurtosis of x, (..., n), along its last axis: 0 if normal, large with outliers."""
    x = x - x.mean(axis=-1, keepdims=True)
    square = x**2
    return np.mean(square**2, axis=-1) / np.maximum(np.mean(square, axis=-1) ** 2, 1e-300) - 3.0


def _statistics(scores: np.ndarray, lags: int) -> np.ndarray:
    """Return the statistics of the predictive check, (2, ...): portmanteau and excess kurtosis of scores, (..., n)."""
    return np.stack([portmanteau(scores, lags), kurtosis(scores)])


@lru_cache(maxsize=4)
def _null_statistics(n: int, lags: int, seed: int) -> np.ndarray:
    """Return `_statistics` of PREDICTIVE_DRAWS series of n standard normal values, (2, PREDICTIVE_DRAWS).

    They are cached, as they are the same for all models.
    """
    noise = np.random.default_rng(seed + 1)
    return np.stack([_statistics(noise.standard_normal(n), lags) for _ in range(PREDICTIVE_DRAWS)], axis=1)


def tangents(target: Target, mode: Mode) -> np.ndarray:
    """Return the changes of the whitened residuals with parameters of the motion, per posterior sd of each, (k, n).

    Coefficients at zero are left out, because they are not free to follow the residuals; so are parameters for which
    the change is not finite.
    """
    at_zero = target.reflected & (np.abs(mode.z) <= ZERO_SCORE)
    free = [i for i in target.moving if not at_zero[i]]
    steps = DIFFERENCE_STEP * mode.sd()
    shifted = mode.z + np.diag(steps)[free]
    here, *scores = [_comparable(mode, r) for r in mode.likelihood.residuals(np.stack([mode.z, *shifted]))]
    slopes = (np.array(scores).reshape(len(free), here.size) - here) / DIFFERENCE_STEP
    return slopes[np.all(np.isfinite(slopes), axis=1)]


def _comparable(mode: Mode, r: np.ndarray) -> np.ndarray:
    """Return residuals r, (n,), whitened, or unchanged under heavy-tailed noise, so that the result is linear in r."""
    # For heavy-tailed noise whitening is nonlinear, and directions in the residuals would be distorted.
    return r if mode.likelihood.target.noise_model.heavy_tailed else mode.likelihood.whitened(r, mode.z)


def check_fit(target: Target, mode: Mode, period: float, seed: int) -> tuple[FitCheck, dict[str, np.ndarray]]:
    """Check a fit at its mode: its residuals, fits to parts of the record, and a forecast.

    Parameters
    ----------
    target : Target
        The model on its record.
    mode : Mode
        Mode of its posterior.
    period : float
        Period of the oscillation in s: the largest lag of the predictive check, limited to 4 to n/5 samples.
    seed : int
        Seed of the draws.

    Returns
    -------
    check : FitCheck
        The checks.
    arrays : dict of str to ndarray
        `fit` and `residual`, (n,), in the unit of the record; `whitened`: the whitened residuals, (n,), which should be
        independent and standard normal; `autocorrelation`: that of the whitened residuals, from lag 0 to three times
        the lag of the predictive check, (l,).
    """
    t, n, r = target.signal.t, target.signal.t.size, mode.likelihood.residual(mode.z)
    white = mode.likelihood.whitened(r, mode.z)
    lags = int(np.clip(period / np.median(np.diff(t)), 4, max(n // 5, 4)))
    # Posterior predictive p values of the autocorrelation and of the kurtosis of whitened residuals.
    parts = np.array_split(
        laplace_draws(target, mode, PREDICTIVE_DRAWS, seed), max(4, PREDICTIVE_DRAWS * n // MOST_RESIDUALS)
    )
    scores = (
        np.stack([mode.likelihood.whitened(mode.likelihood.residual(z), z) for z in part]) for part in parts
    )
    observed = np.concatenate([_statistics(s, lags) for s in scores], axis=1)
    # A draw with an unbounded motion gives nan, which counts as more extreme than any noise.
    beyond = np.sum(_null_statistics(n, lags, seed) >= np.nan_to_num(observed, nan=np.inf), axis=1)
    p, p_tails = ((1 + beyond) / (PREDICTIVE_DRAWS + 1)).tolist()
    tails = float(kurtosis(white))
    fitted = orthonormal(tangents(target, mode).T)
    line = find_spectral_line(t, white, period, fitted)
    form = find_missing_form(
        mode, white, fitted, lambda change: _comparable(mode, r + change) - _comparable(mode, r)
    )
    # Whitening has removed the peaks: name that of the residuals themselves.
    if line.chance > NAMED_PEAK_LIMIT:
        line = replace(line, words=name_peak(t, r, period))
    windows, shift, count, later = _fit_windows(target, mode, seed)
    window_p = min(1.0, count * math.erfc(shift / math.sqrt(2)))
    rms = float(np.sqrt(np.mean(r**2)))
    fit = target.signal.y - r
    arrays = {
        "fit": fit,
        "residual": r,
        "whitened": white,
        "autocorrelation": autocorrelation(white, min(3 * lags, n // 2)),
    }
    check = FitCheck(
        windows=windows,
        rms=rms,
        share=rms / max(0.5 * float(np.ptp(fit)), 1e-300),
        residual_autocorrelation=float(autocorrelation(r, 1)[1]),
        predictive_p=p,
        line_p=line.chance,
        form_p=form.chance,
        kurtosis=tails,
        tails_p=p_tails,
        window_spread=shift,
        window_p=window_p,
        forecast=later,
        rivals=form.rivals,
        verdict=_verdict(
            target.noise_model, p, line, form, window_p, p_tails < P_LIMIT and tails > OUTLIER_KURTOSIS
        ),
    )
    return check, arrays


def _verdict(
    noise: NoiseModel, p: float, line: SpectralLine, form: StrongestForm, window_p: float, outliers: bool
) -> str:
    """Return the verdict as text: that the model fits, or that it does not and the first reason found.

    noise: the fitted noise model. p, window_p: p values of the predictive check and of the shifts between windows.
    outliers: whether there are significant ones.
    """
    correlated, no = noise.name == "correlated", FitStatus.DOES_NOT_FIT
    if p < P_LIMIT or line.chance < LINE_LIMIT:
        under = "" if correlated else " under independent noise"
        return no.because(f"structure remains in the residuals{under}: {line.words}")
    if form.chance < FORM_LIMIT:
        return no.because(f"the residuals look as if {form.words}")
    if window_p < WINDOW_LIMIT:
        return no.because("the coefficients change from one part of the record to another")
    if outliers and not noise.heavy_tailed:
        return no.because("outliers in the residuals, which this noise model does not allow for")
    return f"{FitStatus.FITS.value}, with correlated noise" if correlated else FitStatus.FITS.value


def _fit_windows(
    target: Target, mode: Mode, seed: int
) -> tuple[tuple[PartialFit, ...], float, int, Forecast | None]:
    """Fit the first, the middle and the last half of the record. All motions start at the record's first sample.

    Returns the fits, that of the whole record first; the largest difference of a coefficient from the whole record, in
    standard deviations of the difference; the number of differences; and the forecast of the second half from the
    first. A half without a finite posterior is left out; if it is the first half, or no forecast is possible, the
    forecast is None.
    """
    t, n = target.signal.t, target.signal.t.size
    half = n // 2
    whole, _ = _fit_window(
        mode.likelihood, "whole record", mode.z, mode.information, float(t[0]), float(t[-1])
    )
    windows, largest, count, later = [whole], 0.0, 0, None
    for label, first in (("first half", 0), ("middle half", (n - half) // 2), ("last half", n - half)):
        part = mode.likelihood.on(slice(first, first + half))
        top = maximise_posterior(part, mode.z, close=ROUGH_LAST_STEP)
        if not np.isfinite(top.value):
            continue
        start, stop = float(t[first]), float(t[first + half - 1])
        w, factor = _fit_window(part, label, top.x, top.information, start, stop)
        windows.append(w)
        if first == 0:
            density = whole.log_evidence - w.log_evidence
            later = forecast(mode.likelihood, part.with_scale(1.0), top.x, factor, density, seed)
        for name in target.oscillator.coefficients:
            shift = abs(w.values[name] - whole.values[name])
            # A window is part of the whole record, so the variance of the shift is the difference (Hausman 1978).
            variance = max(w.sd[name] ** 2 - whole.sd[name] ** 2, 0.25 * whole.sd[name] ** 2)
            largest, count = max(largest, shift / variance**0.5), count + 1
    return tuple(windows), largest, count, later


def _fit_window(
    likelihood: Likelihood, label: str, z: np.ndarray, information: np.ndarray, start: float, stop: float
) -> tuple[PartialFit, np.ndarray]:
    """Return the fit of a window (start to stop), and the Cholesky factor of the covariance of its scores, (d, d).

    z, information: the scores at the best fit, (d,), and the information matrix there, (d, d).

    Without a positive definite information matrix the factor, the sds and the evidence are nan.
    """
    try:
        factor = covariance_factor(information)
        evidence = log_evidence_near(likelihood, z)
    except Refusal:  # the information is too ill-conditioned
        factor, evidence = np.full_like(information, np.nan), np.nan
    target = likelihood.target
    values = {n: float(v) for n, v in target.values(z).items()}
    return PartialFit(label, start, stop, values, value_sds(target, z, factor @ factor.T), evidence), factor


@dataclass(frozen=True)
class Prediction:
    """The prediction of the second half of a record, at each of its m samples.

    Attributes
    ----------
    error : ndarray, shape (m,)
        Record minus predictive mean.
    sd : ndarray, shape (m,)
        Predictive standard deviation, including the noise.
    """

    error: np.ndarray
    sd: np.ndarray

    @property
    def rms(self) -> float:
        """Root mean square of `error`, in the unit of the record."""
        return float(np.sqrt(np.mean(self.error**2)))

    @property
    def expected(self) -> float:
        """Root mean square of `sd`, in the unit of the record: the value of `rms` that is expected."""
        return float(np.sqrt(np.mean(self.sd**2)))

    @property
    def coverage(self) -> float:
        """Fraction of the m samples inside their predictive 95 % intervals."""
        return float(np.mean(np.abs(self.error) < NORMAL_95 * self.sd))


def predict_second_half(likelihood: Likelihood, draws: np.ndarray, half: int) -> Prediction:
    """Predict the samples after the first `half` ones, from draws of the scores given those first samples.

    The variance of the noise is the mean square residual of the first half, for any noise model. Draws whose motion is
    not finite are left out.

    Parameters
    ----------
    likelihood : Likelihood
        Likelihood of the whole record.
    draws : ndarray, shape (m, d)
        Draws of the scores given the first half.
    half : int
        Number of samples in the first half.

    Returns
    -------
    Prediction
        The prediction.

    Raises
    ------
    Refusal
        If no draw has a finite motion in the second half.
    """
    n = likelihood.y.size
    count, total, square, first = 0, np.zeros(n - half), np.zeros(n - half), 0.0
    for batch in np.array_split(
        draws, max(1, len(draws) // FORECAST_DRAWS, len(draws) * n // MOST_RESIDUALS)
    ):
        r = likelihood.residuals(batch)
        r = r[np.all(np.isfinite(r), axis=1)]
        count += len(r)
        total += r[:, half:].sum(axis=0)
        square += (r[:, half:] ** 2).sum(axis=0)
        first += float((r[:, :half] ** 2).sum())
    if not count:
        raise Refusal("no motion that fits the first half has a finite continuation in the second half")
    error = total / count
    return Prediction(error, np.sqrt(np.maximum(square / count - error**2, 0.0) + first / (count * half)))


def forecast(
    whole: Likelihood, first: Likelihood, z: np.ndarray, factor: np.ndarray, log_predictive: float, seed: int
) -> Forecast | None:
    """Forecast the second half of a record from the first by Laplace's approximation.

    Parameters
    ----------
    whole, first : Likelihood
        Likelihoods of the whole record, and of its first half with the common prior scale fixed at 1.
    z : ndarray, shape (d,)
        Mode of the posterior for the first half.
    factor : ndarray, shape (d, d)
        Cholesky factor of the covariance there.
    log_predictive : float
        Log density of the second half given the first, in nats.
    seed : int
        Seed of the draws.

    Returns
    -------
    Forecast or None
        None if `log_predictive` or `factor` is not finite, the covariance is singular, or no draw has a finite motion.
    """
    if not (np.isfinite(log_predictive) and np.all(np.isfinite(factor))):
        return None
    try:
        draws = truncated_near(first, z, factor).draw(np.random.default_rng(seed), FORECAST_DRAWS)
        ahead = predict_second_half(whole, draws, first.y.size)
    except (np.linalg.LinAlgError, Refusal):  # a singular covariance, or no draw has a finite motion
        return None
    return Forecast(ahead.rms, ahead.expected, ahead.coverage, log_predictive)
