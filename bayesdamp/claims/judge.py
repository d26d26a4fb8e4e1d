"""A claim, what was measured, and the verdict; and all of them as a page."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

from bayesdamp.report.markdown import table
from bayesdamp.report.results.comparing import Comparison, compared
from bayesdamp.report.results.run import Run
from bayesdamp.report.results.sweeping import Series, series

Verdict = Literal["holds", "does not hold", "holds in part", "better than claimed", "cannot be told"]
"""*Better than claimed*: so far below a printed figure that it does not confirm it."""
FAR = 10.0
"""Factor by which a figure that is below the printed one no longer confirms it."""


@dataclass(frozen=True)
class Judgement:
    """What was measured, in a sentence or two with its numbers, and what that says of the claim."""

    verdict: Verdict
    measured: str


@dataclass(frozen=True)
class Runs:
    """The runs that claims are judged by: the folder of `paper`, None where there is none, those of `noise`."""

    paper: Path | None = None
    noise: tuple[Path, ...] = ()

    @cached_property
    def compared(self) -> Comparison | None:
        """The clean pendulums of the paper."""
        return compared(Run(self.paper)) if self.paper else None

    @cached_property
    def along_noise(self) -> list[Series]:
        """Errors at several levels of noise."""
        return [s for folder in self.noise for s in series(Run(folder)) if s.factor == "noise"]


@dataclass(frozen=True)
class Claim:
    """text: in our words; where: in the paper; judge: measures and judges."""

    text: str
    where: str
    judge: Callable[[Runs], Judgement]


NO_RUN = Judgement("cannot be told", "The run that would tell is not here.")


def on_clean(judge: Callable[[Comparison], Judgement]) -> Callable[[Runs], Judgement]:
    """Make a judge of the clean pendulums one of runs, which cannot tell where these are not among them."""
    return lambda runs: judge(runs.compared) if runs.compared else NO_RUN


def judged(claims: Iterable[Claim], runs: Runs) -> list[tuple[Claim, Judgement]]:
    """Every claim with its judgement, in order."""
    return [(claim, claim.judge(runs)) for claim in claims]


def written(found: Iterable[tuple[Claim, Judgement]], runs: Runs | None = None) -> str:
    """The page, in Markdown, with the runs that it judges by."""
    found = list(found)
    counts = {v: sum(j.verdict == v for _, j in found) for v in dict.fromkeys(j.verdict for _, j in found)}
    cells = [(c.text, c.where, j.measured, f"**{j.verdict}**") for c, j in found]
    lines = [
        "# The paper's claims, measured",
        "",
        f"Of {len(found)} claims: "
        + ", ".join(f"{count} {verdict}" for verdict, count in counts.items())
        + ".",
        "",
        "Made by `bayesdamp claims`. Errors are in per cent of the truth; *initial* is what a method finds by itself,",
        "*refined* the trajectory fit that starts there. *Better than claimed* is a figure more than ten times",
        "below the printed one, in time more than three: it does not confirm the claim, it is another figure.",
        "",
        table(("claim", "where", "measured", "verdict"), cells),
    ]
    for folder in (runs.paper, *runs.noise) if runs else ():
        if folder is not None:
            info = Run(folder).info
            code = str(info.get("revision") or "an unknown revision")
            lines += ["", f"Judged by the run `{folder.name}` beside this page, made by {code}."]
    return "\n".join(lines) + "\n"
