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
    date, rest = 0, cell  # 0: without a date
    if slashed := _SLASHED.match(cell):
        low, high = sorted((int(slashed[1]), int(slashed[2])))
        if not (1 <= low <= 12 and high <= 31):
            return None
        rest = cell[slashed.end() :]
    elif dated := next(filter(None, (pattern.match(cell) for pattern in _DATES)), None):
        try:
            date = datetime.date(int(dated["y"]), int(dated["m"]), int(dated["d"])).toordinal()
        except ValueError:
            return None
        if cell[dated.end() : dated.end() + 1] not in ("T", "t", " "):
            return None
        rest = cell[dated.end() + 1 :].strip()
    found = _TIME.fullmatch(rest)
    if found is None:
        return None
    hours, minutes, seconds = int(found[1]), int(found[2]), float((found[3] or "0").replace(",", "."))
    zone = (found[4] or "").upper()
    if zone in ("AM", "PM"):
        if not 1 <= hours <= 12:
            return None
        hours = hours % 12 + 12 * (zone == "PM")
    if minutes > 59 or seconds >= 61 or (hours > 24 if date else found[3] is None):
        return None
    total = 3600.0 * hours + 60.0 * minutes + seconds
    if not date:
        return None, total
    if zone[:1] in ("+", "-"):
        digits = zone[1:].replace(":", "").ljust(4, "0")
        if int(digits[:2]) > 14 or int(digits[2:]) > 59:
            return None
        offset = 3600 * int(digits[:2]) + 60 * int(digits[2:])
        total += offset if zone[0] == "-" else -offset
    days, total = divmod(total, DAY)
    return date + int(days), total


def seconds(days: list[int | None], of_day: np.ndarray) -> np.ndarray:
    """Return times (n,) in s: of dated stamps from the first one's midnight on, of others with midnights counted."""
    if None not in days:
        return of_day + DAY * (np.array(days, float) - float(days[0] or 0))
    t = of_day.copy()
    known = np.flatnonzero(np.isfinite(t))
    falls = np.diff(t[known]) < -80000.0
    t[known] += DAY * np.concatenate([np.zeros(min(known.size, 1)), np.cumsum(falls)])
    return t
