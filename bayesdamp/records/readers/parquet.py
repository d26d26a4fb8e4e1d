"""Read Parquet tables with pyarrow."""

from pathlib import Path

import numpy as np

from bayesdamp.records.files.contents import Column, Contents, Reader, refuse_large, trim_facts
from bayesdamp.records.files.tree import to_seconds, unit_and_rate
from bayesdamp.types import InputError


class ParquetReader(Reader):
    """Reader of Apache Parquet files."""

    format = "a Parquet file"
    extensions = (".parquet", ".pq")
    extra = "parquet"

    def claims(self, head: bytes, path: Path) -> bool:
        """Return whether `head` begins with PAR1, or PARE (encrypted, refused by `read`); the path has no effect."""
        return head[:4] in (b"PAR1", b"PARE")

    def read(self, path: Path) -> Contents:
        """Return the columns that contain numbers, timestamps or durations; other columns are left out.

        Timestamps and durations become seconds (`to_seconds`). Raises InputError if the file is encrypted or unpacks to
        more than LARGEST_FILE bytes.
        """
        import pyarrow
        import pyarrow.parquet as parquet

        with path.open("rb") as raw:
            if raw.read(4) == b"PARE":
                raise InputError("is encrypted; save it without a key")
        with parquet.ParquetFile(path) as file:
            meta = file.metadata
            sizes = [meta.row_group(i).total_byte_size for i in range(meta.num_row_groups)]
            refuse_large(max(sum(sizes), 8 * meta.num_rows * meta.num_columns))
            table = file.read()
        columns: list[Column] = []
        for field, data in zip(table.schema, table.columns, strict=True):
            numeric = pyarrow.types.is_integer(field.type) or pyarrow.types.is_floating(field.type)
            timed = pyarrow.types.is_timestamp(field.type) or pyarrow.types.is_duration(field.type)
            if not (numeric or timed or pyarrow.types.is_decimal(field.type)):
                continue
            values = np.asarray(data.to_numpy())
            empty = np.asarray(data.is_null().to_numpy(), bool)
            stated = unit_and_rate(_attributes(field.metadata))
            if timed:
                values, stated["unit"] = to_seconds(values), "s"
            columns.append(Column(field.name, values.astype(float), empty=empty, **stated))
        facts = _attributes(table.schema.metadata)
        for name in ("pandas", "ARROW:schema"):
            facts.pop(name, None)
        return Contents("Parquet", tuple(columns), trim_facts(facts))


def _attributes(metadata: dict[bytes, bytes] | None) -> dict[str, str | float]:
    """Decode metadata of a Parquet file to values by name: finite numbers where possible, else texts.

    The result is empty if the metadata are None.
    """
    attributes: dict[str, str | float] = {}
    for key, value in (metadata or {}).items():
        text = value.decode("utf-8", "replace")
        try:
            number = float(text)
        except ValueError:
            number = np.nan
        attributes[key.decode("utf-8", "replace")] = number if np.isfinite(number) else text
    return attributes


PLUGIN = ParquetReader()
