"""The three methods that train a network on each record: pinn, neural_ode, rnn.

Trainings are short where accuracy does not matter. Records with noise have fixed seeds.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch

from bayesdamp.estimators import run
from bayesdamp.estimators.networks.shooting import Shooting
from bayesdamp.estimators.networks.training import generator
from bayesdamp.estimators.shared import checked_features
from tests.estimators.truths import (
    EVERYTHING,
    INITIAL,
    PAPER,
    SHORT,
    error,
    pendulum,
)


def initial(name, signal, problem, seed=1, **options):
    (estimate,) = run(name, signal, problem, options=options, stages=["initial"], seed=seed)
    return estimate


@pytest.fixture(scope="module")
def noisy():
    return pendulum({"zeta": 0.05}, noise=0.003, samples=1000, free=("stiffness",))


def test_the_seed_is_all_the_chance_there_is(noisy):
    """torch's own random numbers and settings are neither used nor moved."""
    name = "pinn"
    signal, problem = noisy
    first = initial(name, signal, problem, **SHORT[name])
    torch.manual_seed(99)
    before = torch.get_rng_state(), torch.get_num_threads(), torch.get_default_dtype()
    assert initial(name, signal, problem, **SHORT[name]).values == first.values
    after = torch.get_rng_state(), torch.get_num_threads(), torch.get_default_dtype()
    assert torch.equal(before[0], after[0])
    assert before[1:] == after[1:]
    assert {"loss", "zeta"} <= set(first.trace)
    # Negative control: another seed is another network.
    assert initial(name, signal, problem, seed=2, **SHORT[name]).values != first.values


@pytest.mark.parametrize(
    ("name", "damping"), list(zip(("pinn", "rnn", "neural_ode"), PAPER, strict=True)), ids=str
)
def test_papers_pendulum(name, damping):
    ((parameter, truth),) = damping.items()
    options = {"records": 256, "epochs": 20} if name == "rnn" else {}
    found = initial(name, *pendulum(damping, samples=2000), **options)
    assert error(found.values[parameter], truth) < INITIAL[name] / 4  # an order below what is asked for
    assert found.outcome == "ok"
    assert found.trace[parameter][-1] == found.values[parameter]
    if name == "neural_ode":  # the learnt force is odd and follows the law
        velocity, force, law = (np.array(found.details[name]) for name in ("velocity", "force", "law"))
        assert force == pytest.approx(-force[::-1], abs=1e-12)
        assert np.abs(force - truth * velocity * np.abs(velocity)).max() < 0.1 * force.max()
        assert np.abs(law - truth * velocity * np.abs(velocity)).max() < 0.02 * force.max()


@pytest.mark.parametrize("name", ["pinn", "neural_ode"])
def test_sums_and_free_parameters_are_named(name):
    signal, problem = pendulum({"zeta": 0.05, "mu_c": 0.03}, samples=1000, free=EVERYTHING)
    found = initial(name, signal, problem, **SHORT[name])
    assert set(found.values) == {"zeta", "mu_c", *EVERYTHING}
    assert error(found.values["theta0"], 0.3) < 5.0


def test_pinn_negative_control_a_wrong_equation_of_motion_does_not_fit():
    signal, problem = pendulum({"zeta": 0.05}, samples=800)
    wrong = dataclasses.replace(problem.system, known={**problem.system.known, "stiffness": 22.0})
    fits, misses = (
        initial("pinn", signal, dataclasses.replace(problem, system=system), rounds=25).details
        for system in (problem.system, wrong)
    )
    assert misses["data_rms"] > 10 * fits["data_rms"]


def test_sensitivities_through_the_solver_are_differences():
    signal, problem = pendulum({"mu_c": 0.03}, samples=400, free=("stiffness", "omega0"))
    seen = checked_features(signal)
    random = generator(np.random.default_rng(0))
    shooting = Shooting(signal, problem, seen, width=3, steps=24, continuity_weight=1.0, random=random)
    x = shooting.start
    _, jacobian = shooting.linearise(x)
    direction = torch.randn(x.numel(), dtype=torch.float64, generator=random)
    step = 1e-5
    change = (shooting.residuals(x + step * direction) - shooting.residuals(x - step * direction)) / (
        2 * step
    )
    assert torch.allclose(jacobian @ direction, change, atol=1e-6 * float(change.abs().max()))
