"""A sampler from outside that says nothing of its draws: they are summarised and judged, in a study and in Python."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

import pytest

import bayesdamp as bd
from bayesdamp.config import load_study
from bayesdamp.pipeline import run_study
from bayesdamp.plugins import read_modules, use
from bayesdamp.store import read_table

OWN = Path(__file__).parent / "quiet_sampler.py"
STUDY = """
version = 1
name = "quiet"
seed = 5
plugins = { modules = ["quiet_sampler.py"] }
system = { restoring = "linear", stiffness = "free", rest_angle = 0.0, theta0 = 0.3, omega0 = 0.0 }
estimators = { use = [] }
models = { compare = ["viscous"] }
posterior = { samplers = ["nuts", "independence", "apart"], noise = "gaussian" }
evidence = { methods = [] }
[[signal]]
name = "rig"
simulate = { viscous = 0.1, stiffness = 20.0, duration = 10.0, samples = 200, noise_sd = 0.003 }
"""
FALSE_ALARM = 4.0
"""Monte Carlo errors by which two samplers' means may differ: once in 16,000 seeds."""


@pytest.fixture(autouse=True)
def _nothing_stays():
    yield
    use(())


def test_in_a_study(tmp_path):
    """The same posterior as NUTS, in units of Monte Carlo error; chains that do not meet are named."""
    shutil.copy(OWN, tmp_path)
    (tmp_path / "s.toml").write_text(STUDY, encoding="utf-8")
    out = tmp_path / "out"
    assert run_study(load_study(tmp_path / "s.toml"), out, workers=1) == 0
    rows = {(r["sampler"], r["parameter"]): r for r in read_table(out / "posteriors.csv")}
    nuts = {name: r for (sampler, name), r in rows.items() if sampler == "nuts"}
    assert {"zeta", "stiffness", "noise_sd"} <= set(nuts)
    for name, theirs in nuts.items():
        own = rows["independence", name]
        assert own["outcome"] == "ok"
        error = math.hypot(*(r["sd"] / math.sqrt(r["ess_bulk"]) for r in (own, theirs)))
        assert abs(own["mean"] - theirs["mean"]) < FALSE_ALARM * error, name
        assert own["unit"] == theirs["unit"]
    assert rows["apart", "zeta"]["outcome"].startswith("not converged: R-hat")


def test_in_python():
    use(read_modules([OWN]))
    signal = bd.simulate({"viscous": 0.1}, "linear", stiffness=20.0, theta0=0.3, duration=10.0, samples=200,
                         noise_sd=0.003, seed=1)  # fmt: skip
    fit = bd.fit(signal, bd.Model("viscous", restoring="linear", noise="gaussian", deviation="none"))
    drawn = bd.sample(fit, sampler="independence")
    assert drawn.outcome == "ok"
    assert drawn.summaries["zeta"]["mean"] == pytest.approx(float(drawn.data.posterior["zeta"].mean()))
    assert drawn.summaries["zeta"]["rhat"] < 1.01
    assert bd.sample(fit, sampler="apart").outcome.startswith("not converged: R-hat")
