"""Summaries and convergence diagnostics of posterior draws.

The diagnostics are the rank-normalised split R̂ and the effective sample sizes of bulk, tails and mean, from Vehtari,
Gelman, Simpson, Carpenter, Bürkner, "Rank-normalization, folding, and localization: an improved R̂ for assessing
convergence of MCMC", Bayesian Analysis 16 (2021). Sections and formulas that are cited in this module are those of this
paper. ArviZ computes the same numbers, but its import takes half a second in each process. Draws have the shape (chain,
draw). A result is nan if a chain has fewer than four draws or a draw is not finite.
"""

from collections.abc import Mapping

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.types import OK

LEAST_DRAWS = 4
"""Least number of draws in a chain for which diagnostics are computed; with fewer they are nan (conventional)."""
RHAT_LIMIT = 1.01
ESS_LIMIT = 400.0
"""RHAT_LIMIT is the largest R̂, and ESS_LIMIT the smallest effective sample size, at which draws count as reliable
(recommended by Vehtari et al. 2021)."""
HDI_PROBABILITY = 0.95
"""Probability of the shortest (highest-density) interval of a parameter that a summary contains."""
QUANTILES = {"q2.5": 0.025, "q25": 0.25, "median": 0.5, "q75": 0.75, "q97.5": 0.975}
"""Levels of the quantiles in a summary, by name."""


def rhat(draws: np.ndarray) -> float:
    """Return the rank-normalised split R̂ of draws, (chain, draw).

    It is the larger of two values: that of the draws (bulk), and that of their absolute distances from the median
    (tails); see section 4.1 of Vehtari et al., Bayesian Analysis 16 (2021). It is nan if there is one chain, if a chain
    has fewer than `LEAST_DRAWS` draws, if a draw is not finite, or if all draws are equal.
    """
    if not _usable(draws) or draws.shape[0] < 2:
        return float("nan")
    halves = _split(draws)
    return max(_rhat(_normalised(halves)), _rhat(_normalised(np.abs(halves - np.median(halves)))))


def ess_bulk(draws: np.ndarray) -> float:
    """Return the bulk effective sample size of draws, (chain, draw), computed from their normalised ranks.

    See section 4.2 of Vehtari et al., Bayesian Analysis 16 (2021). It is nan if a chain has fewer than `LEAST_DRAWS`
    draws or a draw is not finite.
    """
    return _ess(_normalised(_split(draws))) if _usable(draws) else float("nan")


def ess_tail(draws: np.ndarray) -> float:
    """Return the tail effective sample size of draws, (chain, draw): the smaller one for the 5 % and 95 % quantiles.

    See section 4.3 of Vehtari et al., Bayesian Analysis 16 (2021). It is nan if a chain has fewer than `LEAST_DRAWS`
    draws or a draw is not finite.
    """
    if not _usable(draws):
        return float("nan")
    return min(_ess(_split(draws <= np.quantile(draws, level)).astype(float)) for level in (0.05, 0.95))


def effective_mean(draws: np.ndarray) -> float:
    """Return the effective sample size for the mean of draws, (chain, draw).

    See section 3.2 of Vehtari et al., Bayesian Analysis 16 (2021). It is nan if a chain has fewer than `LEAST_DRAWS`
    draws or a draw is not finite.
    """
    return _ess(_split(draws)) if _usable(draws) else float("nan")


def monte_carlo_error(draws: np.ndarray) -> float:
    """Return the Monte Carlo standard error of the mean of draws, (chain, draw), in the unit of the draws.

    It is the sd of all draws divided by the root of `effective_mean`, and nan if this is nan.
    """
    return float(np.std(draws, ddof=1) / np.sqrt(effective_mean(draws)))


def _usable(draws: np.ndarray) -> bool:
    """Return whether draws, (chain, draw), are all finite and each chain has at least `LEAST_DRAWS` of them."""
    return draws.shape[1] >= LEAST_DRAWS and bool(np.all(np.isfinite(draws)))


def _split(draws: np.ndarray) -> np.ndarray:
    """Return the first and the last half of each chain as two separate chains, (2 · chain, draw // 2).

    All first halves come first. draws: shape (chain, draw). The middle draw of an odd number is left out.
    """
    half = draws.shape[1] // 2
    return np.vstack((draws[:, :half], draws[:, -half:]))


def _normalised(draws: np.ndarray) -> np.ndarray:
    """Return the standard normal quantiles of the ranks of draws among all draws, (chain, draw) each.

    Equal draws get their mean rank (formula 14 of Vehtari et al., Bayesian Analysis 16 (2021)).
    """
    _, which, ties = np.unique(draws, return_inverse=True, return_counts=True)
    ranks = (np.cumsum(ties) - (ties - 1) / 2)[which].reshape(draws.shape)
    return scipy.special.ndtri((ranks - 3 / 8) / (draws.size + 1 / 4))


