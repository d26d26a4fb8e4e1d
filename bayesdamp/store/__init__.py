"""The folder of a run: one atomic file a cell, the tables, provenance, and a lock."""

from bayesdamp.store.cells import CellResult, Store
from bayesdamp.store.files import write_bytes, write_json
from bayesdamp.store.origin import provenance, sha256
from bayesdamp.store.tables import (
    CALIBRATION_TABLES,
    DAMPING_CURVES,
    SPECIMEN_TABLES,
    TABLES,
    TEXT_OF,
    read_table,
    write_table,
)

__all__ = [
    "CALIBRATION_TABLES",
    "DAMPING_CURVES",
    "SPECIMEN_TABLES",
    "TABLES",
    "TEXT_OF",
    "CellResult",
    "Store",
    "provenance",
    "read_table",
    "sha256",
    "write_bytes",
    "write_json",
    "write_table",
]
