"""Problems with an evidence by quadrature, whose trajectories are computed here."""

from functools import lru_cache

import numpy as np
from scipy.integrate import solve_ivp
from scipy.special import gammainc, gammaln, logsumexp

from bayesdamp.inference.evidence import Draws
from bayesdamp.inference.mode import Mode, find_mode
from bayesdamp.inference.model.target import Target
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.priors import HalfNormal, LogNormal, SharedHalfNormal
from bayesdamp.types import Signal

KNOWN = {"stiffness": 20.0, "rest_angle": 0.0, "epsilon": 0.1, "theta0": 0.3, "omega0": 0.0, "noise_sd": 0.02}
TIMES = np.linspace(0.0, 6.0, 151)
LIMIT = 0.05
"""nats"""
PRIORS = {"zeta": HalfNormal(0.45), "mu_c": HalfNormal(0.9), "noise_sd": LogNormal(0.01, sigma=1.0)}
PER_RATIO = {"zeta": 20.0**0.5, "mu_c": 0.5 * np.pi * 20.0 * 0.3}
"""Coefficients with a damping ratio of 1, which is ζ/ω, and 2μ/(π ω² A) for an energy loss of 4μA in a cycle."""


def trajectories(zeta: np.ndarray, mu_c: np.ndarray) -> np.ndarray:
    """Return θ at TIMES for m parameter sets, (m, n), by one run of SciPy's DOP853."""
    k, eps, m = KNOWN["stiffness"], KNOWN["epsilon"], zeta.size

    def slope(_: float, state: np.ndarray) -> np.ndarray:
        x, v = state.reshape(2, m)
        return np.concatenate([v, -2 * zeta * v - mu_c * np.tanh(v / eps) - k * x])

    start = np.repeat([KNOWN["theta0"], KNOWN["omega0"]], m)
    return solve_ivp(slope, TIMES[[0, -1]], start, "DOP853", t_eval=TIMES, rtol=1e-9, atol=1e-11).y[:m]


def record(zeta: float, mu_c: float, seed: int) -> np.ndarray:
    clean = trajectories(np.array([zeta]), np.array([mu_c]))[0]
    return clean + KNOWN["noise_sd"] * np.random.default_rng(seed).standard_normal(TIMES.size)


def log_density(square: np.ndarray, sd: np.ndarray | float, n: int = TIMES.size) -> np.ndarray:
    """Return the normal log density of n residuals with this sum of squares."""
    return -0.5 * square / np.square(sd) - n * np.log(np.asarray(sd) * np.sqrt(2 * np.pi))


BOTH, TOUCHING = ("viscous", "coulomb"), {"zeta": (0.0, 0.14), "mu_c": (0.0, 0.16)}
CASES: dict[str, tuple[tuple[str, ...], np.ndarray, dict[str, tuple[float, float]]]] = {
    "one far": (("coulomb",), record(0.0, 0.12, 4), {"mu_c": (0.06, 0.18)}),
    "two touching": (BOTH, record(0.06, 0.0, 3), TOUCHING),
    "three touching": (BOTH, record(0.06, 0.0, 3), {**TOUCHING, "noise_sd": (0.014, 0.028)}),
    "one shared": (("viscous",), record(0.2, 0.0, 3), {"zeta": (0.16, 0.24)}),
    "two shared": (BOTH, record(0.2, 0.0, 3), {"zeta": (0.0, 0.24), "mu_c": (0.0, 0.25)}),
}
"""Damping, record, and ranges of the parameters, outside of which the posterior is negligible. In the cases called
shared the damping ratios have one unknown scale, as by default."""


