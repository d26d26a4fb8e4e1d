"""Read the Universal File Format (UFF), data set 58 (functions at nodal degrees of freedom), with pyuff."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bayesdamp.records.files.contents import Column, Contents, Reader, trim_facts
from bayesdamp.types import Fact, InputError

_SETS = re.compile(rb"(?:^|[\r\n])    -1[ \t]*\r?\n[ \t]{0,5}(\d{1,5})(b?)(?=[ \t\r\n])")
TIME_RESPONSE = (0, 1)
"""Codes for the type of a function in a data set 58 that may be a time record: general, time response. Other functions,
such as spectra, are left out."""
TIME_AXIS = (0, 17)
"""Codes for the quantity of the abscissa in a data set 58 that may be time: unknown, time."""
_ORDINATES = {8: ("m", "angle"), 11: ("m", "velocity"), 12: ("m", "acceleration")}
"""Unit and quantity of the values, by the code for the ordinate in a data set 58. The unit is used only if the data set
states no other."""
_DIRECTIONS = dict(
    zip(range(-6, 7), ("-RZ", "-RY", "-RX", "-Z", "-Y", "-X", "", "X", "Y", "Z", "RX", "RY", "RZ"))
)
"""Name of the direction of a degree of freedom, by its code in a data set 58: along an axis (X), or around it (RX)."""


class UffReader(Reader):
    """Reader of universal files, data set 58."""

    format = "a universal file (UFF)"
    extensions = (".uff", ".unv", ".uf", ".58", ".bunv")

    def claims(self, head: bytes, path: Path) -> bool:
        """Return whether the first bytes contain the opening lines of a data set; the path has no effect."""
        return _SETS.search(head) is not None

    def read(self, path: Path) -> Contents:
        """Return the time records in all data sets 58 as columns; a note counts the other functions, such as spectra.

        A record with equal sampling intervals gets a sampling rate, any other a column of times. Raises InputError if
        there are no time records, if the file is cut off, or if a sampling interval is not positive.
        """
        import pyuff

        file = pyuff.UFF(str(path))
        kinds = [int(kind) for kind in file.get_set_types()]
        if not kinds:
            raise InputError("contains no complete data set: the file is cut off; export it again")
        sets: list[Any] = [file.read_sets(i) for i, kind in enumerate(kinds) if kind == 58]
        if not sets:
            present = ", ".join(map(str, sorted(set(kinds))))
            raise InputError(
                f"its data sets are {present}; a record must be a data set of type 58; export time histories"
            )
        timed = [
            data
            for data in sets
            if int(data.get("func_type", 0)) in TIME_RESPONSE
            and not np.iscomplexobj(data["data"])
            and int(data.get("abscissa_spec_data_type", 17)) in TIME_AXIS
        ]
        if not timed:
            raise InputError(
                "none of its data sets 58 is a time record (are they spectra?); export the time histories"
            )
        for data in timed:
            samples, claimed = np.size(data["data"]), int(data["num_pts"])
            if samples < claimed:
                raise InputError(
                    f"is cut off: a data set has {samples} of the {claimed} samples in its header; export it again"
                )
        columns: list[Column] = []
        facts: dict[str, Fact] = {}
        names: list[str] = []
        for i, data in enumerate(timed, start=1):
            # Name: entity, node and direction of the response, else the description, else the number of the data set.
            named = _text(data, "rsp_ent_name")
            node = f"{int(data.get('rsp_node', 0))}{_DIRECTIONS.get(int(data.get('rsp_dir', 0)), '')}"
            named = f"{named} {node}".strip() if node != "0" else named or _text(data, "id1")
            name, number = named or f"set {i}", 2
            while name in names:
                name, number = f"{named} [{number}]", number + 1
            names.append(name)
            unit, quantity = _ORDINATES.get(int(data.get("ordinate_spec_data_type", 0)), ("", ""))
            unit = _text(data, "ordinate_axis_units_lab") or unit
            step, group = float(data.get("abscissa_inc", 0.0)), str(i) if len(timed) > 1 else ""
            column = Column(name, np.asarray(data["data"], float), group, unit=unit, quantity=quantity)
            if int(data["abscissa_spacing"]) != 1:
                columns += [Column(f"{name} time", np.asarray(data["x"], float), group, unit="s"), column]
            elif step > 0:
                columns.append(replace(column, rate=1 / step, start=float(data["abscissa_min"])))
            else:
                raise InputError(f"{name}: the sampling interval is {step:g} s; export it again")
            texts = {f"{name}: {key}": _text(data, key) for key in ("id1", "id2", "id3", "id4")}
            facts |= {key: text for key, text in texts.items() if text}
        left = len(sets) - len(timed)
        notes = (f"{left} data sets that are not records in time are left out.",) if left else ()
        return Contents("UFF 58", tuple(columns), trim_facts(facts), notes, channels=True)


def _text(data: Any, key: str) -> str:
    """Return the text with the name `key` in a data set; "" if it is NONE or missing."""
    text = str(data.get(key, "")).strip()
    return "" if text.upper() == "NONE" else text


PLUGIN = UffReader()
