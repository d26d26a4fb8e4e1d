"""Progress: the step in words, the time left by what was seen, plain lines where there is no terminal."""

from __future__ import annotations

import io
import math
import time
from pathlib import Path

import pytest
from rich.console import Console

from bayesdamp.config import load_study
from bayesdamp.config.shipped import folder
from bayesdamp.pipeline import progress as p
from bayesdamp.pipeline.jobs import jobs_of


class Clock:
    now = 0.0

    def monotonic(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Clock:
    made = Clock()
    monkeypatch.setattr(p.time, "monotonic", made.monotonic)
    monkeypatch.setenv("BAYESDAMP_CACHE", str(tmp_path / "cache"))
    return made


def test_time_left_by_the_steps_own_pace(clock: Clock) -> None:
    shown = p.Progress(lambda _: None)
    shown.begin(p.Step("unheard-of", "weighing", 4))
    assert math.isnan(shown.left())
    assert shown.line() == "weighing"
    clock.now = 20.0
    shown.advance()
    assert shown.left() == pytest.approx(60.0)
    assert shown.line() == "weighing, about 60 s left"


def test_the_pace_of_the_last_run_is_remembered(clock: Clock) -> None:
    first = p.Progress(lambda _: None)
    first.begin(p.Step("answer", "weighing", 2))
    clock.now = 30.0
    first.end()
    second = p.Progress(lambda _: None)
    second.begin(p.Step("answer", "weighing", 3))
    assert second.left() == pytest.approx(45.0)
    clock.now += 50.0  # slower than then: nothing is known any more
    assert math.isnan(second.left())


def test_the_time_left_is_that_of_the_whole_run(clock: Clock) -> None:
    shown = p.Progress(lambda _: None)
    steps = [
        p.Step("answer", "weighing", 1),
        p.Step("sampled", "sampling", 2),
        p.Step("report", "drawing", 1),
    ]
    shown.plan(steps)
    usual = p.USUAL
    shown.begin(steps[0])
    assert shown.left() == pytest.approx(usual["answer"] + 2 * usual["sampled"] + usual["report"])
    clock.now = usual["answer"]
    shown.begin(steps[1])
    assert shown.left() == pytest.approx(2 * usual["sampled"] + usual["report"])
    clock.now += 5.0
    shown.advance()  # slower or faster than usual: its own pace counts, and the later steps stay
    assert shown.left() == pytest.approx(5.0 + usual["report"])
    shown.begin(steps[2])
    assert shown.left() == pytest.approx(usual["report"])


def test_a_step_that_is_left_out_is_no_longer_waited_for(clock: Clock) -> None:
    shown = p.Progress(lambda _: None)
    shown.plan([p.Step("look", "fitting", 3), p.Step("weigh", "weighing", 3), p.Step("report", "drawing", 1)])
    shown.begin(p.Step("weigh", "weighing", 3))
    assert shown.left() == pytest.approx(3 * p.USUAL["weigh"] + p.USUAL["report"])


def test_a_plan_has_what_a_run_will_do() -> None:
    study = load_study(folder() / "quickstart.toml")
    jobs = jobs_of(study)
    kinds = [step.kind for step in p.planned(study, jobs, set())]
    assert kinds == ["read", "answer", "sampled", "model", "average", "report"]
    done = {"signal/viscous/0", "answer/viscous/0", *(f"mode/viscous/0/{m}" for m in study.models.compare)}
    assert [step.kind for step in p.planned(study, jobs, done)] == ["sampled", "average", "report"]


def test_what_was_there_already_is_no_pace(clock: Clock, tmp_path: Path) -> None:
    pace = p.Pace(tmp_path / "pace.json")
    pace.learn("look", 0.01)
    assert math.isnan(pace.of("look"))
    (tmp_path / "pace.json").write_text("{ broken", encoding="utf-8")
    assert math.isnan(p.Pace(tmp_path / "pace.json").of("look"))


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (math.nan, ""),
        (3.4, "a few seconds left"),
        (3.6, "about 5 s left"),
        (9.0, "about 10 s left"),
        (12.0, "about 10 s left"),
        (42.0, "about 40 s left"),
        (97.0, "about 2 minutes left"),
        (600.0, "about 10 minutes left"),
        (7200.0, "about 2 hours left"),
    ],
)
def test_words_of_time(seconds: float, words: str) -> None:
    assert p.left_words(seconds) == words


