"""Read and write the folder of a run: results of tasks, tables, provenance, and the lock."""

from bayesdamp.store.files import write_bytes, write_json
from bayesdamp.store.origin import provenance, sha256
from bayesdamp.store.results import Store, TaskResult
from bayesdamp.store.tables import (
    CALIBRATION_TABLES,
    DAMPING_CURVES,
    POPULATION,
    TABLES,
    TEXT_COLUMNS,
    read_table,
    write_table,
)

__all__ = [
    "CALIBRATION_TABLES",
    "DAMPING_CURVES",
    "POPULATION",
    "TABLES",
    "TEXT_COLUMNS",
    "Store",
    "TaskResult",
    "provenance",
    "read_table",
    "sha256",
    "write_bytes",
    "write_json",
    "write_table",
]
