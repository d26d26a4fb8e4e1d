"""Fifty records whose friction touches zero, each weighed by importance, by bridge and by nested sampling.

`python -m tests.inference.evidence.audit FILE.csv` writes the table; test_audit.py beside it reads the one that ships.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import numpy as np

from bayesdamp.inference.evidence import EVIDENCES
from bayesdamp.inference.fit.search import find_mode
from bayesdamp.inference.model.target import Target
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.types import Signal
from tests.inference.evidence.weighing_problems import KNOWN, PRIORS, TIMES, record

CASES = 50
METHODS = ("importance", "bridge", "nested")
HEADER = ["case", "zeta", "touching", *(f"{m}{x}" for m in METHODS for x in ("", "_stderr", "_outcome"))]


def case(number: int) -> tuple[Target, dict[str, float]]:
    """Viscous damping drawn from a third of its prior, no friction at all; both are inferred, the rest is known."""
    rng = np.random.default_rng([20260101, number])
    zeta = abs(0.15 * rng.standard_normal())
    priors = {n: PRIORS[n] for n in ("zeta", "mu_c")}
    known = {n: v for n, v in KNOWN.items() if n not in priors}
    y = record(zeta, 0.0, int(rng.integers(2**31)))
    osc = Oscillator(("viscous", "coulomb"), "linear")
    return Target(Signal(TIMES, y), osc, "gaussian", priors, known), {"zeta": zeta, "mu_c": 0.02}


def row(number: int) -> list[object]:
    """One line of the table. touching: sds of the posterior between its mode and no friction."""
    target, start = case(number)
    mode = find_mode(target, {"start": start}, noise_level=KNOWN["noise_sd"])
    line: list[object] = [number, start["zeta"], float(mode.z[1] / mode.sd()[1])]
    for name in METHODS:
        found = EVIDENCES.get(name).evidence("viscous+coulomb", target, mode, number)
        line += [found.log_evidence, found.stderr, found.outcome]
    return line


def main(path: Path) -> None:
    """All cases; those that the file already has are kept."""
    done = list(csv.reader(path.open(encoding="utf-8")))[1:] if path.exists() else []
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerows([HEADER, *done])
        for number in range(len(done), CASES):
            writer.writerow(row(number))
            file.flush()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
