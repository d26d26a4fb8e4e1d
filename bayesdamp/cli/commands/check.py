"""`bayesdamp check`: what a study asks for; nothing is run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bayesdamp.cli import options as o
from bayesdamp.cli.asked import read_study

if TYPE_CHECKING:
    from bayesdamp.config import Study


def check(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A study file (TOML).")],
    plugin: o.Plugins = None,
) -> int:
    """Read a study and its records, list its tasks, say what is wrong; run nothing."""
    from rich.console import Console

    loaded = read_study(file, plugin)
    from bayesdamp.config import in_keys
    from bayesdamp.pipeline import cells
    from bayesdamp.pipeline.run import read_records
    from bayesdamp.store.cells import Place
    from bayesdamp.table import Table

    with in_keys():
        read_records(loaded)
    counts = Counter(Place.of(name).kind for name in cells(loaded))
    console = Console()
    asked = [(label, ", ".join(names) or "none") for label, names in _asked(loaded)]
    summary = Table(["", "what the study asks for"], asked)
    console.print(summary.rich(title=f"{loaded.name}: {file}", title_justify="left"))
    tasks = [(kind, str(number)) for kind, number in (*counts.items(), ("all", counts.total()))]
    console.print(Table(["tasks", "number"], tasks).rich())
    typer.echo(f"{file}: ok")
    return 0


def _asked(loaded: Study) -> list[tuple[str, Sequence[str]]]:
    use = loaded.estimators
    return [
        ("signals", [f"{s.name} (x{s.repeats})" if s.repeats > 1 else s.name for s in loaded.signals]),
        ("models", loaded.models.compare),
        ("restoring laws", list(dict.fromkeys(law for s in loaded.signals for law in s.restoring))),
        ("estimators", use.use),
        ("stages", use.stages),
        ("samplers", loaded.posterior.samplers),
        ("noise", loaded.noises),
        ("evidence", loaded.evidence.methods),
    ]
