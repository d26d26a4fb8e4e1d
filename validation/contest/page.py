"""Write the page of the contest from its rows."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from bayesdamp.formatting import fixed_decimals, markdown_table as table
from bayesdamp.types import OK
from validation.contest import plots
from validation.contest.roster import OURS, ROSTER, SCRIPT, peers_of
from validation.contest.scoring import (
    coverage,
    groups_of,
    holds_more,
    names,
    paired,
    quantile_of_errors,
    simulated,
)
from validation.rows import numbers, where
from validation.scoring import Interval, three

INTRODUCTION = """# A contest

This page compares bayesdamp with other methods of measuring damping on the same records. Each method runs with its
authors' defaults; the last section lists the changes for methods whose defaults do not work on a single decay. The
score is the error of the equivalent viscous damping ratio at three amplitudes of each record: near its start, near its
end, and between. Simulated records come from SciPy's DOP853, and the truth from the energy at their turning points.
Intervals are 95 %: a bootstrap over records for errors, Wilson's interval for shares. Seconds are CPU seconds of one
thread without imports.
"""
SCRIPT_WORDS = """## A script that an engineer could write in an afternoon

About 130 lines of NumPy, SciPy and Numba solve the motion of viscous, Coulomb and quadratic damping on a cubic spring
or a pendulum by Runge-Kutta steps, fit each of the seven sums by least squares over windows that grow, weigh the sums
by BIC, name a sum at a weight of 0.95, and average intervals from the Jacobians over the sums. The script gets the same
input as the other peers: samples and amplitudes. The table compares it with bayesdamp on the records that both got.
"""
GROUP_WORDS = {
    "family": "sums of viscous, Coulomb and quadratic damping on four springs, noise of 0.3 to 3 %, 8 to 60 cycles; "
    "each is drawn until its true sum is 12 nats or more ahead of every sum that lacks one of its terms, so that the "
    "record can determine the damping",
    "discrepant": "the same with an effect that no candidate has: drift, Stribeck friction, a nonlinear sensor, a "
    "second mode, …",
    "noisy": "the family with noise of 5 to 15 % of the first amplitude",
    "short": "the family's first 3 to 6 cycles",
    "gappy": "the family with three gaps, 40 % of the time in total",
    "measured": "ten runs of one disc that others measured; the truth comes from the half cycles of the nine other "
    "runs, so differences between runs count as errors, which the interval of a single run does not include",
}
VISCOUS = "only viscous, all simulated"
HOW = """## How each was run

- Decrement: peaks at least 0.7 periods apart, a straight line through their logarithms. For this and the next three,
  the rest position is the mean of the last whole cycles, at most five.
- Hilbert: without the first and last cycle; one line through ln(envelope), or at each amplitude a line through a
  quarter of its range on either side.
- Half power: the spectrum of the whole record, without a window, padded with zeros.
- curve_fit: an exponentially decaying cosine, starting at the frequency of the spectrum; the interval is 1.96 sd of its
  covariance.
- PySINDy: its thresholded least squares (0.1 in SI units), its smoothed differences, a library of x, v, sign v, v|v|.
- pyOMA2: order up to 10; time scaled to 2 Hz, because its widths in Hz are meant for buildings; SSI without the checks
  of mode shapes, which do not exist for one channel; EFDD with the velocity as second channel, because it does not
  accept one channel.
- pyEMA: LSCF on the spectrum of the record, padded with zeros to 512 samples if it is shorter; time scaled to 500 Hz,
  because its band is meant for hammer tests.
- NumPyro: three dampings and a cubic spring in diffrax, in units of the covariance of a least-squares solution, from
  which it starts (otherwise a record did not finish in 180 CPU seconds); 250 and 250 steps of one NUTS chain, at most
  180 CPU seconds for a record, including compilation.
