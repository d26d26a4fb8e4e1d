"""Test whether answers are right, or give a warning, on records that no law fits and on records of poor quality.

`python -m validation.reports.misfit TABLE FOLDER --seed 22 [--count 6]` answers simulated records as
`bayesdamp compare --quick` does, and writes the page. The family consists of the sums of viscous, Coulomb and quadratic
damping with the restoring laws of bayesdamp.
"""

import math
import tempfile
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from bayesdamp.cli.records import ReadingOptions, records_in
from bayesdamp.interface.answer import answer, compare_models
from bayesdamp.types import Refusal, Signal
from bayesdamp.verdict.types import Verdict
from validation.scoring import groups_of, hits_of, make_page, named, page_options, row_of, score_table
from validation.truth.discrepancies import stribeck
from validation.truth.drawing import MIDDLE, Draw, draw_oscillator, log_uniform, middle_ratio
from validation.truth.motion import NoMotionError, solve_motion
from validation.truth.oscillator import SUMS, Discrepancy
from validation.truth.ratio import harmonic_ratio
from validation.truth.records import Case

POWERS = {"cubic": 3.0, "root": 0.5}
"""Power of the velocity v in the damping force |v|^power of the kinds of records that have only this damping. It is not
in the family (sums of viscous, Coulomb and quadratic damping)."""
OUTSIDE = (
    "beats", "two_modes", "driven", "clipped", "stiction", "drift", "wander", "damping_changes", "clock_changes",
    *POWERS,
)  # fmt: skip
"""Kinds of records that the family (sums of viscous, Coulomb and quadratic damping) does not fit."""
INSIDE = ("coarse", "quantised", "outliers", "slight_drift")
"""Kinds of records that the family (sums of viscous, Coulomb and quadratic damping) fits, but whose data are poor."""


def draw_case(kind: str, number: int, seed: int) -> Case:
    """Simulate a random record of a kind (in `OUTSIDE` or `INSIDE`) on a linear spring.

    The record is determined by kind, number and seed. If its damping is not in the family, the true damping of the
    result is the name of the kind, such as "cubic". A motion that sticks is drawn again.
    """
    rng = np.random.default_rng([seed, (*OUTSIDE, *INSIDE).index(kind), number])
    damping = {"stiction": "coulomb"}.get(kind, str(rng.choice(SUMS)))
    while True:
        draw = _with_discrepancy(kind, rng, draw_oscillator(rng, damping, "linear"))
        with suppress(NoMotionError):
            true = kind if kind in ("stiction", *POWERS) else damping
            return Case(f"{kind}-{seed}-{number}", kind, _simulate(kind, rng, draw), true)


def _with_discrepancy(kind: str, rng: np.random.Generator, draw: Draw) -> Draw:
    """Return a draw whose oscillator has the discrepancy of a kind, or the draw itself if the kind has none."""
    oscillator, odd = draw.oscillator, Discrepancy()
    if kind == "coarse":
        draw = replace(draw, per_cycle=10.0)
    if kind == "damping_changes":
        growth = _sign(rng) * rng.uniform(1.0, 2.5)  # change of the logarithm of the damping over the record
        odd = Discrepancy(scale=lambda t: math.exp(growth * ((t - draw.begin) / draw.duration - 0.5)))
    if kind == "stiction":
        odd = stribeck(rng, draw, excess=rng.uniform(0.5, 2.0), speed=rng.uniform(0.03, 0.15))
    if kind in POWERS:

        def unit(x: float, v: float, turn: float = 0.0) -> float:
            return math.copysign(abs(v) ** POWERS[kind], v)

        # At the middle amplitude, this force dissipates as much as the damping that it replaces.
        c = middle_ratio(draw) / harmonic_ratio(unit, MIDDLE * draw.amplitude, draw.frequency)
        oscillator = replace(oscillator, damping={})
        odd = Discrepancy(kind, lambda x, v, turn: c * unit(x, v))
    return replace(draw, oscillator=replace(oscillator, discrepancy=odd))


