"""A sampler plug-in that returns only draws: the study summarises and judges them."""

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
    'posterior = { samplers = ["laplace", "independent", "apart"], noise = "gaussian" }',
    "evidence = { methods = [] }",
    simulate="viscous = 0.1, stiffness = 20.0, duration = 10.0, samples = 200, noise_sd = 0.003",
    system=SYSTEM.replace("20.0", '"free"'),
)


def test_draws_of_a_plug_in_are_summarised_and_judged(tmp_path):
    """Means agree with those of the sampler "laplace" within four Monte Carlo errors: one false alarm in 16,000 seeds.
    Control: a sampler whose chains do not agree."""
    shutil.copy(OWN, tmp_path)
    out = tmp_path / "out"
    assert run_study(write_study(tmp_path, STUDY), out, workers=1) == 0
    rows = {(r["sampler"], r["parameter"]): r for r in read_table(out / "posteriors.csv")}
    expected = {name: r for (sampler, name), r in rows.items() if sampler == "laplace"}
    assert {"zeta", "stiffness", "noise_sd"} <= set(expected)
    for name, row in expected.items():
        own = rows["independent", name]
        assert (own["outcome"], own["unit"]) == ("ok", row["unit"])
        error = math.hypot(*(r["sd"] / math.sqrt(r["ess_bulk"]) for r in (own, row)))
        assert abs(own["mean"] - row["mean"]) < 4 * error, name
    assert rows["apart", "zeta"]["outcome"].startswith("not converged: R-hat")
