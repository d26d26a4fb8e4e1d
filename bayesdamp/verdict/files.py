"""Write and read verdict.json and verdicts.csv, a run's verdicts on its records."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from bayesdamp.store.files import write_json
from bayesdamp.store.tables import write_table
from bayesdamp.verdict.types import Verdict, columns

JSON, TABLE = "verdict.json", "verdicts.csv"


def read(path: Path) -> list[Verdict]:
    """Read the JSON that `write` wrote.

    Raises
    ------
    OSError
        Where the file cannot be read.
    AttributeError, KeyError, TypeError, ValueError
        Where the file is something else.
    """
    return [Verdict.from_dict(entry) for entry in json.loads(path.read_text(encoding="utf-8"))]


def write(folder: Path, verdicts: Sequence[Verdict], shown: Sequence[Verdict] | None = None) -> None:
    """Write both files into a run's folder: an object and a line for each verdict.

    Parameters
    ----------
    folder
        The run's folder.
    verdicts
        In the order of the records, then those of the specimens.
    shown
        The same verdicts in the units that their records came in, for the table; `verdicts` by default.
    """
    write_json(folder / JSON, [v.to_dict() for v in verdicts])
    rows = [v.row() for v in shown or verdicts]
    names = columns()
    more = dict.fromkeys(s.term for v in verdicts for s in v.energy if s.term not in names)
    behind = names.index("quadratic") + 1
    write_table(folder / TABLE, (*names[:behind], *more, *names[behind:]), rows)
