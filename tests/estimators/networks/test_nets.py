"""The three methods that train a network on each record: pinn, neural_ode, rnn.

Trainings are short in tests that do not depend on accuracy. Records with noise have fixed seeds.
"""

import math

import numpy as np
import pytest
import torch

from bayesdamp.estimators.methods.neural_ode import NeuralOdeOptions
from bayesdamp.estimators.methods.pinn import PinnOptions
from bayesdamp.estimators.methods.rnn import COPIES, Simulator
from bayesdamp.estimators.networks.collocation import Collocation
from bayesdamp.estimators.networks.recurrent import RecurrentNetwork
from bayesdamp.estimators.networks.shooting import Shooting
from bayesdamp.estimators.networks.training import Round, ScaledRecord, jacobian, on_tensors, train
from bayesdamp.estimators.shared import checked_features
from bayesdamp.types import Refusal
from tests.estimators.truths import EVERYTHING, INITIAL, PAPER, SHORT, error, initial, pendulum


def test_a_training_neither_uses_nor_changes_the_random_numbers_and_settings_of_torch():
    """Negative control: another seed gives another network."""
    record = pendulum({"zeta": 0.05}, noise=0.003, samples=1000, free=("stiffness",))
    first = initial("pinn", *record, **SHORT["pinn"])
    torch.manual_seed(99)
    before, settings = torch.get_rng_state(), (torch.get_num_threads(), torch.get_default_dtype())
    assert initial("pinn", *record, **SHORT["pinn"]).values == first.values
    assert torch.equal(before, torch.get_rng_state())
    assert settings == (torch.get_num_threads(), torch.get_default_dtype())
    assert initial("pinn", *record, seed=2, **SHORT["pinn"]).values != first.values


@pytest.mark.parametrize(
    ("name", "damping"), list(zip(("pinn", "rnn", "neural_ode"), PAPER, strict=True)), ids=str
)
def test_networks_recover_the_damping_of_the_papers_pendulum(name, damping):
    """To a quarter of the limit. The force that neural_ode learns is odd and follows the law."""
    ((parameter, truth),) = damping.items()
    estimate = initial(name, *pendulum(damping, samples=2000))
    assert error(estimate.values[parameter], truth) < INITIAL[name] / 4
    assert estimate.outcome == "ok"
    if name == "neural_ode":
        velocity, force, law = (np.array(estimate.details[key]) for key in ("velocity", "force", "law"))
        assert force == pytest.approx(-force[::-1], abs=1e-12)
        assert np.abs(force - truth * velocity * np.abs(velocity)).max() < 0.1 * force.max()
        assert np.abs(law - truth * velocity * np.abs(velocity)).max() < 0.02 * force.max()


@pytest.mark.parametrize("name", ["pinn", "neural_ode"])
def test_sums_and_unknown_parameters_are_estimated(name):
    signal, problem = pendulum({"zeta": 0.05, "mu_c": 0.03}, samples=1000, free=EVERYTHING)
    estimate = initial(name, signal, problem, **SHORT[name])
    assert set(estimate.values) == {"zeta", "mu_c", *EVERYTHING}
    assert error(estimate.values["theta0"], 0.3) < 5.0


@pytest.mark.parametrize("quantity", ["angle", "velocity", "acceleration"])
@pytest.mark.parametrize("kind", ["neural_ode", "pinn"])
def test_derivatives_of_a_loss_are_central_differences(kind, quantity):
    signal, problem = pendulum({"mu_c": 0.03}, samples=400, free=("stiffness", "omega0"), quantity=quantity)
    features, rng = checked_features(signal), np.random.default_rng(0)
    if kind == "neural_ode":
        loss = Shooting(signal, problem, features, rng, NeuralOdeOptions(width=3, steps=24))
    else:
        loss = Collocation(signal, problem, features, rng, PinnOptions(width=4, collocation=100))
    check_differences(lambda x: loss.evaluate(x)[0], loss.first, loss.evaluate(loss.first)[1](), rng)


