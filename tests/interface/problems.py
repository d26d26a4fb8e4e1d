"""Records of a linear viscous oscillator, whose motion is known in closed form, their fit and their posterior."""

import re
from collections.abc import Callable, Iterable, Mapping
from functools import lru_cache

import numpy as np

import bayesdamp as bd

TRUTH = {"zeta": 0.05, "stiffness": 20.0, "rest_angle": 0.0, "theta0": 0.3, "omega0": 0.0}
NOISE = 0.003
KNOWN = {n: v for n, v in TRUTH.items() if n != "zeta"} | {"noise_sd": NOISE}
"""All parameters except the damping."""
TIMES = np.linspace(0.0, 6.0, 150)
MODEL = bd.Model("viscous", "linear", noise="gaussian")


def closed_form(t: np.ndarray, p: Mapping[str, float]) -> np.ndarray:
    """Return θ(t) of θ̈ + 2ζθ̇ + k(θ − θ_e) = 0, under-damped; t in s, any shape."""
    zeta, start = p["zeta"], p["theta0"] - p["rest_angle"]
    omega = np.sqrt(p["stiffness"] - zeta**2)
    wave = start * np.cos(omega * t) + (p["omega0"] + zeta * start) / omega * np.sin(omega * t)
    return p["rest_angle"] + np.exp(-zeta * t) * wave


def not_refused(cases: Iterable[tuple[Callable[[], object], str]]) -> list[str]:
    """Describe each call that does not raise an `InputError` of one line that contains its pattern."""
    failures = []
    for call, pattern in cases:
        try:
            call()
        except bd.InputError as error:
            if not re.search(pattern, str(error)) or "\n" in str(error):
                failures.append(f"{pattern}: {error}")
        else:
            failures.append(f"{pattern}: nothing is raised")
    return failures


@lru_cache
def record(seed: int = 3) -> bd.Signal:
    """Return the closed form with white noise."""
    noise = NOISE * np.random.default_rng(seed).standard_normal(TIMES.size)
    return bd.signal(TIMES, closed_form(TIMES, TRUTH) + noise, name=f"closed form {seed}", cleaned=False)


@lru_cache
def fit() -> bd.Fit:
    return bd.fit(record(), MODEL)


@lru_cache
def posterior() -> bd.Posterior:
    return bd.sample(fit(), warmup=200, draws=500, seed=2)
