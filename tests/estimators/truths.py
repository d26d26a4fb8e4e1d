"""Records with a known truth, from an independent solver at 1e-11 and from closed forms."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from scipy.integrate import solve_ivp

from bayesdamp.estimators import names_for_all
from bayesdamp.types import Problem, Signal, System

TERM = {"zeta": "viscous", "mu_c": "coulomb", "mu_q": "quadratic"}
PAPER = ({"zeta": 0.05}, {"mu_c": 0.03}, {"mu_q": 0.05})
NETS = ("pinn", "neural_ode", "rnn")
"""They train for seconds on each record: their tests are in a file of their own."""
SHORT = {
    "pinn": {"rounds": 25, "width": 10, "collocation": 200},
    "neural_ode": {"rounds": 5, "width": 4, "steps": 24},
    "rnn": {"records": 128, "epochs": 4, "units": 8},
    "symbolic_regression": {"population": 100, "generations": 10, "searches": 1},
}
"""Options of a short training, for what does not depend on accuracy; the other methods need none."""
QUICK = [name for name in names_for_all() if name not in NETS]
INITIAL = {"envelope": 5.0, "topological": 5.0, "pinn": 2.0, "neural_ode": 5.0, "rnn": 5.0}
"""Largest error of an initial estimate on a clean record, per cent; 1 for the others."""
EVERYTHING = ("stiffness", "gravity", "spring_angle", "theta0", "omega0")


def pendulum(
    damping: dict[str, float],
    *,
    k: float = 20.0,
    theta0: float = 0.3,
    epsilon: float = 0.1,
    duration: float = 10.0,
    samples: int = 5000,
    noise: float = 0.0,
    seed: int = 0,
    free: Iterable[str] = (),
    quantity: str = "angle",
    model: tuple[str, ...] | None = None,
) -> tuple[Signal, Problem]:
    """The paper's pendulum (γ = 1, θ_s = 0, θ̇0 = 0), and the problem of finding its damping."""
    zeta, mu_c, mu_q = (damping.get(name, 0.0) for name in TERM)

    def slope(_: float, y: np.ndarray) -> tuple[float, float]:
        drag = 2 * zeta * y[1] + mu_c * math.tanh(y[1] / epsilon) + mu_q * y[1] * abs(y[1])
        return y[1], -drag - k * y[0] + math.cos(y[0])

    t = np.linspace(0.0, duration, samples)
    y = solve_ivp(slope, (0.0, duration), (theta0, 0.0), "DOP853", t, rtol=1e-11, atol=1e-13, max_step=0.02).y
    values = {
        "angle": lambda: y[0],
        "velocity": lambda: y[1],
        "acceleration": lambda: np.array([slope(0.0, column)[1] for column in y.T]),
    }[quantity]()
    values = values + noise * np.random.default_rng(seed).normal(size=samples)
    known = {"stiffness": k, "gravity": 1.0, "spring_angle": 0.0, "theta0": theta0, "omega0": 0.0}
    known["epsilon"] = epsilon
    system = System(
        "horizontal_pendulum",
        {name: value for name, value in known.items() if name not in free},
        dict.fromkeys(free),
    )
    return Signal(t, values, quantity), Problem(model or tuple(TERM[name] for name in damping), system)


def damped_cosine(zeta: float = 0.08, k: float = 25.0, theta0: float = 0.4) -> tuple[Signal, Problem]:
    """Linear spring and viscous damping, in closed form."""
    t = np.linspace(0.0, 12.0, 3000)
    w = math.sqrt(k - zeta**2)
    y = theta0 * np.exp(-zeta * t) * (np.cos(w * t) + zeta / w * np.sin(w * t))
    known = {"stiffness": k, "rest_angle": 0.0, "theta0": theta0, "omega0": 0.0}
    return Signal(t, y), Problem(("viscous",), System("linear", known))


def dry_friction(mu: float = 0.2, k: float = 25.0, theta0: float = 0.4) -> tuple[Signal, Problem]:
    """Linear spring and exact dry friction, in closed form: amplitude drops by 2μ/k each half-cycle."""
    t = np.linspace(0.0, 10.0, 3000)
    w, shift = math.sqrt(k), mu / k
    half = np.floor(t * w / math.pi)
    # In half-cycle j a cosine about ±μ/k, its amplitude θ0 − (2j + 1)μ/k; no sticking before 10 s.
    assert theta0 - (2 * half[-1] + 1) * shift > shift
    y = (theta0 - (2 * half + 1) * shift) * np.cos(w * t) + shift * (-1.0) ** half
    known = {"stiffness": k, "rest_angle": 0.0, "theta0": theta0, "omega0": 0.0, "epsilon": 0.0}
    return Signal(t, y), Problem(("coulomb",), System("linear", known))


def error(value: float, truth: float) -> float:
    """In per cent of the truth."""
    return 100 * abs(value / truth - 1)
