"""A whole study from its file: tables, determinism, resume, refusals, and what the user is told."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bayesdamp.config import load_study
from bayesdamp.pipeline.candidates.candidate import StudyCandidate
from bayesdamp.pipeline.candidates.posteriors import weighted_curves
from bayesdamp.pipeline.jobs import task_names
from bayesdamp.pipeline.run import run_study
from bayesdamp.store import Store, read_table
from tests.studies import COMPARED, WEIGHED, signal_text, study_text, tables_of, write_study

SIMULATE = "viscous = 0.05, duration = 10.0, samples = 400, noise_sd ="
SMALL = study_text(
    'estimators = { use = ["least_squares"] }',
    COMPARED,
    "posterior = { warmup = 200, draws = 500 }",
    simulate=f"{SIMULATE} 0.003",
    name="noisy",
)
BOTH = SMALL + signal_text("clean", f"{SIMULATE} 0.0")


QUICK = BOTH.replace("posterior = { warmup = 200, draws = 500 }", WEIGHED)


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """The small study, run once in this process. Not to be changed by a test."""
    folder = tmp_path_factory.mktemp("study")
    status = run_study(write_study(folder, BOTH), folder / "out", workers=1)
    assert status == 0
    return folder / "out"


def test_truth_is_inside_and_the_right_model_first(run):
    rows = [
        r for r in read_table(run / "posteriors.csv") if r["signal"] == "noisy" and r["model"] == "viscous"
    ]
    zeta = {r["sampler"]: r for r in rows if r["parameter"] == "zeta"}
    assert set(zeta) == {"nuts", "emcee", "smc"}
    smc = zeta.pop("smc")
    assert abs(smc["mean"] - 0.05) < 4 * smc["sd"]
    for row in zeta.values():
        # four posterior sds: a false alarm once in 16,000 seeds
        assert abs(row["mean"] - 0.05) < 4 * row["sd"]
        assert row["outcome"] == "ok"
        assert row["rhat"] <= 1.01
    # negative control: the wrong damping is behind by hundreds of nats and does not fit
    rows = [r for r in read_table(run / "evidence.csv") if r["signal"] == "noisy" and r["method"] != "smc"]
    evidence = {r["model"]: r for r in rows}
    assert evidence["viscous"]["probability"] > 0.99
    assert evidence["quadratic"]["log_bayes_factor"] < -20
    fits = {r["model"]: r for r in read_table(run / "fits.csv") if r["signal"] == "noisy"}
    assert fits["viscous"]["verdict"] == "fits"
    assert fits["quadratic"]["verdict"].startswith("does not fit")


def test_weighted_draws_give_the_curves_that_sampling_gives(run, tmp_path):
    """Of a candidate that was not sampled its evidence has the draws. Medians of a thousand draws and of more, and the
    widths of their bands: four standard errors are 0.2 sds and 12 %. Negative control: weights of another posterior."""
    study = load_study(run.parent / "study.toml")
    spec = next(s for s in study.signals if s.name == "noisy")
    sampled = Store(run).read("posterior/noisy/0/viscous/nuts").arrays["spread/equivalent_ratio"]
    sd = sampled.std(axis=0)

    def apart(store: Store) -> tuple[float, float]:
        candidate = StudyCandidate(study, spec, 0, "viscous", store)
        found = weighted_curves(candidate, 5)["spread/equivalent_ratio"]
        shift = np.max(np.abs(np.median(found, axis=0) - np.median(sampled, axis=0)) / sd)
        return float(shift), float(np.max(np.abs(found.std(axis=0) / sd - 1)))

    shift, wider = apart(Store(run))
    assert shift < 0.2
    assert wider < 0.12
    shutil.copytree(run, tmp_path / "out")
    other = Store(tmp_path / "out")
    cell = other.read("evidence/noisy/0/viscous/importance")
    zeta = cell.arrays["y"][:, 0]
    tilted = cell.arrays["log_weights"] + 2.0 * (zeta - zeta.mean()) / zeta.std()
    other.write(replace(cell, arrays={**cell.arrays, "log_weights": tilted}))
    assert apart(other)[0] > 1.0
    other.write(replace(cell, outcome="not to be trusted"))
    assert weighted_curves(StudyCandidate(study, spec, 0, "viscous", other), 5) == {}


def test_a_record_without_noise_has_no_posterior_and_is_no_failure(run):
    rows = [r for r in read_table(run / "posteriors.csv") if r["signal"] == "clean"]
    assert rows
    assert all(r["outcome"].startswith("not applicable") for r in rows)
    at = {"signal": "clean", "model": "viscous", "parameter": "zeta", "stage": "refined"}
    errors = [r["error_pct"] for r in read_table(run / "estimates.csv") if at.items() <= r.items()]
    assert 0 < len(errors) == sum(e < 1e-4 for e in errors)


def test_cells_are_listed_without_running(run, tmp_path):
    listed = set(task_names(write_study(tmp_path, BOTH)))
    assert listed == set(Store(run).names())
    assert not (tmp_path / "cells").exists()


def test_same_seed_same_tables_also_after_losing_some_cells(run, tmp_path):
    """A run in another folder, its store seeded with half of the cells, ends with the same tables."""
    out = tmp_path / "out"
    shutil.copytree(run, out)
    gone = ("mode/noisy/0/viscous", "posterior/noisy/0/viscous/emcee")
    lost = [n for n in Store(out).names() if n.startswith(gone)]
    kept = (out / "cells" / "signal" / "noisy" / "0.npz").stat().st_mtime_ns
    for name in lost:
        (out / "cells" / f"{name}.npz").unlink()
    cut = out / "cells" / "evidence" / "noisy" / "0" / "viscous" / "importance.npz"
    cut.write_bytes(cut.read_bytes()[:100])
    run_study(write_study(tmp_path, BOTH), out, workers=1)
    assert (out / "cells" / "signal" / "noisy" / "0.npz").stat().st_mtime_ns == kept
    assert tables_of(out) == tables_of(run)


def test_a_simulated_record_without_an_oscillation_is_refused_and_the_rest_goes_on(tmp_path):
    text = QUICK.replace(signal_text("clean", f"{SIMULATE} 0.0"), "").replace(
        '"viscous", "quadratic"', '"viscous"'
    )
    text = text.replace("samplers = []", 'samplers = ["laplace"]')
    text += signal_text("short", f"{SIMULATE} 0.003".replace("10.0", "0.3"))
    assert run_study(write_study(tmp_path, text), tmp_path / "out", workers=1) == 0
    for table in ("estimates.csv", "posteriors.csv", "evidence.csv"):
        rows = read_table(tmp_path / "out" / table)
        refused = [r for r in rows if r["signal"] == "short"]
        assert refused
        assert all("no oscillation" in str(r["outcome"]) for r in refused), table
        # negative control: the other record has its rows, with numbers
        assert any(r["signal"] == "noisy" and r["outcome"] == "ok" for r in rows), table
    assert "short" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    about = json.loads((tmp_path / "out" / "run.json").read_text())["signals"]
    assert "no oscillation" in about["short"]["outcome"]
    assert about["noisy"]["outcome"] == "ok"
    # The bound is a simulated record's, whether it shows an oscillation or not.
    assert about["short"]["bound"]["zeta"] > about["noisy"]["bound"]["zeta"] > 0


IMPORTS = """
import sys
from pathlib import Path
from bayesdamp.config import load_study
from bayesdamp.pipeline.run import run_study
assert run_study(load_study(sys.argv[1]), Path(sys.argv[2]), workers=1) == 0
print(sorted({name.partition(".")[0] for name in sys.modules} & {"torch", "pysindy", "pyoperon", "gudhi", "optax"}))
"""


def test_a_study_imports_what_its_methods_need_and_no_more(tmp_path):
    text = QUICK.replace('"least_squares"', '"least_squares", "sindy"').replace("['laplace']", "[]")
    write_study(tmp_path, text)
    command = [sys.executable, "-c", IMPORTS, str(tmp_path / "study.toml"), str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "['pysindy']"
