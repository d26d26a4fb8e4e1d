"""Facts that a file states outside its columns: a sampling rate, a unit, when it was recorded."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping

from bayesdamp.provenance import Fact
from bayesdamp.records.files.names import SECONDS

MOST, LONGEST = 60, 200
"""Number of facts of a file that are kept, and characters of one."""
_PAIR = re.compile(r"\s*([^\W\d][^:=\t;]{0,60}?)\s*(?:[:=]\s*[\t;]?|[\t;])\s*(\S.*?)\s*")
_NUMBER = re.compile(r"[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?")
_THOUSANDS = re.compile(r"[1-9]\d{0,2}(?:(?:,\d{3}){2,}(?:\.\d*)?|(?:,\d{3})+\.\d*)(?![\d.,])")
_EITHER = re.compile(r"[1-9]\d{0,2},\d{3}(?![\d.,eE])")
"""A number whose comma may be a decimal mark or separate thousands."""
_HERTZ = {
    **{"khz": 1e3, "ks/s": 1e3, "mhz": 1e6},
    **dict.fromkeys(
        ("", "hz", "1/s", "s/s", "sa/s", "sps", "samples/s", "samples/sec", "samples per second"), 1.0
    ),
}
"""Hz in a unit of rates, by the ways of writing it."""
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
"""A unit of time at the end of a fact's name: `dt_ms`, but not `f_s`."""
_MATLAB_STEP = "Ts"
"""MATLAB's name of a sampling interval; `ts` is more often a time stamp."""


def header_facts(lines: Iterable[str]) -> dict[str, Fact]:
    """Return the facts in the lines above a table.

    Such a line is `key: value`, `key = value`, `key,value,unit`, `key,value,value` with the same value for each
    channel, or a line of names followed by a line of as many values.
    """
    facts: dict[str, Fact] = {}
    before: list[str] = []
    for line in lines:
        line = line.strip().lstrip("#%;/ ").strip().rstrip(",;\t")
        cells = [cell.strip().strip('"') for cell in re.split(r"[,;\t]", line)]
        numbers = sum(bool(_NUMBER.fullmatch(cell)) for cell in cells)
        pair = _PAIR.fullmatch(line)
        named = bool(cells[0]) and not re.search("[:=]", cells[0]) and not _NUMBER.fullmatch(cells[0])
        if named and 0 < numbers == len(cells) - 1 and len(set(cells[1:])) == 1:
            facts[cells[0]] = cells[1]
        elif len(before) == len(cells) > 1 and numbers and not any(map(_NUMBER.fullmatch, before)):
            facts |= dict(zip(before, cells, strict=True))
        elif re.search(r"\bunits?$", cells[0], re.IGNORECASE) and len(set(filter(None, cells[1:]))) == 1:
            facts[cells[0]] = max(cells[1:]).rpartition(":")[2]
        elif pair and not (len(cells) > 2 and numbers > 1):
            facts[pair[1].strip('"')] = pair[2].strip('"')
        elif 2 <= len(cells) <= 3 and numbers == 1 and _NUMBER.fullmatch(cells[1]):
            facts[cells[0]] = " ".join(cells[1:])
        before = cells
    return trim_facts(facts)


def trim_facts(facts: Mapping[str, object]) -> dict[str, Fact]:
    """Return the first MOST numbers and texts among some facts, each cut to LONGEST characters."""
    trimmed: dict[str, Fact] = {}
    for name, value in facts.items():
        text = " ".join(str(name).split())[:LONGEST]
        if not text or len(trimmed) >= MOST:
            continue
        if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
            trimmed[text] = float(value)
        elif isinstance(value, str) and value.strip():
            trimmed[text] = " ".join(value.split())[:LONGEST]
    return trimmed


def sampling_rate(facts: Mapping[str, Fact]) -> tuple[float, str] | None:
    """Return the sampling rate that facts state.

    Parameters
    ----------
    facts
        By name, such as `Sample interval (ms)`.

    Returns
    -------
    tuple or None
        The rate in Hz and the name of the fact. None where no fact states one, where several differ, or where a
        number's comma is ambiguous.
    """
    rates: dict[float, str] = {}
    for name, value in facts.items():
        bare, unit = _split_unit(name)
        is_rate = bool(_RATES.fullmatch(bare))
        if not (is_rate or _STEPS.fullmatch(bare) or re.split(r"[./]", name)[-1] == _MATLAB_STEP):
            continue
        number = value
        if isinstance(value, str):
            thousands = _THOUSANDS.match(value)
            start = thousands or (None if _EITHER.match(value) else _NUMBER.match(value))
            if start is None:
                continue
            number = float(start[0].replace(",", "" if thousands else "."))
            unit = re.split("[,;]", value[start.end() :])[0].strip(" ()[]").lower() or unit
        number = float(number) * (_HERTZ.get(unit, 0.0) if is_rate else SECONDS.get(unit or "s", 0.0))
        if number > 1e-300 and math.isfinite(rate := number if is_rate else 1 / number):
            rates.setdefault(float(f"{rate:.9g}"), name)
    return next(iter(rates.items())) if len(rates) == 1 else None


def _split_unit(name: str) -> tuple[str, str]:
    """Return the last part of a fact's name, reduced to its letters, and the unit behind it."""
    last = re.split(r"[./]", name)[-1] if not re.search(r"[(\[]", name) else name
    at = re.search(r"[(\[]([^)\]]*)[)\]]\s*$", last)
    unit = at[1].strip().lower() if at else ""
    if at is None and (behind := _UNDERSCORED.fullmatch(last)):
        last, unit = behind[1], behind[2].lower()
    bare = re.sub(r"[^a-z]", "", (last[: at.start()] if at else last).lower())
    ending = None if unit else re.fullmatch(r"(.+?)(?:in)?(khz|hz)", bare)
    return (ending[1], ending[2]) if ending else (bare, unit)


def stated_unit(facts: Mapping[str, Fact]) -> str:
    """Return the unit that a fact gives for the values; empty where none does."""
    wanted = ("unit", "units", "yunit", "yunits", "verticalunits", "angleunit")
    units = {str(value) for name, value in facts.items() if _split_unit(name)[0] in wanted}
    return units.pop() if len(units) == 1 else ""
