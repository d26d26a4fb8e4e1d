"""Whether a model fits: residuals, windows, and a predictive check."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.fft import next_fast_len

from bayesdamp.inference.checks.forecast import TOGETHER, forecast
from bayesdamp.inference.checks.residual_spectrum import Line, orthonormal, standing_out, strongest
from bayesdamp.inference.checks.score_tests import Other, other_form
from bayesdamp.inference.coordinates.truncated_normal import about
from bayesdamp.inference.fit.laplace import log_evidence_near, value_sds
from bayesdamp.inference.fit.maximise import ROUGHLY, maximise_posterior
from bayesdamp.inference.fit.mode import Mode, whitening
from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.noise import NoiseModel
from bayesdamp.outcomes import P_LIMIT, Fitting
from bayesdamp.types import AddedForm, Forecast, PartialFit, Refusal

DRAWS = 200
STEP = 0.1
"""Posterior sds by which a parameter is moved to see what it does to the residuals."""
HELD = 1e-6
"""Score of a coefficient up to which it is held at zero."""
LINE_LIMIT = 0.005
"""Chance from which a part of the residuals' spectrum stands out: with the other two limits, 2 % of true models are
refused."""
FORM_LIMIT = 0.005
"""Chance from which the residuals want a force that no candidate has; a half of a percent more of true models."""
HINT = 0.1
"""Chance up to which the part that stands out of the whitened residuals is named where structure is seen."""
HEAVY = 1.0
"""Excess kurtosis from which outliers matter: a Student t of ten degrees of freedom has it."""
WINDOW_LIMIT = 0.005
"""Chance of the largest shift of a coefficient between a window and the record, for all that are looked at, from which
the coefficients change."""


@dataclass(frozen=True)
class Fit:
    """What is left of a record at the mode.

    fit, residual: in the unit of the record, shape (n,); whitened: scores, shape (n,); autocorrelation of
    the residuals by lag, shape (l,). rms, in the unit of the record; share: of half the fit's range. predictive_p,
    tails_p: posterior predictive p of the structure in whitened residuals and of their kurtosis (in excess of a
    normal's). line_p: chance of the part of their spectrum that stands out most; form_p: that
    of the force, of those that no candidate has, which they want most. window_spread: largest shift of a
    damping coefficient between a window and the whole record, in the sds that the shift has by chance; window_p: the
    chance of one as large. forecast: of the second half by the first, where that says something. rivals: the model
    with other forms of damping beside its own.
    """

    fit: np.ndarray
    residual: np.ndarray
    whitened: np.ndarray
    autocorrelation: np.ndarray
    rms: float
    share: float
    residual_autocorrelation: float
    predictive_p: float
    line_p: float
    form_p: float
    kurtosis: float
    tails_p: float
    windows: tuple[PartialFit, ...]
    window_spread: float
    window_p: float
    forecast: Forecast | None
    rivals: tuple[AddedForm, ...]
    verdict: str


def autocorrelation(x: np.ndarray, lags: int) -> np.ndarray:
    """Autocorrelation of x, shape (..., n), at lags 0 to `lags`, shape (..., lags + 1)."""
    x = x - x.mean(axis=-1, keepdims=True)
    size = next_fast_len(x.shape[-1] + lags, real=True)
    power = np.abs(np.fft.rfft(x, size, axis=-1)) ** 2
    raw = np.fft.irfft(power, size, axis=-1)[..., : lags + 1]
    return raw / np.maximum(raw[..., :1], 1e-300)


def portmanteau(scores: np.ndarray, lags: int) -> np.ndarray:
    """n Σ ρ_l² over lags 1 to `lags` of whitened residuals, shape (..., n): large where structure is left."""
    return scores.shape[-1] * np.sum(autocorrelation(scores, lags)[..., 1:] ** 2, axis=-1)


def laplace_draws(target: Target, mode: Mode, count: int, seed: int) -> np.ndarray:
    """Draws of the scores from the normal distribution of the mode's information, cut off at zero, shape (count, d).

    Folding them there instead would part coefficients that make up for each other.
    """
    return about(mode).draw(np.random.default_rng(seed), count)


def kurtosis(x: np.ndarray) -> np.ndarray:
    """Excess kurtosis of x, shape (..., n), along its last axis: 0 for a normal, large where there are outliers."""
    x = x - x.mean(axis=-1, keepdims=True)
    square = x**2
    return np.mean(square**2, axis=-1) / np.maximum(np.mean(square, axis=-1) ** 2, 1e-300) - 3.0


def _lags(target: Target, period: float) -> int:
    """A period's samples: how far structure is looked for."""
    n = target.signal.t.size
    return int(np.clip(period / np.median(np.diff(target.signal.t)), 4, max(n // 5, 4)))


def _chances(target: Target, mode: Mode, period: float, seed: int) -> tuple[float, float]:
    """Posterior predictive p of the structure and of the tails of whitened residuals."""
    n, lags = target.signal.t.size, _lags(target, period)
    draws = laplace_draws(target, mode, DRAWS, seed)
    parts = np.array_split(draws, max(4, DRAWS * n // TOGETHER))
    of = mode.likelihood
    scores = (np.stack([of.whitened(of.residual(z), z) for z in part]) for part in parts)
    observed = np.concatenate([_statistics(s, lags) for s in scores], axis=1)
    # Not-a-number (a draw that escapes) counts as a misfit.
    beyond = np.sum(_replicated(n, lags, seed) >= np.nan_to_num(observed, nan=np.inf), axis=1)
    structured, tailed = (1 + beyond) / (DRAWS + 1)
    return float(structured), float(tailed)


def _statistics(scores: np.ndarray, lags: int) -> np.ndarray:
    return np.stack([portmanteau(scores, lags), kurtosis(scores)])


@lru_cache(maxsize=4)
def _replicated(n: int, lags: int, seed: int) -> np.ndarray:
    """What the statistics are of n scores that are independent; the same for all candidates on a record."""
    noise = np.random.default_rng(seed + 1)
    return np.stack([_statistics(noise.standard_normal(n), lags) for _ in range(DRAWS)], axis=1)


def tangents(target: Target, mode: Mode) -> np.ndarray:
    """Derivatives of the whitened residuals by what moves the trajectory, a step of the posterior each, shape (k, n).

    A coefficient that is held at zero has none: the residuals want it below.
    """
    names, reflected = target.names, target.reflected
    free = [
        i
        for i, n in enumerate(names)
        if n in target.oscillator.parameters and not (reflected[i] and abs(mode.z[i]) <= HELD)
    ]
    steps = STEP * mode.sd()
    moved = mode.z + np.diag(steps)[free]
    here, *scores = [_seen(mode, r) for r in mode.likelihood.residuals(np.stack([mode.z, *moved]))]
    found = (np.array(scores).reshape(len(free), here.size) - here) / STEP
    return found[np.all(np.isfinite(found), axis=1)]


def _seen(mode: Mode, r: np.ndarray) -> np.ndarray:
    """Residuals r, (n,), as directions are compared with the scores."""
    # Heavy-tailed scores bend with each residual, and so would the waves that are compared with them.
    return r if mode.likelihood.target.noise_model.heavy_tailed else mode.likelihood.whitened(r, mode.z)


def check_fit(target: Target, mode: Mode, period: float, seed: int) -> Fit:
    """All checks of a model at its mode. period: of the oscillation in s: how far structure is looked for."""
    n, r = target.signal.t.size, mode.likelihood.residual(mode.z)
    white = mode.likelihood.whitened(r, mode.z)
    lags = _lags(target, period)
    p, p_tails = _chances(target, mode, period, seed)
    tails = float(kurtosis(white))
    t = target.signal.t
    fitted = orthonormal(tangents(target, mode).T)
    line = standing_out(t, white, period, fitted)
    form = other_form(mode, white, fitted, lambda change: _seen(mode, r + change) - _seen(mode, r))
    if line.chance > HINT:  # where whitening has levelled the spectrum, it says what there was to level
        line = replace(line, words=strongest(t, r, period))
    windows, spread, looks, later = _windows(target, mode, seed)
    window_p = min(1.0, looks * math.erfc(spread / math.sqrt(2)))
    rms = float(np.sqrt(np.mean(r**2)))
    lag_one = float(autocorrelation(r, 1)[1])
    return Fit(
        fit=target.signal.y - r,
        residual=r,
        whitened=white,
        autocorrelation=autocorrelation(white, min(3 * lags, n // 2)),
        rms=rms,
        share=rms / max(0.5 * float(np.ptp(target.signal.y - r)), 1e-300),
        residual_autocorrelation=lag_one,
        predictive_p=p,
        line_p=line.chance,
        form_p=form.chance,
        kurtosis=tails,
        tails_p=p_tails,
        windows=windows,
        window_spread=spread,
        window_p=window_p,
        forecast=later,
        rivals=form.rivals,
        verdict=_verdict(target.noise_model, p, line, form, window_p, p_tails < P_LIMIT and tails > HEAVY),
    )


def _verdict(noise: NoiseModel, p: float, line: Line, form: Other, window_p: float, outliers: bool) -> str:
    correlated, no = noise.name == "correlated", Fitting.DOES_NOT_FIT
    if p < P_LIMIT or line.chance < LINE_LIMIT:
        also = "" if correlated else " with independent noise"
        return no.because(f"structure is left in the residuals{also}: {line.words}")
    if form.chance < FORM_LIMIT:
        return no.because(f"the residuals are as where {form.words}")
    if window_p < WINDOW_LIMIT:
        return no.because("the coefficients change from one part of the record to another")
    if outliers and not noise.heavy_tailed:
        return no.because("outliers in the residuals, which this noise model does not allow for")
    return f"{Fitting.FITS.value}, with correlated noise" if correlated else Fitting.FITS.value


def _windows(
    target: Target, mode: Mode, seed: int
) -> tuple[tuple[PartialFit, ...], float, int, Forecast | None]:
    """The mode on the first, the middle and the last half of the record; the motion starts where it did.

    With the largest shift of a coefficient, in the sds that it has by chance, how many were looked at, and what the
    first half says of the second.
    """
    t, n = target.signal.t, target.signal.t.size
    half = n // 2
    whole, _ = _window(mode.likelihood, "whole record", mode.z, mode.information, float(t[0]), float(t[-1]))
    windows, spread, looks, later = [whole], 0.0, 0, None
    for label, first in (("first half", 0), ("middle half", (n - half) // 2), ("last half", n - half)):
        part = slice(first, first + half)
        likelihood = mode.likelihood.of(part)
        top = maximise_posterior(likelihood, mode.z, close=ROUGHLY)
        if not np.isfinite(top.value):
            continue
        w, factor = _window(
            likelihood, label, top.x, top.information, float(t[first]), float(t[first + half - 1])
        )
        windows.append(w)
        if first == 0:
            density = whole.log_evidence - w.log_evidence
            later = forecast(mode.likelihood, likelihood.held(1.0), top.x, factor, density, seed)
        for name in target.oscillator.coefficients:
            shift = abs(w.values[name] - whole.values[name])
            # The part is contained in the whole: the variance of the shift is the difference (Hausman 1978).
            variance = max(w.sd[name] ** 2 - whole.sd[name] ** 2, 0.25 * whole.sd[name] ** 2)
            spread, looks = max(spread, shift / variance**0.5), looks + 1
    return tuple(windows), spread, looks, later


def _window(
    likelihood: Likelihood,
    label: str,
    z: np.ndarray,
    information: np.ndarray,
    start: float,
    stop: float,
) -> tuple[PartialFit, np.ndarray]:
    """The window, and a factor of the covariance of its scores."""
    try:
        factor = whitening(information)
        evidence = log_evidence_near(likelihood, z)
    except Refusal:  # too stiff for its loose directions to be told
        factor, evidence = np.full_like(information, np.nan), np.nan
    covariance = factor @ factor.T
    target = likelihood.target
    values = {n: float(v) for n, v in target.values(z).items()}
    return PartialFit(label, start, stop, values, value_sds(target, z, covariance), evidence), factor
