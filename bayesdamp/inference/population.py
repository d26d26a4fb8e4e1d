"""The mean and the spread of a coefficient over a population of specimens, from posterior draws of each specimen.

The coefficients θ of specimens have a normal distribution with location m and scale τ, truncated at zero. The
likelihood of (m, τ) is a product over specimens of ∫ p(record | θ) N(θ | m, τ) dθ. Up to a constant, each factor is the
mean of N(θ | m, τ) / prior(θ) over the specimen's posterior draws (Hogg, Myers & Bovy, Astrophysical Journal 725,
2010). Each draw is replaced by a narrow normal distribution, which makes the factor smooth for small τ; the integrals
have closed forms. Averages over m and τ are sums over a grid. The prior of m is half-normal with a given scale, and
that of τ given m is half-normal with scale m. (With a wider prior of τ, two specimens would not limit the spread: the
likelihood decreases no faster than 1/τ.)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.numerics.weights import effective_size, normalise, summarise
from bayesdamp.types import OK, Refusal

HISTOGRAM_BINS = 150
"""Number of bins into which the posterior draws of one specimen's coefficient are sorted."""
LOCATIONS, SCALES = 121, 81
"""Numbers of grid values of the location m and of the scale τ, which describe the normal distribution of a coefficient
over specimens before its truncation at zero."""
GRID_SDS = 9.0
"""Half-width of the grid of the location m of the distribution over specimens, at each value of its scale τ, in
standard deviations of m given τ and the records (for a flat prior of m)."""
LARGEST_TAU = 4.0
"""Largest scale τ on the grid of distributions over specimens, in units of the prior scale of the location m; the prior
probability beyond is below 1e-4."""
FAR_FROM_ZERO = 8.0
"""Near zero, the normal densities of `Kernels` are reflected at zero. A density whose centre is at least this many of
its standard deviations from zero is not, because this would have no effect."""
GRID_POINTS, GRID_HALF_WIDTH, HYPER_DRAWS = 801, 6.0, 2000
"""Grid of one specimen's coefficient: number of points, and half-width in standard deviations of its likelihood.
`HYPER_DRAWS`: number of draws of the location m and scale τ of the distribution over specimens, over which the
specimen's posterior is averaged."""
LEAST_EFFECTIVE = 100
"""Each specimen's draws are reweighted for the records of the other specimens. If the effective number of one
specimen's draws is then below this, the result is unreliable (conventional)."""
FEW_SPECIMENS = 5
"""With fewer specimens than this, the upper limits of mean and spread mostly follow from their priors, and the outcome
says so."""


@dataclass(frozen=True)
class Sample:
    """Weighted posterior draws of one specimen's coefficient.

    name: of the specimen. values: n draws of the coefficient, in its unit, (n,). log_weights: log weights of the draws,
    (n,), up to a constant. log_prior: log density, at the draws, of the prior under which they were made, (n,).
    """

    name: str
    values: np.ndarray
    log_weights: np.ndarray
    log_prior: np.ndarray


@dataclass(frozen=True)
class Population:
    """The population of a coefficient: summaries in the unit of the coefficient.

    Attributes
    ----------
    mean, spread : mapping of str to float
        Posterior mean, sd, q2.5, median and q97.5 of the mean and of the standard deviation of the truncated normal
        distribution of specimens. These differ from m and τ, which describe it before the truncation.
    shrunk : mapping of str to mapping
        The same summary of each specimen's coefficient given the records of all specimens, by name of the specimen.
    effective : mapping of str to float
        Effective number of each specimen's draws after reweighting for the records of all specimens, by name.
    outcome : str
        "ok", or a sentence on what limits the result.
    """

    mean: Mapping[str, float]
    spread: Mapping[str, float]
    shrunk: Mapping[str, Mapping[str, float]]
    effective: Mapping[str, float]
    outcome: str


