"""Progress: the step in words, a bar on a terminal, plain lines where there is none."""

from __future__ import annotations

import io

from rich.console import Console

from bayesdamp.config import load_study
from bayesdamp.config.shipped import folder
from bayesdamp.pipeline import progress as p
from bayesdamp.pipeline.jobs import jobs_of


def test_plain_lines_where_there_is_no_terminal() -> None:
    out = io.StringIO()
    with p.progress_on(Console(file=out)) as shown:
        shown.begin("reading 1 record", 1)
        shown.advance()
        shown.begin("estimating", 100)
        for _ in range(40):
            shown.advance()
    assert out.getvalue().splitlines() == ["estimating"]


def test_a_bar_on_a_terminal() -> None:
    out = io.StringIO()
    with p.progress_on(Console(file=out, force_terminal=True, width=100)) as shown:
        shown.begin("estimating", 100)
        for _ in range(40):
            shown.advance()
        shown._bar.refresh()
    assert "estimating" in out.getvalue()
    assert "40/100" in out.getvalue()


def test_nothing_is_said_to_be_weighed_of_what_is_no_free_decay() -> None:
    study = load_study(folder() / "quickstart.toml")
    job = next(job for job in jobs_of(study) if job.part == "answer")
    words = p.words_of(study, [job], {(job.signal, job.repeat)})
    assert words == "measuring what moves: no free decay, so no damping model is weighed"


def test_a_quiet_console_says_nothing() -> None:
    out = io.StringIO()
    with p.progress_on(Console(file=out, quiet=True)) as shown:
        shown.begin("estimating", 1)
    assert out.getvalue() == ""


def test_every_job_of_a_study_has_words() -> None:
    study = load_study(folder() / "quickstart.toml")
    words = {job.part: p.words_of(study, [job]) for job in jobs_of(study)}
    assert all(words.values())
    assert not any("_" in one for one in words.values())
    assert words["answer"] == "weighing 3 damping models under 1 restoring law"
