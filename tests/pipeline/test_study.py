"""A whole study from its file: tables, the same results again, resumed runs, refusals."""

import json
import math
import shutil
from pathlib import Path
from typing import Any

import pytest
import xarray as xr

from bayesdamp.pipeline.jobs import task_names
from bayesdamp.store.files import read_table
from bayesdamp.store.results import Store
from tests.studies import (
    COMPARED,
    SYSTEM,
    WEIGHED,
    finish_study,
    signal_text,
    study_text,
    tables_of,
    write_study,
)

SIMULATE = "viscous = 0.05, duration = 10.0, samples = 400, noise_sd ="
SMALL = study_text(
    'estimators = { use = ["least_squares"] }',
    COMPARED,
    "posterior = { warmup = 200, draws = 500 }",
    simulate=f"{SIMULATE} 0.003",
    name="noisy",
    system=f"{SYSTEM}, inertia = 0.7",
)
BOTH = SMALL + signal_text("clean", f"{SIMULATE} 0.0")
QUICK = SMALL.replace("posterior = { warmup = 200, draws = 500 }", WEIGHED)


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    """Run the small study once in this process; tests must not change its folder."""
    return finish_study(tmp_path_factory.mktemp("study"), BOTH)


def rows_of(run: Path, table: str, **keys: str) -> list[dict[str, Any]]:
    """Return the rows of a table that have these values."""
    return [row for row in read_table(run / table) if keys.items() <= row.items()]


def test_posteriors_contain_the_truth_and_the_right_model_is_first(run):
    """Within four posterior sds: one false alarm in 16,000 seeds. Control: the wrong damping is far behind and does not
    fit."""
    rows = rows_of(run, "posteriors.csv", signal="noisy", model="viscous", parameter="zeta")
    assert {r["sampler"] for r in rows} == {"nuts", "emcee", "smc"}
    for row in rows:
        assert abs(row["mean"] - 0.05) < 4 * row["sd"]
        assert row["sampler"] == "smc" or (row["outcome"] == "ok" and row["rhat"] <= 1.01)
    rows = [r for r in rows_of(run, "evidence.csv", signal="noisy") if r["method"] != "smc"]
    evidence = {r["model"]: r for r in rows}
    assert evidence["viscous"]["probability"] > 0.99
    behind = evidence["quadratic"]["log_evidence"] - evidence["viscous"]["log_evidence"]
    assert -20 > evidence["quadratic"]["log_bayes_factor"] == pytest.approx(behind)
    fits = {r["model"]: r for r in rows_of(run, "fits.csv", signal="noisy")}
    assert fits["viscous"]["verdict"] == "fits"
    assert fits["viscous"]["rms"] == pytest.approx(Store(run).read("mode/noisy/0/viscous").meta["rms"])
    assert fits["quadratic"]["verdict"].startswith("does not fit")
    estimated = rows_of(run, "estimates.csv", signal="noisy", model="viscous", parameter="zeta")
    assert all(r["error_pct"] == pytest.approx(2000 * abs(r["value"] - 0.05)) for r in estimated)


def test_a_posterior_has_derived_quantities(run):
    rows = rows_of(run, "posteriors.csv", signal="noisy", model="viscous", sampler="nuts")
    parameters = {r["parameter"]: r for r in rows}
    zeta, coefficient = parameters["zeta"], parameters["viscous_coefficient"]
    assert zeta["q2.5"] == pytest.approx(zeta["mean"] - 1.96 * zeta["sd"], abs=0.4 * zeta["sd"])
    assert zeta["q97.5"] == pytest.approx(zeta["mean"] + 1.96 * zeta["sd"], abs=0.4 * zeta["sd"])
    assert zeta["divergences"] == 0
    assert abs(parameters["half_life"]["median"] - math.log(2) / zeta["median"]) < 1e-6
    assert abs(coefficient["mean"] - 1.4 * zeta["mean"]) < 1e-12
    assert (coefficient["unit"], parameters["energy_lost"]["unit"]) == ("N m s", "J")
    with xr.open_datatree(run / "posterior" / "noisy.0.viscous.nuts.nc", engine="h5netcdf") as tree:
        promised = {"posterior", "prior", "posterior_predictive", "log_likelihood", "observed_data"}
        assert promised <= set(tree.children)
        assert tree["posterior"]["zeta"].mean() == pytest.approx(zeta["mean"])
        assert tree["posterior"]["zeta"].attrs["units"] == "1/s"


