"""What a file says beside its columns: a sampling rate, a unit, when it was recorded."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping

from bayesdamp.provenance import Fact
from bayesdamp.records.files.named_units import SECONDS

MOST, LONGEST = 60, 200
"""Facts of a file that are kept, and characters of one."""
_PAIR = re.compile(r"\s*([^\W\d][^:=\t;]{0,60}?)\s*(?:[:=]\s*[\t;]?|[\t;])\s*(\S.*?)\s*")
_NUMBER = re.compile(r"[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?")
_THOUSANDS = re.compile(r"[1-9]\d{0,2}(?:(?:,\d{3}){2,}(?:\.\d*)?|(?:,\d{3})+\.\d*)(?![\d.,])")
_EITHER = re.compile(r"[1-9]\d{0,2},\d{3}(?![\d.,eE])")
"""A number whose comma may be a decimal mark or set thousands apart."""
_HERTZ = {
    "": 1.0,
    "hz": 1.0,
    "khz": 1e3,
    "mhz": 1e6,
    "ks/s": 1e3,
    **dict.fromkeys(("s/s", "sa/s", "samples/s", "samples/sec", "samples per second", "1/s", "sps"), 1.0),
}
_RATES = re.compile(
    r"(samp|sample|sampling|samples|acquisition|scan|frame|data|outputdata|daq|adc|log|logging|update|sensor)"
    r"(rate|frequency|freq|persecond|persec|spersecond)|rate|fs|fps|sr|srate|odr|fsamp|fsample"
    r"|(abtast|mess|sample|sampling)(rate|frequenz)"
)
_STEPS = re.compile(
    r"(sample|sampling|time|horizontal|log|logging|scan|x|wf)?(interval|step|increment)|(sample|sampling)(time|period)"
    r"|dt|deltat|deltax|tstep|tinc|xinc|abtast(intervall|zeit|periode)|zeitschritt"
)
_UNDERSCORED = re.compile(r"(..+)(?<!per)_([mun]?s(?:ec)?)", re.IGNORECASE)
"""A unit of time behind a fact's name: `dt_ms`; `f_s` is none."""
_MATLAB_STEP = "Ts"
"""MATLAB's name of a sampling interval; `ts` is rather a time stamp."""


def header_facts(lines: Iterable[str]) -> dict[str, Fact]:
    """The facts in lines above a table: `key: value`, `key = value`, `key,value,unit`, `key,value,value` where a value
    stands for each of several channels alike, or a line of names with a line of as many values below it."""
    found: dict[str, Fact] = {}
    before: list[str] = []
    for line in lines:
        line = line.strip().lstrip("#%;/ ").strip().rstrip(",;\t")
        cells = [cell.strip().strip('"') for cell in re.split(r"[,;\t]", line)]
        numbers = sum(bool(_NUMBER.fullmatch(cell)) for cell in cells)
        pair = _PAIR.fullmatch(line)
        named = bool(cells[0]) and not re.search("[:=]", cells[0]) and not _NUMBER.fullmatch(cells[0])
        if named and 0 < numbers == len(cells) - 1 and len(set(cells[1:])) == 1:
            found[cells[0]] = cells[1]
        elif len(before) == len(cells) > 1 and numbers and not any(map(_NUMBER.fullmatch, before)):
            found |= dict(zip(before, cells, strict=True))
        elif re.search(r"\bunits?$", cells[0], re.IGNORECASE) and len(set(filter(None, cells[1:]))) == 1:
            found[cells[0]] = max(cells[1:]).rpartition(":")[2]
        elif pair and not (len(cells) > 2 and numbers > 1):
            found[pair[1].strip('"')] = pair[2].strip('"')
        elif 2 <= len(cells) <= 3 and numbers == 1 and _NUMBER.fullmatch(cells[1]):
            found[cells[0]] = " ".join(cells[1:])
        before = cells
    return kept(found)


def kept(facts: Mapping[str, object]) -> dict[str, Fact]:
    """The facts that are worth keeping, cut to a length that a page can show."""
    found: dict[str, Fact] = {}
    for name, value in facts.items():
        text = " ".join(str(name).split())[:LONGEST]
        if not text or len(found) >= MOST:
            continue
        if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
            found[text] = float(value)
        elif isinstance(value, str) and value.strip():
            found[text] = " ".join(value.split())[:LONGEST]
    return found


def sampling_rate(facts: Mapping[str, Fact]) -> tuple[float, str] | None:
    """Return the rate in Hz and the fact that says it; None where none does, or several that differ do."""
    found: dict[float, str] = {}
    for name, value in facts.items():
        if rate := _rate(name, value):
            found.setdefault(float(f"{rate:.9g}"), name)
    return next(iter(found.items())) if len(found) == 1 else None


def _rate(name: str, value: Fact) -> float | None:
    """Return the rate in Hz that a fact says; None where it is of something else, or its number has two readings."""
    bare, unit = _parted(name)
    is_rate = bool(_RATES.fullmatch(bare))
    if not (is_rate or _STEPS.fullmatch(bare) or re.split(r"[./]", name)[-1] == _MATLAB_STEP):
        return None
    number, behind = _read(value) if isinstance(value, str) else (float(value), "")
    unit = re.split("[,;]", behind)[0].strip(" ()[]").lower() or unit
    factor = _HERTZ.get(unit, 0.0) if is_rate else SECONDS.get(unit or "s", 0.0)
    if not number * factor > 1e-300:
        return None
    rate = number * factor if is_rate else 1 / (number * factor)
    return rate if math.isfinite(rate) else None


def _read(text: str) -> tuple[float, str]:
    """Return the number that a text begins with and what follows; 0 where there is none, or it has two readings."""
    if at := _THOUSANDS.match(text):
        return float(at[0].replace(",", "")), text[at.end() :]
    at = None if _EITHER.match(text) else _NUMBER.match(text)
    return (float(at[0].replace(",", ".")), text[at.end() :]) if at else (0.0, "")


def _parted(name: str) -> tuple[str, str]:
    """A fact's last name, letters alone, and the unit in brackets behind it."""
    last = re.split(r"[./]", name)[-1] if not re.search(r"[(\[]", name) else name
    at = re.search(r"[(\[]([^)\]]*)[)\]]\s*$", last)
    unit = at[1].strip().lower() if at else ""
    if at is None and (behind := _UNDERSCORED.fullmatch(last)):
        last, unit = behind[1], behind[2].lower()
    bare = re.sub(r"[^a-z]", "", (last[: at.start()] if at else last).lower())
    if not unit:
        ending = re.fullmatch(r"(.*?)(?:in)?(khz|hz)", bare)
        bare, unit = (ending[1], ending[2]) if ending and ending[1] else (bare, "")
    return bare, unit


def said_unit(facts: Mapping[str, Fact]) -> str:
    """The unit that a fact gives for the values, empty where none does."""
    wanted = ("unit", "units", "yunit", "yunits", "verticalunits", "angleunit")
    found = {str(v) for n, v in facts.items() if _parted(n)[0] in wanted}
    return found.pop() if len(found) == 1 else ""
