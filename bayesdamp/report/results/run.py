"""A run's folder, read once, as the sections want it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Self

from bayesdamp.formatting import number
from bayesdamp.provenance import Provenance
from bayesdamp.report.drawing import Drawings
from bayesdamp.store import TABLES, TEXT_OF, CellResult, Store, read_table
from bayesdamp.store.cells import Place
from bayesdamp.store.files import read_description
from bayesdamp.types import OK, InputError, candidate_name
from bayesdamp.units import Unit, unit_named
from bayesdamp.verdict import files
from bayesdamp.verdict.types import Verdict

Row = dict[str, Any]
_NUMBERS = ("sd_noise", "sd_law", "deviation", "deviation_low", "deviation_high", "unexplained_pct")
LATER: dict[str, object] = {"restoring": "", **dict.fromkeys(_NUMBERS, math.nan)}
"""Columns that earlier runs did not write, and what stands in for them."""


class Run:
    """What a folder holds. Anything but run.json may be missing.

    info: run.json. verdicts: of records and specimens, in base units. estimates, posteriors, evidence, fits: the rows
    of the tables, if any. A row's `model` is its candidate's name: the damping sum, with the restoring law where the
    signal is compared under several.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = Path(folder)
        self.info = read_description(self.folder)
        self.estimates, self.posteriors, self.evidence, self.fits = (self._table(name) for name in TABLES)
        self.drawings = Drawings(self.folder / "figures")
        self._store = Store(self.folder, self.info.get("cells"))
        self._names = self._store.names()
        self._places = [Place.of(name) for name in self._names]
        self._read: dict[str, CellResult | None] = {}
        self.verdicts = read_verdicts(self.folder)

    @classmethod
    def of_cells(cls, info: Row, cells: Sequence[CellResult], verdicts: Sequence[Verdict] = ()) -> Self:
        """Make a run of results in memory, without a folder."""
        run = cls.__new__(cls)
        run.info, run.drawings, run.verdicts = info, Drawings(None), list(verdicts)
        run.estimates, run.posteriors, run.evidence, run.fits = [], [], [], []
        run._read = {cell.name: cell for cell in cells}
        run._names = list(run._read)
        run._places = [Place.of(name) for name in run._names]
        return run

    @property
    def study(self) -> Row:
        """The resolved study, as far as run.json has it."""
        return self.info.get("study") or {}

    @property
    def under_law(self) -> bool:
        """Whether its samplers and evidence had laws hold approximately."""
        return (self.study.get("posterior") or {}).get("deviation") == "law"

    @property
    def signals(self) -> list[str]:
        """Names of the signals, in the study's order."""
        tables = (row["signal"] for rows in self._tables for row in rows)
        cells = (place.record for place in self._places if place.kind == "signal")
        return _unique([*(self.info.get("signals") or {}), *tables, *cells])

    @property
    def models(self) -> list[str]:
        """Names of the damping models, in the study's order."""
        return _unique([*(self.info.get("models") or []), *(r["model"] for t in self._tables for r in t)])

    @property
    def _tables(self) -> tuple[list[Row], ...]:
        return self.estimates, self.posteriors, self.evidence, self.fits

    def about(self, signal: str) -> Row:
        """What run.json says of a signal: notes, unit, quantity, simulated, ..."""
        return (self.info.get("signals") or {}).get(signal) or {}

    def unit(self, signal: str) -> Unit:
        """The unit that a signal's record came in."""
        return unit_named(self.about(signal).get("unit") or "rad")

    def quantity(self, signal: str) -> str:
        """What was recorded of a signal: "angle", "velocity", "acceleration" or "envelope"."""
        return str(self.about(signal).get("quantity") or "angle")

    def rms(self, row: Row) -> str:
        """Return the residual of a line of fits.csv in the unit that the record came in."""
        unit = self.unit(row["signal"])
        return f"{number(row['rms'] * unit.scale, 3)} {unit.of(self.quantity(row['signal']))}"

    def provenance(self, signal: str) -> Provenance:
        """How a signal's record was read."""
        return Provenance.of(self.about(signal))

    def simulated(self, signal: str) -> bool:
        """Whether the signal was made by the program, so that the truth is known."""
        return bool(self.about(signal).get("simulated"))

    def repeats(self, signal: str) -> list[int]:
        """Numbers of a signal's repeats, at least one."""
        tables = {row["repeat"] for rows in self._tables for row in rows if row["signal"] == signal}
        cells = {place.repeat for place in self._places if place.record == signal}
        return sorted(r for r in tables | cells if r is not None) or [0]

    def cell(self, *parts: object) -> CellResult | None:
        """A stored cell by the parts of its name; None where there is none that can be read."""
        name = "/".join(map(str, parts))
        if name not in self._read:
            try:
                self._read[name] = self._store.read(name) if name in self._names else None
            except KeyError:
                self._read[name] = None
        return self._read[name]

    def cells(self, *parts: object) -> list[CellResult]:
        """All readable cells below these parts of a name."""
        below = "/".join(map(str, parts)) + "/"
        found = (self.cell(name) for name in self._names if name.startswith(below))
        return [cell for cell in found if cell is not None]

    def not_ok(self) -> list[CellResult]:
        """The readable cells that ended with a sentence."""
        found = (self.cell(name) for name in self._names)
        return [cell for cell in found if cell is not None and cell.outcome != OK]

    def _table(self, name: str) -> list[Row]:
        path = self.folder / name
        if not path.is_file():
            return []
        rows = read_table(path)
        later = LATER | ({"deviation": ""} if (name, "deviation") in TEXT_OF else {})
        rows = [{**later, **row} for row in rows]
        missing = set(TABLES[name]) - set(rows[0]) if rows else set()
        if missing:
            raise InputError(
                f"{path}: column {', '.join(sorted(missing))} is missing; was it written by a run?"
            )
        for row in rows:
            if len(self.about(row["signal"]).get("restoring") or ()) > 1:
                row["model"] = candidate_name(row["model"], row["restoring"])
        return rows


def read_verdicts(folder: Path) -> list[Verdict]:
    """Return what verdict.json holds; nothing where there is none. Raises InputError where it holds something else."""
    path = folder / files.JSON
    try:
        return files.read(path)
    except (OSError, ValueError):
        return []
    except (AttributeError, KeyError, TypeError):
        raise InputError(f"{path}: is not as a run wrote it; run it again") from None


def rows_of(rows: Iterable[Row], **wanted: object) -> list[Row]:
    """The rows whose columns have these values."""
    return [row for row in rows if all(row[column] == value for column, value in wanted.items())]


def _unique(items: Iterable[str]) -> list[str]:
    return list(dict.fromkeys(items))