def test_draws_have_the_damping_ratios_of_the_answer(run):
    """At the answer's amplitudes, within half a standard deviation. Control: quadratic damping has other ratios."""
    store = Store(run)
    answer = store.read("answer/noisy/0").meta["verdict"]["damping_ratio"]
    for model, agrees in (("viscous", True), ("quadratic", False)):
        ratios = store.read(f"posterior/noisy/0/{model}/nuts").meta["ratios"]
        assert [r["amplitude"] for r in ratios] == [r["amplitude"] for r in answer]
        pairs = zip(ratios, answer, strict=True)
        shifts = [abs(own["value"] - r["value"]) / (r["high"] - r["low"]) for own, r in pairs]
        assert (max(shifts) < 0.5 / 3.92) == agrees


def test_a_record_without_noise_has_estimates_but_no_posterior(run):
    rows = rows_of(run, "posteriors.csv", signal="clean")
    assert rows
    assert all(r["outcome"].startswith("not applicable") for r in rows)
    refined = {"signal": "clean", "model": "viscous", "parameter": "zeta", "stage": "refined"}
    errors = [r["error_pct"] for r in rows_of(run, "estimates.csv", **refined)]
    assert 0 < len(errors) == sum(e < 1e-4 for e in errors)


def test_the_tasks_of_a_study_are_those_of_its_run(run, tmp_path):
    assert set(task_names(write_study(tmp_path, BOTH))) == set(Store(run).names())


def test_a_run_without_some_results_ends_with_the_same_tables(run, tmp_path):
    """Some results are missing and one is damaged; another is not computed again."""
    out = tmp_path / "out"
    shutil.copytree(run, out)
    missing = ("mode/noisy/0/viscous", "posterior/noisy/0/viscous/emcee")
    for name in [n for n in Store(out).names() if n.startswith(missing)]:
        (out / "cells" / f"{name}.npz").unlink()
    record = out / "cells" / "signal" / "noisy" / "0.npz"
    stamp = record.stat().st_mtime_ns
    damaged = out / "cells" / "evidence" / "noisy" / "0" / "viscous" / "importance.npz"
    damaged.write_bytes(damaged.read_bytes()[:100])
    finish_study(tmp_path, BOTH)
    assert record.stat().st_mtime_ns == stamp
    assert tables_of(out) == tables_of(run)


def test_a_simulated_record_without_an_oscillation_is_refused_and_the_others_are_computed(tmp_path):
    """Control: the other record has rows with numbers."""
    text = QUICK.replace('"viscous", "quadratic"', '"viscous"')
    text = text.replace("samplers = []", 'samplers = ["nuts"]')
    text += signal_text("short", f"{SIMULATE} 0.003".replace("10.0", "0.3"))
    out = finish_study(tmp_path, text)
    for table in ("estimates.csv", "posteriors.csv", "evidence.csv"):
        outcomes = [str(r["outcome"]) for r in rows_of(out, table, signal="short")]
        assert outcomes
        assert all("no oscillation" in outcome for outcome in outcomes), table
        assert rows_of(out, table, signal="noisy", outcome="ok"), table
    assert "short" in (out / "report.html").read_text(encoding="utf-8")
    signals = json.loads((out / "run.json").read_text())["signals"]
    assert "no oscillation" in signals["short"]["outcome"]
    assert signals["noisy"]["outcome"] == "ok"
    # Every simulated record has a bound, whether it shows an oscillation or not.
    assert signals["short"]["bound"]["zeta"] > signals["noisy"]["bound"]["zeta"] > 0