def _rhat(chains: np.ndarray) -> float:
    """Return the potential scale reduction factor R̂ of chains, (chain, draw), without splitting or rank normalisation.

    See formulas (1) to (4) of Vehtari et al., Bayesian Analysis 16 (2021). It is infinite if the chains are constant
    but differ, and nan if all draws are equal. There must be at least two chains.
    """
    n = chains.shape[1]
    between = n * np.var(np.mean(chains, axis=1), ddof=1)
    within = np.mean(np.var(chains, axis=1, ddof=1))
    with np.errstate(divide="ignore", invalid="ignore"):  # constant chains give inf, or nan if all are equal
        return float(np.sqrt((between / within + n - 1) / n))


def _ess(chains: np.ndarray) -> float:
    """Return the effective sample size of chains, (chain, draw), without splitting or rank normalisation.

    See formulas (10) to (13) of Vehtari et al., Bayesian Analysis 16 (2021). The sum of autocorrelations is truncated
    by Geyer's initial monotone positive sequence. For N draws the result is at most N log₁₀ N, and N if all are equal.
    """
    if np.ptp(chains) < np.finfo(float).resolution:
        return float(chains.size)
    count, n = chains.shape
    size, away = scipy.fft.next_fast_len(2 * n, real=True), chains - np.mean(chains, axis=1, keepdims=True)
    power = np.abs(np.asarray(scipy.fft.rfft(away, size, axis=1))) ** 2
    covariance = np.mean(np.asarray(scipy.fft.irfft(power, size, axis=1))[:, :n] / n, axis=0)
    within = covariance[0] * n / (n - 1)
    total = covariance[0] + (np.var(np.mean(chains, axis=1), ddof=1) if count > 1 else 0.0)
    rho = 1.0 - (within - covariance) / total
    rho[0] = 1.0
    pairs = rho[0 : n - 1 : 2] + rho[1:n:2]
    # The sum ends at the first pair that is not positive, or at the largest lag (as in Stan).
    ends = ~(pairs > 0) | (np.arange(pairs.size) >= (n - 3) // 2)
    last = int(np.argmax(ends))
    remainder = rho[2 * last] if pairs[last] >= 0 or rho[2 * last] > 0 else 0.0
    time = -1.0 + 2.0 * np.sum(np.minimum.accumulate(pairs[:last])) + remainder
    return float(chains.size / max(time, 1.0 / np.log10(chains.size)))


def moments_and_quantiles(values: np.ndarray) -> dict[str, float]:
    """Return mean, sd, five quantiles and the ends of the shortest 95 % interval of values, (n,).

    The names are mean, sd, q2.5, q25, median, q75, q97.5, hdi_low and hdi_high; all are in the unit of the values.
    """
    ordered = np.sort(values)
    inside = int(np.ceil(HDI_PROBABILITY * ordered.size))
    first = int(np.argmin(ordered[inside - 1 :] - ordered[: ordered.size - inside + 1]))
    return {
        "mean": float(values.mean()),
        "sd": float(values.std(ddof=1)),
        **{name: float(np.quantile(ordered, level)) for name, level in QUANTILES.items()},
        "hdi_low": float(ordered[first]),
        "hdi_high": float(ordered[first + inside - 1]),
    }


def summarise(draws: np.ndarray, ensembles: int | None = None) -> dict[str, float]:
    """Summarise the posterior draws of one parameter by moments, quantiles and convergence diagnostics.

    Parameters
    ----------
    draws : ndarray, shape (chain, draw)
        Values of the parameter, in its unit.
    ensembles : int, optional
        Number of independent groups of consecutive chains, if the chains of a group are not independent (emcee's
        walkers). R̂ then compares the groups instead of the chains; the effective sample sizes are still computed from
        the chains.

    Returns
    -------
    dict of str to float
        mean, sd, median, other quantiles (q2.5, q25, q75, q97.5), ends of the shortest 95 % interval (hdi_low,
        hdi_high), ess_bulk, ess_tail and rhat, which may be nan.
    """
    chains = draws
    if ensembles is not None:  # (walker, step) to (ensemble, step · walker)
        chains = draws.reshape(ensembles, -1, draws.shape[1]).swapaxes(1, 2).reshape(ensembles, -1)
    return {
        **moments_and_quantiles(draws.reshape(-1)),
        "ess_bulk": ess_bulk(draws),
        "ess_tail": ess_tail(draws),
        "rhat": rhat(chains),
    }


def verdict(summaries: Mapping[str, Mapping[str, float]]) -> str:
    """Return "ok", or a sentence on the first parameter whose draws are not reliable.

    summaries: the result of `summarise` for each parameter, by name. R̂ must be at most `RHAT_LIMIT`, and both
    effective sample sizes (bulk and tail) at least `ESS_LIMIT`; nan counts as not reliable.
    """
    for name, s in summaries.items():
        if not s["rhat"] <= RHAT_LIMIT:
            return f"not converged: R-hat of {name} is {s['rhat']:.3f}, above {RHAT_LIMIT}"
        for kind in ("bulk", "tail"):
            if not s[f"ess_{kind}"] >= ESS_LIMIT:
                size = f"{kind} effective sample size of {name} is {s[f'ess_{kind}']:.0f}"
                return f"too few draws: {size}, below {ESS_LIMIT:.0f}"
    return OK
