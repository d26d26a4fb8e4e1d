"""The genetic search: its range, its generations, and several unknowns at once. Seeds are fixed."""

from __future__ import annotations

import numpy as np
import pytest

from bayesdamp.estimators import run
from bayesdamp.estimators.methods import genetic
from bayesdamp.estimators.methods.genetic import Genes, coefficient_alone
from bayesdamp.estimators.shared import checked_features, oscillator
from bayesdamp.physics.trajectories import Trajectories
from tests.estimators.truths import EVERYTHING, damped_cosine, dry_friction, error, pendulum


def initial(signal, problem, **options):
    return run("genetic", signal, problem, options=options, stages=["initial"], seed=1)[0]


@pytest.fixture(scope="module")
def viscous():
    signal, problem = pendulum({"zeta": 0.05}, samples=1000)
    return signal, problem, initial(signal, problem)


def test_it_converges_in_the_generations_that_the_paper_names(viscous):
    _, _, found = viscous
    assert found.details["generations"] <= 40
    assert error(found.values["zeta"], 0.05) < 0.01
    best, mean = found.trace["best_misfit"], found.trace["mean_misfit"]
    assert best.size == mean.size == found.trace["zeta"].size == found.details["generations"] + 1
    assert np.all(best <= mean)
    assert np.all(np.diff(best) <= 0)  # the elite is kept
    assert best[0] > 100 * best[-1]
    # Negative control: two generations of eight are no search.
    poor = initial(*viscous[:2], population=8, generations=1)
    assert error(poor.values["zeta"], 0.05) > 1.0


def test_every_individual_is_one_trajectory(viscous, monkeypatch):
    signal, problem, found = viscous
    batches = []
    original = Trajectories.many

    def counted(self, values):
        batches.append(values["zeta"].shape)
        return original(self, values)

    monkeypatch.setattr(Trajectories, "many", counted)
    again = initial(signal, problem)
    assert batches == [(40,)] * (found.details["generations"] + 1)
    assert again.evaluations == found.evaluations == 40 * len(batches)


def test_the_range_is_the_records_own():
    """From 0 to four times what would make the decay alone, whatever the truth is."""
    for zeta in (0.02, 0.1):
        signal, problem = damped_cosine(zeta)
        seen = checked_features(signal)
        genes = Genes(signal, problem, seen)
        assert genes.low[0] == 0.0
        assert genes.high[0] == pytest.approx(4 * zeta, rel=0.1)
    signal, problem = dry_friction()
    (term,) = oscillator(problem).terms
    assert coefficient_alone(term, checked_features(signal)) == pytest.approx(0.2, rel=0.1)


def test_a_frequency_and_a_midline_become_a_stiffness_and_an_angle():
    signal, problem = pendulum({"zeta": 0.05}, free=("stiffness", "spring_angle"), samples=1000)
    genes = Genes(signal, problem, checked_features(signal))
    assert genes.labels == ["zeta", "frequency", "midline"]
    p = genes.decode(np.full((3, 3), 0.5))
    assert p["stiffness"] == pytest.approx(np.full(3, 20.0), rel=0.01)
    assert p["spring_angle"] == pytest.approx(np.zeros(3), abs=0.005)
    # Negative control: another frequency is another stiffness.
    assert abs(genes.decode(np.array([[0.5, 1.0, 0.5]]))["stiffness"][0] - 20.0) > 1.0


def test_six_unknowns():
    signal, problem = pendulum({"mu_q": 0.05}, free=EVERYTHING, samples=1000)
    found = initial(signal, problem)
    truth = {"mu_q": 0.05, "stiffness": 20.0, "gravity": 1.0, "theta0": 0.3}
    assert set(found.values) == {"mu_q", *EVERYTHING}
    for name, value in truth.items():
        assert error(found.values[name], value) < 1.0


def test_a_long_record_is_thinned_and_a_short_one_is_not(viscous):
    signal, problem, _ = viscous
    genes = Genes(signal, problem, checked_features(signal))
    assert genetic._Fitness(signal, genes, 0.3, 6250).y.size == signal.t.size
    thinned = genetic._Fitness(signal, genes, 0.3, 300)
    assert thinned.y.size == 300
    assert (thinned.y[0], thinned.y[-1]) == (signal.y[0], signal.y[-1])


def test_another_damping_is_no_good_fit():
    signal, problem = pendulum({"mu_c": 0.06}, samples=1000, model=("viscous",))
    refined = run("genetic", signal, problem, stages=["refined"], seed=1)[0]
    assert "the model is incomplete" in refined.outcome
