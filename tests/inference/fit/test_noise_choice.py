"""The choice of the noise model of a record."""

import numpy as np
import pytest

from bayesdamp.inference.deviation.candidate import MotionCandidate
from bayesdamp.inference.deviation.data import prepare_data
from bayesdamp.inference.deviation.model_comparison import compare_candidates
from bayesdamp.inference.noise import NOISES
from bayesdamp.physics.oscillator import Oscillator, simulate
from bayesdamp.records.cleaning.clean import recording_step
from bayesdamp.types import Signal

TIMES = np.linspace(0.0, 10.0, 301)
KNOWN = {"stiffness": 20.0, "rest_angle": 0.0}
SD = 0.004


@pytest.mark.parametrize("kind", NOISES.names())
def test_the_true_noise_is_the_most_probable(kind):
    """By more than 5 nats (odds of 150), except for normal noise: Student's t with many degrees of freedom and noise
    with a short correlation contain it, and are behind only by their further parameter. Only a record with a recording
    step is compared with quantised noise."""
    p = {**KNOWN, "epsilon": 0.02, "zeta": 0.05, "mu_q": 0.2, "theta0": 0.3, "omega0": 0.0}
    osc = Oscillator(("viscous", "quadratic"), "linear")
    values = {"noise_sd": SD, "noise_dof": 2.5, "noise_time": 0.1}
    model = NOISES.get("gaussian" if kind == "quantised" else kind)
    y = simulate(osc, p, TIMES) + model.draw(np.random.default_rng(21), np.diff(TIMES), values)
    if kind == "quantised":
        y = 5 * SD * np.round(y / (5 * SD))
    data = prepare_data(Signal(TIMES, y, step=recording_step(y)))
    candidates = [MotionCandidate(osc.damping, "linear")]
    noise = compare_candidates(data, candidates, known=KNOWN, approximate=False, noises=NOISES.names()).noise
    assert noise.likeliest == kind
    by_name = {item.name: item.log_evidence for item in noise.weighed}
    others = [log for name, log in by_name.items() if name != kind]
    assert by_name[kind] > max(others) + (0.0 if kind == "gaussian" else 5.0)
    assert ("quantised" in by_name) == (kind == "quantised")
