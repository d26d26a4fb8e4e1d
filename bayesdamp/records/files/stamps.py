"""Times that are written as a time of day, with a date or without."""

from __future__ import annotations

import datetime
import re

import numpy as np

DAY = 86400.0
_DATES = (
    re.compile(r"(?P<y>\d{4})[-/](?P<m>\d{1,2})[-/](?P<d>\d{1,2})"),
    re.compile(r"(?P<d>\d{1,2})\.(?P<m>\d{1,2})\.(?P<y>\d{4})"),
)
_SLASHED = re.compile(r"(\d{1,2})/(\d{1,2})/(?:\d{4}|\d\d)[ ,]\s*")
"""A date of which nobody says whether its day or its month stands first: midnights are counted instead."""
_TIME = re.compile(
    r"(\d{1,2}):(\d\d)(?::(\d\d(?:[.,]\d+)?))?\s*(AM|PM|Z|UTC|GMT|[+-]\d\d(?::?\d\d)?)?", re.IGNORECASE
)


def stamp(cell: str) -> tuple[int | None, float] | None:
    """(day, seconds of it) of a cell such as `2024-05-03T10:00:00.25Z`, `03.05.2024 10:00:00`, `5/3/2024 1:00:00 PM` or
    `10:00:00.25`.

    day: counted from the year 1, None without a date or where its order is not known; with a zone, both are UTC's. None
    where the cell is no time that exists (`99:99`), or has neither date nor seconds.
    """
    slashed = _SLASHED.match(cell)
    if slashed is not None and not _may_be_a_day(int(slashed[1]), int(slashed[2])):
        return None
    date, rest = _date(cell) if slashed is None else (0, cell[slashed.end() :])
    found = _TIME.fullmatch(rest)
    if date is None or found is None:
        return None
    hours, minutes, seconds = int(found[1]), int(found[2]), float((found[3] or "0").replace(",", "."))
    half = (found[4] or "").upper()
    if half in ("AM", "PM"):
        if not 1 <= hours <= 12:
            return None
        hours = hours % 12 + 12 * (half == "PM")
    dated = date > 0
    if minutes > 59 or seconds >= 61 or (dated and hours > 24) or (not dated and found[3] is None):
        return None
    total = 3600.0 * hours + 60.0 * minutes + seconds
    zone = (found[4] or "").upper()
    if not dated:
        return None, total
    if zone[:1] in ("+", "-"):
        digits = zone[1:].replace(":", "").ljust(4, "0")
        if int(digits[:2]) > 14 or int(digits[2:]) > 59:
            return None
        offset = 3600 * int(digits[:2]) + 60 * int(digits[2:])
        total += offset if zone[0] == "-" else -offset
    days, total = divmod(total, DAY)
    return date + int(days), total


def _may_be_a_day(first: int, second: int) -> bool:
    """Whether a day and a month, in either order, exist."""
    return 1 <= min(first, second) <= 12 and 1 <= max(first, second) <= 31


def _date(cell: str) -> tuple[int | None, str]:
    """(day from the year 1, 0 without a date and None for one that does not exist; what stands behind it)."""
    for pattern in _DATES:
        at = pattern.match(cell)
        if at is not None:
            if cell[at.end() : at.end() + 1] not in ("T", "t", " "):
                return None, ""
            try:
                day = datetime.date(int(at["y"]), int(at["m"]), int(at["d"])).toordinal()
            except ValueError:
                return None, ""
            return day, cell[at.end() + 1 :].strip()
    return 0, cell


def seconds(days: list[int | None], of_day: np.ndarray) -> np.ndarray:
    """Times (n,) in s: of dated stamps from the first one's midnight on, of others with midnights passed counted."""
    if all(day is not None for day in days):
        first = days[0] or 0
        return of_day + DAY * np.array([(day or 0) - first for day in days], float)
    return past_midnight(of_day)


def past_midnight(t: np.ndarray) -> np.ndarray:
    """Times of day (n,) that go on past midnight; others as they are. NaN stays."""
    known = np.flatnonzero(np.isfinite(t))
    falls = np.diff(t[known]) < -80000.0
    if not falls.any():
        return t
    out = t.copy()
    out[known] += DAY * np.concatenate([[0], np.cumsum(falls)])
    return out
