"""Whether a model fits: residuals, parts of the record, a predictive check, and the second half by the first."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.inference.coordinates.truncated_normal import near
from bayesdamp.inference.mode import (
    ROUGHLY,
    Mode,
    log_evidence_near,
    maximise_posterior,
    value_sds,
    whitening,
)
from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.noise import NoiseModel
from bayesdamp.inference.residual_tests import (
    SpectralLine,
    StrongestForm,
    orthonormal,
    other_form,
    standing_out,
    strongest,
)
from bayesdamp.outcomes import P_LIMIT, Fitting
from bayesdamp.types import FitCheck, Forecast, PartialFit, Refusal

DRAWS = 200
FORECAST_DRAWS = 50
"""Draws of Laplace's approximation for a forecast, and draws in a batch: they give their part of the width within a
tenth."""
TOGETHER = 2_000_000
"""Largest number of residuals in memory."""
INTERVAL = 1.959963984540054
"""Half-width of a central 95 % interval in sds."""
STEP = 0.1
"""Step of a parameter, in posterior sds, that shows its effect on the residuals."""
AT_ZERO = 1e-6
"""Score up to which a coefficient counts as zero."""
LINE_LIMIT = 0.005
"""Chance below which a part of the residuals' spectrum stands out. With the other two limits, 2 % of true models are
rejected."""
FORM_LIMIT = 0.005
"""Chance below which the residuals show a force that no candidate has; half a percent more of true models."""
HINT = 0.1
"""Chance up to which the part that stands out of the whitened residuals is named where structure remains."""
HEAVY = 1.0
"""Excess kurtosis from which outliers matter: that of a Student t with ten degrees of freedom."""
WINDOW_LIMIT = 0.005
"""Chance of the largest shift of a coefficient between a window and the record, for all shifts together, below which
the coefficients change."""


def autocorrelation(x: np.ndarray, lags: int) -> np.ndarray:
    """Return the autocorrelation of x, (..., n), at lags 0 to `lags`, (..., lags + 1)."""
    x = x - x.mean(axis=-1, keepdims=True)
    size = scipy.fft.next_fast_len(x.shape[-1] + lags, real=True)
    power = np.abs(np.fft.rfft(x, size, axis=-1)) ** 2
    raw = np.fft.irfft(power, size, axis=-1)[..., : lags + 1]
    return raw / np.maximum(raw[..., :1], 1e-300)


def portmanteau(scores: np.ndarray, lags: int) -> np.ndarray:
    """Return n Σ ρ_l² over lags 1 to `lags` of whitened residuals, (..., n): large where structure remains."""
    return scores.shape[-1] * np.sum(autocorrelation(scores, lags)[..., 1:] ** 2, axis=-1)


def laplace_draws(target: Target, mode: Mode, count: int, seed: int) -> np.ndarray:
    """Draw scores from the truncated normal distribution of the mode's information, (count, d).

    Folding draws at zero instead would separate coefficients that compensate each other.
    """
    normal = near(mode.near, mode.z, mode.factor)
    return normal.draw(np.random.default_rng(seed), count)


def kurtosis(x: np.ndarray) -> np.ndarray:
    """Return the excess kurtosis of x, (..., n), along its last axis: 0 for a normal, large with outliers."""
    x = x - x.mean(axis=-1, keepdims=True)
    square = x**2
    return np.mean(square**2, axis=-1) / np.maximum(np.mean(square, axis=-1) ** 2, 1e-300) - 3.0


def _statistics(scores: np.ndarray, lags: int) -> np.ndarray:
    return np.stack([portmanteau(scores, lags), kurtosis(scores)])


@lru_cache(maxsize=4)
def _replicated(n: int, lags: int, seed: int) -> np.ndarray:
    """Return the statistics of n independent scores, (2, DRAWS); they are the same for all candidates on a record."""
    noise = np.random.default_rng(seed + 1)
    return np.stack([_statistics(noise.standard_normal(n), lags) for _ in range(DRAWS)], axis=1)


def tangents(target: Target, mode: Mode) -> np.ndarray:
    """Return the derivatives of the whitened residuals by the motion's parameters, in posterior sds, (k, n).

    A coefficient at zero has none: the residuals pull it below zero.
    """
    at_zero = target.reflected & (np.abs(mode.z) <= AT_ZERO)
    free = [i for i in target.moving if not at_zero[i]]
    steps = STEP * mode.sd()
    moved = mode.z + np.diag(steps)[free]
    here, *scores = [_comparable(mode, r) for r in mode.likelihood.residuals(np.stack([mode.z, *moved]))]
    slopes = (np.array(scores).reshape(len(free), here.size) - here) / STEP
    return slopes[np.all(np.isfinite(slopes), axis=1)]


def _comparable(mode: Mode, r: np.ndarray) -> np.ndarray:
    """Return residuals r, (n,), in the units in which directions are compared with the scores."""
    # Heavy-tailed scores are nonlinear in each residual, and so would be the waves that are compared with them.
    return r if mode.likelihood.target.noise_model.heavy_tailed else mode.likelihood.whitened(r, mode.z)


def check_fit(target: Target, mode: Mode, period: float, seed: int) -> tuple[FitCheck, dict[str, np.ndarray]]:
    """Make all checks of a model at its mode.

    Parameters
    ----------
    target : Target
        The model on its record.
    mode : Mode
        Its mode.
    period : float
        Of the oscillation in s; structure is looked for up to this lag.
    seed : int
        Of the draws.

    Returns
    -------
    check : FitCheck
        The checks.
    arrays : dict of str to ndarray
        The fit and its residual, (n,), in the unit of the record; the whitened residuals, (n,), as independent standard
        scores; and their autocorrelation by lag, (l,).
    """
    t, n, r = target.signal.t, target.signal.t.size, mode.likelihood.residual(mode.z)
    white = mode.likelihood.whitened(r, mode.z)
    lags = int(np.clip(period / np.median(np.diff(t)), 4, max(n // 5, 4)))
    # Posterior predictive p of the structure and of the tails of whitened residuals.
    parts = np.array_split(laplace_draws(target, mode, DRAWS, seed), max(4, DRAWS * n // TOGETHER))
    scores = (
        np.stack([mode.likelihood.whitened(mode.likelihood.residual(z), z) for z in part]) for part in parts
    )
    observed = np.concatenate([_statistics(s, lags) for s in scores], axis=1)
    # A draw whose motion escapes is not a number, and counts as a misfit.
    beyond = np.sum(_replicated(n, lags, seed) >= np.nan_to_num(observed, nan=np.inf), axis=1)
    p, p_tails = ((1 + beyond) / (DRAWS + 1)).tolist()
    tails = float(kurtosis(white))
    fitted = orthonormal(tangents(target, mode).T)
    line = standing_out(t, white, period, fitted)
    form = other_form(
        mode, white, fitted, lambda change: _comparable(mode, r + change) - _comparable(mode, r)
    )
    if line.chance > HINT:  # whitening has levelled the spectrum; name what there was to level
        line = replace(line, words=strongest(t, r, period))
    windows, spread, looks, later = _windows(target, mode, seed)
    window_p = min(1.0, looks * math.erfc(spread / math.sqrt(2)))
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
        window_spread=spread,
        window_p=window_p,
        forecast=later,
        rivals=form.rivals,
        verdict=_verdict(target.noise_model, p, line, form, window_p, p_tails < P_LIMIT and tails > HEAVY),
    )
    return check, arrays


def _verdict(
    noise: NoiseModel, p: float, line: SpectralLine, form: StrongestForm, window_p: float, outliers: bool
) -> str:
    correlated, no = noise.name == "correlated", Fitting.DOES_NOT_FIT
    if p < P_LIMIT or line.chance < LINE_LIMIT:
        under = "" if correlated else " under independent noise"
        return no.because(f"structure remains in the residuals{under}: {line.words}")
    if form.chance < FORM_LIMIT:
        return no.because(f"the residuals look as if {form.words}")
    if window_p < WINDOW_LIMIT:
        return no.because("the coefficients change from one part of the record to another")
    if outliers and not noise.heavy_tailed:
        return no.because("outliers in the residuals, which this noise model does not allow for")
    return f"{Fitting.FITS.value}, with correlated noise" if correlated else Fitting.FITS.value


def _windows(
    target: Target, mode: Mode, seed: int
) -> tuple[tuple[PartialFit, ...], float, int, Forecast | None]:
    """Fit the first, the middle and the last half of the record; the motion starts at the record's first sample.

    Returns the fits with that of the whole record, the largest shift of a coefficient in the sds that it has by chance,
    how many shifts there are, and the forecast of the second half by the first.
    """
    t, n = target.signal.t, target.signal.t.size
    half = n // 2
    whole, _ = _window(mode.likelihood, "whole record", mode.z, mode.information, float(t[0]), float(t[-1]))
    windows, spread, looks, later = [whole], 0.0, 0, None
    for label, first in (("first half", 0), ("middle half", (n - half) // 2), ("last half", n - half)):
        part = mode.likelihood.on(slice(first, first + half))
        top = maximise_posterior(part, mode.z, close=ROUGHLY)
        if not np.isfinite(top.value):
            continue
        start, stop = float(t[first]), float(t[first + half - 1])
        w, factor = _window(part, label, top.x, top.information, start, stop)
        windows.append(w)
        if first == 0:
            density = whole.log_evidence - w.log_evidence
            later = forecast(mode.likelihood, part.with_scale(1.0), top.x, factor, density, seed)
        for name in target.oscillator.coefficients:
            shift = abs(w.values[name] - whole.values[name])
            # The part is contained in the whole: the variance of the shift is the difference (Hausman 1978).
            variance = max(w.sd[name] ** 2 - whole.sd[name] ** 2, 0.25 * whole.sd[name] ** 2)
            spread, looks = max(spread, shift / variance**0.5), looks + 1
    return tuple(windows), spread, looks, later


def _window(
    likelihood: Likelihood, label: str, z: np.ndarray, information: np.ndarray, start: float, stop: float
) -> tuple[PartialFit, np.ndarray]:
    """Return the fit of a window, and a factor of the covariance of its scores."""
    try:
        factor = whitening(information)
        evidence = log_evidence_near(likelihood, z)
    except Refusal:  # so stiff that its loose directions are lost to rounding
        factor, evidence = np.full_like(information, np.nan), np.nan
    target = likelihood.target
    values = {n: float(v) for n, v in target.values(z).items()}
    return PartialFit(label, start, stop, values, value_sds(target, z, factor @ factor.T), evidence), factor


@dataclass(frozen=True)
class Ahead:
    """The prediction of the second half of a record, at each of its m samples.

    Attributes
    ----------
    error : ndarray, shape (m,)
        The record minus its predictive mean.
    sd : ndarray, shape (m,)
        The predictive sd, noise included.
    """

    error: np.ndarray
    sd: np.ndarray

    @property
    def rms(self) -> float:
        """Root mean square error, in the unit of the record."""
        return float(np.sqrt(np.mean(self.error**2)))

    @property
    def expected(self) -> float:
        """Root mean predictive variance, in the unit of the record."""
        return float(np.sqrt(np.mean(self.sd**2)))

    @property
    def coverage(self) -> float:
        """Share of the samples inside their 95 % interval."""
        return float(np.mean(np.abs(self.error) < INTERVAL * self.sd))


def carried_on(likelihood: Likelihood, draws: np.ndarray, half: int) -> Ahead:
    """Predict the samples after the first `half` ones from draws of the scores given these.

    The variance of the noise is the mean square of the residuals of the first half, whatever the noise model. The
    interval ignores that neighbouring samples may have correlated errors.

    Parameters
    ----------
    likelihood : Likelihood
        Of the whole record.
    draws : ndarray, shape (m, d)
        Of the scores given the first half.
    half : int
        Number of samples in the first half.

    Raises
    ------
    Refusal
        Where no draw has a finite motion over the second half.
    """
    n = likelihood.y.size
    count, total, square, first = 0, np.zeros(n - half), np.zeros(n - half), 0.0
    for batch in np.array_split(draws, max(1, len(draws) // FORECAST_DRAWS, len(draws) * n // TOGETHER)):
        r = likelihood.residuals(batch)
        r = r[np.all(np.isfinite(r), axis=1)]
        count += len(r)
        total += r[:, half:].sum(axis=0)
        square += (r[:, half:] ** 2).sum(axis=0)
        first += float((r[:, :half] ** 2).sum())
    if not count:
        raise Refusal("no motion that fits the first half goes on through the second")
    error = total / count
    return Ahead(error, np.sqrt(np.maximum(square / count - error**2, 0.0) + first / (count * half)))


def forecast(
    whole: Likelihood, first: Likelihood, z: np.ndarray, factor: np.ndarray, log_predictive: float, seed: int
) -> Forecast | None:
    """Forecast the second half of a record from the first by Laplace's approximation; None where that fails.

    Parameters
    ----------
    whole, first : Likelihood
        Of the whole record, and of its first half with the shared scale fixed at 1.
    z : ndarray, shape (d,)
        The mode on the first half.
    factor : ndarray, shape (d, d)
        Cholesky factor of the covariance there.
    log_predictive : float
        Log density of the second half given the first, in nats.
    seed : int
        Of the draws.
    """
    if not (np.isfinite(log_predictive) and np.all(np.isfinite(factor))):
        return None
    try:
        draws = near(first, z, factor).draw(np.random.default_rng(seed), FORECAST_DRAWS)
        ahead = carried_on(whole, draws, first.y.size)
    except (np.linalg.LinAlgError, Refusal):  # too stiff to draw from, or no draw has a finite motion
        return None
    return Forecast(ahead.rms, ahead.expected, ahead.coverage, log_predictive)
