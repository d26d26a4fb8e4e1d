"""Progress: plain lines without a terminal, and descriptions of the stages."""

import io
from pathlib import Path

from rich.console import Console

from bayesdamp.pipeline import progress as p
from bayesdamp.pipeline.jobs import Job
from tests.studies import COMPARED, VISCOUS, WEIGHED, study_text, write_study


def test_without_a_terminal_long_stages_are_plain_lines() -> None:
    out = io.StringIO()
    with p.progress_bar(Console(file=out)) as bar:
        progress = p.Progress(bar)
        progress.begin("reading 1 record", [Job("a", 0, task_group="read")])
        progress.advance()
        progress.begin("estimating", [Job("a", 0, "viscous")] * 100)
    assert out.getvalue().splitlines() == ["estimating"]


def test_a_stage_says_how_many_damping_models_it_evaluates(tmp_path: Path) -> None:
    study = write_study(tmp_path, study_text(COMPARED, WEIGHED, simulate=VISCOUS))
    words = p.describe_stage(study, [Job("rig", 0, model) for model in ("viscous", "quadratic")])
    assert words == "fitting, sampling and weighing 2 damping models on 1 record"
