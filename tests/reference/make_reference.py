"""Reference posteriors without the package: emcee on trajectories of SciPy's DOP853.

    python tests/reference/make_reference.py viscous_coulomb      # ten minutes for each name

`<name>.json` in this folder states the problem: the model, the priors in natural units, and the truth. The record is
simulated here with DOP853 and NumPy's generator. Record, moments, quantiles, their Monte Carlo errors and the settings
are written to the same file. Independent ensembles of emcee use stretch and differential-evolution moves. Parameters
are sampled in natural units, those with a lognormal prior as logarithms, and half-normal coefficients with a wall at
zero.
"""

from __future__ import annotations

import json
import math
import platform
import sys
from pathlib import Path

import emcee
import numpy as np
import scipy
from scipy import stats
from scipy.integrate import solve_ivp

LOG_2PI = math.log(2 * math.pi)

NAMES = ("viscous_coulomb", "coulomb_correlated", "touching_zero")
FOLDER = Path(__file__).parent
ENSEMBLES = 3
WALKERS = 512
BURN = 250
STEPS = 700


def slope_of(problem: dict, p: dict[str, np.ndarray]):
    """Return the function from (θ, θ̇) to its derivative. Parameters have shape (w,), for w trajectories at once."""
    q = {**problem["known"], **p}
    zeta, mu_c, eps, k = q.get("zeta", 0.0), q.get("mu_c", 0.0), q["epsilon"], q["stiffness"]

    def slope(_, y):
        angle, v = y.reshape(2, -1)
        drag = 2 * zeta * v + mu_c * np.tanh(v / eps)
        if problem["restoring"] == "linear":
            force = -k * (angle - q["rest_angle"])
        else:
            force = -k * (angle - q["spring_angle"]) + q["gravity"] * np.cos(angle)
        return np.concatenate([v, force - drag])

    return slope


def record_of(problem: dict) -> tuple[np.ndarray, np.ndarray]:
    """Return times in s, jittered if the noise is correlated, and the noisy angle in rad."""
    rng = np.random.default_rng(problem["seed"])
    truth, n = problem["truth"], problem["samples"]
    t = np.linspace(0.0, problem["duration"], n)
    if problem["noise"] == "correlated":
        t[1:-1] += rng.uniform(-0.3, 0.3, n - 2) * t[1]
    start, fine = (truth["theta0"], truth["omega0"]), {"rtol": 1e-11, "atol": 1e-13, "max_step": 0.005}
    run = solve_ivp(slope_of(problem, truth), (0.0, t[-1]), start, "DOP853", t_eval=t, **fine)
    noise = rng.standard_normal(n)
    if problem["noise"] == "correlated":
        rho = np.exp(-np.diff(t) / truth["noise_time"])
        for i in range(1, n):
            noise[i] = rho[i - 1] * noise[i - 1] + math.sqrt(1 - rho[i - 1] ** 2) * noise[i]
    return t, run.y[0] + truth["noise_sd"] * noise


def log_prior(problem: dict, p: dict[str, np.ndarray]) -> np.ndarray:
    """Return the log prior density of w parameter sets, (w,)."""
    densities = {
        "halfnormal": lambda x, prior: stats.halfnorm.logpdf(x, scale=prior["scale"]),
        "normal": lambda x, prior: stats.norm.logpdf(x, prior["mean"], prior["sd"]),
        "lognormal": lambda x, prior: stats.lognorm.logpdf(x, prior["sigma"], scale=prior["median"]),
    }
    return sum(densities[prior["prior"]](p[name], prior) for name, prior in problem["priors"].items())


def log_likelihood(problem: dict, t: np.ndarray, y: np.ndarray, p: dict[str, np.ndarray]) -> np.ndarray:
    """Return the log likelihood of w parameter sets, (w,), by one run of DOP853, whose error is that of the mean square
    over all w: a hundredth of the admissible one. Correlated noise is a product of one-step conditionals."""
    w = p["theta0"].size
    start = np.concatenate([p["theta0"], p["omega0"]])
    run = solve_ivp(slope_of(problem, p), (0.0, t[-1]), start, "DOP853", t_eval=t, rtol=1e-9, atol=1e-11)
    r = y - run.y[:w]
    sd = np.repeat(p["noise_sd"][:, None], t.size, axis=1)
    if problem["noise"] == "correlated":
        rho = np.exp(-np.diff(t) / p["noise_time"][:, None])
        r = np.concatenate([r[:, :1], r[:, 1:] - rho * r[:, :-1]], axis=1)
        sd[:, 1:] *= np.sqrt(1 - rho**2)
    return -0.5 * np.sum((r / sd) ** 2 + LOG_2PI, axis=1) - np.sum(np.log(sd), axis=1)


