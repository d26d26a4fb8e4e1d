"""Read NumPy's .npy and .npz files. Pickled Python objects are not read, because they can run any code."""

from pathlib import Path

import numpy as np

from bayesdamp.records.files.contents import Contents, Reader, archive_names, refuse_archive
from bayesdamp.records.files.tree import Walk
from bayesdamp.types import InputError

_MAGIC = b"\x93NUMPY"


class NumpyReader(Reader):
    """Reader of `.npy` and `.npz` files."""

    format = "a NumPy file"
    extensions = (".npy", ".npz")

    def claims(self, head: bytes, path: Path) -> bool:
        """Return whether the file has NumPy's signature, or is a ZIP archive of `.npy` files."""
        if head.startswith(_MAGIC):
            return True
        if not head.startswith(b"PK"):
            return False
        names = archive_names(path)
        if names is None:
            return path.suffix.lower() == ".npz"
        return bool(names) and all(name.endswith(".npy") for name in names)

    def read(self, path: Path) -> Contents:
        """Return arrays, and fields of structured arrays, as columns named by their paths.

        Arrays of one element become facts. In an .npz archive, arrays of Python objects are skipped. Raises InputError
        if an .npy file is such an array, if an archive is encrypted or too large, or if there is no column.
        """
        walk = Walk()
        with path.open("rb") as file:
            single = file.read(len(_MAGIC)) == _MAGIC
        if single:
            try:  # memory-mapped, so that a wrong size in the header is noticed before memory is allocated
                walk.add("", np.array(np.load(path, mmap_mode="r", allow_pickle=False)))
            except ValueError as error:
                if "Python objects" in str(error):
                    what = "contains pickled objects, which are not read; save plain arrays of numbers"
                    raise InputError(what) from None
                raise
            return walk.contents("NumPy array")
        refuse_archive(path)
        with np.load(path, allow_pickle=False) as data:
            for key in data.files:
                try:
                    walk.add(key, data[key])
                except ValueError as error:
                    if "pickle" not in str(error):  # arrays of Python objects are skipped
                        raise
        return walk.contents("NumPy archive")


PLUGIN = NumpyReader()
