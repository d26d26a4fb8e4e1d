"""Read a run's folder once, for all sections of its report."""

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
from bayesdamp.types import InputError, candidate_name
from bayesdamp.units import Unit, unit_named
from bayesdamp.verdict import files

Row = dict[str, Any]
_NUMBERS = ("sd_noise", "sd_law", "deviation", "deviation_low", "deviation_high", "unexplained_pct")
LATER: dict[str, object] = {"restoring": "", **dict.fromkeys(_NUMBERS, math.nan)}
"""Columns that earlier versions did not write, with the values that replace them."""


class RunFolder:
    """The contents of a run's folder. Everything except run.json may be missing.

    Attributes
    ----------
    folder
        Of the run.
    info
        The contents of run.json.
    verdicts
        Of records and specimens, in base units.
    estimates, posteriors, evidence, fits
        Rows of the tables. A row's `model` is the candidate's name: the damping sum, with the restoring law if the
        signal is compared under several laws.
    drawings
        Where figures are saved.

    Raises
    ------
    InputError
        If the folder, a table or verdict.json is not what a run writes.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = Path(folder)
        self.info = read_description(self.folder)
        self.estimates, self.posteriors, self.evidence, self.fits = (self._table(name) for name in TABLES)
        self.drawings = Drawings(self.folder / "figures")
        self._store = Store(self.folder, self.info.get("cells"))
        self._places = {name: Place.of(name) for name in self._store.names()}
        self._read: dict[str, CellResult | None] = {}
        path = self.folder / files.JSON
        try:
            self.verdicts = files.read(path)
        except (OSError, ValueError):
            self.verdicts = []
        except (AttributeError, KeyError, TypeError):
            raise InputError(f"{path}: not a file that a run wrote; run the study again") from None

    @classmethod
    def of_cells(cls, info: Row, cells: Sequence[CellResult]) -> Self:
        """Return a run of results in memory, without a folder."""
        run = cls.__new__(cls)
        run.info, run.drawings, run.verdicts = info, Drawings(None), []
        run.estimates, run.posteriors, run.evidence, run.fits = [], [], [], []
        run._read = {cell.name: cell for cell in cells}
        run._places = {name: Place.of(name) for name in run._read}
        return run

    @property
    def study(self) -> Row:
        """The resolved study, if run.json contains it."""
        return self.info.get("study") or {}

    @property
    def under_law(self) -> bool:
        """Whether samplers and evidence allowed deviations from the laws."""
        return (self.study.get("posterior") or {}).get("deviation") == "law"

    @property
    def signals(self) -> list[str]:
        """Names of the signals, in the study's order."""
        rows = (row["signal"] for row in self._rows)
        cells = (place.record for place in self._places.values() if place.kind == "signal")
        return list(dict.fromkeys([*(self.info.get("signals") or {}), *rows, *cells]))

    @property
    def models(self) -> list[str]:
        """Names of the damping models, in the study's order."""
        return list(dict.fromkeys([*(self.info.get("models") or []), *(row["model"] for row in self._rows)]))

    @property
    def _rows(self) -> list[Row]:
        return [*self.estimates, *self.posteriors, *self.evidence, *self.fits]

    def about(self, signal: str) -> Row:
        """Return the description of a signal in run.json: notes, unit, quantity, simulated, ..."""
        return (self.info.get("signals") or {}).get(signal) or {}

    def unit(self, signal: str) -> Unit:
        """Return the unit of a signal's record."""
        return unit_named(self.about(signal).get("unit") or "rad")

    def quantity(self, signal: str) -> str:
        """Return the recorded quantity: "angle", "velocity", "acceleration" or "envelope"."""
        return str(self.about(signal).get("quantity") or "angle")

    def rms(self, row: Row) -> str:
        """Return the residual of a row of fits.csv, which is in the unit of the record."""
        unit = self.unit(row["signal"]).of(self.quantity(row["signal"]))
        return f"{number(row['rms'], 3)} {unit}"

    def provenance(self, signal: str) -> Provenance:
        """Return how a signal's record was read."""
        return Provenance.of(self.about(signal))

    def simulated(self, signal: str) -> bool:
        """Return whether the program simulated the signal, so that the truth is known."""
        return bool(self.about(signal).get("simulated"))

    def simulation(self, signal: str) -> Row:
        """Return how the program simulated the signal, as in the study: damping, true values, duration and so on."""
        studied = (s for s in self.study.get("signals") or [] if isinstance(s, dict) and s["name"] == signal)
        source = next(studied, {}).get("source") or {}
        return source if "damping" in source else {}

    def repeats(self, signal: str) -> list[int]:
        """Return the numbers of a signal's repeats, at least one."""
        tables = {row["repeat"] for row in self._rows if row["signal"] == signal}
        cells = {place.repeat for place in self._places.values() if place.record == signal}
        return sorted(r for r in tables | cells if r is not None) or [0]

    def cell(self, *parts: object) -> CellResult | None:
        """Return a stored result by the parts of its name; None if there is none that can be read."""
        name = "/".join(map(str, parts))
        if name not in self._read:
            self._read[name] = self._store.find(name) if name in self._places else None
        return self._read[name]

    def cells(self, *parts: object) -> list[CellResult]:
        """Return all readable results whose names begin with these parts."""
        prefix = "".join(f"{part}/" for part in parts)
        results = (self.cell(name) for name in self._places if name.startswith(prefix))
        return [cell for cell in results if cell is not None]

    def _table(self, name: str) -> list[Row]:
        path = self.folder / name
        if not path.is_file():
            return []
        later = LATER | ({"deviation": ""} if (name, "deviation") in TEXT_OF else {})
        rows = [{**later, **row} for row in read_table(path)]
        missing = set(TABLES[name]) - set(rows[0]) if rows else set()
        if missing:
            raise InputError(
                f"{path}: column {', '.join(sorted(missing))} is missing; was this file written by a run?"
            )
        for row in rows:
            if len(self.about(row["signal"]).get("restoring") or ()) > 1:
                row["model"] = candidate_name(row["model"], row["restoring"])
        return rows


def rows_of(rows: Iterable[Row], **wanted: object) -> list[Row]:
    """Return the rows whose columns have these values."""
    return [row for row in rows if all(row[column] == value for column, value in wanted.items())]
