"""Records with a known truth, from an independent solver at 1e-11 and from closed forms."""

from collections.abc import Iterable

import numpy as np

from bayesdamp.estimators import names_for_all, run
from bayesdamp.types import Estimate, Problem, Signal, System
from tests.physics.independent import LAWS, trajectory, viscous, with_coulomb

TERM = {"zeta": "viscous", "mu_c": "coulomb", "mu_q": "quadratic"}
PAPER = ({"zeta": 0.05}, {"mu_c": 0.03}, {"mu_q": 0.05})
NETS = ("pinn", "neural_ode", "rnn")
"""Methods that train for seconds on each record; their tests are in their own file."""
SHORT = {
    "pinn": {"rounds": 25, "width": 10, "collocation": 200},
    "neural_ode": {"rounds": 5, "width": 4, "steps": 24},
    "rnn": {"records": 128, "epochs": 4, "units": 8},
    "symbolic_regression": {"population": 100, "generations": 10, "searches": 1},
}
"""Options of a short training, for tests that do not depend on accuracy."""
QUICK = [name for name in names_for_all() if name not in NETS]
INITIAL = {"envelope": 5.0, "topological": 5.0, "pinn": 2.0, "neural_ode": 5.0, "rnn": 5.0}
"""Largest error of an initial estimate on a clean record in per cent; 1 for the other methods."""
EVERYTHING = ("stiffness", "gravity", "spring_angle", "theta0", "omega0")


def pendulum(
    damping: dict[str, float],
    *,
    k: float = 20.0,
    theta0: float = 0.3,
    samples: int = 5000,
    noise: float = 0.0,
    seed: int = 0,
    free: Iterable[str] = (),
    quantity: str = "angle",
    model: tuple[str, ...] | None = None,
) -> tuple[Signal, Problem]:
    """Return a record of the paper's pendulum (γ = 1, θ_s = 0, θ̇0 = 0), and the problem of its damping."""
    t = np.linspace(0.0, 10.0, samples)
    known = {**LAWS["horizontal_pendulum"], "stiffness": k, "theta0": theta0}
    motion = trajectory("horizontal_pendulum", {**known, **damping}, t, longest=0.02)
    values = motion[:, ("angle", "velocity", "acceleration").index(quantity)]
    values = values + noise * np.random.default_rng(seed).normal(size=samples)
    given = {name: value for name, value in known.items() if name not in free}
    system = System("horizontal_pendulum", given, dict.fromkeys(free))
    return Signal(t, values, quantity), Problem(model or tuple(TERM[name] for name in damping), system)


def damped_cosine(zeta: float = 0.08, k: float = 25.0, theta0: float = 0.4) -> tuple[Signal, Problem]:
    """Return a linear spring with viscous damping in closed form."""
    t = np.linspace(0.0, 12.0, 3000)
    known = {"stiffness": k, "rest_angle": 0.0, "theta0": theta0, "omega0": 0.0}
    return Signal(t, viscous(t, zeta, k**0.5, theta0)), Problem(("viscous",), System("linear", known))


def dry_friction() -> tuple[Signal, Problem]:
    """Return a linear spring with exact dry friction of 0.2 in closed form."""
    t = np.linspace(0.0, 10.0, 3000)
    known = {"stiffness": 25.0, "rest_angle": 0.0, "theta0": 0.4, "omega0": 0.0, "epsilon": 0.0}
    y = with_coulomb({**known, "mu_c": 0.2}, t)[:, 0]
    return Signal(t, y), Problem(("coulomb",), System("linear", known))


def initial(
    name: str, signal: Signal, problem: Problem, seed: int = 1, stage: str = "initial", **options: object
) -> Estimate:
    """Return the estimate of one stage."""
    (estimate,) = run(name, signal, problem, options=options, stages=[stage], seed=seed)
    return estimate


def error(value: float, truth: float) -> float:
    """Return the error in per cent of the truth."""
    return 100 * abs(value / truth - 1)
