"""A sampler from outside that says nothing of its draws: they are summarised and judged, in a study and in Python."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

from bayesdamp.pipeline.run import run_study
from bayesdamp.store import read_table
from tests.studies import SYSTEM, study_text, write_study

OWN = Path(__file__).parent / "quiet_sampler.py"
STUDY = study_text(
    'plugins = { modules = ["quiet_sampler.py"] }',
    "estimators = { use = [] }",
    'models = { compare = ["viscous"] }',
    'posterior = { samplers = ["nuts", "independence", "apart"], noise = "gaussian" }',
    "evidence = { methods = [] }",
    simulate="viscous = 0.1, stiffness = 20.0, duration = 10.0, samples = 200, noise_sd = 0.003",
    system=SYSTEM.replace("20.0", '"free"'),
)
FALSE_ALARM = 4.0
"""Monte Carlo errors by which two samplers' means may differ: once in 16,000 seeds."""


def test_in_a_study(tmp_path):
    """The same posterior as NUTS, in units of Monte Carlo error; chains that do not meet are named."""
    shutil.copy(OWN, tmp_path)
    out = tmp_path / "out"
    assert run_study(write_study(tmp_path, STUDY), out, workers=1) == 0
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
