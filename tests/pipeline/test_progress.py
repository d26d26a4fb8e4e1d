"""Progress: the step in words, a bar on a terminal, plain lines where there is none."""

from __future__ import annotations

import io
from itertools import count
from types import SimpleNamespace

import pytest
from rich.console import Console

from bayesdamp.config import load_study
from bayesdamp.config.load import shipped_folder
from bayesdamp.formatting import duration
from bayesdamp.pipeline import progress as p
from bayesdamp.pipeline.jobs import Job, jobs_of


def test_plain_lines_where_there_is_no_terminal() -> None:
    out = io.StringIO()
    with p.progress_on(Console(file=out)) as shown:
        shown.begin("reading 1 record", [Job("a", 0, part="read")])
        shown.advance()
        shown.begin("estimating", [Job("a", 0, "viscous")] * 100)
        for _ in range(40):
            shown.advance()
    assert out.getvalue().splitlines() == ["estimating"]


def test_a_bar_on_a_terminal() -> None:
    out = io.StringIO()
    with p.progress_on(Console(file=out, force_terminal=True, width=100)) as shown:
        shown.begin("estimating", [Job("a", 0, "viscous")] * 100)
        for _ in range(40):
            shown.advance()
        shown._bar.refresh()
    assert "estimating" in out.getvalue()
    assert "40/100" in out.getvalue()


def test_the_bar_shows_the_time_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """A second a job: 60 of 100 are left. Control: not that of the jobs that are done."""
    clock = count(0.0)
    monkeypatch.setattr(p, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    out = io.StringIO()
    with p.progress_on(Console(file=out, force_terminal=True, width=100)) as shown:
        shown.begin("estimating", [Job("a", 0, "viscous")] * 100)
        for _ in range(40):
            shown.advance()
        shown._bar.refresh()
    assert f"{duration(60.0)} left" in out.getvalue()
    assert f"{duration(40.0)} left" not in out.getvalue()


def test_a_quiet_console_says_nothing() -> None:
    out = io.StringIO()
    with p.progress_on(Console(file=out, quiet=True)) as shown:
        shown.begin("estimating", [Job("a", 0, "viscous")])
    assert out.getvalue() == ""


def test_every_job_of_a_study_has_words() -> None:
    study = load_study(shipped_folder() / "quickstart.toml")
    words = {job.part: p.words_of(study, [job]) for job in jobs_of(study)}
    assert all(words.values())
    assert not any("_" in one for one in words.values())
    assert words["answer"] == "measuring the damping of 1 record with 3 damping models and 1 restoring law"


def test_the_time_left_is_that_of_the_whole_run(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([0.0, 3.0, 6.0, 6.0, 30.0, 54.0])
    monkeypatch.setattr(p, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    answers = [Job(name, 0, part="answer") for name in "ab"]
    branches = [Job(name, 0, "viscous") for name in "ab"]
    with p.progress_on(Console(quiet=True), [*answers, *branches]) as shown:
        shown.begin("measuring", answers)
        shown.advance()
        pace = 3.0 / p.TYPICAL["answer"]
        assert shown.left == pytest.approx(3.0 + 2 * pace * p.TYPICAL["model"])
        shown.advance()
        shown.begin("estimating", branches)
        shown.advance()
        assert shown.left == pytest.approx(24.0), "as long as the other branch took"
        shown.advance()
        assert shown.left == 0.0
