"""The mean and the spread of a coefficient over specimens, from each specimen's own posterior draws.

Specimens' coefficients are normal about a population's location m with a scale τ, cut off at zero. The likelihood of
(m, τ) is a product over specimens of ∫ p(record | θ) N(θ | m, τ) dθ, and each factor is, but for a constant, the mean
of N(θ | m, τ) / prior(θ) over the specimen's posterior draws (Hogg, Myers & Bovy, Astrophysical Journal 725, 2010).
Every draw stands for a narrow normal, so that a τ below the distance of draws is no noise, and the integral remains a
closed form. m and τ are integrated on a grid. m has a half-normal prior with a scale that is given; τ,
given m, one with the scale m: specimens of one kind do not spread by much more than their size. (A prior of τ as wide
as that of m would let few specimens have any spread: with two of them the likelihood falls no faster than 1/τ.)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr, logsumexp

from bayesdamp.inference.curves.weighted import effective, shares, summarise
from bayesdamp.types import OK, Refusal

BINS = 150
LOCATIONS, SCALES = 121, 81
REACH = 9.0
"""Standard deviations of m, given τ, to each side of the grid's middle; of the prior, in scales: tail below 1e-4."""
LARGEST = 4.0
FAR = 8.0
"""A wall so many widths away from a normal cuts nothing off."""
POINTS, WIDE, HYPER_DRAWS = 801, 6.0, 2000
"""Of the grid for a specimen's own coefficient: points, sds to each side; draws of (m, τ) that it is averaged over."""
LEAST = 100
"""Effective draws of a specimen, once the others have had their say, below which the summary is not to be trusted."""
FEW = 5
"""Specimens below which a spread is mostly what the prior allows."""


@dataclass(frozen=True)
class Sample:
    """One specimen's posterior draws of the coefficient, (n,), their log weights, and the log prior density there."""

    name: str
    values: np.ndarray
    log_weights: np.ndarray
    log_prior: np.ndarray


@dataclass(frozen=True)
class Population:
    """What the specimens say together.

    mean, spread: summaries of the mean and the sd of the coefficient over the population (of the normal that is cut off
    at zero, not of its parameters); shrunk: each specimen's own value once the others have had their say; effective:
    its effective draws then. All in the unit of the coefficient.
    """

    mean: Mapping[str, float]
    spread: Mapping[str, float]
    shrunk: Mapping[str, Mapping[str, float]]
    effective: Mapping[str, float]
    outcome: str


@dataclass(frozen=True)
class _Kernels:
    """A specimen's likelihood as a sum of normals of one width about centres, (b,), with log weights, (b,)."""

    centres: np.ndarray
    log_weights: np.ndarray
    width: float
    mean: float
    sd: float


def population(samples: Sequence[Sample], scale: float, *, from_zero: bool = True) -> Population:
    """The population of a coefficient. scale: of the prior of m.

    from_zero: whether the coefficient cannot be negative; of one that can, m has a normal prior about zero, and τ a
    half-normal one, of that scale. Raises Refusal for fewer than two specimens.
    """
    if len(samples) < 2:
        raise Refusal("a spread needs two specimens or more")
    kernels = [_kernels(s, from_zero) for s in samples]
    m, tau, log_prior = _grid(kernels, scale, from_zero)
    logs = [_log_likelihood(k, m, tau, from_zero) for k in kernels]
    density = log_prior + np.sum(logs, axis=0)
    weights = np.exp(density - density.max())
    weights /= weights.sum()
    mean, spread = _moments(m, tau) if from_zero else (m, tau)
    shrunk, size = {}, {}
    for sample, kernel in zip(samples, kernels, strict=True):
        low, high = kernel.mean - WIDE * kernel.sd, kernel.mean + WIDE * kernel.sd
        x, gap = np.linspace(max(low, 0.0) if from_zero else low, high, POINTS, retstep=True)
        some = np.random.default_rng(0).choice(weights.size, HYPER_DRAWS, p=weights.ravel())
        # A normal narrower than the grid's gap could fall between its points.
        wide = np.sqrt(tau.ravel()[some] ** 2 + gap**2)[:, None]
        given = _density(kernel, x, from_zero) - 0.5 * ((x - m.ravel()[some][:, None]) / wide) ** 2
        given = np.exp(given - np.asarray(logsumexp(given, axis=1, keepdims=True))).mean(axis=0)
        ratio = given / np.maximum(np.exp(_density(kernel, x, from_zero)), 1e-300)
        log_ratio = np.log(np.maximum(np.interp(sample.values, x, ratio, left=0.0, right=0.0), 1e-300))
        shrunk[sample.name] = summarise(x, given)
        size[sample.name] = effective(sample.log_weights - sample.log_prior + log_ratio)
    return Population(
        summarise(mean.ravel(), weights.ravel()),
        summarise(spread.ravel(), weights.ravel()),
        shrunk,
        size,
        _outcome(len(samples), size),
    )


