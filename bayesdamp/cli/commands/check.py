"""Define `bayesdamp check`, which checks a study file."""

from collections import Counter

import typer
from rich.console import Console

from bayesdamp.cli import options as o
from bayesdamp.cli.runs import read_study
from bayesdamp.config import in_keys
from bayesdamp.formatting import Table
from bayesdamp.pipeline.jobs import task_names
from bayesdamp.pipeline.run import read_records
from bayesdamp.store.results import TaskName


def check(file: o.StudyFile, plugin: o.Plugins = None) -> int:
    """Check a study file and its records: show what the study asks for, or the first error. Nothing is run."""
    loaded = read_study(file, plugin)
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
    counts = Counter(TaskName.of(name).kind for name in task_names(loaded))
    console = Console()
    rows = [(label, ", ".join(names) or "none") for label, names in contents.items()]
    summary = Table(["", "what the study asks for"], rows)
    console.print(summary.rich(title=f"{loaded.name}: {file}", title_justify="left"))
    tasks = [(kind, str(number)) for kind, number in (*counts.items(), ("all", counts.total()))]
    console.print(Table(["tasks", "number"], tasks).rich())
    typer.echo(f"{file}: ok")
    return 0
