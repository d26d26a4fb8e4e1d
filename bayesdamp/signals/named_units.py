"""Units that the names of columns say: `Angle(deg)`, `Time [ms]`, `acceleration / (m/s²)`, `phi_deg`."""

from __future__ import annotations

import re

SECONDS = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "µs", "μs", "usec", "microsecond", "microseconds"), 1e-6),
    **dict.fromkeys(("ns", "nanosecond", "nanoseconds"), 1e-9),
    **dict.fromkeys(("min", "minute", "minutes"), 60.0),
}
"""Of a unit of time as it may be written."""
LENGTHS = {
    **dict.fromkeys(("rad", "radian", "radians"), "rad"),
    **dict.fromkeys(("deg", "degree", "degrees", "°"), "deg"),
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), "m"),
    **dict.fromkeys(("mm", "millimeter", "millimeters", "millimetre", "millimetres"), "mm"),
}
"""Of a displacement's, the unit as a study names it."""
_PER = (
    ("acceleration", re.compile(r"(/s2|/s/s|/\(s2\)|s-2|/sec2)$")),
    ("velocity", re.compile(r"(/s|s-1|/sec)$")),
)


def seconds_in(name: str) -> float | None:
    """Seconds in the unit that a column of times is named after; None where it names none."""
    found = [SECONDS[said.lower()] for said in _said(name) if said.lower() in SECONDS]
    return found[0] if len(set(found)) == 1 else None


def unit_and_quantity(name: str) -> tuple[str, str] | None:
    """The unit of the displacement and the recorded quantity that a column is named after; None where it names none, or
    several."""
    found = {one for one in map(_unit, _said(name)) if one is not None}
    return found.pop() if len(found) == 1 else None


def _said(name: str) -> list[str]:
    """What may be a unit in a name: within brackets, behind a last " / ", " in " or "_"."""
    inside = re.findall(r"\(((?:[^()]|\([^()]*\))*)\)|\[([^\[\]]*)\]|\{([^{}]*)\}", name)
    found = ["".join(groups).strip() for groups in inside]
    behind = re.search(r"(?:\s/\s*|\sin\s+|_)([^\s_]+)\s*$", name)
    return found + ([behind[1].strip("()[]{}")] if behind and not found else [])


def _unit(said: str) -> tuple[str, str] | None:
    text = re.sub(r"[\s*^·.{}]", "", said.lower().replace("²", "2").replace("⁻", "-").replace("¹", "1"))
    for quantity, per in _PER:
        if (at := per.search(text)) and text[: at.start()] in LENGTHS:
            return LENGTHS[text[: at.start()]], quantity
    return (LENGTHS[text], "angle") if text in LENGTHS else None
