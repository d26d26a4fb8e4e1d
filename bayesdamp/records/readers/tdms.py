"""National Instruments' TDMS (npTDMS)."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from bayesdamp.records.files.contents import Column, Contents, Reader
from bayesdamp.records.files.facts import kept, sampling_rate
from bayesdamp.records.files.limits import allowed
from bayesdamp.records.files.tree import plain, seconds_of


class TdmsReader(Reader):
    """National Instruments' TDMS by npTDMS."""

    format = "a TDMS file"
    extensions = (".tdms",)

    def claims(self, head: bytes, path: Path) -> bool:
        """The tag of its first segment."""
        return head[:4] == b"TDSm"

    def read(self, path: Path) -> Contents:
        """Channels of all groups, with their increments where they have a waveform."""
        from nptdms import TdmsFile

        columns: list[Column] = []
        # Opened here, since the library leaves a damaged file open.
        with _unlogged(), path.open("rb") as stream, TdmsFile.open(stream) as file:
            facts: dict[str, Any] = {str(k): plain(v) for k, v in file.properties.items()}
            groups = [group for group in file.groups() if any(len(c) for c in group.channels())]
            allowed(sum(8 * len(channel) for group in groups for channel in group.channels()))
            for group in groups:
                facts |= {f"{group.name}.{k}": plain(v) for k, v in group.properties.items()}
                for channel in group.channels():
                    column = _column(channel, group.name, len(groups) > 1)
                    columns += [column] if column is not None else []
            status = getattr(file, "file_status", None)
        warnings = ()
        if status is not None and status.incomplete_final_segment:
            lost = [one.expected_length - one.read_length for one in (status.channel_statuses or {}).values()]
            many = f", {max(lost)} samples of a channel are missing" if lost and max(lost) > 0 else ""
            what = (
                f"the file is cut off within its last segment{many}: it was not closed, or not copied whole."
            )
            warnings = (what,)
        return Contents("TDMS", tuple(columns), kept(facts), warnings=warnings, channels=True)


@contextmanager
def _unlogged() -> Iterator[None]:
    """Without the library's own lines on stderr about damaged segments."""
    before = logging.root.manager.disable
    logging.disable()
    try:
        yield
    finally:
        logging.disable(before)


def _column(channel: Any, group: str, several: bool) -> Column | None:
    data = np.asarray(channel[:])
    said = channel.properties
    name = f"{group}.{channel.name}" if several else channel.name
    if data.dtype.kind == "M":
        return Column(name, seconds_of(data), group, unit="s")
    if data.dtype.kind not in "fiub" or data.size == 0:
        return None
    step = float(said.get("wf_increment", 0.0) or 0.0)
    found = sampling_rate(kept({str(k): plain(v) for k, v in said.items()}))
    rate = 1 / step if step > 0 else found[0] if found else None
    unit = str(
        said.get("unit_string", "") or said.get("NI_UnitDescription", "") or said.get("unit", "") or ""
    )
    start = float(said.get("wf_start_offset", 0.0) or 0.0)
    return Column(name, data.astype(float), group, unit=unit.strip(), rate=rate, start=start)


PLUGIN = TdmsReader()