@dataclass(frozen=True)
class Kernels:
    """The likelihood of one specimen's coefficient as a weighted sum of b normal densities of equal width.

    centres, log_weights: of the densities, (b,). width: standard deviation of each density. mean, sd: mean and standard
    deviation of the normalised likelihood.
    """

    centres: np.ndarray
    log_weights: np.ndarray
    width: float
    mean: float
    sd: float

    @classmethod
    def of(cls, sample: Sample) -> Kernels:
        """Estimate the likelihood from a specimen's posterior draws, whose weights are divided by the prior density.

        The draws are sorted into bins that are much narrower than the normal densities. The width of the densities
        follows from the effective number of draws by Silverman's rule. The draws are shifted towards their mean, so
        that the width does not increase the variance (West, Journal of the Royal Statistical Society B 55, 1993); but
        not if the mean is less than four sds above zero, where a shift would distort more than the width does.
        """
        log_weights = sample.log_weights - sample.log_prior
        w = normalise(log_weights)
        mean = float(w @ sample.values)
        sd = float(np.sqrt(w @ (sample.values - mean) ** 2))
        relative_width = 1.06 * effective_size(log_weights) ** -0.2
        drawn = sample.values
        if not mean < 4 * sd:
            drawn = mean + np.sqrt(max(1 - relative_width**2, 0.0)) * (drawn - mean)
        edges = np.linspace(drawn.min(), drawn.max(), HISTOGRAM_BINS + 1)
        mass = np.histogram(drawn, edges, weights=w)[0]
        centres = np.histogram(drawn, edges, weights=w * drawn)[0]
        filled = mass > 0
        return cls(centres[filled] / mass[filled], np.log(mass[filled]), relative_width * sd, mean, sd)

    def log_likelihood(self, m: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Return log ∫ likelihood(θ) N(θ | m, τ) dθ over θ ≥ 0 for arrays m and tau of one shape, up to a constant.

        N(θ | m, τ) is normalised over θ ≥ 0. The result has the same shape.
        """
        width, log = self.width, np.full(m.shape, -np.inf)
        variance = width**2 + tau**2

        def overlap(centre: float) -> np.ndarray:
            """Return log ∫ K(θ) N(θ | m, τ) dθ over all θ, in the shape of m, up to a constant.

            K is the normal density with standard deviation `width` about the centre.
            """
            return -0.5 * (m - centre) ** 2 / variance - 0.5 * np.log(variance)

        def inside(centre: float) -> np.ndarray:
            """Return the log of the integral in `overlap`, but over θ ≥ 0 only; in the shape of m."""
            top = (m * width**2 + centre * tau**2) / variance
            return overlap(centre) + scipy.special.log_ndtr(top * np.sqrt(variance) / (width * tau))

        for centre, log_weight in zip(self.centres, self.log_weights, strict=True):
            # Near zero the density is reflected, so that no probability is lost.
            near = centre < FAR_FROM_ZERO * width
            term = np.logaddexp(inside(centre), inside(-centre)) if near else overlap(centre)
            log = np.logaddexp(log, log_weight + term)
        return log - scipy.special.log_ndtr(m / tau)

    def log_density(self, x: np.ndarray) -> np.ndarray:
        """Return the log likelihood of one specimen's coefficient at values x ≥ 0, (p,), up to a constant: (p,).

        All normal densities of which the likelihood is the sum are reflected at zero.
        """
        log_weights = self.log_weights[:, None]

        def about(centres: np.ndarray) -> np.ndarray:
            away = (x - centres[:, None]) / self.width
            return np.asarray(scipy.special.logsumexp(log_weights - 0.5 * away**2, axis=0))

        return np.logaddexp(about(self.centres), about(-self.centres))


def infer_population(samples: Sequence[Sample], scale: float) -> Population:
    """Infer the distribution of a non-negative coefficient over a population of specimens.

    Parameters
    ----------
    samples : sequence of Sample
        Posterior draws of each specimen.
    scale : float
        Scale of the half-normal prior of the location m, in the unit of the coefficient.

    Returns
    -------
    Population
        Summaries of the mean and the spread of the population, and of each specimen's coefficient.

    Raises
    ------
    Refusal
        If there are fewer than two specimens.
    """
    if len(samples) < 2:
        raise Refusal("two specimens or more are needed to infer the spread between specimens")
    kernels = [Kernels.of(s) for s in samples]
    m, tau, log_prior = _grid(kernels, scale)
    logs = [k.log_likelihood(m, tau) for k in kernels]
    density = log_prior + np.sum(logs, axis=0)
    weights = np.exp(density - density.max())
    weights /= weights.sum()
    # Mean and standard deviation of the truncated normal distribution.
    ratio = m / tau
    hazard = np.exp(-0.5 * ratio**2 - scipy.special.log_ndtr(ratio)) / np.sqrt(2 * np.pi)
    mean, spread = m + tau * hazard, tau * np.sqrt(np.maximum(1 - ratio * hazard - hazard**2, 0.0))
    shrunk, size = {}, {}
    for sample, kernel in zip(samples, kernels, strict=True):
        low, high = kernel.mean - GRID_HALF_WIDTH * kernel.sd, kernel.mean + GRID_HALF_WIDTH * kernel.sd
        x, gap = np.linspace(max(low, 0.0), high, GRID_POINTS, retstep=True)
        drawn = np.random.default_rng(0).choice(weights.size, HYPER_DRAWS, p=weights.ravel())
        # The width is at least the distance of grid points, so that no density falls between them.
        wide = np.sqrt(tau.ravel()[drawn] ** 2 + gap**2)[:, None]
        given = kernel.log_density(x) - 0.5 * ((x - m.ravel()[drawn][:, None]) / wide) ** 2
        given = np.exp(given - np.asarray(scipy.special.logsumexp(given, axis=1, keepdims=True))).mean(axis=0)
        ratio = given / np.maximum(np.exp(kernel.log_density(x)), 1e-300)
        log_ratio = np.log(np.maximum(np.interp(sample.values, x, ratio, left=0.0, right=0.0), 1e-300))
        shrunk[sample.name] = summarise(x, given)
        size[sample.name] = effective_size(sample.log_weights - sample.log_prior + log_ratio)
    worst, outcome = min(size, key=lambda name: size[name]), OK
    if size[worst] < LEAST_EFFECTIVE:
        few = f"given the other specimens, {worst} has only {size[worst]:.0f} effective draws (below {LEAST_EFFECTIVE})"
        outcome = f"not to be trusted: {few}"
    elif len(samples) < FEW_SPECIMENS:
        outcome = (
            f"only {len(samples)} specimens: upper limits of mean and spread mostly follow from their priors"
        )
    centre, width = (summarise(x.ravel(), weights.ravel()) for x in (mean, spread))
    return Population(centre, width, shrunk, size, outcome)


def _grid(kernels: Sequence[Kernels], scale: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the grid of m and τ, and the log prior probability of its cells, (LOCATIONS, SCALES) each.

    The values of τ are evenly spaced in their logarithm. For each τ, the values of m are evenly spaced about the mean
    of the specimens, weighted for this τ, and not below 0. Log probabilities are up to a constant. scale: scale of the
    prior of m.
    """
    means, sds = (np.array([getattr(k, n) for k in kernels]) for n in ("mean", "sd"))
    tau = np.geomspace(1e-3 * min(sds.min(), scale), LARGEST_TAU * scale, SCALES)
    precision = 1 / (sds[:, None] ** 2 + tau**2)
    middle = np.sum(means[:, None] * precision, axis=0) / precision.sum(axis=0)
    reach = GRID_SDS / np.sqrt(precision.sum(axis=0))
    # For a wide truncated normal distribution m may be anywhere from zero on.
    low, high = np.maximum(middle - reach, 0.0), np.maximum(middle + reach, reach)
    m = np.linspace(low, high, LOCATIONS)
    tau = np.broadcast_to(tau, m.shape)
    area = np.log((high - low) / (LOCATIONS - 1)) + np.log(tau)
    wide = np.maximum(m, 1e-3 * tau)
    log_prior = -0.5 * (m / scale) ** 2 - 0.5 * (tau / wide) ** 2 - np.log(wide)
    return m, tau, log_prior + area