def _simulate(kind: str, rng: np.random.Generator, draw: Draw) -> Signal:
    """Simulate the record of a draw, with the fault of its kind. Raises NoMotionError if the motion sticks."""
    motion = solve_motion(draw.oscillator, draw.displacement, draw.frequency, draw.begin + draw.duration)
    u = np.linspace(0.0, 1.0, int(draw.cycles * draw.per_cycle))
    phase, rate = 2 * np.pi * draw.cycles * u, -math.log(draw.left) / (2 * np.pi * draw.cycles)
    change = _sign(rng) * log_uniform(rng, 0.0025, 0.025) if kind == "clock_changes" else 0.0
    y = motion.displacements(draw.begin + draw.duration * (u + change * u * (u - 1))) / draw.amplitude
    # Second oscillation: amplitude and frequency relative to the first one, and decay rate per radian of the phase of
    # the first one.
    second = {
        "beats": (rng.uniform(0.5, 1.0), 1 + rng.uniform(1.0, 4.0) / draw.cycles, rate),
        "two_modes": (log_uniform(rng, 0.05, 0.5), rng.uniform(1.3, 5.0), rate),
        "driven": (log_uniform(rng, 0.05, 0.4), rng.uniform(0.5, 1.6), 0.0),
        "wander": (log_uniform(rng, 0.03, 0.4), rng.uniform(0.4, 3.0) / draw.cycles, 0.0),
    }
    if kind in second:
        size, frequency, decay = second[kind]
        y += size * np.exp(-decay * phase) * np.cos(frequency * phase + rng.uniform(0, 2 * np.pi))
    if kind.endswith("drift"):
        y += _sign(rng) * log_uniform(rng, 0.01, 0.1) * (1 if kind in INSIDE else 10) * u
    y += draw.noise * rng.standard_normal(u.size)
    if kind == "clipped":
        level = rng.uniform(0.4, 0.9)
        y = np.clip(y, -level if rng.random() < 0.5 else -np.inf, level)
    if kind == "quantised":
        y = 0.1 * np.round(y / 0.1)
    if kind == "outliers":
        at = rng.choice(u.size, round(u.size * rng.uniform(0.01, 0.05)), replace=False)
        y[at] += rng.choice([-1.0, 1.0], at.size) * rng.uniform(0.3, 1.0, at.size)
    return Signal(draw.duration * u, motion.equilibrium + draw.amplitude * y)


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def answer_file(signal: Signal, amplitudes: tuple[float, ...]) -> Verdict:
    """Write a record to a CSV file, and read and answer it as `bayesdamp compare --quick` does.

    Raises InputError if the file is refused, and Refusal if the record is not the free decay of one oscillator.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "record.csv"
        pd.DataFrame({"t": signal.t, "angle": signal.y}).to_csv(file, index=False)
        (record,) = records_in(file, ReadingOptions(time="t", angle="angle", unit="rad"))
    if record.signal is None:
        raise Refusal(record.refusal)
    return answer(record.signal, compare_models(record.signal), sample=False).verdict


def row(kind: str, number: int, seed: int) -> dict[str, Any]:
    """Simulate record `number` of a kind of `OUTSIDE` or `INSIDE`, answer its file, and return the row of the table."""
    return row_of(draw_case(kind, number, seed), answer_file)


def page(rows: pd.DataFrame) -> str:
    """Return the page in Markdown from the rows of the table: the result, how it was computed, and the scores."""
    inside, outside = (rows.loc[rows["group"].isin(kinds)] for kinds in (INSIDE, OUTSIDE))
    parts = {
        **groups_of(inside, order=INSIDE), "**of the family**": inside,
        **groups_of(outside, order=OUTSIDE), "**outside**": outside,
    }  # fmt: skip
    return f"""# Simulated misfits

On records that no law fits, a wrong damping is named outright, without a warning, in \
{hits_of(named(outside, right=0), len(outside))}. On records of the family with poor data this is so in \
{hits_of(named(inside, right=0), len(inside))}, and the true damping is named outright in \
{hits_of(named(inside, right=1), len(inside))}. The brackets contain 95 % intervals of the fractions.

The oscillators are drawn at random by `validation.truth.drawing` and solved by SciPy (8 to 60 cycles, 0.3 to 3 % \
noise, 30 to 90 % of the amplitude lost). Each record is written to a file and answered as `bayesdamp compare --quick` \
does: under all dampings and restoring laws, which may hold approximately. Without an answer are records that are \
recognised as not being the free decay of one oscillator. *Correctly* means that the damping that is named outright is \
the true sum. Stiction, cubic and square-root damping are not among the sums that are compared, so any damping that is \
named there is wrong. No threshold was chosen on this seed.

{score_table(parts, "records", "answered", "named outright, correctly", "named outright, wrongly")}

scored.csv has every case. `make reports` makes this report again.
"""


def main() -> None:
    """Run the command line: score the cases that the table lacks, and write the page."""
    given = page_options(__doc__, seed=21, count=1).parse_args()
    todo = {
        f"{kind}-{given.seed}-{number}/bayesdamp": (kind, number, given.seed)
        for number in range(given.count)
        for kind in (*INSIDE, *OUTSIDE)
    }
    make_page(given, todo, row, page, shipped="scored.csv")


if __name__ == "__main__":
    main()
