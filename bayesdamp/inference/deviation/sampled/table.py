"""What the draws of one candidate say: its parameters with the parts of their uncertainty, and how its law deviates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bayesdamp.inference.deviation.gaussian.tempered import Sampled
from bayesdamp.inference.deviation.numbers.deviations import left_over, size_of
from bayesdamp.inference.deviation.weighing import Result, Weighing

SHARE = 0.95
"""Of the draws that are in the shortest interval."""
QUANTILES = {"q2.5": 0.025, "q25": 0.25, "median": 0.5, "q75": 0.75, "q97.5": 0.975}


@dataclass(frozen=True)
class Posterior:
    """One candidate, sampled. parameters: name to mean, sd, sd_noise, sd_law, quantiles and the shortest interval;
    deviation: of the damping law, energy-weighted, (2.5 %, median, 97.5 %); unexplained: root mean square of what the
    plain fit leaves beyond noise, as a share of the amplitude. draws: (n, p), in the order of
    `parameters`; evidence and its standard error in nats; acceptance and temperatures of the sampler."""

    parameters: Mapping[str, Mapping[str, float]]
    deviation: tuple[float, float, float]
    unexplained: float
    draws: np.ndarray
    log_evidence: float
    stderr: float
    acceptance: float
    temperatures: int

    @property
    def names(self) -> tuple[str, ...]:
        """Of the inferred parameters."""
        return tuple(self.parameters)


def posterior_of(weighing: Weighing, result: Result, found: Sampled) -> Posterior:
    """The parameters' posterior from a candidate's draws.

    sd_noise is what the noise alone would leave were the laws exact, sd_law the rest.
    """
    parameters = result.fit.parameters
    z = found.draws[:, : parameters.free.size]
    values = parameters.values(z)[:, parameters.free]
    noise = noise_sds(weighing, result)
    rows = {name: summary(values[:, i], float(noise[i])) for i, name in enumerate(parameters.free_names)}
    return Posterior(
        rows, _deviation(weighing, result, found), left_over(weighing, result)[0], values, found.log_evidence,
        found.stderr, found.acceptance,
        found.temperatures,
    )  # fmt: skip


def noise_sds(weighing: Weighing, result: Result) -> np.ndarray:
    """The sd that noise alone would leave of each inferred parameter, (p,), were the laws exact."""
    rates = np.abs(result.fit.parameters.rates(result.fit.z))
    sds = np.linalg.norm(result.exact_weighed.factors[0], axis=1) * rates
    return sds * np.sqrt(weighing.variance / result.exact_variance)


def summary(values: np.ndarray, noise: float) -> dict[str, float]:
    """Of draws (n,): mean, sd and its parts, quantiles, the shortest interval."""
    sd = float(np.std(values, ddof=1))
    noise = min(noise, sd)
    ordered = np.sort(values)
    inside = int(np.ceil(SHARE * values.size))
    widths = ordered[inside - 1 :] - ordered[: values.size - inside + 1]
    first = int(np.argmin(widths))
    return {
        "mean": float(np.mean(values)),
        "sd": sd,
        "sd_noise": noise,
        "sd_law": float(np.sqrt(sd**2 - noise**2)),
        **{name: float(np.quantile(values, q)) for name, q in QUANTILES.items()},
        "hdi_low": float(ordered[first]),
        "hdi_high": float(ordered[first + inside - 1]),
    }


def _deviation(weighing: Weighing, result: Result, found: Sampled) -> tuple[float, float, float]:
    """Quantiles of the damping law's deviation over the draws."""
    d, n = result.fit.z.size, result.solver.knots.size
    if found.draws.shape[1] == d:
        return 0.0, 0.0, 0.0
    sizes = size_of(weighing, result, found.draws[:, d : d + n])
    low, middle, high = (float(q) for q in np.quantile(sizes, (0.025, 0.5, 0.975)))
    return low, middle, high