- Script: frequency from the spectrum of the longest piece without a gap, first values from the first and the last
  cycle; two springs by seven sums; 40 steps in a cycle, divided at turning points; windows of 3, 6, 12, … cycles; the
  ratio at an amplitude is that of the energies. It gives no answer if its best fit explains less than half of the
  variance of the record. It was changed twice, after 40 records each of seeds 91 and 92: before, it took its frequency
  from interpolated gaps, and its intervals from draws that were truncated at zero.
- bayesdamp: `compare(signal, sample=False)` on the unchanged record, without information on the spring or the damping.
  In a first contest (seed 811) it refused 35 of 37 gappy records, because it used only the longest piece and mistook
  some gaps for a beat. This was corrected before records of other seeds were drawn.

Methods that need even sampling get straight lines across gaps.
"""


def page(rows: pd.DataFrame, missing: Mapping[str, str]) -> str:
    """Return the page of the contest in Markdown.

    Parameters
    ----------
    rows : DataFrame
        The rows of the contest.
    missing : mapping
        By environment, the reason why its peers did not take part.
    """
    of_simulated = simulated(rows)
    by_group = {g: where(rows, group=g) for g in groups_of(rows)}
    parts = by_group | {VISCOUS: where(of_simulated, damping="viscous")}
    factors = {
        name: {group: paired(part, name, OURS) for group, part in parts.items()}
        for name in peers_of(rows)
        if name != OURS
    }
    factor_lines = [[ROSTER[n].label, *(_factor(*f) for f in own.values())] for n, own in factors.items()]
    groups = [
        f"- **{g}** ({part['record'].nunique()} records): {GROUP_WORDS[g]}." for g, part in by_group.items()
    ]
    absent = [f"{name} did not take part: {why}." for name, why in missing.items()]
    comparisons = [
        *_faster(of_simulated),
        *_where_refused(by_group),
        *_where_better({n: {g: f for g, (f, _) in own.items()} for n, own in factors.items()}),
    ]
    scores = [f"## {group.capitalize()}\n\n{_scores(part)}\n" for group, part in by_group.items()]
    refusals = []
    for name in peers_of(rows):
        texts = where(rows, rows["outcome"] != OK, peer=name)["outcome"]
        # The beginning of a refusal without its numbers, so that equal reasons have equal text.
        reasons = Counter(re.sub(r"\d+(\.\d+)?(e-?\d+)?", "#", text)[:110] for text in texts)
        if reasons:
            listed = "; ".join(f"{n} × {text}" for text, n in reasons.most_common())
            refusals.append(f"- {ROSTER[name].label}: {listed}")
    return f"""{INTRODUCTION}
{_lines(groups)}

Seed {", ".join(sorted(set(of_simulated["record"].str.split("-").str[1])))}; `make contest ARGS="--seed 1"` draws \
other records.

{_lines([*absent, *_given(rows)])}

{_script(rows)}![errors](errors.svg)

## All simulated records

{_scores(of_simulated)}

## Better and worse than bayesdamp

The numbers are the error of a peer over that of bayesdamp on the records that both answered, as a geometric mean. \
**Bold**: the peer is nearer to the truth by more than chance.

{table(["", *parts], factor_lines)}

{_lines(comparisons)}

![coverage and time](cost.svg)

{_lines(scores)}
## Refusals

{_lines(refusals)}

{HOW}
`make contest` makes this page, and resumes after an interruption; `rows.csv` has every answer.
"""


def _lines(lines: list[str]) -> str:
    """Join lines by line breaks. It is a function because an f-string of Python 3.11 cannot contain a backslash."""
    return "\n".join(lines)


def write(folder: Path, rows: pd.DataFrame, missing: Mapping[str, str]) -> None:
    """Write README.md and its plots, errors.svg and cost.svg, into a folder. The arguments are those of `page`."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "README.md").write_text(page(rows, missing), encoding="utf-8")
    plots.errors(rows, folder / "errors.svg")
    plots.cost(rows, folder / "cost.svg")


