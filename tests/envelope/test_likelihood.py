"""Likelihoods of the decay rates of an envelope, and the answer from several records."""

import numpy as np

from bayesdamp.interface.answer import Answer
from bayesdamp.interface.envelopes import analyse, answer_envelope, specimen_of_envelopes
from bayesdamp.physics.amplitude import SUMS
from bayesdamp.priors import odds
from bayesdamp.records.envelope.record import EnvelopeRecord, make_record
from bayesdamp.store.results import AnswerContent
from bayesdamp.verdict.envelope import joint_damping, specimen
from bayesdamp.verdict.specimen import specimen_probabilities
from validation.truth.ringdowns import Ringdown, simulate


def record(seed: int, scatter: float = 0.1) -> EnvelopeRecord:
    ringdown = Ringdown({"viscous": 0.13, "coulomb": 0.005}, scatter=scatter, scatter_time=0.5, behind=15.0)
    truth = simulate(ringdown, np.random.default_rng(seed))
    return make_record(f"r{seed}", truth.t, truth.level, "dBm", 1e6)


def test_several_records_of_one_damping_determine_it_better():
    """Viscous and Coulomb damping in four records.

    Control: in the product of their separate evidences every record has its own coefficients, which makes a sum with a
    further term 100 times less probable than common coefficients do.
    """
    truth = "viscous+coulomb"
    answers = [analyse(record(seed, scatter=0.8)) for seed in (11, 12, 13, 14)]
    joint = joint_damping(answers)
    probability = specimen_probabilities(joint)[0]
    assert next(iter(probability)) == truth
    assert probability[truth] > max(item.verdict.probabilities[truth] for item in answers)
    _, low, high = joint.spread()
    assert low < 0.05 < high
    assert joint_damping(answers[:1]) is None
    further = "viscous+coulomb+quadratic"
    each = [item.verdict.probabilities for item in answers]
    apart = sum(np.log(p[further] / p[truth]) for p in each)
    apart -= 3 * np.log(odds(further.split("+")) / odds(truth.split("+")))
    assert apart < np.log(0.01 * probability[further] / probability[truth])


def test_decay_rates_are_those_of_the_closed_form():
    """Viscous and cubic damping over 60 dB, dA/dt = -A/10 - 2A³/5 (Bernoulli's equation).

    At the amplitude of 0.1 the cubic term has 1/100 of its rate at the start.
    """
    t = np.arange(0.0, 60.0, 0.05)
    a = np.sqrt(0.1 / (0.5 * np.exp(0.2 * t) - 0.4))
    a *= np.exp(0.02 * np.random.default_rng(1).normal(size=t.size))
    likelihoods = analyse(make_record("r", t, a, "rad", 1.0), sums=[("viscous", "cubic")]).likelihoods
    _, slope, information = likelihoods["viscous+cubic"].in_scores(np.log(0.1), 1.0)
    rates, sd = np.linalg.solve(information[0], slope[0]), np.sqrt(np.diag(np.linalg.inv(information[0])))
    assert np.all(np.abs(rates - [0.1, 0.4 * 0.1**2]) < 5 * sd)
    assert np.all(sd < [0.001, 0.0004])


def test_stored_answers_give_the_same_specimen():
    records = [record(seed) for seed in (5, 6)]
    stored = [answer_envelope(item, None, SUMS, 0, repeated=True) for item in records]
    answers = [Answer(AnswerContent.of_meta(item.content.meta()), item.arrays) for item in stored]
    of_stored = specimen_of_envelopes("one", answers)
    assert of_stored.to_dict() == specimen("one", [analyse(item) for item in records]).to_dict()
