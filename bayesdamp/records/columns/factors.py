"""A factor that the name of a column has beside its unit: `angle x1000 (deg)`, `disp (1e-3 m)`, `acc (10^-3 m/s^2)`."""

from __future__ import annotations

import re

from bayesdamp.records.files.named_units import SECONDS, unit_written

_POWER = r"(?:\d+(?:\.\d+)?e[+-]?\d+|10\s*(?:\^|\*\*)\s*[({]?[+-]?\d+[)}]?|10[⁺⁻]?[⁰¹²³⁴⁵⁶⁷⁸⁹]+)"
"""What can be nothing but a factor: `1e-3`, `10^-3`, `10⁻³`."""
_TENS = r"10{1,8}"
_MARKED = rf"(?:[x×*·/]\s*(?:{_POWER}|{_TENS})|(?:{_POWER}|{_TENS})\s*[x×*·]|{_POWER}|0\.0*1)"
"""A plain 10, 100 ... is one only behind or before a sign: `(2 g)`, `(10 V)` are ranges of sensors."""
_INSIDE = re.compile(
    rf"^(?:(?P<before>{_MARKED})\s*(?P<unit>\D.*)|(?P<of>.*?[^\s,;])[\s,;]*(?P<behind>{_MARKED}))$",
    re.IGNORECASE,
)
_OUTSIDE = rf"(?:(?<!\d)[×*·/]\s*(?:{_POWER}|{_TENS})|x\s*(?:{_POWER}|10{{2,8}})|(?<![\w.]){_POWER})"
"""Beside brackets `x10` may be the tenth of x1, x2, x3 ..."""
_BEFORE = re.compile(rf"\w[\s_]*({_OUTSIDE})\s*[(\[{{](?P<unit>[^()\[\]{{}}]+)[)\]}}]\s*$", re.IGNORECASE)
_BEHIND = re.compile(rf"[(\[{{](?P<unit>[^()\[\]{{}}]+)[)\]}}]\s*({_OUTSIDE})\s*$", re.IGNORECASE)
_FIRST = re.compile(
    rf"^((?:{_POWER}|{_TENS})\s*[×*·])\s*[^\W\d].*[(\[{{](?P<unit>[^()\[\]{{}}]+)[)\]}}]\s*$", re.IGNORECASE
)
_BARE = re.compile(rf"(?:\s/|\sin)\s+({_MARKED})\s*(?P<unit>[^\s\d]\S*)\s*$", re.IGNORECASE)
_ALL = re.compile(rf"^({_POWER})\s*(?P<unit>\D.*)$", re.IGNORECASE)
"""A name that is a unit alone, from the second line of a head."""
_JOINED = re.compile(
    rf"_(x(?:{_POWER}|10{{2,8}}))_(?P<unit>[^\W\d_]+)$|_(?P<of>[^\W\d_]+)_(x(?:{_POWER}|10{{2,8}}))$",
    re.IGNORECASE,
)
_LONGEST = 200
"""Characters of a name that are looked through."""
_PROBE = re.compile(r"[x×]\s*100?$", re.IGNORECASE)
"""What an oscilloscope says of its probe, which its volts contain."""


def factor_beside_unit(name: str, apart: str = "") -> tuple[str, str] | None:
    """(the factor, the unit) as a column's name, or a unit that is written apart from it, says them; None where
    there is no factor, or none beside a unit that is known."""
    name = name[:_LONGEST]
    inside = [
        apart.strip("()[]{} "),
        *re.findall(r"[(\[{]\s*((?:[^()\[\]{}]|\([^()]*\)|\{[^{}]*\})*?)\s*[)\]}]", name),
    ]
    for text in inside:
        at = _INSIDE.match(text)
        if at is not None and (found := _known(at["before"] or at["behind"], at["unit"] or at["of"])):
            return found
    for pattern in (_BEFORE, _BEHIND, _FIRST, _BARE, _ALL, _JOINED):
        at = pattern.search(name)
        if at is None:
            continue
        groups = at.groupdict()
        unit = groups["unit"] or groups.get("of") or ""
        factor = next(text for text in at.groups() if text and text != unit)
        if found := _known(factor, unit):
            return found
    return None


def _known(factor: str, unit: str) -> tuple[str, str] | None:
    factor, unit = factor.strip(), unit.strip(" ,;·*x×")
    if unit.lower() not in SECONDS and unit_written(unit) is None:
        return None
    return None if _PROBE.search(factor) and unit.lower() in ("v", "mv", "volt", "volts") else (factor, unit)