def _given(rows: pd.DataFrame) -> Iterator[str]:
    """Yield sentences on the peers with one number for all amplitudes, and on those with fewer records than others."""
    counts = {name: len(where(rows, peer=name)) for name in peers_of(rows)}
    values = {name: three(where(rows, peer=name, outcome=OK), "value") for name in counts}
    constant = [ROSTER[n].label for n, v in values.items() if len(v) and not np.ptp(v, axis=1).any()]
    if constant:
        yield (
            f"These give one number for all amplitudes: {'; '.join(constant)}. This number is scored at each "
            "amplitude. A factor against them shows that the damping depends on the amplitude, not that bayesdamp "
            "fits better than a good script."
        )
    most = max(counts.values())
    fewer = [f"{ROSTER[name].label} ({count})" for name, count in counts.items() if count < most]
    if fewer:
        yield f"These got fewer than all {most} records: {'; '.join(fewer)}."


def _script(rows: pd.DataFrame) -> str:
    """Return the section that compares the peer `script` with bayesdamp, on the records that both received.

    It is "" if there are no such records.
    """
    theirs, own = (set(where(rows, peer=name)["record"]) for name in (SCRIPT, OURS))
    rows = where(rows, [record in theirs & own for record in rows["record"]])
    if rows.empty:
        return ""
    parts = {g: where(rows, group=g) for g in groups_of(rows)}
    if len(part := simulated(rows)):
        parts = {"all simulated": part} | parts

    def median_error(part: pd.DataFrame) -> str:
        return _percent(Interval(quantile_of_errors(part, 0.5).value, math.nan, math.nan))

    cells: dict[str, Callable[[pd.DataFrame], str]] = {
        "answered": lambda part: f"{len(where(part, outcome=OK))} of {len(part)}",
        "median error": median_error,
        "coverage of the intervals": lambda part: fixed_decimals(coverage(part)[0].value, 2),
        "named outright, of these correctly": lambda part: (
            "{1}, {2}".format(*names(part)) if names(part)[0] else "–"
        ),
        "CPU seconds a record": _seconds,
    }
    lines = [
        [what, *(" / ".join(cell(where(part, peer=n)) for n in (SCRIPT, OURS)) for part in parts.values())]
        for what, cell in cells.items()
    ]
    factors = {name: paired(part, SCRIPT, OURS) for name, part in parts.items()}
    lines.append(["the script's error over bayesdamp's", *(_factor(*f) for f in factors.values())])
    more = {name: holds_more(part, SCRIPT, OURS) for name, part in parts.items()}

    def groups_where(holds: Callable[[str], bool]) -> str:
        return ", ".join(name for name in parts if holds(name)) or "no group"

    return f"""{SCRIPT_WORDS}
{table(["script / bayesdamp", *parts], lines)}

These differences exceed chance, on the records that both answered:

- the script is nearer to the truth in {groups_where(lambda name: factors[name][0].high < 1)}, \
bayesdamp in {groups_where(lambda name: factors[name][0].low > 1)};
- the script's intervals contain the truth more often in {groups_where(lambda name: more[name].low > 0)}, \
bayesdamp's in {groups_where(lambda name: more[name].high < 0)}.

"""


def _scores(rows: pd.DataFrame) -> str:
    """Return the Markdown table of the scores of all peers on the records of these rows, a line for each peer."""
    lines = []
    for name in peers_of(rows):
        part = where(rows, peer=name)
        answered = where(part, outcome=OK)
        known, named, right = names(part)
        lines.append([
            ROSTER[name].label, str(len(part)), str(len(answered)),
            *(_percent(quantile_of_errors(part, level)) for level in (0.5, 0.9)),
            str(coverage(answered)[0]), f"{named} of {known}, {right}" if named else "–", _seconds(part),
        ])  # fmt: skip
    heads = "records", "answered", "median error", "90 % quantile", "coverage", "named, right", "seconds"
    return table(["", *heads], lines)


