"""A run on several processes has the tables of one process, and a killed process loses only its own task."""

import os
import signal
import sys
import time
from collections.abc import Collection
from concurrent.futures import Future
from pathlib import Path
from unittest.mock import Mock

import pytest

from bayesdamp.machine import processes
from bayesdamp.pipeline.run import run_study
from bayesdamp.pipeline.workers import open_pool, run_in_pool
from bayesdamp.store.results import Store
from tests.pipeline.workers.test_cluster import local_cluster
from tests.studies import COMPARED, ESTIMATED, WEIGHED, plugin_source, study_text, tables_of, write_study

STUDY = study_text(
    ESTIMATED,
    COMPARED,
    WEIGHED,
    simulate="viscous = 0.05, duration = 10.0, samples = 300, noise_sd = 0.003",
    name="noisy",
)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return write_study(tmp_path_factory.mktemp("study"), STUDY)


@pytest.fixture(scope="module")
def alone(study, tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("alone") / "out"
    assert run_study(study, out, workers=1) == 0
    return out


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory):
    """The address of a Dask cluster of two worker processes on this machine."""
    config = pytest.importorskip("dask").config
    settings = {"distributed.worker.daemon": False, "distributed.scheduler.allowed-failures": 0}
    with config.set(settings), local_cluster(2, tmp_path_factory.mktemp("dask"), processes=True) as cluster:
        yield cluster.scheduler_address


@pytest.mark.slow
def test_a_dask_cluster_gives_the_tables_of_one_process(study, alone, scheduler, tmp_path):
    out = tmp_path / "out"
    assert run_study(study, out, scheduler=scheduler) == 0
    assert (tables_of(out), Store(out).names()) == (tables_of(alone), Store(alone).names())
    drawn = {p.name: p.read_bytes() for p in (out / "figures").iterdir()}
    assert drawn == {p.name: p.read_bytes() for p in (alone / "figures").iterdir()} != {}


@pytest.mark.slow
def test_dask_workers_have_a_study_s_plug_ins(scheduler, tmp_path):
    """The next study on the same workers has a plug-in of the same name with another source. The motion is the same, so
    that the coefficient is twice as large, except for the width of its prior."""
    source = plugin_source("cubic_drag")
    text = STUDY.replace("system =", 'plugins = { modules = ["own.py"] }\nsystem =')
    coefficients = []
    for factor in (1.0, 0.5):
        (tmp_path / "own.py").write_text(source.replace("v**3", f"{factor} * v**3"), encoding="utf-8")
        out, study = tmp_path / f"out{factor}", write_study(tmp_path, text.replace("quadratic", "cubic_drag"))
        assert run_study(study, out, scheduler=scheduler) == 0
        coefficients.append(Store(out).read("mode/noisy/0/cubic_drag").meta["values"]["drag3"])
    assert coefficients[1] == pytest.approx(2 * coefficients[0], rel=0.01)


def job(folder: Path, name: str, given_up: Collection[str]) -> None:
    """Compute a job of two tasks, `name1` and `name2`; a task with a file kills its process, once or always."""
    for task in (f"{name}1", f"{name}2"):
        if task in given_up or (folder / task).exists():
            continue
        order = folder / f"{task}.kill"
        if order.exists():
            if order.read_text() == "once":
                order.unlink()
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(0.02)
        (folder / task).write_text("done")


def spread_out(folder: Path, names: str, pool) -> list[str]:
    """Compute jobs in a pool and return the tasks that were given up; all others and the ends of jobs are checked."""
    done = Mock()
    lost: list[str] = []

    def next_task(name: str, given_up: Collection[str]) -> str | None:
        left = (t for t in (f"{name}1", f"{name}2") if t not in given_up and not (folder / t).exists())
        return next(left, None)

    def submit(name: str, given_up: Collection[str]) -> Future[None]:
        return pool.submit(job, folder, name, given_up)

    run_in_pool(list(names), pool, submit, next_task, lambda _, task: lost.append(task), done)
    tasks = {f"{n}{i}" for n in names for i in (1, 2)}
    assert {task for task in tasks if not (folder / task).exists()} == set(lost)
    assert done.call_count == len(names)
    return lost


@pytest.mark.parametrize(("kills", "killers", "lost"), [("once", "c1 c2", ""), ("always", "b1 e2", "b1 e2")])
def test_a_task_that_kills_its_process_once_is_computed_again_and_always_loses_only_itself(
    tmp_path, kills, killers, lost
):
    for task in killers.split():
        (tmp_path / f"{task}.kill").write_text(kills)
    with processes(2) as pool:
        assert sorted(spread_out(tmp_path, "abcdef", pool)) == lost.split()


@pytest.mark.slow
def test_a_task_that_kills_its_dask_worker_loses_only_itself(scheduler, tmp_path):
    cloudpickle = pytest.importorskip("cloudpickle")
    cloudpickle.register_pickle_by_value(sys.modules[__name__])  # the workers do not have this file
    (tmp_path / "b1.kill").write_text("always")
    try:
        with open_pool(1, scheduler) as pool:
            assert spread_out(tmp_path, "abc", pool) == ["b1"]
    finally:
        cloudpickle.unregister_pickle_by_value(sys.modules[__name__])


def test_a_job_with_an_exception_is_not_computed_again(tmp_path):
    """Control of the tests with kills."""
    (tmp_path / "file").write_text("")
    with processes(1) as pool, pytest.raises(NotADirectoryError):
        spread_out(tmp_path / "file", "a", pool)
