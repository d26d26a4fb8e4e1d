"""A claim, its measurement and its verdict, and all of them as a page."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal, get_args

from bayesdamp.report.results.estimators import ErrorSeries, EstimatorComparison, compare_estimators, series
from bayesdamp.report.results.run import RunFolder
from bayesdamp.table import markdown_table

Verdict = Literal["holds", "does not hold", "holds in part", "better than claimed", "cannot be judged"]
"""*Better than claimed*: so far below a printed figure that it does not confirm it."""
FAR = 10.0
"""Factor by which an error below the printed one no longer confirms it."""


@dataclass(frozen=True)
class Judgement:
    """The verdict on a claim, and the measurement in a sentence or two."""

    verdict: Verdict
    measured: str


@dataclass(frozen=True)
class Runs:
    """The runs by which claims are judged.

    Attributes
    ----------
    paper
        Folder of the study `paper`; None if there is none.
    noise
        Folders of the studies `noise*`.
    """

    paper: Path | None = None
    noise: tuple[Path, ...] = ()

    @cached_property
    def compared(self) -> EstimatorComparison | None:
        """The comparison of the estimators on the paper's pendulums without noise."""
        return compare_estimators(RunFolder(self.paper)) if self.paper else None

    @cached_property
    def along_noise(self) -> list[ErrorSeries]:
        """Errors at several noise levels."""
        return [s for folder in self.noise for s in series(RunFolder(folder)) if s.factor == "noise"]


Judge = Callable[[Runs], Judgement]


@dataclass(frozen=True)
class Claim:
    """A claim of the paper.

    Attributes
    ----------
    text
        In our words.
    where
        Section, table or figure of the paper.
    judge
        Measures and judges.
    """

    text: str
    where: str
    judge: Judge


def claim(claims: list[Claim], text: str, where: str) -> Callable[[Judge], Judge]:
    """Add a claim to a list, with the decorated function as its judge. The arguments are those of `Claim`."""

    def add(judge: Judge) -> Judge:
        claims.append(Claim(text, where, judge))
        return judge

    return add


NO_RUN = Judgement("cannot be judged", "The run that this claim needs is missing.")


def on_clean(judge: Callable[[EstimatorComparison], Judgement]) -> Judge:
    """Turn a judge of the comparison on clean records into a judge of runs; without the comparison it gives NO_RUN."""
    return lambda runs: judge(runs.compared) if runs.compared else NO_RUN


def judged(claims: Iterable[Claim], runs: Runs) -> list[tuple[Claim, Judgement]]:
    """Judge every claim, in order."""
    return [(claim, claim.judge(runs)) for claim in claims]


def written(judgements: Iterable[tuple[Claim, Judgement]], runs: Runs) -> str:
    """Return the page in Markdown, with the runs by which it judges."""
    judgements = list(judgements)
    counts = Counter(judgement.verdict for _, judgement in judgements)
    verdicts = [f"{verdict} {counts[verdict]}" for verdict in get_args(Verdict) if counts[verdict]]
    cells = [(c.text, c.where, j.measured, f"**{j.verdict}**") for c, j in judgements]
    lines = [
        "# The paper's claims, measured",
        "",
        f"Verdicts on {len(judgements)} claims: {', '.join(verdicts)}.",
        "",
        "Made by `bayesdamp claims`. Errors are in per cent of the truth: *initial* is the method's own estimate,",
        "*refined* is the trajectory fit that starts there. *Better than claimed* means that an error is more than ten",
        "times, or a time more than three times, below the printed one; such a figure does not confirm the claim.",
        "",
        markdown_table(("claim", "where", "measured", "verdict"), cells),
    ]
    for folder in (runs.paper, *runs.noise):
        if folder is not None:
            code = str(RunFolder(folder).info.get("revision") or "an unknown revision")
            lines += ["", f"Judged by the run `{folder.name}` next to this page, computed by {code}."]
    return "\n".join(lines) + "\n"