def _seconds(rows: pd.DataFrame) -> str:
    """Return the median CPU time (s) as text, over the rows that have one; a record that reached the limit has none."""
    known = numbers(rows.dropna(subset=["seconds"]), "seconds")
    return f"{np.median(known):.2g}" if known.size else "–"


def _where_better(factors: Mapping[str, Mapping[str, Interval]]) -> Iterator[str]:
    """Yield a Markdown line for each peer that is nearer to the truth than bayesdamp in a group, with the reason.

    factors: by peer and group, the error of the peer divided by that of bayesdamp (see `paired`).
    """
    better = {name: [g for g, f in each.items() if f.high < 1] for name, each in factors.items()}
    if not any(better.values()):
        yield "- On records that both answered, no peer is nearer to the truth in any group by more than chance."
    equal = {name: [g for g, f in each.items() if f.low <= 1 <= f.high] for name, each in factors.items()}
    lines = [f"{ROSTER[name].label} in {', '.join(places)}" for name, places in equal.items() if places]
    if lines:
        yield f"- Neither nearer nor farther by more than chance: {'; '.join(lines)}."
    for name, places in better.items():
        if places:
            yield f"- **{ROSTER[name].label}** is nearer in: {', '.join(places)}. {ROSTER[name].better}".rstrip()


def _faster(rows: pd.DataFrame) -> Iterator[str]:
    """Yield at most one Markdown line: the peers that need less CPU time than bayesdamp, and by which factors."""
    medians = {
        name: float(np.nanmedian(numbers(where(rows, peer=name), "seconds"))) for name in peers_of(rows)
    }
    own = medians.pop(OURS, math.nan)
    times = [f"{ROSTER[name].label} {_digits(own / m)}" for name, m in medians.items() if m < own]
    if times:
        yield f"- **Time**: these need less time than bayesdamp, by these factors: {'; '.join(times)}."


def _where_refused(by_group: Mapping[str, pd.DataFrame]) -> Iterator[str]:
    """Yield a Markdown line for each group with records that bayesdamp refused.

    It names the peers that answered these records, and their median errors. by_group: rows by name of the group.
    """
    for group, part in by_group.items():
        own = where(part, peer=OURS)
        refused = set(where(own, own["outcome"] != OK)["record"])
        extra = where(part, [record in refused for record in part["record"]], outcome=OK)
        others = []
        for name in peers_of(extra):
            answered = where(extra, peer=name)
            error = quantile_of_errors(answered, 0.5).value
            others.append(f"{ROSTER[name].label} {len(answered)} ({_digits(100 * error)} %)")
        if refused:
            head = f"- **{group}**: bayesdamp refused {len(refused)} of {len(own)} records."
            yield f"{head} Peers that answered these, with the median error: {'; '.join(others) or 'none'}."


def _percent(error: Interval) -> str:
    """Return an error, given as a fraction, as text in per cent, with its interval if it has one; a dash for NaN."""
    if math.isnan(error.value):
        return "–"
    ends = "" if math.isnan(error.low) else f" ({_digits(100 * error.low)}–{_digits(100 * error.high)})"
    return f"{_digits(100 * error.value)} %{ends}"


def _factor(factor: Interval, count: int) -> str:
    """Return a ratio of errors with its interval as text, in bold if the interval is below 1; a dash if `count` is 0.

    count: number of records of which the ratio is a mean.
    """
    if not count:
        return "–"
    ends = "" if math.isnan(factor.low) else f" ({_digits(factor.low)}–{_digits(factor.high)})"
    text = f"{_digits(factor.value)}{ends}"
    return f"**{text}**" if factor.high < 1 else text


def _digits(value: float) -> str:
    """Return a number as text with two significant digits (all digits from 100 on) and without an exponent."""
    return f"{value:.0f}" if value >= 100 else f"{float(f'{value:.2g}'):g}"
