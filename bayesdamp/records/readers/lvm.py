"""LabVIEW measurement files, which are text (lvm_read)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from bayesdamp.provenance import Fact
from bayesdamp.records.files.contents import Column, Contents
from bayesdamp.records.files.facts import kept
from bayesdamp.records.readers.text import LARGEST, decoded
from bayesdamp.types import InputError

_MARK = b"LabVIEW Measurement"


class LvmReader:
    """LabVIEW measurement files by lvm_read."""

    format = "a LabVIEW measurement file"
    extensions = (".lvm",)
    extra = ""

    def claims(self, head: bytes, path: Path) -> bool:
        """The header's first words."""
        return head.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(_MARK)

    def read(self, path: Path) -> Contents:
        """Channels of all segments. Raises InputError for a text that is too large."""
        import lvm_read

        if path.stat().st_size > LARGEST:
            raise InputError(f"a text of more than {LARGEST >> 20} MiB; give a part of it")
        # Not lvm_read.read, which would take a pickle that lies beside the file.
        data = lvm_read.read_str(decoded(path.read_bytes()).replace("\r\n", "\n"))
        count = int(data["Segments"])
        columns: list[Column] = []
        for i in range(count):
            columns += _columns(
                data[i], str(data.get("X_Columns", "One")).strip(), str(i + 1) if count > 1 else ""
            )
        facts: dict[str, Fact] = {k: v for k, v in data.items() if isinstance(k, str) and isinstance(v, str)}
        return Contents("LVM", tuple(columns), kept(facts), channels=True)


def _columns(segment: dict[str, Any], axes: str, run: str) -> list[Column]:
    """A segment's columns: times where it has them, else each channel's own rate."""
    table = np.asarray(segment["data"], float)
    table = table.reshape(len(table), -1)
    names = [str(name).strip() for name in segment["Channel names"]]
    units = [str(u).strip() for u in segment.get("Y_Unit_Label", [])]
    steps, starts = segment.get("Delta_X", []), segment.get("X0", [])
    prefix = f"{run}." if run else ""
    found: list[Column] = []
    channel = axis = 0
    for i, name in enumerate(names[: table.shape[1]]):
        values = table[:, i]
        if name == "Comment" or (not name and np.all(np.isnan(values))):
            continue
        empty = np.isnan(values)
        if name == "X_Value" and axes != "No":
            axis += 1
            suffix = f" {axis}" if axes == "Multi" else ""
            if np.any(~empty):
                found.append(
                    Column(f"{prefix}X_Value{suffix}", values, f"{run}/{axis}", run, "s", empty=empty)
                )
            continue
        step = float(steps[channel]) if channel < len(steps) else 0.0
        start = float(starts[channel]) if channel < len(starts) else 0.0
        timed = axes != "No" and any(c.group == f"{run}/{axis}" for c in found)
        found.append(
            Column(
                f"{prefix}{name}",
                values,
                f"{run}/{axis}",
                run,
                units[channel] if channel < len(units) else "",
                rate=1 / step if step > 0 and not timed else None,
                start=start if np.isfinite(start) else 0.0,
                empty=empty,
            )
        )
        channel += 1
    return found


PLUGIN = LvmReader()
