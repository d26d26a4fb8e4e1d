"""Read WAV sound files with SciPy."""

from pathlib import Path

import numpy as np

from bayesdamp.records.files.contents import Column, Contents, Reader
from bayesdamp.types import InputError


class WavReader(Reader):
    """Reader of WAV files; the sampling rate is in the header."""

    format = "a WAV file"
    extensions = (".wav", ".wave")

    def claims(self, head: bytes, path: Path) -> bool:
        """Return whether the first bytes are those of RIFF, RIFX or RF64 of type WAVE; the path has no effect."""
        return head[:4] in (b"RIFF", b"RIFX", b"RF64") and head[8:12] == b"WAVE"

    def read(self, path: Path) -> Contents:
        """Return a column for each channel, in counts (the numbers as SciPy reads them, not scaled to ±1).

        Each has the sampling rate of the header; an InputError is raised if it states none.
        """
        from scipy.io import wavfile

        rate, data = wavfile.read(path)
        if rate <= 0:
            raise InputError("its header states no sampling rate; export it again")
        table = np.asarray(data, float).reshape(len(data), -1)
        names = ["sound"] if table.shape[1] == 1 else [f"channel {i + 1}" for i in range(table.shape[1])]
        columns = [
            Column(name, np.ascontiguousarray(table[:, i]), unit="counts", rate=float(rate))
            for i, name in enumerate(names)
        ]
        return Contents("WAV", tuple(columns), {"sampling rate (Hz)": float(rate)}, channels=True)


PLUGIN = WavReader()