def _outcome(count: int, size: Mapping[str, float]) -> str:
    worst = min(size, key=lambda name: size[name])
    if size[worst] < LEAST:
        return (
            f"not to be trusted: {worst} has {size[worst]:.0f} effective draws where the others expect it, "
            f"below {LEAST}"
        )
    return (
        OK
        if count >= FEW
        else f"only {count}: the upper ends of mean and spread are mostly what their priors allow"
    )


def _kernels(sample: Sample, from_zero: bool) -> _Kernels:
    """The likelihood from draws without their prior; bins much narrower than the normals stand for the draws.

    The width is Silverman's for the effective number of draws. Drawn towards their mean by as much as the normals
    spread them (West, Journal of the Royal Statistical Society B 55, 1993), the draws keep their variance; not so near
    a wall, where a shift would be worse than the few per cent that the width adds.
    """
    log_weights = sample.log_weights - sample.log_prior
    w = shares(log_weights)
    mean = float(w @ sample.values)
    sd = float(np.sqrt(w @ (sample.values - mean) ** 2))
    share = 1.06 * effective(log_weights) ** -0.2
    drawn = sample.values
    if not (from_zero and mean < 4 * sd):
        drawn = mean + np.sqrt(max(1 - share**2, 0.0)) * (drawn - mean)
    edges = np.linspace(drawn.min(), drawn.max(), BINS + 1)
    held = np.histogram(drawn, edges, weights=w)[0]
    centres = np.histogram(drawn, edges, weights=w * drawn)[0]
    some = held > 0
    return _Kernels(centres[some] / held[some], np.log(held[some]), share * sd, mean, sd)


def _grid(
    kernels: Sequence[_Kernels], scale: float, from_zero: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Locations and scales, (LOCATIONS, SCALES), and the log of prior times the cell's area there.

    Scales are even in their logarithm; the locations at each are about the specimens' mean.
    """
    means, sds = (np.array([getattr(k, n) for k in kernels]) for n in ("mean", "sd"))
    tau = np.geomspace(1e-3 * min(sds.min(), scale), LARGEST * scale, SCALES)
    precision = 1 / (sds[:, None] ** 2 + tau**2)
    middle = np.sum(means[:, None] * precision, axis=0) / precision.sum(axis=0)
    reach = REACH / np.sqrt(precision.sum(axis=0))
    low, high = middle - reach, middle + reach
    if from_zero:
        # A wide cut-off normal may have its top anywhere from zero on.
        low, high = np.maximum(low, 0.0), np.maximum(high, reach)
    m = np.linspace(low, high, LOCATIONS)
    tau = np.broadcast_to(tau, m.shape)
    area = np.log((high - low) / (LOCATIONS - 1)) + np.log(tau)
    wide = np.maximum(m, 1e-3 * tau) if from_zero else np.full(m.shape, scale)
    log_prior = -0.5 * (m / scale) ** 2 - 0.5 * (tau / wide) ** 2 - np.log(wide)
    return m, tau, log_prior + area


def _log_likelihood(kernel: _Kernels, m: np.ndarray, tau: np.ndarray, from_zero: bool) -> np.ndarray:
    """log ∫ likelihood(θ) N(θ | m, τ) dθ but for a constant, of the shape of m; θ ≥ 0 where it must be."""
    found = np.full(m.shape, -np.inf)
    for centre, log_weight in zip(kernel.centres, kernel.log_weights, strict=True):
        wall = from_zero and centre < FAR * kernel.width
        found = np.logaddexp(found, log_weight + _met(centre, kernel.width, m, tau, wall))
    return found - log_ndtr(m / tau) if from_zero else found


def _met(centre: float, width: float, m: np.ndarray, tau: np.ndarray, wall: bool) -> np.ndarray:
    """log ∫ K(θ) N(θ | m, τ) dθ but for constants, K a normal about the centre; at a wall over θ ≥ 0, and K with its
    mirror image."""
    variance = width**2 + tau**2

    def one(c: float) -> np.ndarray:
        met = -0.5 * (m - c) ** 2 / variance - 0.5 * np.log(variance)
        if not wall:
            return met
        top = (m * width**2 + c * tau**2) / variance
        return met + log_ndtr(top * np.sqrt(variance) / (width * tau))

    return np.logaddexp(one(centre), one(-centre)) if wall else one(centre)


def _moments(m: np.ndarray, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean and sd of the normal that is cut off at zero."""
    ratio = m / tau
    hazard = np.exp(-0.5 * ratio**2 - log_ndtr(ratio)) / np.sqrt(2 * np.pi)
    return m + tau * hazard, tau * np.sqrt(np.maximum(1 - ratio * hazard - hazard**2, 0.0))


def _density(kernel: _Kernels, x: np.ndarray, from_zero: bool) -> np.ndarray:
    """Log likelihood at coefficients x, (p,), but for a constant."""
    log_weights = kernel.log_weights[:, None]

    def about(centres: np.ndarray) -> np.ndarray:
        away = (x - centres[:, None]) / kernel.width
        return np.asarray(logsumexp(log_weights - 0.5 * away**2, axis=0))

    found = about(kernel.centres)
    return np.logaddexp(found, about(-kernel.centres)) if from_zero else found
