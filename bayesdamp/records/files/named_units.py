"""Units that the names of columns say: `Angle(deg)`, `Time [ms]`, `acceleration / (m/s²)`, `phi_deg`."""

from __future__ import annotations

import re

from bayesdamp.units import UNITS

SECONDS = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds", "sek", "sekunde", "sekunden"), 1.0),
    **dict.fromkeys(("ms", "msec", "msecs", "millis", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "µs", "μs", "usec", "usecs", "micros", "microsecond", "microseconds"), 1e-6),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanos", "nanosecond", "nanoseconds"), 1e-9),
    **dict.fromkeys(("ps", "psec", "picosecond", "picoseconds"), 1e-12),
    **dict.fromkeys(("min", "mins", "minute", "minutes", "minuten"), 60.0),
    **dict.fromkeys(("h", "hr", "hrs", "hour", "hours", "std", "stunde", "stunden"), 3600.0),
    **dict.fromkeys(("d", "day", "days", "tag", "tage"), 86400.0),
}
"""Of a unit of time as it may be written."""
_JOINED = re.compile(
    r"(?:time|stamp|elapsed|(?<![^\W_])t)[.-]?(sec|[mµμun]s|[mun]sec|millis|micros|nanos)$", re.IGNORECASE
)
"""A unit that is joined to the name of times, as in ArduPilot's `TimeUS`."""
TIMES = re.compile(
    r"^t(\d*|[\s_.-]\w)$|time|elapsed|stamp|zeit|temps|tiempo|tempo|second|sekunde|uhr|epoch|x_value",
    re.IGNORECASE,
)
"""What a column of times is named."""
_OF_TIMES = {said for said, seconds in SECONDS.items() if seconds > 60.0 or seconds < 1e-9}
"""Also symbols and words of something else (a depth, a height, an hour angle, horsepower): units in what is named
after times alone."""
_UNSURE = ("in", "v", "V", "g", "au", "foot")
"""Behind a "_" these may as well be a word of the name."""
_SHORT = ("mm", "cm", "um", "mV", "ms", "us")
"""Units of two letters that are no word, so that a blank before them is enough."""
_WORDS = {
    **dict.fromkeys(("velocity", "velocities", "vel", "speed", "gyro", "gyroscope"), "velocity"),
    **dict.fromkeys(("acceleration", "accelerations", "accel", "acc", "accelerometer"), "acceleration"),
}
_PER = (
    ("acceleration", re.compile(r"(/s2|/s/s|/\(s2\)|s-2|/sec2)$")),
    ("velocity", re.compile(r"(/s|s-1|/sec)$")),
)


def seconds_in(name: str) -> float | None:
    """Seconds in the unit that a column of times is named after; None where it names none."""
    said = [one for one in map(_bare, _said(name)) if one in SECONDS]
    if not said and (joined := _JOINED.search(name.strip())):
        said = [joined[1].lower()]
    found = set[float]()
    for unit in said:
        if unit in _OF_TIMES and name.strip().lower() not in ("hours", "days", "stunden", "tage"):
            rest = re.sub(r"[\s_/(\[{]+(in\s+)?$", "", name[: name.lower().rindex(unit.removesuffix("s"))])
            if not TIMES.search(rest.rpartition(".")[2].strip()):
                continue
        found.add(SECONDS[unit])
    return found.pop() if len(found) == 1 else None


def seconds_written(unit: str) -> float | None:
    """Seconds in a unit of time as a file writes it beside the name: `h`, `ms since 2024-01-01`; None for others."""
    return SECONDS.get(_bare(re.sub(r"\s+since\s.*$", "", unit.strip(" ()[]"))))


def may_be_unit(cell: str, name: str) -> bool:
    """Whether a cell below a column's name is its unit, or empty."""
    said = cell.strip("()[] ")
    if _bare(said) in SECONDS:
        return _bare(said) not in _OF_TIMES or bool(TIMES.search(name))
    return said in ("", "-") or unit_written(said) is not None


def _bare(said: str) -> str:
    return said.lower().replace("(s)", "s").strip(" .")


def unit_and_quantity(name: str) -> tuple[str, str] | None:
    """The unit of the displacement and the recorded quantity that a column is named after; None where it names none, or
    several."""
    found = {one for one in map(unit_written, _said(name)) if one is not None}
    if len(found) != 1:
        return None
    unit, quantity = found.pop()
    return unit, quantity if UNITS[unit].physical else quantity_of(name) or quantity


def quantity_of(name: str) -> str | None:
    """The quantity that a word of a column's name says: velocity or acceleration; None where none does."""
    words = re.findall(r"[a-z]+", re.sub(r"([a-z])([A-Z])", r"\1 \2", name).lower())
    found = {_WORDS[word] for word in words if word in _WORDS}
    return found.pop() if len(found) == 1 else None


def _said(name: str) -> list[str]:
    """What may be a unit in a name: within brackets, behind a "/", " in " or "_"."""
    inside = re.findall(r"\(((?:[^()]|\([^()]*\))*)\)|\[([^\[\]]*)\]|\{([^{}]*)\}", name)
    found = ["".join(groups).strip() for groups in inside]
    behind = re.search(r"(?:^[^/\s]+/|\s/\s*|\sin\s+|_)([^\s_]+)\s*$", name)
    last = re.search(r"(?:^|\s)([^\W\d_]+)\s*$", name)
    if not found and not behind and last and (_bare(last[1]) in SECONDS or _plain(last[1]) in _WRITTEN):
        # A unit though nothing marks it: `Angle degrees`, `adc`.
        word, whole = last[1], last[1] == name.strip()
        if (len(word) > 2 and word not in _UNSURE and word != "min") or (word in _SHORT and not whole):
            return [word]
    if found or not behind or (behind[0][0] == "_" and behind[1] in _UNSURE):
        return found
    return [behind[1].strip("()[]{}")]


def unit_written(said: str) -> tuple[str, str] | None:
    """The unit and the quantity that a unit as it is written stands for; None where it is none."""
    text = _plain(said)
    if text in _WRITTEN:
        return _WRITTEN[text].name, _WRITTEN[text].quantity or "angle"
    for quantity, per in _PER:
        unit = _WRITTEN.get(text[: at.start()]) if (at := per.search(text)) else None
        if unit is not None and unit.quantity is None:
            return unit.name, quantity
    return None


def by_name(unit: str | None, quantity: str | None) -> tuple[str | None, str | None]:
    """A unit and a quantity that somebody gives, the unit by its name in `UNITS` where it is written as the head of a
    column may write it: `°`, `degrees`, or `deg/s`, which gives the quantity too unless that is given."""
    if unit is None or unit in UNITS or (written := unit_written(unit)) is None:
        return unit, quantity
    name, what = written
    return name, quantity or (what if what != "angle" else None)


def _plain(said: str) -> str:
    """Without spaces and signs of powers, in small letters."""
    return re.sub(r"[\s*^·.{}]", "", said.lower().replace("²", "2").replace("⁻", "-").replace("¹", "1"))


_WRITTEN = {_plain(said): unit for unit in UNITS.values() for said in (unit.name, *unit.written)}
