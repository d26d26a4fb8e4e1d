"""The noise of a study's records: chosen once for all dampings, or refused in a sentence."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bayesdamp.config import load_study
from bayesdamp.pipeline import cells, run_study
from bayesdamp.store import Store, read_table
from bayesdamp.store.contents import ModeContent
from bayesdamp.types import Seed
from tests.interface.problems import not_refused

STUDY = """
version = 1
name = "noises"
seed = 5
system = {{ restoring = "linear", stiffness = 20.0, rest_angle = 0.0, theta0 = 0.3, omega0 = 0.0 }}
estimators = {{ use = ["least_squares"] }}
models = {{ compare = ["viscous"] }}
posterior = {{ samplers = ["laplace"], noise = {noise}, draws = 500 }}
evidence = {{ methods = [] }}
[[signal]]
name = "noisy"
simulate = {{ viscous = 0.05, duration = 10.0, samples = 200, noise_sd = 0.003 }}
"""


def study(folder, noise):
    file = folder / "noises.toml"
    file.write_text(STUDY.format(noise=noise), encoding="utf-8")
    return load_study(file)


def test_one_noise_is_chosen_and_shown(tmp_path):
    made = study(tmp_path, '["quantised", "student_t", "gaussian"]')
    assert "answer/noisy/0" in cells(made)
    assert run_study(made, tmp_path / "out", workers=1) == 0
    store = Store(tmp_path / "out")
    found = store.read("answer/noisy/0")
    assert found.meta["noise"] == "gaussian"
    assert [one["name"] for one in found.meta["noises"]] == ["student_t", "gaussian"]
    assert read_table(tmp_path / "out" / "fits.csv")[0]["verdict"] == "fits"
    searches = ModeContent.of(store.read("mode/noisy/0/viscous")).climbs
    assert [c.seed for c in searches] == [
        Seed("frequency and decay"),
        Seed("least_squares", "initial"),
        Seed("least_squares", "refined"),
        Seed("prior 1", drawn=True),
        Seed("prior 2", drawn=True),
    ]
    assert all(c.mode == 0 for c in searches[:3])
    report = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert 'id="noise"' in report
    assert "The answer uses the noise model" in report
    assert 'id="seeds"' in report


def test_a_noise_that_is_none_for_the_record_is_refused(tmp_path):
    made = study(tmp_path, '"quantised"')
    assert run_study(made, tmp_path / "out", workers=1) == 0
    (row,) = (r for r in read_table(tmp_path / "out" / "posteriors.csv") if r["sampler"] != "smc")
    assert "recording step" in row["outcome"]
    report = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "The answer uses the noise model" not in report, "there was no choice"
    assert 'id="noise"' not in report


def test_wrong_noise_is_told(tmp_path):
    """Negative control: one word for all of them."""
    wrong = {'"pink"': "pink", '["gaussian", "gaussian"]': "gaussian", "3": "a noise model's name in quotes"}
    cases = ((partial(study, tmp_path, noise), f"posterior.noise.*{said}") for noise, said in wrong.items())
    assert not_refused(cases) == []
    assert study(tmp_path, '"auto"').noises == ("correlated", "gaussian", "quantised", "student_t")


FRICTION = """
version = 1
name = "friction"
seed = 5
estimators = {{ use = [] }}
models = {{ compare = ["coulomb", "viscous+coulomb"] }}
posterior = {{ samplers = [], noise = ["gaussian", "student_t"] }}
evidence = {{ methods = ["laplace"], referee = "never" }}
[system]
restoring = "linear"
stiffness = "free"
rest_angle = 0.0
theta0 = "free"
omega0 = "free"
{given}
[[signal]]
name = "sharp"
file = "sharp.csv"
time = "t"
angle = "x"
"""


@pytest.fixture(scope="module")
def sharp(tmp_path_factory):
    """A folder with a record of a precise encoder: friction that turns over within 0.2 % of the peak velocity."""
    folder = tmp_path_factory.mktemp("sharp")
    t, peak = np.linspace(0.0, 10.0, 500), 0.5 * np.sqrt(20.0)
    x = solve_ivp(
        lambda _, s: [s[1], -20.0 * s[0] - 0.04 * s[1] - 0.3 * np.tanh(s[1] / (0.002 * peak))],
        (0, t[-1]), [0.5, 0.0], "LSODA", t, rtol=1e-9, atol=1e-11,
    ).y[0]  # fmt: skip
    x += 3e-4 * np.random.default_rng(1).standard_normal(t.size)
    rows = np.column_stack([t, x])
    np.savetxt(folder / "sharp.csv", rows, delimiter=",", header="t,x", comments="")
    return folder


def friction(folder, given):
    file = folder / f"friction{len(given)}.toml"
    file.write_text(FRICTION.format(given=given), encoding="utf-8")
    out = folder / f"out{len(given)}"
    assert run_study(load_study(file), out, workers=1) == 0
    store = Store(out)
    return store.read("answer/sharp/0").meta, store.read("mode/sharp/0/viscous+coulomb").meta, out


def test_friction_that_nobody_gave_is_the_answers(sharp):
    """For all candidates of the record, and shown."""
    chosen, mode, out = friction(sharp, "")
    assert chosen["epsilon"] == pytest.approx(0.002 * 0.5 * np.sqrt(20.0), rel=1.6)
    assert mode["known"]["epsilon"] == chosen["epsilon"]
    assert Store(out).read("mode/sharp/0/coulomb").meta["known"]["epsilon"] == chosen["epsilon"]
    assert mode["values"]["mu_c"] == pytest.approx(0.3, abs=0.003)
    assert mode["verdict"] == "fits"
    report = (out / "report.html").read_text(encoding="utf-8")
    assert ">ε / (" in report


def test_friction_that_was_given_stays(sharp):
    """The negative control of the other: with twenty times the true ε the record does not fit."""
    given = 0.04 * 0.5 * np.sqrt(20.0)
    chosen, mode, out = friction(sharp, f"epsilon = {given:.6f}")
    assert chosen["epsilon"] is None
    assert list(chosen["frictions"]) == []
    assert mode["known"]["epsilon"] == pytest.approx(given, rel=1e-5)
    assert mode["verdict"] != "fits"
    report = (out / "report.html").read_text(encoding="utf-8")
    assert ">ε / (" not in report
