"""How the report was made: versions, machine, inputs, times and the solver's error."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from bayesdamp import formatting as fmt
from bayesdamp.outcomes import Status, status_of
from bayesdamp.report.markup import folded, stack
from bayesdamp.report.results.run import RunFolder
from bayesdamp.report.sections import Section
from bayesdamp.store.cells import Place
from bayesdamp.table import Table
from bayesdamp.types import OK


class ProvenanceSection(Section):
    """Versions, revision, machine, inputs, failed tasks, and the time of each kind of task."""

    order = 90
    title = "How this report was made"

    def render(self, run: RunFolder) -> str:
        """Return what made the numbers, and from what."""
        info, text = run.info, (0, 1)
        facts = {
            "source revision": info.get("revision"),
            **(info.get("machine") or {}),
            "seed": info.get("seed"),
        }
        lines = [[name, str(value)] for name, value in facts.items() if value is not None]
        inputs, versions = (list((info.get(key) or {}).items()) for key in ("inputs", "versions"))
        parts: list[object] = [Table(["fact", "value"], lines, text)] if lines else []
        if inputs:
            parts.append(Table(["input", "SHA-256"], inputs, text))
        if versions:
            table = Table(["package", "version"], versions, text)
            parts.append(folded(f"Versions of {len(versions)} packages", table))
        parts.append(_without_result(run))
        parts += _timing(info.get("seconds") or {})
        parts.append(_budget(info.get("error_budget") or {}))
        return stack(*parts)


def _without_result(run: RunFolder) -> Table | None:
    """Return the tasks that ended without a result, by the sentence that gives the reason."""
    tasks: dict[str, list[str]] = {}
    for cell in run.cells():
        # The section on the evidence shows the tasks that were pruned.
        if cell.outcome != OK and status_of(cell.outcome) is not Status.PRUNED:
            tasks.setdefault(cell.outcome, []).append(cell.name)
    columns: dict[str, Callable[[str], str]] = {
        "reason": str,
        "tasks": lambda outcome: (
            ", ".join(tasks[outcome][:3])
            + (f" and {len(tasks[outcome]) - 3} more" if len(tasks[outcome]) > 3 else "")
        ),
    }
    count = sum(map(len, tasks.values()))
    caption = f"{count} task{'s' if count > 1 else ''} ended without a result"
    return Table.of(tasks, columns, (0, 1), caption) if tasks else None


def _timing(seconds: Mapping[str, float]) -> list[object]:
    known = {name: s for name, s in seconds.items() if isinstance(s, (int, float))}
    if not known:
        return []
    kinds: dict[str, list[float]] = {}
    for name, s in known.items():
        kinds.setdefault(Place.of(name).kind, []).append(s)
    kinds["all"] = list(known.values())
    columns: dict[str, Callable[[str], str]] = {
        "stage": str,
        "tasks": lambda kind: str(len(kinds[kind])),
        "sum": lambda kind: fmt.duration(sum(kinds[kind])),
        "longest": lambda kind: fmt.duration(max(kinds[kind])),
    }
    table = Table.of(kinds, columns, caption="Time, summed over workers")
    longest = sorted(known, key=lambda name: -known[name])[:20]
    tasks = Table(["task", "time"], [[name, fmt.duration(known[name])] for name in longest])
    return [table, folded(f"The {len(longest)} longest tasks", tasks)]


def _budget(budget: Mapping[str, Mapping[str, Mapping[str, float]]]) -> Table | None:
    """Return the error budget of the solver."""
    rows = {f"{signal}/{model}": own for signal, each in budget.items() for model, own in each.items() if own}
    columns: dict[str, Callable[[str], str]] = {"task": str}
    for name in dict.fromkeys(key for own in rows.values() for key in own):
        columns[name.replace("_", " ")] = lambda row, name=name: fmt.number(rows[row].get(name), 2)
    caption = "Error budget of the solver: changes by finer integration steps, within three sds of the mode"
    return Table.of(rows, columns, caption=caption) if rows else None


PLUGIN = ProvenanceSection()
