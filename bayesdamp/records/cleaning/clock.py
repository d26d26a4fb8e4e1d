"""Choose the times of the samples: as logged, or a uniform clock if time stamps are rounded or come in bursts.

In a burst, several samples arrive together. They get nearly the same time stamp, because they are stamped when they
arrive and not when they are taken.
"""

import numpy as np

from bayesdamp.records.record import RawRecord
from bayesdamp.types import InputError

BURST_REPEATS = 0.05
"""A time stamp repeats if it equals the stamp before. If at least this fraction of the stamps repeat, the clock "auto"
assumes that the samples were taken at equal time steps, but got their stamps in bursts. A smaller fraction is refused
as a fault of the file (conventional)."""
EVEN_STEPS_RATIO = 1.5
"""If the times of a file go back, the message advises to sort the rows if the sorted times have nearly even steps: mean
step / median step and median step / smallest step are both below this (conventional)."""
MIN_PAUSES, SHORT_STEP = 8, 0.3
"""Time stamps come in bursts if at least `MIN_PAUSES` steps are longer than the mean step (the pauses between bursts),
at least `MIN_PAUSES` steps are not longer, and the median step is at most `SHORT_STEP` times the mean step
(conventional). The test for missing rows of the file also requires at least `MIN_PAUSES` longer steps and as many other
steps."""
JUMP_RATIO = 2.0
"""Some time steps may be multiples of the smallest one, because rows of the file are missing or because the stamps are
rounded. Rows count as missing if the values change more across the longer steps: their mean squared change there must
be more than this factor times that across the other steps (conventional)."""
MULTIPLE_TOLERANCE = 1e-3
"""Rows of the file count as missing only if every time step is a multiple of the smallest step, within this fraction of
the smallest step (conventional)."""
UNIFORM_TOLERANCE = 1e-6
"""Time stamps that differ from a uniform clock by at most this fraction of a step do not count as rounded and are used
as they are (conventional)."""
ROUNDING_TOLERANCE = 0.6
"""Time stamps count as rounded or truncated times of a uniform clock if they differ from the fitted uniform clock by at
most this fraction of the unit of their last digit: 0.5 from rounding, and 0.1 for the error of the fit."""
TIME_UNITS = (1.0, 60.0, 3600.0, 86400.0)
"""Units in which a file may write its times, in s: second, minute, hour and day."""
MOST_STEPS_OFF = 8
"""The clock "auto" refuses a uniform clock if a time stamp differs from it by more than this many typical time steps
(the median of the steps above zero), because the record may then contain a pause (conventional)."""
MIN_ROUNDED_STEPS = 8
"""Time stamps count as rounded only if at least this many time steps differ from the median step. Rounding changes
steps at even distances along the record, but missing or repeated rows change steps at random places. The probability
that eight random changes are evenly distributed, one in each eighth of the record, is only 0.24 % (8!/8⁸)."""


