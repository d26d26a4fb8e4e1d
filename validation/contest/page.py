"""Write the page of the contest (bayesdamp and an engineer's script on the same records) from the rows of its table."""

import math

import numpy as np
import pandas as pd
from scipy.stats import t as student

from bayesdamp.formatting import digits
from validation.contest.peers import OURS, ROSTER
from validation.contest.records import GROUPS
from validation.scoring import errors, groups_of, score_table

INTRODUCTION = """# A contest

This page compares bayesdamp with a script of about 130 lines, as an engineer could write it in an afternoon, on the
same records. The score is the error of the equivalent viscous damping ratio at three amplitudes of each record: near
its start, near its end, and between. Records come from SciPy's DOP853, and the truth from the energy at their turning
points. The last column is the error of a method over that of bayesdamp on the records that both answered, a geometric
mean. The brackets contain 95 % intervals. Seconds are CPU seconds of one thread without imports.

The script solves the motion of viscous, Coulomb and quadratic damping on a cubic spring or a pendulum by Runge-Kutta
steps, fits each of the seven sums by least squares, weighs the sums by BIC, names a sum at a weight of 0.95, and
averages intervals from the Jacobians over the sums.

- **family**: sums of viscous, Coulomb and quadratic damping on four springs, noise of 0.3 to 3 %, 8 to 60 cycles. Each
  is drawn until its true sum is 12 nats or more ahead of every sum that lacks one of its terms, so that the record can
  determine the damping.
- **discrepant**: the same with an effect that no candidate has: drift, Stribeck friction, a nonlinear sensor, a second
  mode, …
- **noisy**: the family with noise of 5 to 15 % of the first amplitude.
- **short**: the family's first 3 to 6 cycles.
- **gappy**: the family with three gaps, 40 % of the time in total.
"""
HOW = """## How each was run

- Script: frequency from the spectrum of the longest piece without a gap, first values from the first and the last
  cycle; two springs by seven sums; 40 steps in a cycle, divided at turning points; windows of 3, 6, 12, … cycles; the
  ratio at an amplitude is that of the energies. It gives no answer if its best fit explains less than half of the
  variance of the record. It was changed twice, after 40 records each of seeds 91 and 92: before, it took its frequency
  from interpolated gaps, and its intervals from draws that were truncated at zero.
- bayesdamp: `compare(signal, sample=False)` on the unchanged record, without information on the spring or the damping.
  In a first contest (seed 811) it refused 35 of 37 gappy records, because it used only the longest piece and mistook
  some gaps for a beat. This was corrected before records of other seeds were drawn.
"""


def page(rows: pd.DataFrame) -> str:
    """Return the page of the contest in Markdown, from the rows of its table (one for each record and method).

    Its tables of scores have a line for each method.
    """
    parts = {"all records": rows, **groups_of(rows, order=GROUPS)}
    ours = rows.loc[rows["peer"] == OURS]
    more = {"error over bayesdamp's": lambda part: paired(part, ours)}
    scores = (
        "records", "answered", "median error", "90 % quantile", "coverage", "named outright", "of these correctly",
        "CPU seconds",
    )  # fmt: skip
    sections = "\n\n".join(
        f"## {name.capitalize()}\n\n{score_table(groups_of(part, 'peer', ROSTER), *scores, more=more)}"
        for name, part in parts.items()
        if len(part)
    )
    seeds = ", ".join(sorted(set(rows["record"].str.split("-").str[1])))
    return f"""{INTRODUCTION}
Seed {seeds}; `python -m validation.contest ROWS.csv FOLDER --seed 1` draws other records.

{sections}

{HOW}
`make reports` makes this page again; `rows.csv` has every answer.
"""


def paired(theirs: pd.DataFrame, ours: pd.DataFrame) -> str:
    """Return the error of a method divided by that of bayesdamp, with its 95 % interval, as text.

    It is the geometric mean, over the records that both answered, of the ratio of their mean errors. Above 1, bayesdamp
    is nearer to the truth. The interval assumes that the logarithms of these ratios are normal. The result is a dash
    for fewer than two records, or if all ratios are 1. theirs, ours: rows of the method and of bayesdamp.
    """
    means = (pd.Series(errors(rows).mean(axis=1), rows["record"]) for rows in (theirs, ours))
    logs = (next(means) / next(means)).dropna().map(math.log)
    if len(logs) < 2 or not logs.any():
        return "–"
    half = student.ppf(0.975, len(logs) - 1) * logs.sem()
    value, low, high = (digits(float(np.exp(logs.mean() + shift)), n=2) for shift in (0, -half, half))
    return f"{value} ({low}–{high})"
