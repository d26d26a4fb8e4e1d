"""Read National Instruments TDMS files with npTDMS."""

import logging
from pathlib import Path
from typing import Any

import numpy as np

from bayesdamp.records.files.contents import Column, Contents, Reader, refuse_large, trim_facts
from bayesdamp.records.files.tree import to_plain, to_seconds, unit_and_rate


class TdmsReader(Reader):
    """Reader of National Instruments TDMS files."""

    format = "a TDMS file"
    extensions = (".tdms",)

    def claims(self, head: bytes, path: Path) -> bool:
        """Return whether the first bytes are the tag of a TDMS segment; the path has no effect."""
        return head[:4] == b"TDSm"

    def read(self, path: Path) -> Contents:
        """Return the channels of all groups as columns; the columns of waveforms have a sampling rate.

        Channels that contain neither numbers nor timestamps are left out. If the end of the file is missing, the
        contents have a warning. Raises InputError if the channels need more than LARGEST_FILE bytes.
        """
        from nptdms import TdmsFile

        before = logging.root.manager.disable
        logging.disable()  # suppresses messages of the library about damaged segments
        try:
            # Open the file here, because the library does not close a damaged file.
            with path.open("rb") as stream, TdmsFile.open(stream) as file:
                facts: dict[str, Any] = {str(k): to_plain(v) for k, v in file.properties.items()}
                groups = [group for group in file.groups() if any(len(c) for c in group.channels())]
                refuse_large(sum(8 * len(channel) for group in groups for channel in group.channels()))
                columns: list[Column] = []
                for group in groups:
                    facts |= {f"{group.name}.{k}": to_plain(v) for k, v in group.properties.items()}
                    columns += _columns(group, f"{group.name}." if len(groups) > 1 else "")
                status = getattr(file, "file_status", None)
        finally:
            logging.disable(before)
        warnings = ()
        if status is not None and status.incomplete_final_segment:
            lost = [c.expected_length - c.read_length for c in (status.channel_statuses or {}).values()]
            many = f", {max(lost)} samples of a channel are missing" if lost and max(lost) > 0 else ""
            cut = f"the file is cut off in its last segment{many}"
            warnings = (f"{cut}: it was not closed, or not copied completely.",)
        return Contents("TDMS", tuple(columns), trim_facts(facts), warnings=warnings, channels=True)


def _columns(group: Any, prefix: str) -> list[Column]:
    """Return columns for the channels of a group with numbers or timestamps; their names begin with `prefix`."""
    columns: list[Column] = []
    for channel in group.channels():
        name, data, properties = f"{prefix}{channel.name}", np.asarray(channel[:]), channel.properties
        if data.dtype.kind == "M":
            columns.append(Column(name, to_seconds(data), group.name, unit="s"))
        elif data.dtype.kind in "fiub" and data.size:
            step = float(properties.get("wf_increment", 0.0) or 0.0)
            stated = unit_and_rate(trim_facts({str(k): to_plain(v) for k, v in properties.items()}))
            units = (properties.get(key) for key in ("unit_string", "NI_UnitDescription", "unit"))
            columns.append(
                Column(
                    name,
                    data.astype(float),
                    group.name,
                    unit=str(next(filter(None, units), "")).strip(),
                    rate=1 / step if step > 0 else stated["rate"],
                    start=float(properties.get("wf_start_offset", 0.0) or 0.0),
                )
            )
    return columns


PLUGIN = TdmsReader()