def clock_times(raw: RawRecord, clock: str, name: str) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return the times of a record in s, (n,), on the clock of the file, and sentences on what was done.

    If the record has no time stamps, its times follow from its sampling rate and start at 0, whatever the clock. The
    clock "as_logged" uses the time stamps. A uniform clock is first stamp + row index × step. The clock "auto" applies
    the first of these rules that fits ("refused" means InputError):

    1. The stamps are the rounded times of a uniform sampling, and no rows are missing: uniform clock, with the step of
       that sampling. Refused if the unit of the stamps' last digit is longer than the step.
    2. Some stamps repeat, but fewer than the fraction BURST_REPEATS: refused.
    3. No stamp repeats, but the stamps come in bursts: refused.
    4. No stamp repeats: as logged.
    5. Otherwise: uniform clock. Its step is the slope of a robust line through the stamps against the row index.
       Refused if a stamp is too far from this line (MOST_STEPS_OFF).

    The clock "uniform" uses the step of rule 1 if the stamps are rounded to this step or finer, else that of rule 5. If
    the stamps come in bursts as in rule 3, the line is fitted only to the first stamp of each burst.

    Parameters
    ----------
    raw
        The record.
    clock
        "as_logged", "uniform", or "auto": uniform if the stamps are rounded or many repeat, else as logged.
    name
        Name of the record in messages.

    Raises
    ------
    InputError
        If the clock is unknown; if stamps decrease or are all equal; if they repeat and the clock is "as_logged"; if
        the choice for "auto" is not clear; if there is neither a time stamp nor a sampling rate.
    """
    if clock not in ("auto", "as_logged", "uniform"):
        raise InputError(f"unknown clock {clock!r}; valid are auto, as_logged, uniform", name)
    rows = raw.rows - raw.rows[0] if raw.rows.size else np.arange(raw.y.size)
    if raw.t is None:
        if raw.rate is None:
            problem = "the record has neither times nor a sampling rate; give the rate in Hz"
            raise InputError(problem, name, arguments=["rate"])
        note = f"No times are used: samples are taken as equally spaced at {raw.rate:g} Hz."
        return rows / raw.rate, (note,)
    gaps = np.diff(raw.t)
    if np.any(gaps < 0):
        at = int(np.argmax(gaps < 0))
        problem, arguments = _describe_backward_times(raw.t, at)
        raise InputError(problem, name, _describe_row(raw, at + 1), arguments)
    if raw.t[-1] == raw.t[0]:
        problem = f"all times are {raw.t[0]:g}; name the right time column, or give the rate in Hz"
        raise InputError(problem, name, arguments=["time", "rate"])
    repeated_fraction = float(np.mean(gaps == 0))
    first_repeat, share = int(np.argmax(gaps == 0)) + 1, f"{100 * repeated_fraction:.3g} %"
    if clock == "as_logged":
        if repeated_fraction:
            problem = f'{share} of the times repeat, which the clock "as_logged" cannot use; use "uniform"'
            raise InputError(problem, name, _describe_row(raw, first_repeat), ["clock"])
        return raw.t, ()
    is_auto = clock == "auto"
    if not (is_auto and _rows_are_missing(rows, raw.t, raw.y)):
        digit, step, largest_misfit = rounded_sampling(rows, raw.t)
        if UNIFORM_TOLERANCE * step < largest_misfit <= ROUNDING_TOLERANCE * digit and digit <= step:
            note = f"The time stamps are written to {digit:.3g} s: {_describe_uniform(raw.t[0], step)}."
            return raw.t[0] + step * rows, (note,)
        if is_auto and digit > step and largest_misfit <= digit:
            raise InputError(
                f"{share} of the times repeat: they are written to {digit:.3g} s, and the mean step between rows is "
                f'{step:.3g} s; remove repeated rows, give the rate, or use the clock "uniform", which estimates it',
                name,
                arguments=["clock", "rate"],
            )
    if is_auto and 0 < repeated_fraction < BURST_REPEATS:
        raise InputError(
            f"the time {raw.t[first_repeat]:.10g} s repeats the one before, as do {share} of the times; these are too "
            'few for stamps in bursts. Correct the file, or use the clock "uniform"',
            name,
            _describe_row(raw, first_repeat),
            ["clock"],
        )
    begins = np.arange(raw.y.size) if repeated_fraction else burst_begins(raw.t)
    in_bursts = begins.size < raw.y.size
    if is_auto and in_bursts:
        raise InputError(
            f'the time stamps come in bursts of about {raw.y.size / begins.size:.2g} samples: use the clock "uniform" '
            'if the samples were taken evenly and only their stamps are late, "as_logged" if they were taken in bursts',
            name,
            arguments=["clock"],
        )
    if is_auto and not repeated_fraction:
        return raw.t, ()
    step, largest_misfit = robust_step(rows[begins], raw.t[begins])
    if is_auto and largest_misfit > MOST_STEPS_OFF * float(np.median(gaps[gaps > 0])):
        raise InputError(
            f"{share} of the times repeat, but a uniform clock would be off by up to {largest_misfit:.3g} s; is there "
            'a pause in the record? To assume equal steps nevertheless, use the clock "uniform"',
            name,
            arguments=["clock"],
        )
    why = f"{share} of the time stamps repeat (they come in bursts)" if repeated_fraction else "As requested"
    anchors = "bursts begin" if in_bursts else "stamps are"
    note = f"{why}: {_describe_uniform(raw.t[0], step)}; the {anchors} within {largest_misfit:.2g} s of these times."
    return raw.t[0] + step * rows, (note,)


def _describe_uniform(start: float, step: float) -> str:
    rate = f"{step * 1e3:.6g} ms ({1 / step:.2f} Hz)"
    return f"times are rebuilt as index × {rate} from the first stamp, {start:.10g} s, on"


def _rows_are_missing(rows: np.ndarray, t: np.ndarray, y: np.ndarray) -> bool:
    """Return whether rows of the file are missing, so that some steps of the times t (n,), in s, are longer.

    If rows are missing, the longer steps are multiples of the smallest step, and the values y (n,) change more across
    the longer steps than across the others. If the stamps are only rounded to about their step, the values change
    equally across both. The result is False if there are fewer than `MIN_PAUSES` longer steps or fewer than
    `MIN_PAUSES` others.

    rows: row numbers of the samples in the file, (n,).
    """
    neighbours = np.diff(rows) == 1
    gaps, moves = np.diff(t)[neighbours], np.diff(y)[neighbours] ** 2
    if gaps.size == 0:
        return False
    least = gaps.min()
    many = np.round(gaps / max(least, 1e-300))
    longer = many > 1
    if (
        min(longer.sum(), (~longer).sum()) < MIN_PAUSES
        or np.abs(gaps - many * least).max() > MULTIPLE_TOLERANCE * least
    ):
        return False
    return bool(moves[longer].mean() > JUMP_RATIO * moves[~longer].mean())


def rounded_sampling(rows: np.ndarray, t: np.ndarray) -> tuple[float, float, float]:
    """Fit a uniform clock to time stamps, and find the last digit to which the stamps are rounded.

    Parameters
    ----------
    rows, t
        Row numbers of the samples in the file and their time stamps in s, each (n,).

    Returns
    -------
    tuple of float
        Unit of the last digit to which the stamps are written (such as 0.01), step of the uniform clock, and largest
        difference between a stamp and the uniform clock, all in s; all zero if the stamps are not rounded.
    """
    late, rounding = t[t.size // 2 :], 4 * np.finfo(float).eps * float(np.abs(t).max())
    digits = [unit * 10.0**-decimals for unit in TIME_UNITS for decimals in range(-3, 13)]
    multiples = [
        digit
        for digit in digits
        if digit >= 4 * rounding and np.abs(late - digit * np.round(late / digit)).max() <= rounding
    ]
    digit, steps = max(multiples, default=0.0), np.diff(t)[np.diff(rows) == 1]
    if not digit or np.sum(np.abs(steps - np.median(steps)) > 0.5 * digit) < MIN_ROUNDED_STEPS:
        return 0.0, 0.0, 0.0
    x = rows - rows.mean()
    step, start = np.polyfit(x, t, 1)
    return digit, float(step), float(np.abs(t - start - step * x).max())


def burst_begins(t: np.ndarray) -> np.ndarray:
    """Return the indices of the samples that begin a burst of time stamps; those of all samples if there are no bursts.

    t: time stamps in s, (n,). In bursts most steps are much shorter than the mean step; a burst begins after each step
    longer than the mean.
    """
    gaps = np.diff(t)
    pauses = gaps > gaps.mean()
    if min(pauses.sum(), (~pauses).sum()) < MIN_PAUSES or np.median(gaps) > SHORT_STEP * gaps.mean():
        return np.arange(t.size)
    return np.r_[0, 1 + np.flatnonzero(pauses)]


def _describe_backward_times(t: np.ndarray, at: int) -> tuple[str, tuple[str, ...]]:
    """Return a message on times t (n,) that decrease after sample `at`, and names of arguments of `read` that can help.

    t: in s. at: index of the sample, from 0. If the times decrease throughout, the message does not advise to sort
    them: the clock may count down, and sorting would then turn the decay into growth.
    """
    gaps = np.diff(t)
    if np.all(gaps <= 0):
        what = (
            f"the time runs backwards throughout, from {t[0]:.10g} to {t[-1]:.10g} s; if the rows are in the order of "
            f"recording, give the rate ({-1 / gaps.mean():.5g} Hz) instead; if the last was recorded first, reverse "
            "them"
        )
        return what, ("rate",)
    rows = int(np.sum(gaps < 0))
    how = f"the time goes back from {t[at]:.10g} to {t[at + 1]:.10g} s"
    how += f" ({rows} rows do so)" if rows > 1 else ""
    steps = np.diff(np.sort(t))
    if steps.min() > np.median(steps) / EVEN_STEPS_RATIO and steps.mean() < EVEN_STEPS_RATIO * np.median(
        steps
    ):
        return f"{how}; the rows are out of order: sort them by time, which makes the times evenly spaced", ()
    what = (
        f"{how}; does another record begin there (split the file), or do the times change their unit (give the rate "
        "instead)? Else name the right time column"
    )
    return what, ("time", "rate")


def robust_step(rows: np.ndarray, t: np.ndarray) -> tuple[float, float]:
    """Fit a straight line, robust against outliers, to the times of samples against their row numbers.

    Parameters
    ----------
    rows, t
        Row numbers of the samples in the file and their times in s, each (n,).

    Returns
    -------
    tuple of float
        Slope of the line (time step from row to row), and the largest distance of a time from the line, both in s.
    """
    x, weights = rows - rows.mean(), np.ones(t.size)
    step, rest = 0.0, t
    for _ in range(20):
        mean_x, mean_t = np.average(x, weights=weights), np.average(t, weights=weights)
        before = step
        step = float(np.sum(weights * (x - mean_x) * (t - mean_t)) / np.sum(weights * (x - mean_x) ** 2))
        rest = t - mean_t - step * (x - mean_x)
        scale = 1.4826 * float(np.median(np.abs(rest))) + 1e-12 * float(np.ptp(t))
        weights = 1 / np.maximum(np.abs(rest) / (1.5 * scale), 1.0)
        if abs(step - before) <= 1e-12 * step:
            break
    return step, float(np.abs(rest).max())


def _describe_row(raw: RawRecord, index: int) -> str:
    line = raw.provenance.first_line
    if line is not None and raw.rows.size:
        return f"line {int(raw.rows[index]) + line}"
    return f"sample {index} (from 0)"
