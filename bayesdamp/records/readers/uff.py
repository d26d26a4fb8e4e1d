"""Universal File Format, data set 58: functions at nodal degrees of freedom (pyuff)."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from bayesdamp.provenance import Fact
from bayesdamp.records.files.contents import Column, Contents, Reader
from bayesdamp.records.files.facts import kept
from bayesdamp.types import InputError

_SETS = re.compile(rb"(?:^|[\r\n])    -1[ \t]*\r?\n[ \t]{0,5}(\d{1,5})(b?)(?=[ \t\r\n])")
TIME_RESPONSE = (0, 1)
"""Function types of a record in time: general, time response."""
TIME_AXIS = (0, 17)
"""Specific data types of an abscissa in time: unknown, time."""
_ORDINATES = {8: ("m", "angle"), 11: ("m", "velocity"), 12: ("m", "acceleration")}
"""Of a data set's ordinate, by its specific data type; SI unless it names its unit."""
_DIRECTIONS = dict(
    zip(range(-6, 7), ("-RZ", "-RY", "-RX", "-Z", "-Y", "-X", "", "X", "Y", "Z", "RX", "RY", "RZ"))
)


class UffReader(Reader):
    """Universal files, data set 58, by pyuff."""

    format = "a universal file (UFF)"
    extensions = (".uff", ".unv", ".uf", ".58", ".bunv")

    def claims(self, head: bytes, path: Path) -> bool:
        """A data set's opening lines."""
        return _SETS.search(head) is not None

    def read(self, path: Path) -> Contents:
        """The functions of all data sets 58."""
        import pyuff

        file = pyuff.UFF(str(path))
        kinds = [int(kind) for kind in file.get_set_types()]
        at = [i for i, kind in enumerate(kinds) if kind == 58]
        if not at:
            if not kinds:
                raise InputError("no data set in it is whole: it is cut off; export it again")
            held = ", ".join(map(str, sorted(set(kinds))))
            raise InputError(f"its data sets are {held}; a record is a data set 58: export time histories")
        sets: list[Any] = [file.read_sets(i) for i in at]
        timed = [s for s in sets if _timed(s)]
        if not timed:
            raise InputError("its data sets 58 are no records in time (spectra?); export the time histories")
        for data in timed:
            held, claimed = np.size(data["data"]), int(data["num_pts"])
            if held < claimed:
                raise InputError(
                    f"is cut off: a data set claims {claimed} samples and has {held}; export it again"
                )
        names = _names(timed)
        columns: list[Column] = []
        for i, (data, name) in enumerate(zip(timed, names, strict=True), start=1):
            columns += _columns(data, name, str(i) if len(timed) > 1 else "")
        facts: dict[str, Fact] = {
            f"{name}: {key}": str(s[key]).strip()
            for s, name in zip(timed, names, strict=True)
            for key in ("id1", "id2", "id3", "id4")
            if str(s.get(key, "")).strip().upper() not in ("", "NONE")
        }
        left = len(sets) - len(timed)
        notes = (f"{left} data sets that are no records in time are left out.",) if left else ()
        return Contents("UFF 58", tuple(columns), kept(facts), notes, channels=True)


def _timed(data: Any) -> bool:
    kind = int(data.get("func_type", 0)) in TIME_RESPONSE and not np.iscomplexobj(data["data"])
    return kind and int(data.get("abscissa_spec_data_type", 17)) in TIME_AXIS


def _names(sets: list[Any]) -> list[str]:
    """A name for each data set: its response's node and direction, else its own words, else its number."""
    found: list[str] = []
    for data in sets:
        entity = str(data.get("rsp_ent_name", "")).strip()
        node = f"{int(data.get('rsp_node', 0))}{_DIRECTIONS.get(int(data.get('rsp_dir', 0)), '')}"
        words = str(data.get("id1", "")).strip()
        entity = "" if entity.upper() == "NONE" else entity
        named = (
            f"{entity} {node}".strip()
            if node != "0"
            else entity or ("" if words.upper() == "NONE" else words)
        )
        name = named or f"set {len(found) + 1}"
        number = 2
        while name in found:
            name, number = f"{named} [{number}]", number + 1
        found.append(name)
    return found


def _columns(data: Any, name: str, group: str) -> list[Column]:
    unit, quantity = _ORDINATES.get(int(data.get("ordinate_spec_data_type", 0)), ("", ""))
    written = str(data.get("ordinate_axis_units_lab", "")).strip()
    unit = written if written.upper() not in ("", "NONE") else unit
    values, x = np.asarray(data["data"], float), np.asarray(data["x"], float)
    if int(data["abscissa_spacing"]) == 1:
        step = float(data["abscissa_inc"])
        if not step > 0:
            raise InputError(f"{name}: its samples are {step:g} s apart; export it again")
        start = float(data["abscissa_min"])
        return [Column(name, values, group, unit=unit, quantity=quantity, rate=1 / step, start=start)]
    time = Column(f"{name} time", x, group, unit="s")
    return [time, Column(name, values, group, unit=unit, quantity=quantity)]


PLUGIN = UffReader()
