"""Read MATLAB files of version 4 to 7, including structs and cells, with SciPy."""

from __future__ import annotations

import zlib
from pathlib import Path

from bayesdamp.records.files import contents
from bayesdamp.records.files.contents import Contents, Reader
from bayesdamp.records.files.tree import Walk
from bayesdamp.types import InputError

_COMPRESSED = 15
"""Code of a compressed data element (MathWorks, MAT-File Format, table 1-1)."""


class MatlabReader(Reader):
    """Reader of MATLAB files of version 4 to 7."""

    foreign = True
    format = "a MATLAB file"
    extensions = (".mat",)

    def claims(self, head: bytes, path: Path) -> bool:
        """Return whether the file has the header of version 5 to 7, or is named .mat and may be version 4.

        Version 4 has no signature: a zero byte among the first 64 is enough. Version 7.3 is HDF5 and is not claimed.
        """
        if b"MATLAB 7.3" in head[:128] or b"\x89HDF\r\n" in head[:1024]:
            return False
        return head.startswith(b"MATLAB 5.0 MAT-file") or (
            path.suffix.lower() == ".mat" and b"\0" in head[:64]
        )

    def read(self, path: Path) -> Contents:
        """Return numeric variables, and fields of structs, as columns named by their paths.

        Raises InputError if the file has none, as if it contains only MATLAB objects, or if it unpacks to more than
        LARGEST_FILE bytes.
        """
        from scipy.io import loadmat  # imports slowly, and few records need it
        from scipy.io.matlab import MatlabFunction, MatlabOpaque

        _refuse_large_elements(path)
        data = loadmat(path, simplify_cells=True)
        walk = Walk()
        opaque = [name for name, item in data.items() if isinstance(item, MatlabOpaque | MatlabFunction)]
        walk.add("", {name: item for name, item in data.items() if name not in opaque})
        if not walk.columns and "__function_workspace__" in data:
            right = "save its arrays: t = x.Time; y = x.Data; save('record.mat', 't', 'y')"
            raise InputError(
                f"contains a MATLAB object (a timeseries or table?), which only MATLAB reads; {right}"
            )
        return walk.contents("MATLAB")


def _refuse_large_elements(path: Path) -> None:
    """Raise InputError if the elements unpack to more than LARGEST_FILE bytes, zlib.error if they are damaged.

    A file of version 4 is not checked.
    """
    with path.open("rb") as file:
        head = file.read(128)
        if not head.startswith(b"MATLAB 5.0"):
            return
        order = "little" if head[126:128] == b"IM" else "big"
        total = 0
        while len(tag := file.read(8)) == 8:
            kind, size = (int.from_bytes(tag[i : i + 4], order) for i in (0, 4))
            data = file.read(size)
            if kind != _COMPRESSED:
                total += size
                continue
            unpack = zlib.decompressobj()
            while data and total <= contents.LARGEST_FILE:
                total += len(unpack.decompress(data, 2**24))
                data = unpack.unconsumed_tail
            contents.refuse_large(total)


PLUGIN = MatlabReader()
