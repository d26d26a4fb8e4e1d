"""A study that is run from Python: typed results and tables."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bayesdamp as bd
from bayesdamp.store.files import read_table
from bayesdamp.store.results import Store, TaskResult
from tests.interface.problems import not_refused

STUDY: dict[str, Any] = {
    "version": 1,
    "name": "small",
    "system": {"restoring": "linear", "stiffness": 20.0, "rest_angle": 0.0, "theta0": 0.3, "omega0": 0.0},
    "signal": [
        {"name": "bench", "simulate": {"viscous": 0.05, "duration": 6.0, "samples": 150, "noise_sd": 0.003}}
    ],
    "estimators": {"use": ("koopman",)},
    "models": {"compare": ["viscous", "quadratic"]},
    "posterior": {"samplers": ["nuts"], "warmup": 100, "draws": 200},
    "evidence": {"methods": ["importance"]},
}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> bd.Run:
    return bd.run_study(STUDY, tmp_path_factory.mktemp("run") / "small")


def test_tables_are_the_files(run: bd.Run) -> None:
    assert run.outcome == "ok"
    assert run.report.is_file()
    for name in ("estimates", "posteriors", "evidence", "fits"):
        table, rows = getattr(run, name), read_table(run.folder / f"{name}.csv")
        assert len(table) == len(rows) > 0
        assert list(table.columns) == list(rows[0])


def test_typed_results_are_the_tables(run: bd.Run) -> None:
    candidate = run.candidate("bench", "viscous")
    assert (candidate.restoring, candidate.repeat, candidate.outcome) == ("linear", 0, "ok")
    row = run.posteriors.query("sampler == 'nuts' and model == 'viscous' and parameter == 'zeta'")
    post = candidate.posteriors["nuts"]
    assert post.draws[..., post.names.index("zeta")].mean() == pytest.approx(row["mean"].item())
    assert post.log_likelihood.shape == post.draws.shape[:2]
    assert np.all(np.isfinite(post.log_likelihood))
    row = run.evidence.query("model == 'viscous' and method == 'importance'")
    assert candidate.evidence["importance"].log_evidence == row["log_evidence"].item()
    assert [e.stage for e in candidate.estimates["koopman"]] == ["initial", "refined"]
    assert abs(candidate.values["zeta"] - 0.05) < 4 * candidate.sd["zeta"]
    assert {(c.record, c.damping) for c in run.candidates} == {("bench", "viscous"), ("bench", "quadratic")}
    assert "zeta" in repr(candidate)
    assert "bench/0" in repr(run)


def test_a_saved_run_is_loaded_with_its_results(run: bd.Run, tmp_path: Path) -> None:
    """Without the files of draws, their log likelihoods are unknown. A damaged result counts as failed, but not the
    failure of a task that is not in the study."""
    copy = bd.load(run.save(tmp_path / "copy"))
    assert copy.candidate("bench", "viscous").values == run.candidate("bench", "viscous").values
    for path in copy.folder.rglob("*.nc"):
        path.unlink()
    post = bd.load(copy.folder).candidate("bench", "viscous").posteriors["nuts"]
    assert post.log_likelihood.shape == post.draws.shape[:2]
    assert np.all(np.isnan(post.log_likelihood))
    damaged = copy.folder / "cells/mode/bench/0/quadratic.npz"
    damaged.write_bytes(damaged.read_bytes()[:-100])
    Store(copy.folder).write(TaskResult("mode/bench/0/coulomb", "", outcome="failed: not in this study"))
    less = bd.load(copy.folder)
    assert less.outcome == "1 tasks failed: mode/bench/0/quadratic"
    assert less.candidate("bench", "quadratic").values == {}
    with pytest.raises(bd.InputError, match="give a new folder"):
        run.save(tmp_path / "copy")
    os.mkfifo(copy.folder / "pipe")
    with pytest.raises(bd.InputError, match="is a named pipe"):
        copy.save(tmp_path / "another")
    with pytest.raises(bd.InputError, match=r"does not contain run\.json"):
        bd.Run.load(tmp_path)


def test_misuse_is_refused_in_one_line_and_nothing_is_written(run: bd.Run, tmp_path: Path) -> None:
    out = tmp_path / "new"
    wrong: list[tuple[Callable[[], object], str]] = [
        (lambda: bd.run_study({**STUDY, "sampler": {}}, out), "study: sampler: unknown key"),
        (lambda: bd.run_study(3, out), "must be a file, a dictionary or a Study"),  # type: ignore[arg-type]
        (lambda: bd.run_study(STUDY, out, workers=0), "workers is 0"),
        (lambda: bd.run_study(STUDY, out, workers="2"), "workers is '2'"),  # type: ignore[arg-type]
        (lambda: bd.run_study(out / "none.toml"), "there is no such file"),
        (lambda: run.candidate("bensh", "viscous"), "did you mean 'bench'"),
        (lambda: run.candidate("bench", "viscous", repeat=1), "not run on repeat 1"),
    ]
    assert not_refused(wrong) == []
    assert not out.exists()
