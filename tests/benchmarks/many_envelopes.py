"""Simulated ring-downs in dBm as files, to be answered in one `compare` call.

    python -m tests.benchmarks.many_envelopes FOLDER COUNT [SEED]

then `time bayesdamp compare FOLDER/*.txt --quantity envelope --workers 2 --out OUT`.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from validation.experiments.envelopes import drawn
from validation.truth.ringdowns import simulate


def main(folder: Path, count: int, seed: int = 1) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for i in range(count):
        rng = np.random.default_rng([seed, i])
        made = simulate(drawn("harsh" if i % 2 else "plain", rng), rng)
        rows = [f"{t:.7g}, {level:.7g}" for t, level in zip(made.t, made.level, strict=True)]
        head = "% Frequency [Hz]: 1562325.84\n% time [s], power [dBm]\n"
        (folder / f"ringdown_{i:04d}.txt").write_text(head + "\n".join(rows) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]), *map(int, sys.argv[2:]))
