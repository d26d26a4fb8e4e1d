"""The end of a comparison on the terminal: a short table and one sentence a record."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from bayesdamp.report import words
from bayesdamp.report.reading import ASIDE, coefficients, ranking, summary_rows
from bayesdamp.report.run import Run, rows_of
from bayesdamp.report.specimens import sentences
from bayesdamp.report.verdict import verdict
from bayesdamp.types import BEWARE, candidate_parts

SHOWN = 5


def conclude(folder: Path, console: Console) -> None:
    """Print what a run's folder says of each record, and where its report is."""
    run = Run(folder)
    for signal in run.signals:
        repeat = run.repeats(signal)[0]
        console.print()
        console.print(Text(f"{signal}: {verdict(run, signal, repeat).sentence}"), soft_wrap=True)
        for warning in run.warnings(signal):
            console.print(Text(BEWARE + warning), soft_wrap=True)
        table = _candidates(run, signal, repeat)
        if table is not None:
            console.print(table)
    for said in sentences(run):
        console.print()
        console.print(Text(said), soft_wrap=True)
    console.print(str(folder / "report.html"), soft_wrap=True, highlight=False)


def _candidates(run: Run, signal: str, repeat: int) -> Table | None:
    found = ranking(run, signal, repeat)
    if found is None:
        return None
    one_law = len({row["restoring"] for row in found.rows}) == 1
    laws = [] if one_law else ["restoring"]
    table = Table("damping", *laws, "probability", "parameters ± sd", "fit")
    weighed = [row for row in found.rows if not row["outcome"].startswith(ASIDE)]
    for row in weighed[:SHOWN]:
        damping, law = candidate_parts(row["model"])
        fit = rows_of(run.fits, signal=signal, repeat=repeat, model=row["model"])
        table.add_row(
            words.model(damping),
            *([] if one_law else [words.law(law or row["restoring"])]),
            words.probability(row["probability"]),
            _sizes(run, signal, repeat, row["model"]),
            fit[0]["verdict"].partition(":")[0] if fit else words.NONE,  # the reason is in the sentence
        )
    left = len(found.rows) - len(weighed[:SHOWN])
    if left:
        table.caption = f"{left} more candidate{'s' if left > 1 else ''}: see the report"
    return table


def _sizes(run: Run, signal: str, repeat: int, model: str) -> str:
    """The damping coefficients, from the posterior or else from the mode."""
    rows = {r["parameter"]: r for r in summary_rows(run, signal, repeat, model)[1]}
    cell = run.cell("mode", signal, repeat, model)
    values, sds = (cell.meta.get("values", {}), cell.meta.get("sd", {})) if cell else ({}, {})
    parts = []
    for name in coefficients(run, model):
        if name in rows:
            shown = (
                f"{words.with_error(rows[name]['mean'], rows[name]['sd'])} {words.unit(rows[name]['unit'])}"
            )
        else:
            shown = f"{words.with_error(values.get(name), sds.get(name))} (mode)"
        parts.append(f"{words.symbol(name).text} {shown}")
    return "\n".join(parts) or words.NONE
