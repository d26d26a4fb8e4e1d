"""Show how the report was made: software, machine, input files, and tasks without a result."""

from bayesdamp.formatting import Table
from bayesdamp.report.results.run import RunFolder
from bayesdamp.report.sections import Section, collapsible, stack
from bayesdamp.types import OK, Status, status_of

FACTS = "Revision of the source code, the machine, the seed of the random numbers, and digests of the input files."


class ProvenanceSection(Section):
    """The section with the versions of the software, the machine, the input files, and the tasks without a result."""

    order = 90
    title = "How this report was made"

    def render(self, run: RunFolder) -> str:
        """Return tables of the input files, the software, the machine, and the tasks whose outcome is not `ok`.

        Pruned tasks are left out.
        """
        info, text = run.info, (0, 1)
        facts = {
            "source revision": info.get("revision"),
            **(info.get("machine") or {}),
            "seed": info.get("seed"),
            **{f"SHA-256 of {name}": digest for name, digest in (info.get("inputs") or {}).items()},
        }
        lines = [[name, str(value)] for name, value in facts.items() if value is not None]
        versions = list((info.get("versions") or {}).items())
        parts: list[object] = [Table(["item", "value"], lines, text, FACTS)] if lines else []
        if versions:
            table = Table(["package", "version"], versions, text)
            parts.append(collapsible(f"Versions of {len(versions)} packages", table))
        tasks: dict[str, list[str]] = {}
        for task_result in run.task_results():
            # The section on the evidence shows pruned tasks.
            if task_result.outcome != OK and status_of(task_result.outcome) is not Status.PRUNED:
                tasks.setdefault(task_result.outcome, []).append(task_result.name)
        if tasks:
            count = sum(map(len, tasks.values()))
            lines = [
                [why, ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")]
                for why, names in tasks.items()
            ]
            caption = f"{count} task{'s' if count > 1 else ''} ended without a result, by reason."
            parts.append(Table(["reason", "tasks"], lines, text, caption))
        return stack(*parts)


PLUGIN = ProvenanceSection()
