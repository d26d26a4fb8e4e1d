"""`bayesdamp study`, `check`, `calibrate` and `report`: work on a study file, or on the folder of a run."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bayesdamp.cli import options as o
from bayesdamp.cli.runs import check_folder, read_study, run_and_print
from bayesdamp.types import InputError

if TYPE_CHECKING:
    from rich.console import Console

File = Annotated[Path, typer.Argument(metavar="FILE", help="A study file (TOML).")]


def study(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE", help="A study file (TOML), the name of one that ships, or a run's run.json."
        ),
    ],
    out: o.Out = None,
    workers: o.Workers = None,
    scheduler: o.Scheduler = None,
    plugin: o.Plugins = None,
    fresh: o.Fresh = False,
    quick: o.Quick = False,
    quiet: o.Quiet = False,
    as_json: o.AsJson = False,
) -> int:
    """Run what is missing of a study, and write its report."""
    loaded = read_study(file, plugin)
    folder = check_folder(out, loaded.name)
    from bayesdamp.config import in_keys
    from bayesdamp.pipeline import Depth

    def finish(folder: Path, console: Console) -> None:
        from bayesdamp.report.terminal import beware

        if (page := folder / "report.html").is_file():
            beware(folder, console)
            typer.echo(page)

    depth = Depth.ANSWER if quick else Depth.WHOLE
    options = {"workers": workers, "scheduler": scheduler, "fresh": fresh, "quiet": quiet}
    with in_keys():
        return run_and_print(loaded, folder, depth, finish, as_json=as_json, **options)


def check(file: File, plugin: o.Plugins = None) -> int:
    """Read a study and its records, list its tasks and report errors; nothing is run."""
    from rich.console import Console

    loaded = read_study(file, plugin)
    from bayesdamp.config import in_keys
    from bayesdamp.pipeline import cells
    from bayesdamp.pipeline.run import read_records
    from bayesdamp.store.cells import Place
    from bayesdamp.table import Table

    with in_keys():
        read_records(loaded)
    use = loaded.estimators
    contents = {
        "signals": [f"{s.name} (x{s.repeats})" if s.repeats > 1 else s.name for s in loaded.signals],
        "models": loaded.models.compare,
        "restoring laws": dict.fromkeys(law for s in loaded.signals for law in s.restoring),
        "estimators": use.use,
        "stages": use.stages,
        "samplers": loaded.posterior.samplers,
        "noise": loaded.noises,
        "evidence": loaded.evidence.methods,
    }
    counts = Counter(Place.of(name).kind for name in cells(loaded))
    console = Console()
    rows = [(label, ", ".join(names) or "none") for label, names in contents.items()]
    summary = Table(["", "what the study asks for"], rows)
    console.print(summary.rich(title=f"{loaded.name}: {file}", title_justify="left"))
    tasks = [(kind, str(number)) for kind, number in (*counts.items(), ("all", counts.total()))]
    console.print(Table(["tasks", "number"], tasks).rich())
    typer.echo(f"{file}: ok")
    return 0


def calibrate(
    file: File,
    out: o.Out = None,
    models: Annotated[bool, typer.Option("--models", help="Test the probabilities of the models.")] = False,
    records: Annotated[
        int | None,
        typer.Option(min=1, help="Records of each model (of all with --models); by default as in the study."),
    ] = None,
    workers: o.Workers = None,
    fresh: o.Fresh = False,
    no_report: Annotated[
        bool,
        typer.Option("--no-report", help="Do not write report.html; `bayesdamp report` writes it later."),
    ] = False,
) -> int:
    """Check the intervals: draw from a study's own prior, simulate, infer, and compare with the truth."""
    from rich.console import Console

    loaded = read_study(file)
    folder = check_folder(out, loaded.name)
    from bayesdamp.calibrate import run_calibration

    status = run_calibration(
        loaded,
        folder,
        records=records,
        models=models,
        workers=workers,
        fresh=fresh,
        report=not no_report,
        console=Console(stderr=True),
    )
    typer.echo(folder if no_report else folder / "report.html")
    return status


def report(folder: Annotated[Path, typer.Argument(metavar="DIR", help="The folder of a run.")]) -> int:
    """Write the report of a run again; nothing is computed."""
    if not folder.is_dir():
        raise InputError(f"{folder}: there is no such folder; give the folder of a run, such as reports/NAME")
    from bayesdamp.report import render

    typer.echo(render(folder))
    return 0
