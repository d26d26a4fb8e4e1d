"""Parquet tables (pyarrow)."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from bayesdamp.records.files.contents import Column, Contents
from bayesdamp.records.files.facts import kept
from bayesdamp.records.files.limits import allowed
from bayesdamp.records.files.tree import described, seconds_of
from bayesdamp.types import InputError


class ParquetReader:
    """Apache Parquet by pyarrow."""

    format = "a Parquet file"
    extensions = (".parquet", ".pq")
    extra = "parquet"

    def claims(self, head: bytes, path: Path) -> bool:
        """PAR1, or PARE where it is encrypted."""
        return head[:4] in (b"PAR1", b"PARE")

    def read(self, path: Path) -> Contents:
        """Numeric and time columns. Raises InputError where it is encrypted."""
        import pyarrow
        import pyarrow.parquet as parquet

        with path.open("rb") as raw:
            if raw.read(4) == b"PARE":
                raise InputError("is encrypted; save it without a key")
        with parquet.ParquetFile(path) as file:
            meta = file.metadata
            sizes = [meta.row_group(i).total_byte_size for i in range(meta.num_row_groups)]
            allowed(max(sum(sizes), 8 * meta.num_rows * meta.num_columns))
            table = file.read()
        columns = []
        for field, data in zip(table.schema, table.columns, strict=True):
            numeric = pyarrow.types.is_integer(field.type) or pyarrow.types.is_floating(field.type)
            timed = pyarrow.types.is_timestamp(field.type) or pyarrow.types.is_duration(field.type)
            if not (numeric or timed or pyarrow.types.is_decimal(field.type)):
                continue
            found = np.asarray(data.to_numpy())
            empty = np.asarray(data.is_null().to_numpy(), bool)
            said = described(_words(field.metadata))
            if timed:
                found, said["unit"] = seconds_of(found), "s"
            columns.append(Column(field.name, found.astype(float), empty=empty, **said))
        facts = {
            k: v for k, v in _words(table.schema.metadata).items() if k not in ("pandas", "ARROW:schema")
        }
        return Contents("Parquet", tuple(columns), kept(facts))


def _words(metadata: dict[bytes, bytes] | None) -> dict[str, str | float]:
    found: dict[str, str | float] = {}
    for key, value in (metadata or {}).items():
        text = value.decode("utf-8", "replace")
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        found[key.decode("utf-8", "replace")] = number if math.isfinite(number) else text
    return found


PLUGIN = ParquetReader()
