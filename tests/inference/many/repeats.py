"""Repeats of one specimen whose joint posterior is also had by quadrature, from the closed form of a linear decay.

Known are the start's velocity, the rest angle and, but for one problem, the stiffness; each record has an angle at the
start and a noise of its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import logsumexp

from bayesdamp.inference.fit.search import find_mode
from bayesdamp.inference.many.joint import Joint
from bayesdamp.inference.many.record import Exact
from bayesdamp.inference.model.target import Target
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.priors import HalfNormal, LogNormal, Normal, Prior
from bayesdamp.types import Seed, Signal

STIFFNESS = 20.0
TIMES = np.linspace(0.0, 6.0, 240)
PRIORS: Mapping[str, Prior] = {
    "zeta": HalfNormal(scale=0.3),
    "stiffness": LogNormal(median=21.0, sigma=0.2),
    "theta0": Normal(mean=0.0, sd=0.5),
    "noise_sd": LogNormal(median=0.01, sigma=1.0),
}


def decay(zeta: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    """The angle of a start at 1 rad without velocity, at all times: closed form, (..., n)."""
    zeta, stiffness = np.asarray(zeta)[..., None], np.asarray(stiffness)[..., None]
    w = np.sqrt(stiffness - zeta**2)
    return np.exp(-zeta * TIMES) * (np.cos(w * TIMES) + zeta / w * np.sin(w * TIMES))


def records(zetas: Sequence[float], seed: int, noise: float = 0.01) -> list[Signal]:
    """A record for each damping (1/s), each from an angle of its own."""
    rng = np.random.default_rng(seed)
    starts = [0.3, 0.22, 0.35, 0.27]
    made = [a * decay(np.array(z), np.array(STIFFNESS)) for a, z in zip(starts, zetas)]
    return [Signal(TIMES, y + rng.normal(0, noise, TIMES.size), name=f"r{i}") for i, y in enumerate(made)]


def targets(signals: Sequence[Signal], free: Sequence[str] = ("zeta", "theta0", "noise_sd")) -> list[Target]:
    known = {"stiffness": STIFFNESS, "rest_angle": 0.0, "omega0": 0.0}
    known = {n: v for n, v in known.items() if n not in free}
    osc = Oscillator(("viscous",), "linear")
    return [Target(s, osc, "gaussian", {n: PRIORS[n] for n in free}, known) for s in signals]


def starts(made: Sequence[Target]) -> tuple[list[dict[str, float]], list[float]]:
    """Values and the solver's tolerance at each record's own mode."""
    modes = [
        find_mode(
            t,
            {Seed("near"): {"zeta": 0.1, "stiffness": 20.0, "theta0": 0.3, "noise_sd": 0.01}},
            noise_level=0.01,
        )
        for t in made
    ]
    return [t.all_values(m.z) for t, m in zip(made, modes)], [m.tolerance for m in modes]


def joint(made: Sequence[Target], shared: Sequence[str], tolerances: Sequence[float]) -> Joint:
    return Joint(tuple(map(Exact, made, tolerances)), tuple(shared))


def log_alone(signal: Signal, zeta: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
    """Log likelihood of one record, its start and noise integrated out, at any dampings and stiffnesses, (...).

    The start is a linear coefficient with a normal prior: in closed form; the noise on a grid of its score.
    """
    h = decay(zeta, stiffness)
    y, n, sd0 = signal.y, signal.y.size, 0.5
    hh, hy, yy = np.sum(h * h, axis=-1)[..., None], (h @ y)[..., None], y @ y
    score = np.linspace(-2, 2, 401)
    sd = 0.01 * np.exp(score)
    precision = hh / sd**2 + 1 / sd0**2
    exponent = -0.5 * yy / sd**2 + 0.5 * (hy / sd**2) ** 2 / precision
    log_density = exponent - n * np.log(sd) - 0.5 * n * np.log(2 * np.pi) - 0.5 * np.log(precision * sd0**2)
    return logsumexp(log_density - 0.5 * score**2 - 0.5 * np.log(2 * np.pi), axis=-1) + np.log(
        score[1] - score[0]
    )
