"""When a run reads a file again, and the order of its tasks."""

import os
from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from bayesdamp.config import Recording
from bayesdamp.inference.evidence import EVIDENCES
from bayesdamp.pipeline import answering, records
from bayesdamp.pipeline.jobs import Depth, Job, stages, tasks_of
from bayesdamp.pipeline.records import read_free_decay
from bayesdamp.pipeline.tasks import compute_and_store
from bayesdamp.store.results import Store
from tests.studies import COMPARED, VISCOUS, WEIGHED, study_text, write_study


def test_a_file_that_is_replaced_with_the_same_time_stamp_is_read_again(tmp_path: Path, monkeypatch) -> None:
    """Control: the same file is not read a second time, unless other records take its place in memory."""
    t, file = np.arange(400) / 40, tmp_path / "rig.csv"
    recording, signals = Recording(file=file.name, path=file), []
    for size in (0.2, 0.3):
        path, y = tmp_path / "new.csv", size * np.exp(-0.05 * t) * np.cos(6 * t)
        np.savetxt(path, np.column_stack([t, y]), delimiter=",", fmt="%.6f")  # both files have the same size
        os.utime(path, (1e9, 1e9))
        path.replace(file)
        signals.append(read_free_decay(recording, "rig"))
    first, second = signals
    assert np.max(second.y) == pytest.approx(1.5 * np.max(first.y), rel=1e-3)
    assert read_free_decay(recording, "rig") is second
    monkeypatch.setattr(records, "MOST_CACHED_SAMPLES", second.t.size + second.whole_t.size)
    assert read_free_decay(recording, "other") is read_free_decay(recording, "other")
    assert read_free_decay(recording, "rig") is not second


def test_evidence_that_needs_draws_comes_after_the_samplers_and_only_for_sampled_candidates(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Control: other evidence is computed for every candidate."""
    settings = "posterior = { samplers = ['nuts'] }\nevidence = { methods = ['laplace', 'importance'] }"
    study = write_study(tmp_path, study_text(COMPARED, settings, simulate=VISCOUS))
    job = Job("rig", 0, "viscous")

    def methods(job: Job) -> list[str]:
        return [task.name.split("/")[-1] for task in tasks_of(study, Store(tmp_path), job)]

    unsampled = replace(job, is_sampled=False)
    assert {"nuts", "nested"}.isdisjoint(methods(unsampled))
    assert {"laplace", "importance"} <= set(methods(unsampled))
    monkeypatch.setattr(type(EVIDENCES.get("importance")), "needs_draws", True)
    assert "importance" not in methods(unsampled)
    order = methods(job)
    assert order.index("nuts") < order.index("importance") < order.index("nested")


def test_records_are_sampled_one_by_one_unless_all_answers_are_wanted_first(tmp_path: Path) -> None:
    study, store = write_study(tmp_path, study_text(COMPARED, WEIGHED, simulate=VISCOUS)), Store(tmp_path)

    def groups(answer_first: bool) -> list[set[str]]:
        every = stages(study, store, Depth.SAMPLED, answer_first)
        return [{job.task_group for job in stage} for stage in every if stage]

    assert groups(True) == [{"answer"}, {"sampled"}]
    assert groups(False) == [{"sampled"}]
    tasks = tasks_of(study, store, Job("rig", 0, task_group="sampled"))
    assert [task.name.split("/")[0] for task in tasks] == ["signal", "answer", "sampled"]


def test_a_record_is_compared_once_for_its_answer_and_its_sampled_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Control: the sampled answer on another record is compared anew."""
    study, store = write_study(tmp_path, study_text(COMPARED, WEIGHED, simulate=VISCOUS)), Store(tmp_path)
    compare = Mock(wraps=answering.compare_models)
    monkeypatch.setattr(answering, "compare_models", compare)
    for task in tasks_of(study, store, Job("rig", 0, task_group="sampled")):
        compute_and_store(store, task)
    assert compare.call_count == 1
    compute_and_store(store, tasks_of(replace(study, seed=8), store, Job("rig", 0, task_group="sampled"))[2])
    assert compare.call_count == 2
