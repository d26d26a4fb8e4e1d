"""Progress: the step in words, a bar on a terminal, plain lines where there is none."""

from __future__ import annotations

import io

from rich.console import Console

from bayesdamp.pipeline import progress as p
from bayesdamp.pipeline.jobs import Job


def test_plain_lines_where_there_is_no_terminal() -> None:
    out = io.StringIO()
    with p.progress_bar(Console(file=out)) as bar:
        shown = p.Progress(bar)
        shown.begin("reading 1 record", [Job("a", 0, task_group="read")])
        shown.advance()
        shown.begin("estimating", [Job("a", 0, "viscous")] * 100)
        for _ in range(40):
            shown.advance()
    assert out.getvalue().splitlines() == ["estimating"]
