"""Decays of an amplitude by tables of dissipation, against closed forms and an independent integrator."""

from __future__ import annotations

import numpy as np
import pytest

from bayesdamp.inference.envelope.sums import Sum
from bayesdamp.physics.amplitude import SUMS, DecayLaw, Scale, TabulatedLaw, decay, rates_per_unit
from bayesdamp.physics.damping import TERMS
from tests.physics.amplitude.test_laws import RATES, T, integrated


def tabled(*terms: str, scores: tuple[float, ...] = ()) -> TabulatedLaw:
    """Return the decay law by tables, also for terms that have a closed form."""
    item = Sum(terms, 0.5, -3.0, Scale())
    vars(item)["each"] = tuple(map(TERMS.get, terms))
    law = item.law(scores)
    assert isinstance(law, TabulatedLaw)
    return law


@pytest.mark.parametrize("terms", [SUMS[1], SUMS[-1]], ids="+".join)
def test_decays_by_tables_agree_with_closed_forms(terms):
    """Within the error of the interpolation. Control: a rate that is larger by 1e-5."""
    rates = np.array([RATES[term] for term in terms])
    truth = pytest.approx(decay(T, 0.3, terms, rates), abs=1e-7)
    assert tabled(*terms).decay(T, 0.3, rates) == truth
    assert tabled(*terms).decay(T, 0.3, rates * (1 + 1e-5)) != truth


@pytest.mark.parametrize(
    ("terms", "scores", "rates"),
    [
        (("viscous", "power"), (0.6,), [0.2, 0.3]),
        (("stribeck",), (0.4, -0.3), [0.2]),
    ],
)
def test_decays_by_tables_solve_their_equation(terms, scores, rates):
    """Control: slopes of rates that are larger by 1 %."""
    law = tabled(*terms, scores=scores)
    rates = np.array(rates)
    truth = integrated(lambda t, x: law.rate(x, rates), 0.3)
    x = law.decay(T, 0.3, rates)
    assert x == pytest.approx(truth, abs=1e-6)
    differences = DecayLaw.slopes(law, T, x, 0.3, rates, 1e-4)
    assert law.slopes(T, x, 0.3, rates, 1e-4) == pytest.approx(differences, abs=1e-4)
    assert law.slopes(T, x, 0.3, 1.01 * rates, 1e-4) != pytest.approx(differences, abs=1e-4)


def test_decay_rates_of_terms_are_those_of_the_documentation():
    """f(A) in dA/dt = -A f(A), from the table in docs/laws.md, at 0.2 rad and 7 rad/s."""
    a, omega, scale = 0.2, 7.0, Scale(0.2, 7.0)
    known = {
        "cubic": 3 / 8 * omega**2 * a**2,
        "displacement": a**2 / 8,
        "structural": 1 / (np.pi * omega),
        "coulomb": 2 / (np.pi * omega * a),
    }
    for name, truth in known.items():
        assert rates_per_unit(TERMS.get(name), np.zeros(1), {}, scale) == pytest.approx(truth, rel=1e-6), name
