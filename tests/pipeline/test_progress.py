"""Progress: plain lines without a terminal, and descriptions of the stages."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from rich.console import Console

from bayesdamp.pipeline import progress as p
from bayesdamp.pipeline.jobs import Job
from tests.studies import COMPARED, WEIGHED, study_text, write_study


def test_without_a_terminal_long_stages_are_plain_lines() -> None:
    out = io.StringIO()
    with p.progress_bar(Console(file=out)) as bar:
        progress = p.Progress(bar)
        progress.begin("reading 1 record", [Job("a", 0, task_group="read")])
        progress.advance()
        progress.begin("estimating", [Job("a", 0, "viscous")] * 100)
        for _ in range(40):
            progress.advance()
    assert out.getvalue().splitlines() == ["estimating"]


@pytest.mark.parametrize(
    ("samplers", "activity"), [("[]", "checking the evidence of"), ('["nuts"]', "sampling")]
)
def test_a_study_without_samplers_does_not_say_that_it_samples(
    tmp_path: Path, samplers: str, activity: str
) -> None:
    simulated = "viscous = 0.05, duration = 10.0, samples = 100, noise_sd = 0.003"
    text = study_text(COMPARED, WEIGHED.replace("[]", samplers), simulate=simulated)
    stage = [Job("rig", 0, "viscous", task_group="sample")]
    assert p.describe_stage(write_study(tmp_path, text), stage) == f"{activity} 1 damping model on 1 record"
