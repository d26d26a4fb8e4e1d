"""Progress: the step in words, a bar on a terminal, plain lines where there is none."""

from __future__ import annotations

import io

from rich.console import Console

from bayesdamp.config import load_study
from bayesdamp.config.load import shipped_folder
from bayesdamp.pipeline import progress as p
from bayesdamp.pipeline.jobs import Job, jobs_of


def test_plain_lines_where_there_is_no_terminal() -> None:
    out = io.StringIO()
    with p.progress_on(Console(file=out)) as shown:
        shown.begin("reading 1 record", [Job("a", 0, task_group="read")])
        shown.advance()
        shown.begin("estimating", [Job("a", 0, "viscous")] * 100)
        for _ in range(40):
            shown.advance()
    assert out.getvalue().splitlines() == ["estimating"]


def test_every_job_of_a_study_has_words() -> None:
    study = load_study(shipped_folder() / "quickstart.toml")
    words = {job.task_group: p.describe_stage(study, [job]) for job in jobs_of(study)}
    assert all(words.values())
    assert not any("_" in one for one in words.values())
    assert words["answer"] == "measuring the damping of 1 record with 3 damping models and 1 restoring law"