def make(name: str) -> dict:
    """Return the content of the file of a problem."""
    stated = json.loads((FOLDER / f"{name}.json").read_text())
    problem = {**stated["problem"], "truth": stated["truth"]}
    t, y = record_of(problem)
    names = list(problem["priors"])
    log = np.array([problem["priors"][n]["prior"] == "lognormal" for n in names])
    wall = np.array([problem["priors"][n]["prior"] == "halfnormal" for n in names])

    def natural(u: np.ndarray) -> np.ndarray:
        return np.where(log, np.exp(np.where(log, u, 0.0)), u)

    def density(u: np.ndarray) -> np.ndarray:
        value = np.full(len(u), -np.inf)
        inside = np.flatnonzero(~np.any(wall & (u < 0), axis=1))
        if inside.size:
            p = dict(zip(names, natural(u[inside]).T))
            value[inside] = log_prior(problem, p) + log_likelihood(problem, t, y, p)
            value[inside] += np.sum(u[inside][:, log], axis=1)
        return np.where(np.isfinite(value), value, -np.inf)

    truth = np.array([problem["truth"][n] for n in names])
    centre = np.where(log, np.log(np.where(log, truth, 1.0)), truth)
    rng = np.random.default_rng(problem["seed"] + 1)
    moves = [(emcee.moves.DEMove(), 0.7), (emcee.moves.StretchMove(), 0.3)]
    chains, accepted = [], []
    for ensemble in range(ENSEMBLES):
        start = centre + 0.002 * np.maximum(np.abs(centre), 0.1) * rng.standard_normal((WALKERS, len(names)))
        start = np.where(wall, np.abs(start), start)
        sampler = emcee.EnsembleSampler(WALKERS, len(names), density, moves=moves, vectorize=True)
        sampler.random_state = np.random.RandomState(problem["seed"] + 100 + ensemble).get_state()
        state = sampler.run_mcmc(start, BURN)
        sampler.reset()
        sampler.run_mcmc(state, STEPS)
        chains.append(sampler.get_chain())
        accepted.append(float(np.mean(sampler.acceptance_fraction)))
        print(f"{name}: ensemble {ensemble + 1} of {ENSEMBLES}", flush=True)
    draws = natural(np.stack(chains))  # (ensemble, step, walker, parameter)
    summary = {}
    for i, parameter in enumerate(names):
        x = draws[..., i]
        tau = float(np.mean([emcee.autocorr.integrated_time(c[..., i], quiet=True)[0] for c in chains]))
        size = x.size / tau
        means, sd = x.mean(axis=(1, 2)), float(x.std(ddof=1))
        within = float(np.mean(x.var(axis=(1, 2), ddof=1)))
        summary[parameter] = {
            "mean": float(x.mean()),
            "sd": sd,
            "quantiles": [float(q) for q in np.quantile(x, [0.025, 0.25, 0.5, 0.75, 0.975])],
            "ess": size,
            "mcse": sd / math.sqrt(size),
            "rhat": math.sqrt(1 + float(means.var(ddof=1)) / within),
        }
    at_truth = {n: np.array([v]) for n, v in problem["truth"].items()}
    return stated | {
        "record": {"t": t.tolist(), "y": y.tolist()},
        "at_truth": {
            "log_likelihood": float(log_likelihood(problem, t, y, at_truth)[0]),
            "log_prior": float(log_prior(problem, at_truth)[0]),
        },
        "posterior": summary,
        "quantiles": [0.025, 0.25, 0.5, 0.75, 0.975],
        "made": {
            "by": "tests/reference/make_reference.py",
            "method": "emcee (0.7 DE, 0.3 stretch) on scipy.integrate.solve_ivp, DOP853, rtol 1e-9",
            "ensembles": ENSEMBLES,
            "walkers": WALKERS,
            "burn": BURN,
            "steps": STEPS,
            "acceptance": accepted,
            "seed": problem["seed"],
            "versions": {
                "python": platform.python_version(),
                **{package.__name__: package.__version__ for package in (np, scipy, emcee)},
            },
        },
    }


if __name__ == "__main__":
    for argument in sys.argv[1:] or NAMES:
        path = FOLDER / f"{argument}.json"
        path.write_text(json.dumps(make(argument), indent=1) + "\n")
        print(path)
