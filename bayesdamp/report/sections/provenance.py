"""With what, on what and in what time it was made."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from bayesdamp import formatting as fmt
from bayesdamp.outcomes import Status, status_of
from bayesdamp.report.html import folded, stack
from bayesdamp.report.results.run import Run
from bayesdamp.report.sections._layout import Section
from bayesdamp.store.cells import Place
from bayesdamp.table import Line, Table


class Provenance(Section):
    """Versions, revision, machine, inputs, and the seconds of each kind of cell."""

    order = 90
    title = "How this was made"

    def render(self, run: Run) -> str:
        """What the numbers were made by and from."""
        info = run.info
        facts = [
            ("source revision", info.get("revision")),
            *(info.get("machine") or {}).items(),
            ("seed", info.get("seed")),
        ]
        lines = [Line([name, str(value)]) for name, value in facts if value is not None]
        text = frozenset({0, 1})
        parts: list[object] = [Table(["fact", "value"], lines, text)] if lines else []
        inputs: Mapping[str, str] = info.get("inputs") or {}
        if inputs:
            parts.append(Table(["input", "SHA-256"], [Line([k, v]) for k, v in inputs.items()], text))
        versions: Mapping[str, str] = info.get("versions") or {}
        if versions:
            table = Table(["package", "version"], [Line([k, v]) for k, v in versions.items()], text)
            parts.append(folded(f"Versions of {len(versions)} packages", table))
        parts += _without_result(run)
        parts += _timing(info.get("seconds") or {})
        parts += _budget(info.get("error_budget") or {})
        return stack(*parts)


def _without_result(run: Run) -> list[object]:
    """The sentences that tasks ended with instead of a result, each with the names of its tasks."""
    found: dict[str, list[str]] = {}
    for cell in run.not_ok():
        if status_of(cell.outcome) is not Status.PRUNED:  # the evidence section has these
            found.setdefault(cell.outcome, []).append(cell.name)
    if not found:
        return []
    count = sum(map(len, found.values()))
    lines = [
        Line([outcome, ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")])
        for outcome, names in found.items()
    ]
    caption = f"{count} task{'s' if count > 1 else ''} ended with a sentence instead of a result"
    return [Table(["sentence", "tasks"], lines, frozenset({0, 1}), caption)]


def _timing(seconds: Mapping[str, float]) -> list[object]:
    known = {name: s for name, s in seconds.items() if isinstance(s, (int, float))}
    if not known:
        return []
    kinds: dict[str, list[float]] = {}
    for name, s in known.items():
        kinds.setdefault(Place.of(name).kind, []).append(s)
    rows = [*kinds.items(), ("all", list(known.values()))]
    columns: dict[str, Callable[[tuple[str, list[float]]], str]] = {
        "stage": lambda row: row[0],
        "tasks": lambda row: str(len(row[1])),
        "together": lambda row: fmt.duration(sum(row[1])),
        "the longest": lambda row: fmt.duration(max(row[1])),
    }
    table = Table.of(rows, columns, caption="Time, summed over workers")
    longest = sorted(known, key=lambda name: -known[name])[:20]
    cells = Table(["task", "time"], [Line([name, fmt.duration(known[name])]) for name in longest])
    return [table, folded(f"The {len(longest)} longest tasks", cells)]


def _budget(budget: Mapping[str, Mapping[str, Mapping[str, float]]]) -> list[object]:
    rows = [
        (f"{signal}/{model}", own) for signal, each in budget.items() for model, own in each.items() if own
    ]
    columns: dict[str, Callable[[tuple[str, Mapping[str, float]]], str]] = {"where": lambda row: row[0]}
    for name in dict.fromkeys(key for _, own in rows for key in own):
        columns[name.replace("_", " ")] = lambda row, name=name: fmt.number(row[1].get(name), 2)
    caption = (
        "What finer integration steps change within three sds of the mode: the error budget of the solver"
    )
    return [Table.of(rows, columns, caption=caption)] if rows else []


PLUGIN = Provenance()
