"""Read HDF5 files, including MATLAB 7.3, with h5py."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bayesdamp.records.files.contents import Contents, Reader, refuse_large, trim_facts
from bayesdamp.records.files.tree import DEEPEST_LEVEL, Walk, join_path, to_plain, unit_and_rate
from bayesdamp.types import InputError

_MAGIC = b"\x89HDF\r\n\x1a\n"
_PACKED, _MISSING = ("scale_factor", "add_offset"), ("_FillValue", "missing_value")
"""Names of attributes of netCDF and xarray: `_PACKED` marks packed numbers, which are refused; `_MISSING` contains the
value of missing numbers, which become NaN (CF-1.11, 8.1 and 2.5.1)."""


class Hdf5Reader(Reader):
    """Reader of HDF5 files, including MATLAB 7.3."""

    foreign = True
    format = "an HDF5 or MATLAB 7.3 file"
    extensions = (".h5", ".hdf5", ".hdf", ".he5")

    def claims(self, head: bytes, path: Path) -> bool:
        """Return whether the file has the HDF5 signature at byte 0, 512, 1024 or 2048, or a MATLAB 7.3 header.

        Only its first bytes, `head`, are examined.
        """
        signed = any(head[at : at + 8] == _MAGIC for at in (0, 512, 1024, 2048))
        return signed or head.startswith(b"MATLAB 7.3")

    def read(self, path: Path) -> Contents:
        """Return the numeric datasets as columns named by their paths.

        Attributes, single numbers and texts become facts about the file. Numbers that an attribute in `_MISSING`
        declares as missing become NaN. Soft and external links are not followed. Raises InputError if there are no such
        datasets, if a dataset is stored in another file or contains packed (scaled) numbers, or if all datasets
        together have more than LARGEST_FILE bytes.
        """
        import h5py

        with path.open("rb") as head:
            matlab = b"MATLAB 7.3" in head.read(128) or path.suffix.lower() == ".mat"
        with h5py.File(path, "r") as file:
            walk = _GroupWalk(h5py, "MATLAB_version" in file.attrs or matlab)
            walk.visit("", file, "", 0)
        return walk.contents("MATLAB 7.3" if matlab else "HDF5")


class _GroupWalk(Walk):
    """Collector of columns and facts (named numbers and texts) in HDF5 groups and datasets.

    Datasets to which the cells of a MATLAB cell array refer are collected too; several are runs, numbered from 1.
    """

    def __init__(self, h5py: Any, matlab: bool) -> None:
        super().__init__()
        self.h5py, self.matlab = h5py, matlab
        self.total = 0

    def visit(self, path: str, item: Any, run: str, depth: int) -> None:
        """Collect the columns and facts of a group or dataset, and of all groups and datasets below it.

        Raises InputError for data in another file, packed numbers, and more than LARGEST_FILE bytes. path: path of the
        item in the file, with dots. run: run (one of several measurements) to which the item belongs, "" for none.
        depth: number of levels above the item.
        """
        if depth > DEEPEST_LEVEL:
            return
        if isinstance(item, self.h5py.Group):
            self._add_facts(path, item)
            for key in item:
                # Follow only hard links: other links may point to any file of the machine.
                if not key.startswith("#") and isinstance(item.get(key, getlink=True), self.h5py.HardLink):
                    self.visit(join_path(path, key), item[key], run, depth + 1)
            return
        if not isinstance(item, self.h5py.Dataset):
            return
        if item.is_virtual or item.external:
            raise InputError(f"{path[:60]!r} is stored in another file; copy the data into one file")
        if item.shape is None:
            return
        self.total += item.dtype.itemsize * int(np.prod(item.shape, dtype=object))
        refuse_large(self.total)
        data = item[()]
        if item.dtype == self.h5py.ref_dtype:
            refs = [ref for ref in np.asarray(data).ravel() if ref]
            for i, ref in enumerate(refs, start=1):
                self.visit(f"{path}.{i}", item.file[ref], run or (str(i) if len(refs) > 1 else ""), depth + 1)
        elif self.h5py.check_string_dtype(item.dtype) is not None:
            if np.size(data) == 1:
                self.facts[path] = str(to_plain(np.ravel(data)[0]))
        elif to_plain(item.attrs.get("MATLAB_class", "")) == "char":
            self.facts[path] = "".join(chr(c) for c in np.ravel(data)[:200])
        elif "MATLAB_empty" not in item.attrs:
            stated = unit_and_rate(trim_facts(self._add_facts(path, item)))
            array, before = np.asarray(data), len(self.columns)
            if any(name in item.attrs for name in _PACKED) and array.size > 1:
                packed = f"the numbers of {path[:60]!r} are packed ({', '.join(_PACKED)})"
                raise InputError(f"{packed}; unpack them (xarray does)")
            for name in _MISSING:
                if name in item.attrs and array.dtype.kind in "fiu":
                    array = np.where(array == item.attrs[name], np.nan, array)
            self.add(path, array.T if self.matlab else array, run, depth)
            if any(stated.values()):
                self.columns[before:] = [replace(c, **stated) for c in self.columns[before:]]

    def _add_facts(self, path: str, item: Any) -> dict[str, Any]:
        facts = {
            str(name): to_plain(value) for name, value in item.attrs.items() if not name.startswith("MATLAB")
        }
        self.facts |= {join_path(path, name): value for name, value in facts.items()}
        return facts


PLUGIN = Hdf5Reader()
