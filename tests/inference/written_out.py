"""Two problems written out by other means: records, priors and likelihoods without the package.

Records from DOP853 and NumPy's generator, likelihoods on LSODA trajectories, priors in natural units.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import odeint, solve_ivp

LOG_2PI = math.log(2 * math.pi)

PROBLEMS: dict[str, dict] = {
    "viscous_coulomb": {
        "damping": ["viscous", "coulomb"],
        "restoring": "horizontal_pendulum",
        "noise": "gaussian",
        "known": {"stiffness": 20.0, "gravity": 1.0, "spring_angle": 0.0, "epsilon": 0.1},
        "truth": {"zeta": 0.04, "mu_c": 0.02, "theta0": 0.3, "omega0": 0.0, "noise_sd": 0.006},
        "priors": {
            "zeta": {"prior": "halfnormal", "scale": 0.4},
            "mu_c": {"prior": "halfnormal", "scale": 0.8},
            "theta0": {"prior": "normal", "mean": 0.05, "sd": 0.6},
            "omega0": {"prior": "normal", "mean": 0.0, "sd": 2.0},
            "noise_sd": {"prior": "lognormal", "median": 0.005, "sigma": 1.0},
        },
        "duration": 8.0,
        "samples": 200,
        "seed": 11,
    },
    "coulomb_correlated": {
        "damping": ["coulomb"],
        "restoring": "linear",
        "noise": "correlated",
        "known": {"rest_angle": 0.0, "epsilon": 0.03},
        "truth": {
            "mu_c": 0.05,
            "stiffness": 20.0,
            "theta0": 0.3,
            "omega0": 0.1,
            "noise_sd": 0.006,
            "noise_time": 0.05,
        },
        "priors": {
            "mu_c": {"prior": "halfnormal", "scale": 0.8},
            "stiffness": {"prior": "lognormal", "median": 21.0, "sigma": 0.5},
            "theta0": {"prior": "normal", "mean": 0.0, "sd": 0.6},
            "omega0": {"prior": "normal", "mean": 0.0, "sd": 2.0},
            "noise_sd": {"prior": "lognormal", "median": 0.005, "sigma": 1.0},
            "noise_time": {"prior": "lognormal", "median": 0.3, "sigma": 1.5},
        },
        "duration": 8.0,
        "samples": 200,
        "seed": 12,
    },
}


def slope_of(problem: dict, p: dict[str, float]):
    """(θ, θ̇) to its derivative, on plain floats."""
    q = {**problem["known"], **p}
    zeta, mu_c, eps, k = q.get("zeta", 0.0), q.get("mu_c", 0.0), q["epsilon"], q["stiffness"]
    if problem["restoring"] == "linear":
        rest = q["rest_angle"]

        def slope(y, t=0.0):
            v = y[1]
            return v, -2 * zeta * v - mu_c * math.tanh(v / eps) - k * (y[0] - rest)
    else:
        gravity, spring = q["gravity"], q["spring_angle"]

        def slope(y, t=0.0):
            v = y[1]
            drag = 2 * zeta * v + mu_c * math.tanh(v / eps)
            return v, -drag - k * (y[0] - spring) + gravity * math.cos(y[0])

    return slope


def record_of(problem: dict) -> tuple[np.ndarray, np.ndarray]:
    """Times in s and the noisy angle in rad; a jittered clock for the correlated noise."""
    rng = np.random.default_rng(problem["seed"])
    truth, n = problem["truth"], problem["samples"]
    t = np.linspace(0.0, problem["duration"], n)
    if problem["noise"] == "correlated":
        t[1:-1] += rng.uniform(-0.3, 0.3, n - 2) * t[1]
    slope = slope_of(problem, truth)
    run = solve_ivp(
        lambda _, y: slope(y),
        (0.0, t[-1]),
        (truth["theta0"], truth["omega0"]),
        method="DOP853",
        rtol=1e-11,
        atol=1e-13,
        t_eval=t,
        max_step=0.005,
    )
    noise = rng.standard_normal(n)
    if problem["noise"] == "correlated":
        rho = np.exp(-np.diff(t) / truth["noise_time"])
        for i in range(1, n):
            noise[i] = rho[i - 1] * noise[i - 1] + math.sqrt(1 - rho[i - 1] ** 2) * noise[i]
    return t, run.y[0] + truth["noise_sd"] * noise


def log_prior(problem: dict, p: dict[str, float]) -> float:
    total = 0.0
    for name, prior in problem["priors"].items():
        x = p[name]
        kind = prior["prior"]
        if kind == "halfnormal":
            z, scale = x / prior["scale"], 0.5 * prior["scale"]
        elif kind == "normal":
            z, scale = (x - prior["mean"]) / prior["sd"], prior["sd"]
        else:
            z, scale = math.log(x / prior["median"]) / prior["sigma"], prior["sigma"] * x
        total -= 0.5 * (z * z + LOG_2PI) + math.log(scale)
    return total


def log_likelihood(problem: dict, t: np.ndarray, y: np.ndarray, p: dict[str, float]) -> float:
    """By LSODA; the correlated noise by its covariance as a product of one-step conditionals."""
    fit = odeint(slope_of(problem, p), (p["theta0"], p["omega0"]), t, rtol=1e-8, atol=1e-9, mxstep=5000)[:, 0]
    r = y - fit
    sd = np.full(r.size, p["noise_sd"])
    if problem["noise"] == "correlated":
        rho = np.exp(-np.diff(t) / p["noise_time"])
        r = np.concatenate([r[:1], r[1:] - rho * r[:-1]])
        sd[1:] *= np.sqrt(1 - rho**2)
    return float(-0.5 * np.sum((r / sd) ** 2 + LOG_2PI) - np.sum(np.log(sd)))
