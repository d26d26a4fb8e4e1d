"""What the draws of one candidate say: its parameters with the parts of their uncertainty, and how its law deviates."""

from __future__ import annotations

import numpy as np

from bayesdamp.inference.deviation.gaussian.tempered import Sampled
from bayesdamp.inference.deviation.numbers.deviations import left_over, size_of
from bayesdamp.inference.deviation.weighing import Result, Weighing

SHARE = 0.95
"""Of the draws that are in the shortest interval."""
QUANTILES = {"q2.5": 0.025, "q25": 0.25, "median": 0.5, "q75": 0.75, "q97.5": 0.975}


def posterior_of(weighing: Weighing, result: Result, found: Sampled) -> tuple[dict[str, object], np.ndarray]:
    """Return what the draws of a candidate say, and the inferred parameters of each, (n, p).

    parameters: name to mean, sd, quantiles and the shortest interval; sd_noise is what the noise alone would leave were
    the laws exact, sd_law the rest. deviation: of the damping law, energy-weighted, (2.5 %, median, 97.5 %);
    unexplained: root mean square of what the plain fit leaves beyond noise, as a share of the amplitude. Evidence and
    its standard error are in nats.
    """
    parameters = result.fit.parameters
    d, n = parameters.free.size, result.solver.knots.size
    values = parameters.values(found.draws[:, :d])[:, parameters.free]
    rows = zip(parameters.free_names, values.T, noise_sds(weighing, result), strict=True)
    sizes = size_of(weighing, result, found.draws[:, d : d + n]) if found.draws.shape[1] > d else np.zeros(1)
    said = {
        "parameters": {name: summary(own, float(noise)) for name, own, noise in rows},
        "deviation": np.quantile(sizes, (0.025, 0.5, 0.975)).tolist(),
        "unexplained": left_over(weighing, result)[0],
        "log_evidence": found.log_evidence,
        "stderr": found.stderr,
        "acceptance": found.acceptance,
        "temperatures": found.temperatures,
    }
    return said, values


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
