"""The noise model of a study's records: chosen once for all damping models, or refused with a reason."""

import numpy as np
import pytest

from bayesdamp.store.files import read_table
from bayesdamp.store.results import ModeContent, Store
from tests.physics.independent import trajectory
from tests.studies import finish_study, study_text

STUDY = study_text(
    'estimators = { use = ["least_squares"] }',
    'models = { compare = ["viscous"] }',
    'posterior = { samplers = ["nuts"], noise = NOISE, draws = 500 }',
    "evidence = { methods = [] }",
    simulate="viscous = 0.05, duration = 10.0, samples = 200, noise_sd = 0.003",
    name="noisy",
)


def test_one_noise_model_is_chosen_and_shown(tmp_path):
    out = finish_study(tmp_path, STUDY.replace("NOISE", '["quantised", "student_t", "gaussian"]'))
    store = Store(out)
    answer = store.read("answer/noisy/0").meta
    assert answer["noise"] == "gaussian"
    assert [noise["name"] for noise in answer["noises"]] == ["student_t", "gaussian"]
    assert read_table(out / "fits.csv")[0]["verdict"] == "fits"
    assert ModeContent.of(store.read("mode/noisy/0/viscous")).shares[0] > 0.99
    assert "noise_dof" not in store.read("mode/noisy/0/viscous").meta["sd"]  # it has the answer's noise model
    assert "The answer uses the noise model" in (out / "report.html").read_text(encoding="utf-8")


def test_a_noise_model_that_does_not_suit_the_record_is_refused(tmp_path):
    out = finish_study(tmp_path, STUDY.replace("NOISE", '"quantised"'))
    (row,) = (r for r in read_table(out / "posteriors.csv") if r["sampler"] != "smc")
    assert "recording step" in row["outcome"]
    assert "The answer uses the noise model" not in (out / "report.html").read_text(encoding="utf-8")


FRICTION = study_text(
    "estimators = { use = [] }",
    'models = { compare = ["coulomb", "viscous+coulomb"] }',
    'posterior = { samplers = [], noise = ["gaussian", "student_t"] }',
    'evidence = { methods = ["laplace"], referee = "never" }',
    system='restoring = "linear", stiffness = "free", rest_angle = 0.0, theta0 = "free", omega0 = "free"',
    name="sharp",
    file="sharp.csv",
    time="t",
    angle="x",
)


def test_the_inferred_width_of_friction_is_used_for_all_candidates(tmp_path):
    """The record is that of a precise encoder; the sign of the friction changes within 0.2 % of the peak velocity."""
    t, peak = np.linspace(0.0, 10.0, 500), 0.5 * np.sqrt(20.0)
    p = {"zeta": 0.02, "mu_c": 0.3, "epsilon": 0.002 * peak, "stiffness": 20.0}
    x = trajectory("linear", {**p, "rest_angle": 0.0, "theta0": 0.5, "omega0": 0.0}, t)[:, 0]
    x += 3e-4 * np.random.default_rng(1).standard_normal(t.size)
    np.savetxt(tmp_path / "sharp.csv", np.column_stack([t, x]), delimiter=",", header="t,x", comments="")
    out = finish_study(tmp_path, FRICTION)
    width = Store(out).read("answer/sharp/0").meta["epsilon"]
    assert width == pytest.approx(0.002 * peak, rel=1.6)
    for model in ("coulomb", "viscous+coulomb"):
        assert Store(out).read(f"mode/sharp/0/{model}").meta["known"]["epsilon"] == width
    mode = Store(out).read("mode/sharp/0/viscous+coulomb").meta
    assert mode["values"]["mu_c"] == pytest.approx(0.3, abs=0.003)
    assert mode["verdict"] == "fits"
    assert "The damping models are compared with ε = " in (out / "report.html").read_text(encoding="utf-8")
