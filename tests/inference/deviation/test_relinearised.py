"""The mode of parameters and deviations on a record that determines only a combination of the parameters."""

import numpy as np
import pytest

import bayesdamp as bd
import bayesdamp.inference.deviation.candidate as candidates
from bayesdamp.inference.deviation.quick import compare_signal
from bayesdamp.inference.model.target import Scores
from bayesdamp.physics.oscillator import Oscillator, simulate
from validation.measured.run import DATA

RECORD = DATA / "spring_disc" / "molla_durissima_discopieno_14.91945_0.2016_3.csv"


def remaining_squares(law: str) -> float:
    """Return the sum of squares at the mode, for viscous and quadratic damping under a law.

    The record is of a disc on a spring. Its small swings, read as an angle, determine only a combination of a
    pendulum's spring and gravity.
    """
    comparison = compare_signal(bd.read(RECORD).signal(), damping=["viscous+quadratic"], restoring=[law])
    (result,) = comparison.results
    return float(np.sum((comparison.data.y - result.linearisation.motion.y) ** 2))


@pytest.mark.skipif(not RECORD.is_file(), reason="needs the measured records of ../shared/data")
def test_a_law_with_indeterminate_parameters_fits_as_well_as_a_simple_law(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Control: with straight steps in scores, halved where they fail, the search stops early."""
    plain = remaining_squares("linear")
    assert remaining_squares("horizontal_pendulum") == pytest.approx(plain, rel=0.02)
    monkeypatch.setattr(Scores, "retract", lambda self, law, z, new: new)
    assert remaining_squares("horizontal_pendulum") > 1.5 * plain


def test_deviations_of_the_frequency_make_up_for_a_wrong_law(monkeypatch: pytest.MonkeyPatch) -> None:
    """Under the linear law, h follows the frequency of a pendulum that swings by ± 1 rad, up to the noise.

    Control: with full Gauss–Newton steps only, the search stops far from the mode.
    """
    frequency, noise, t = 4.47, 0.005, np.linspace(0.0, 56.2, 1200)
    p = {
        "zeta": np.log(8) / t[-1],
        "stiffness": frequency**2,
        "rest_angle": 0.0,
        "theta0": 1.0,
        "omega0": 0.0,
    }
    y = simulate(Oscillator(("viscous",), "pendulum"), p, t)
    record = bd.Signal(t, y + noise * np.random.default_rng(0).standard_normal(t.size))

    def squares() -> float:
        (result,) = compare_signal(record, damping=["viscous"], restoring=["linear"]).results
        return result.linearisation.squares / noise**2

    assert squares() == pytest.approx(t.size, rel=0.1)
    monkeypatch.setattr(candidates, "SHARES", (1.0,))
    assert squares() > 10 * t.size