@pytest.mark.parametrize("cell", ["lstm", "gru"])
def test_recurrent_layers_are_those_of_torch(cell):
    """Also the derivatives through time are central differences. Negative control: gates in another order."""
    rng = np.random.default_rng(0)
    network = RecurrentNetwork(cell, 5)
    weights, sequences = 2.0 * network.draw(rng), rng.normal(size=(7, 9, 2))
    reference = getattr(torch.nn, cell.upper())(2, 5, batch_first=True, dtype=torch.float64)
    blocks = weights[:-6].reshape(-1, 5, 8)
    # torch has the gates in the orders input, forget, new, output, and reset, update, new.
    matrix = np.concatenate(blocks[[0, 1, 3, 2] if cell == "lstm" else [1, 0, 2]])
    own = (matrix[:, :2], matrix[:, 2:7], matrix[:, 7], np.zeros(len(matrix)))
    with torch.no_grad():
        for parameter, values in zip(reference.parameters(), own, strict=True):
            parameter.copy_(torch.from_numpy(values))
        last = reference(torch.from_numpy(sequences))[0][:, -1].numpy()
    expected = last @ weights[-6:-1] + weights[-1]
    assert network.read(weights, sequences) == pytest.approx(expected, abs=1e-12)
    assert np.abs(network.read(np.r_[matrix.ravel(), weights[-6:]], sequences) - expected).max() > 0.01
    rows = torch.from_numpy(weights).expand(len(sequences), -1)
    answers, slopes = jacobian(lambda x: network.answers(x, torch.from_numpy(sequences)), rows)
    assert answers.numpy() == pytest.approx(expected, abs=1e-12)
    check_differences(lambda x: network.read(x, sequences), weights, slopes.numpy(), rng)


def check_differences(function, x, slopes, rng):
    direction, step = rng.normal(size=x.size), 1e-5
    change = (function(x + step * direction) - function(x - step * direction)) / (2 * step)
    assert slopes @ direction == pytest.approx(change, abs=1e-6 * np.abs(change).max())
    # Negative control: derivatives in the reverse order.
    assert slopes[::-1] @ direction != pytest.approx(change, abs=1e-2 * np.abs(change).max())


def capped(x, v, epsilon):
    return max(min(v, 1.0), -1.0) * math.sqrt(2.0) + float(abs(x)) * np.arctan(v / epsilon)


def decides(x, v, epsilon):
    return v**3 if v > 0.0 else math.tanh(v / epsilon)


@pytest.mark.parametrize("kernel", [capped, decides])
def test_a_kernel_on_tensors_has_its_values_and_slopes(kernel):
    """A user's kernel may use `if`, functions of single numbers, and functions that torch names differently."""
    x, v = np.array([0.1, -0.2, 0.3, 0.4]), np.array([0.5, -0.4, 1.5, -2.0])
    slopes = [(kernel(a, b + 1e-6, 0.3) - kernel(a, b - 1e-6, 0.3)) / 2e-6 for a, b in zip(x, v)]
    rows = torch.from_numpy(np.column_stack([x, v]))
    values, derivatives = jacobian(lambda row: on_tensors(kernel)(row[:, 0], row[:, 1], 0.3), rows)
    assert values.numpy() == pytest.approx([kernel(*row, 0.3) for row in zip(x, v)], abs=1e-14)
    assert derivatives[:, 1].numpy() == pytest.approx(slopes, abs=1e-8)


def test_a_force_uses_the_given_equilibrium():
    signal, problem = pendulum({"zeta": 0.05}, model=("displacement",))
    record = ScaledRecord(signal, problem, checked_features(signal))
    assert record.damping_shapes(torch.ones(1)).item() == pytest.approx(record.base["rest"] ** 2, rel=1e-6)


def test_a_function_that_torch_lacks_is_refused_in_a_sentence():
    with pytest.raises(Refusal, match="the force uses the function gamma, which torch does not have"):
        on_tensors(lambda x: math.gamma(x))(torch.ones(2))


def test_training_and_validation_records_are_different():
    """Negative control: each record occurs several times, so that another split would share records."""
    signal, problem = pendulum({"zeta": 0.05}, samples=1000)
    simulator = Simulator(signal, problem, checked_features(signal), np.random.default_rng(0))
    (own, places), (others, other_places), _ = simulator.sequences(simulator.centre, 0.5, 99)
    assert (len(own), len(others)) == (len(places), len(other_places))
    assert not set(places) & set(other_places)
    assert len(places) == COPIES * len(set(places))
    assert places[-1] == places[-COPIES]


@pytest.mark.parametrize(("fall", "rounds"), [(1e-4, 9), (1e-2, 51)])
def test_training_ends_when_it_fits_only_noise(fall, rounds):
    """It ends early if the loss of 500 samples falls by less than 1/500 in a round, even if values still change."""
    descent = (Round(np.array([1.0 + i]), (1.0 - fall) ** i, i + 1) for i in range(1000))
    assert train(descent, 50, lambda x: x, samples=500).evaluations == rounds
