"""Read MATLAB files of versions 4 to 7 with SciPy, including structs and cells."""

import math
from pathlib import Path

from bayesdamp.records.files.contents import Contents, Reader, refuse_large
from bayesdamp.records.files.tree import Walk
from bayesdamp.types import InputError


class MatlabReader(Reader):
    """Reader of MATLAB files of version 4 to 7."""

    foreign = True
    format = "a MATLAB file"
    extensions = (".mat",)

    def claims(self, head: bytes, path: Path) -> bool:
        """Return whether the file has the header of versions 5 to 7, or has the extension .mat and may be version 4.

        Version 4 has no signature: a zero byte among the first 64 bytes is enough. Version 7.3 is HDF5 and is not
        accepted.
        """
        if b"MATLAB 7.3" in head[:128] or b"\x89HDF\r\n" in head[:1024]:
            return False
        return head.startswith(b"MATLAB 5.0 MAT-file") or (
            path.suffix.lower() == ".mat" and b"\0" in head[:64]
        )

    def read(self, path: Path) -> Contents:
        """Return numeric variables, and fields of structs, as columns named by their paths.

        Single numbers and texts become facts. Raises InputError if there are no columns, for example in a file of
        MATLAB objects. Raises it also if the arrays outside of structs and cells need more than LARGEST_FILE bytes as
        64-bit numbers.
        """
        from scipy.io import loadmat, whosmat  # imports slowly, and few records need it
        from scipy.io.matlab import MatlabFunction, MatlabOpaque

        refuse_large(sum(8 * math.prod(shape) for _, shape, _ in whosmat(path)))
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


PLUGIN = MatlabReader()