def log_prior(case: str, axes: dict[str, np.ndarray]) -> np.ndarray:
    """Return the log prior density of the parameters on the product of the axes.

    Half-normals of n ratios with one scale that is log-uniform from 1e-8 to 0.3 have a closed form in their length.
    """
    grids = np.meshgrid(*axes.values(), indexing="ij")
    if "shared" not in case:
        return sum(np.asarray(PRIORS[n].log_density(x)) for n, x in zip(axes, grids))
    half, squares = 0.5 * len(axes), sum((x / PER_RATIO[n]) ** 2 for n, x in zip(axes, grids))
    inside = gammainc(half, 0.5 * squares / 1e-8**2) - gammainc(half, 0.5 * squares / 0.3**2)
    log = gammaln(half) + np.log(0.5 * inside / np.log(0.3 / 1e-8)) + half * np.log(4 / np.pi / squares)
    return log - sum(np.log(PER_RATIO[n]) for n in axes)


@lru_cache
def problem(case: str) -> tuple[Target, Mode]:
    damping, y, ranges = CASES[case]
    known = {n: v for n, v in KNOWN.items() if n not in ranges}
    shared = {n: SharedHalfNormal(per_ratio=r) for n, r in PER_RATIO.items()} if "shared" in case else {}
    priors = {n: {**PRIORS, **shared}[n] for n in ranges}
    target = Target(Signal(TIMES, y), Oscillator(damping, "linear"), "gaussian", priors, known)
    seed = {n: 0.5 * (low + high) for n, (low, high) in ranges.items()}
    return target, find_mode(target, [seed], noise_level=KNOWN["noise_sd"])


@lru_cache
def posterior_grid(case: str, count: int) -> tuple[tuple[np.ndarray, ...], np.ndarray]:
    """Return Gauss–Legendre nodes of each parameter, and the log of prior · likelihood · weight on their product."""
    _, y, ranges = CASES[case]
    nodes, weights = np.polynomial.legendre.leggauss(count)
    axes = {n: low + 0.5 * (high - low) * (nodes + 1) for n, (low, high) in ranges.items()}
    motion = [n for n in ranges if n != "noise_sd"]
    grids = np.meshgrid(*(axes[n] for n in motion), indexing="ij")
    given = dict(zip(motion, (g.ravel() for g in grids)))
    still = np.zeros(count ** len(motion))
    motions = trajectories(given.get("zeta", still), given.get("mu_c", still))
    square, sd = np.sum((y - motions) ** 2, axis=-1).reshape(grids[0].shape), KNOWN["noise_sd"]
    if "noise_sd" in ranges:
        square, sd = square[..., None], axes["noise_sd"]
    logs = log_density(square, sd) + log_prior(case, axes)
    for i, (low, high) in enumerate(ranges.values()):
        along = np.log(0.5 * (high - low) * weights)
        logs = logs + along.reshape([-1 if j == i else 1 for j in range(len(ranges))])
    return tuple(axes.values()), logs


@lru_cache
def quadrature(case: str) -> float:
    """Return the log of the integral of prior · likelihood over the natural parameters, to 1e-3 nats."""
    results = [float(logsumexp(posterior_grid(case, count)[1])) for count in (44, 56)]
    assert abs(results[0] - results[1]) < 1e-3, "the grid is too coarse"
    logs = posterior_grid(case, 56)[1]
    for axis, (low, _) in enumerate(CASES[case][2].values()):
        edges = [np.take(logs, i, axis).max() for i in ((-1,) if low == 0.0 else (0, -1))]
        assert max(edges) < logs.max() - 12, "the grid cuts the posterior"
    return results[1]


def exact_draws(case: str, seed: int, chains: int = 4, count: int = 1000) -> Draws:
    """Return independent draws of the posterior: of cells of a fine grid, and uniform inside a cell."""
    axes, logs = posterior_grid(case, 56)
    rng = np.random.default_rng(seed)
    p = np.exp(logs - logs.max()).ravel()
    index = np.unravel_index(rng.choice(p.size, chains * count, p=p / p.sum()), logs.shape)
    columns = []
    for (low, high), axis, i in zip(CASES[case][2].values(), axes, index):
        walls = np.concatenate([[low], 0.5 * (axis[1:] + axis[:-1]), [high]])
        columns.append(walls[i] + rng.uniform(size=i.size) * (walls[i + 1] - walls[i]))
    target, _ = problem(case)
    return Draws.of(target, np.stack(columns, axis=-1).reshape(chains, count, -1))
