"""Records whose friction touches zero, each weighed by importance, by bridge and by nested sampling.

`python -m tests.inference.evidence.audit TABLE.csv FOLDER [--count 12]` writes the table, or what it lacks, and the
page; test_audit.py beside it reads the one that ships.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from bayesdamp.formatting import markdown_table
from bayesdamp.inference.evidence import EVIDENCES
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.search import find_mode
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.types import Signal
from tests.inference.evidence.weighing_problems import KNOWN, PRIORS, TIMES, record
from validation.rows import make_page, page_options

CASES = 12
METHODS = ("importance", "bridge", "nested")
HEADER = ("case", "zeta", "touching", *(f"{m}{x}" for m in METHODS for x in ("", "_stderr", "_outcome")))


def case(number: int) -> tuple[Target, dict[str, float]]:
    """Viscous damping drawn from a third of its prior, no friction at all; both are inferred, the rest is known."""
    rng = np.random.default_rng([20260101, number])
    zeta = abs(0.15 * rng.standard_normal())
    priors = {n: PRIORS[n] for n in ("zeta", "mu_c")}
    known = {n: v for n, v in KNOWN.items() if n not in priors}
    y = record(zeta, 0.0, int(rng.integers(2**31)))
    osc = Oscillator(("viscous", "coulomb"), "linear")
    return Target(Signal(TIMES, y), osc, "gaussian", priors, known), {"zeta": zeta, "mu_c": 0.02}


def row(number: int) -> dict[str, object]:
    """One line of the table. touching: sds of the posterior between its mode and no friction."""
    target, start = case(number)
    mode = find_mode(target, [start], noise_level=KNOWN["noise_sd"])
    line: dict[str, object] = {
        "case": number, "zeta": start["zeta"], "touching": float(mode.z[1] / mode.sd()[1]),
    }  # fmt: skip
    for name in METHODS:
        evidence = EVIDENCES.get(name).evidence("viscous+coulomb", target, mode, number)
        line |= {
            name: evidence.log_evidence,
            f"{name}_stderr": evidence.stderr,
            f"{name}_outcome": evidence.outcome,
        }
    return line


def differences(rows: pd.DataFrame, method: str) -> tuple[np.ndarray, np.ndarray]:
    """Nats by which a method is above nested sampling, (n,), and the standard errors of that, (n,)."""
    away = rows[method] - rows["nested"]
    return away.to_numpy(), np.hypot(rows[f"{method}_stderr"], rows["nested_stderr"]).to_numpy()


def page(rows: pd.DataFrame) -> str:
    """The page, in Markdown."""
    results = {m: differences(rows, m) for m in METHODS[:2]}
    largest = " and ".join(f"{np.abs(away).max():.3f}" for away, _ in results.values())
    heads = (
        "method", "median standard error, nats", "largest difference from nested, nats",
        "the same in its standard errors", "mean difference and its 95 % interval, nats",
    )  # fmt: skip
    lines, observed = [], 0.0
    for method, (away, sd) in results.items():
        error = np.sqrt(np.sum(sd**2)) / away.size
        observed = max(observed, 2.8 * error)
        lines.append([
            method, f"{rows[f'{method}_stderr'].median():.3f}", f"{np.abs(away).max():.3f}",
            f"{np.abs(away / sd).max():.1f}", f"{away.mean():+.3f} ± {1.96 * error:.3f}",
        ])  # fmt: skip
    return f"""# Evidence where a coefficient touches zero

Importance and bridge sampling differ from nested sampling by {largest} nats at most, over {len(rows)} records.

Records of a viscous oscillator, weighed with viscous + Coulomb damping, whose friction is not there: the posterior \
touches zero (a median of {rows["touching"].median():.2f} of its standard deviations from its mode to no friction, \
{rows["touching"].max():.1f} at most).

{markdown_table(heads, lines)}

An error of {observed:.2f} nats in every record would be seen in the mean (5 %) with a probability of 0.8. A forgotten \
reflection at zero (ln 2 = 0.69 nats) is seen; so says the test that reads the table \
(`tests/inference/evidence/test_audit.py`). `make reports` makes it again.
"""


def main() -> None:
    """All cases; those that the file already has are kept."""
    parser = page_options(__doc__)
    parser.add_argument("--count", type=int, default=CASES)
    given = parser.parse_args()
    todo = {str(number): (number,) for number in range(given.count)}
    make_page(given, "touching_zero.csv", HEADER, todo, row, page)


if __name__ == "__main__":
    main()
