"""Simulated records: noise, outliers, gaps and rounding; and they do not contain the true parameters."""

import json

import numpy as np
import pytest

from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.records.simulate import simulate_signal
from bayesdamp.types import InputError

OSC = Oscillator(("viscous",), "linear")
P = {"zeta": 0.0537, "stiffness": 20.731, "rest_angle": 0.1, "theta0": 0.4, "omega0": 0.0}


def simulated(seed=0, **options):
    settings = {"duration": 10.0, "samples": 2001, "name": "x", "rng": np.random.default_rng(seed), **options}
    return simulate_signal(OSC, P, **settings)


def test_a_simulated_record_does_not_contain_its_truth():
    text = json.dumps(simulated(noise_sd=0.0123).provenance.to_dict())
    for number in ("0.0537", "20.731", "0.0123"):
        assert number not in text


def test_noise_has_its_standard_deviation_and_correlation():
    """Within five standard errors: false alarm below one in a million."""
    still = simulated(samples=20001).y
    white = simulated(noise_sd=0.1, samples=20001).y - still
    assert white.std() == pytest.approx(0.1, abs=5 * 0.1 / np.sqrt(40000))
    assert abs(np.corrcoef(white[1:], white[:-1])[0, 1]) < 5 / np.sqrt(20000)
    slow = simulated(noise_sd=0.1, noise="correlated", noise_time=0.01, samples=20001).y - still
    rho = np.exp(-0.0005 / 0.01)
    assert np.corrcoef(slow[1:], slow[:-1])[0, 1] == pytest.approx(rho, abs=5 * np.sqrt((1 - rho**2) / 20000))
    heavy = simulated(noise_sd=0.1, noise="student_t", noise_dof=3.0, samples=20001).y - still
    assert np.median(np.abs(heavy)) == pytest.approx(0.1 * 0.7649, rel=0.05)


def test_outliers_gaps_and_rounding_are_as_requested():
    still = simulated().y
    assert np.sum(simulated(outliers=7).y != still) == 7
    assert np.sum(simulated(outliers=0.01).y != still) == 20
    t = simulated(gaps=2).t
    assert (t.size, t[-1], np.sum(np.diff(t) > 0.006)) == (2001 - 2 * 40, 10.0, 2)
    rounded = simulated(quantum=0.01)
    np.testing.assert_allclose(np.round(rounded.y / 0.01), rounded.y / 0.01, atol=1e-9)
    assert rounded.step == 0.01


@pytest.mark.parametrize(
    ("options", "message"), [({"noise": "pink"}, "unknown noise 'pink'"), ({"gaps": 30}, "gaps")]
)
def test_an_impossible_option_is_refused(options, message):
    """The study file refuses all other wrong options."""
    with pytest.raises(InputError, match=message):
        simulated(**options)