def test_plain_lines_where_there_is_no_terminal(clock: Clock) -> None:
    out = io.StringIO()
    with p.progress_on(Console(file=out)) as shown:
        shown.begin(p.Step("read", "reading 1 record", 1))
        shown.advance()
        shown.begin(p.Step("look", "estimating", 100))
        for _ in range(40):
            clock.now += 1.0
            shown.advance()
    assert out.getvalue().splitlines() == [
        "estimating, about 7 minutes left", "estimating, about 80 s left", "estimating, about 70 s left",
    ]  # fmt: skip


def test_a_line_on_a_terminal(clock: Clock) -> None:
    out = io.StringIO()
    with p.progress_on(Console(file=out, force_terminal=True, width=100)) as shown:
        shown.begin(p.Step("look", "estimating", 100))
        clock.now += 1.0
        shown.advance()
        time.sleep(0.4)  # it is drawn ten times a second
    assert "estimating, about 2 minutes left" in out.getvalue()


def shown_over(clock: Clock, seconds: list[float]) -> list[str]:
    """What is shown while jobs take so long each."""
    shown = p.Progress(lambda _: None)
    shown.begin(p.Step("unheard-of", "weighing", len(seconds)))
    said = []
    for each in seconds[:-1]:
        clock.now += each
        shown.advance()
        said.append(shown.line().partition(", ")[2])
    return said


def test_the_time_left_does_not_jump(clock: Clock) -> None:
    """Jobs that take 5 to 7 s in turn: an estimate of its own each time goes up and down."""
    said = shown_over(clock, [5.0, 7.0, 5.5, 8.0, 5.0, 6.0, 7.0, 5.0])
    numbers = [int(line.split()[1]) for line in said if line.startswith("about")]
    assert numbers == sorted(numbers, reverse=True)
    assert said[-1] == "about 5 s left"


def test_the_time_left_grows_where_a_run_is_far_slower(clock: Clock) -> None:
    said = shown_over(clock, [1.0] * 10 + [20.0] * 10)
    assert said[9] == "about 10 s left"
    assert said[12] == "about 30 s left"


def test_what_takes_longer_than_usual_is_said(clock: Clock) -> None:
    first = p.Progress(lambda _: None)
    first.begin(p.Step("answer", "weighing", 1))
    clock.now = 10.0
    first.end()
    first.begin(p.Step("answer", "weighing", 1))
    assert first.line() == "weighing, about 10 s left"
    clock.now += 3.0
    assert first.line() == "weighing, about 5 s left"
    clock.now += 4.0
    assert first.line() == "weighing, a few seconds left"
    clock.now += 6.0
    assert first.line() == "weighing, a few seconds left"
    clock.now += 1.0
    assert first.line() == "weighing, longer than usual"


def test_nothing_is_said_to_be_weighed_of_what_is_no_free_decay(clock: Clock) -> None:
    study = load_study(folder() / "quickstart.toml")
    job = next(job for job in jobs_of(study) if job.part == "answer")
    step = p.step_of(study, [job], {(job.signal, job.repeat)})
    assert step.words == "measuring what moves: no free decay, so no damping model is weighed"
    shown = p.Progress(lambda _: None)
    shown.begin(step)
    clock.now += 3.0
    shown.end()
    assert math.isnan(p.Pace().of("answer"))  # and its time says nothing of others


def test_a_quiet_console_says_nothing(clock: Clock) -> None:
    out = io.StringIO()
    with p.progress_on(Console(file=out, quiet=True)) as shown:
        shown.begin(p.Step("look", "estimating", 1))
    assert out.getvalue() == ""


def test_every_job_of_a_study_has_words() -> None:
    study = load_study(folder() / "quickstart.toml")
    kinds = {}
    for job in jobs_of(study):
        step = p.step_of(study, [job])
        kinds[step.kind] = step.words
        assert step.words
        assert "_" not in step.words
    assert kinds["answer"] == "weighing 3 damping models under 1 restoring law"
