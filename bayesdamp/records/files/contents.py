"""Define what a reader returns for a file, and interpret the names in it.

A reader returns columns of numbers, and facts (named numbers and texts outside the columns). Their names state runs,
units, quantities, times and sampling rates. Units are written in many ways: `Angle(deg)`, `Time [ms]`, `acceleration /
(m/s²)`, `phi_deg`.
"""

import re
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Protocol

import numpy as np

from bayesdamp.types import UNITS, Fact, InputError

LARGEST_FILE = 2**31
"""Largest size of a file in bytes, also after unpacking; larger files are refused (conventional)."""


@dataclass(frozen=True, eq=False)
class Column:
    """One column, array or channel of a file.

    Parameters
    ----------
    name
        Name with which a user selects the column; "" if the file gives no name.
    values
        Values, shape (n,); NaN where a cell is empty or has no number.
    group
        Sheet, group or variable that contains the column. A column uses only the times of its own group.
    run
        Label of the run (one of several measurements in a file); "" if the file does not state it.
    unit
        Unit as the file writes it, if it is stated outside the name; else "".
    quantity
        "angle" (any displacement), "velocity", "acceleration", or "" if the file does not state it.
    rate
        Sampling rate of the column in Hz; None if the file states none.
    start
        Time of the first sample in s; 0 if the file states none. It is used only with `rate`.
    clock
        Whether the cells are written as times of day.
    empty
        Mask of the empty cells, shape (n,), true where a cell is empty; None if there are none.
    words
        Start of the text of each filled cell that has no number, by index of the row from 0.
    """

    name: str
    values: np.ndarray
    group: str = ""
    run: str = ""
    unit: str = ""
    quantity: str = ""
    rate: float | None = None
    start: float = 0.0
    clock: bool = False
    empty: np.ndarray | None = None
    words: Mapping[int, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        # Names in JSON, HDF5 or MATLAB files can contain lone surrogates, which cannot be printed.
        object.__setattr__(self, "name", self.name.encode("utf-8", "replace").decode("utf-8"))

    @property
    def label(self) -> str:
        """Return the name with its unit in brackets, or the name alone if no unit is stated outside of it.

        A velocity or acceleration in a known unit has the unit of this quantity, such as deg/s for `deg`.
        """
        unit = UNITS[self.unit].of(self.quantity) if self.unit in UNITS and self.quantity else self.unit
        return f"{self.name} ({unit})" if self.name and unit else self.name


@dataclass(frozen=True, eq=False)
class Contents:
    """All that a file contains.

    Parameters
    ----------
    format
        Short name of the format.
    columns
        Columns in the order of the file.
    facts
        Numbers and texts that the file states outside its columns, by name.
    notes
        Sentences on what the reader did.
    first_line
        Line number (from 1) of the first row of numbers in a text file; None for other files.
    lines
        Line of each row, shape (n,), counted from 0 at `first_line`; None if this is None.
    channels
        Whether the format declares each column to be a sensor's channel.
    paired
        Whether several columns of values have their own column of times each, so that each pair is a record.
    warnings
        Sentences that the user must see.
    """

    format: str
    columns: tuple[Column, ...]
    facts: Mapping[str, Fact] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    first_line: int | None = None
    lines: np.ndarray | None = None
    channels: bool = False
    paired: bool = False
    warnings: tuple[str, ...] = ()


class Reader(Protocol):
    """A plug-in that reads one file format.

    A module in `bayesdamp.records.readers` assigns a reader to the name PLUGIN. It imports the library of the format
    only in `read`. A user's own reader derives from this class and has a `name`.

    Attributes
    ----------
    format
        Name of the format with its article, as in "this is an Excel file".
    extensions
        File extensions in small letters, with the dot.
    extra
        Name of this package's optional dependency (extra) that installs the library; "" if it is always installed.
    foreign
        Whether `read` uses a compiled library that a damaged file may crash. If true, it runs in a child process.
    """

    format: str
    extensions: tuple[str, ...]
    extra: str = ""
    foreign: bool = False

    def claims(self, head: bytes, path: Path) -> bool:
        """Return whether the file is of this format.

        This is decided by its first bytes, `head` (up to 64 KiB), and by its path if they are not enough.
        """
        ...

    def read(self, path: Path) -> Contents:
        """Return the contents of the file. May raise any exception for a damaged file; `records.read` reports it."""
        ...


def refuse_large(size: float) -> None:
    """Raise InputError if `size`, the size of a file's unpacked data in bytes, is more than LARGEST_FILE."""
    if size > LARGEST_FILE:
        right = f"files of more than {LARGEST_FILE / 2**30:.3g} GiB are not read; split it, and give a smaller file"
        raise InputError(f"unpacks to {size / 2**30:.3g} GiB; {right}")


def refuse_archive(path: Path) -> None:
    """Raise InputError if a zip archive is encrypted or unpacks to more than LARGEST_FILE bytes.

    Raises zipfile.BadZipFile if it is damaged.
    """
    with zipfile.ZipFile(path) as archive:
        members = archive.infolist()
    if any(member.flag_bits & 1 for member in members):
        raise InputError("is encrypted; save it without a password")
    refuse_large(sum(member.file_size for member in members))


def archive_names(path: Path) -> list[str] | None:
    """Return the names of a zip archive's members; None if it cannot be opened or is not a zip archive."""
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.namelist()
    except (zipfile.BadZipFile, NotImplementedError, OSError):
        return None


DAY = 86400.0
"""Seconds in a day."""
SECONDS = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds", "sek", "sekunde", "sekunden"), 1.0),
    **dict.fromkeys(("ms", "msec", "msecs", "millis", "millisecond", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "µs", "μs", "usec", "usecs", "micros", "microsecond", "microseconds"), 1e-6),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanos", "nanosecond", "nanoseconds"), 1e-9),
    **dict.fromkeys(("ps", "psec", "picosecond", "picoseconds"), 1e-12),
    **dict.fromkeys(("min", "mins", "minute", "minutes", "minuten"), 60.0),
    **dict.fromkeys(("h", "hr", "hrs", "hour", "hours", "std", "stunde", "stunden"), 3600.0),
    **dict.fromkeys(("d", "day", "days", "tag", "tage"), DAY),
}
"""Number of seconds in a unit of time, for each way of writing the unit, in lower case."""
_JOINED = re.compile(
    r"(?:time|stamp|elapsed|(?<![^\W_])t)[.-]?(sec|[mµμun]s|[mun]sec|millis|micros|nanos)$"
    r"|(?:time|elapsed|zeit) (min|h)$",
    re.IGNORECASE,
)
"""Pattern of names of columns of times that end in a unit of time without brackets: joined to the name, as in
ArduPilot's `TimeUS`, or after a blank, as in `Time min`."""
TIMES = re.compile(
    r"^t(\d*|[\s_.-]\w)$|time|elapsed|stamp|zeit|temps|tiempo|tempo|second|sekunde|uhr|epoch|x_value",
    re.IGNORECASE,
)
"""Pattern of names of columns that contain times."""
_ONLY_OF_TIMES = {text for text, seconds in SECONDS.items() if seconds > 60.0 or seconds < 1e-9}
"""Texts that count as units of time only in the name of a column of times. Elsewhere `d`, `h` or `ps` may be a depth,
height or power."""
_AMBIGUOUS_UNITS = ("in", "v", "V", "g", "au", "foot")
"""Texts that do not count as units after "_" or a blank in a column's name, because they may be words of the name."""
_TWO_LETTER_UNITS = ("mm", "cm", "um", "mV", "ms", "us")
"""Units of two letters that count as units after a blank in a column's name, because they are not words."""
_QUANTITIES = {
    **dict.fromkeys(("velocity", "velocities", "vel", "speed", "gyro", "gyroscope"), "velocity"),
    **dict.fromkeys(("omega", "ω", "vitesse", "drehrate", "drehzahl"), "velocity"),
    **dict.fromkeys(("acceleration", "accelerations", "accel", "acc", "accelerometer"), "acceleration"),
}
"""Words of a column's name that state the quantity, in lower case."""
_AXIS = "(?:theta|phi|psi|alpha|angle|[xyzθϑφϕα])"
_STATING = re.compile(rf"(accélération|.*beschleunigung|{_AXIS}ddot)|(.*geschwindigkeit|{_AXIS}dot)")
"""Pattern of further such words for an acceleration (group 1) or a velocity: German compounds (`Drehgeschwindigkeit`)
and derivatives (`thetadot`, also written `theta_dot`)."""
_PER = (
    ("acceleration", re.compile(r"(/s2|/s/s|/\(s2\)|s-2|/sec2|persecond(2|squared|persecond))$")),
    ("velocity", re.compile(r"(/s|s-1|/sec|pers|persec|persecond|prosekunde)$")),
)
_OTHER_UNIT = re.compile(
    r"(?:^[^/\s]+/(?!\S*\s)|\s/\s*|\sin\s+)((?:\S+\s)?\S*(?:(?:/\s*|per |pro )(?:s|sec|second|Sekunde|min|h)(?:\^?2|²)?"
    r"|\bs\^?[-−⁻][12¹²])|[mk]?(?:N|Pa|Hz|bar)|Nm|[dkn]m|°C|gon)\s*$"
)
"""Pattern of a unit that is not in brackets, after "/" or " in ": one per time (`1/s`, `dm s^-1`), or one of a few
others. Other words there, as in `run in air`, are not units."""
_RUN = r"(?:run|trial|take|test|rep|repeat|repetition|lauf|versuch|messung|durchgang|essai|prova|ensayo)"
_RUN_BEHIND = re.compile(
    rf"^(.+?)[\s,;:_-]*[(\[]?(?<![A-Za-z]){_RUN}\s*[#_:.-]?\s*(\d+)[)\]]?\s*$", re.IGNORECASE
)
_RUN_BEFORE = re.compile(rf"^{_RUN}\s*[#_.-]?\s*(\d+)\s*[:,;._\s-]\s*(.+)$", re.IGNORECASE)
_RUN_LATEST = re.compile(r"^(latest)\s*:\s*(.+)$", re.IGNORECASE)
"""Pattern of column names such as `Latest: Angle`, with which Vernier's Logger Pro marks the run that has no number
yet."""
_RUN_ALONE = re.compile(rf"^{_RUN}?\s*[#_.-]?\s*(\d+)$", re.IGNORECASE)
_SECONDS_ALONE = re.compile(r"^(elapsed[\s_]*)?seconds([\s_]*elapsed)?$", re.IGNORECASE)
_INDEX = re.compile(
    r"^(unnamed: 0|index|idx|sample|samples|no|nr|n|i|row|frame|frames|count|counter|#|id)$", re.I
)
_BRACKETS = re.compile(r"(?:[(\[]|(?<!_)\{)\s*([^()\[\]{}]{1,12})\s*[)\]}]\s*$")
MOST_NAMES, LIST_WIDTH = 12, 110
"""Largest number of names in a list in a message, and largest number of characters of this list; the message says how
many more there are (conventional)."""
MOST_FACTS, LONGEST_FACT = 60, 200
"""Largest number of facts (named numbers and texts in a file's header) that are stored, and largest number of
characters of each; further facts and characters are dropped (conventional)."""
_PAIR = re.compile(r"\s*([^\W\d][^:=\t;]{0,60}?)\s*(?:[:=]\s*[\t;]?|[\t;])\s*(\S.*?)\s*")
_NUMBER = re.compile(r"[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?")
_THOUSANDS = re.compile(r"[1-9]\d{0,2}(?:(?:,\d{3}){2,}(?:\.\d*)?|(?:,\d{3})+\.\d*)(?![\d.,])")
_AMBIGUOUS_COMMA = re.compile(r"[1-9]\d{0,2},\d{3}(?![\d.,eE])")
"""Pattern of a number, such as `1,234`, whose comma may be a decimal mark or separate thousands."""
_HERTZ = {
    **{"khz": 1e3, "ks/s": 1e3, "mhz": 1e6, "ghz": 1e9},
    **dict.fromkeys(
        ("", "hz", "1/s", "s/s", "sa/s", "sps", "samples/s", "samples/sec", "samples per second"), 1.0
    ),
}
"""Number of Hz in a unit of frequency or of sampling rates, for each way of writing the unit, in lower case; `mhz` is
`MHz` (see `hertz_written`)."""
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
"""Pattern of the name of a fact (a named number or text in a file) that ends in a unit of time: `dt_ms`, but not
`f_s`."""
_MATLAB_STEP = "Ts"
"""MATLAB's name of a sampling interval; `ts` is more often a time stamp."""


def _normalise_unit(text: str) -> str:
    """Return the text of a unit in a form for comparison: `m/s²`, `m / s^2` and `M/S2` all become `m/s2`."""
    return re.sub(r"[\s*^·.{}]", "", text.lower().translate(str.maketrans("²⁻−¹", "2--1")))


_WRITTEN = {_normalise_unit(text): unit for unit in UNITS.values() for text in (unit.name, *unit.written)}
"""Each known unit by all ways of writing it, in the form of `_normalise_unit`: small letters without blanks, dots and
superscripts."""


def _normalise_time_unit(text: str) -> str:
    return text.lower().replace("(s)", "s").strip(" .")


def _unit_candidates(name: str) -> list[str]:
    """Return the parts of a column's name that may be a unit; empty if there are none.

    These are all texts in brackets. If there are no brackets, it is the end of the name after "/", " in " or "_".
    Without any of these, it is the last word of the name (or the only one), if that is a known unit and not a common
    word.
    """
    inside = re.findall(r"\(((?:[^()]|\([^()]*\))*)\)|\[([^\[\]]*)\]|\{([^{}]*)\}", name)
    if inside:
        return ["".join(groups).strip() for groups in inside]
    behind = re.search(r"_([^\s_/]+/[^\s_]+)\s*$", name) or _OTHER_UNIT.search(name)
    behind = behind or re.search(r"(?:^[^/\s]+/|\s/\s*|\sin\s+|_)([^\s_]+)\s*$", name)
    if behind:
        return [] if behind[0][0] == "_" and behind[1] in _AMBIGUOUS_UNITS else [behind[1].strip("()[]{}")]
    last = re.search(r"(?:^|\s)([^\W\d_]+)\s*$", name)
    if last and (_normalise_time_unit(last[1]) in SECONDS or _normalise_unit(last[1]) in _WRITTEN):
        # A unit without brackets or a separator: `Angle degrees`, `adc`.
        word = last[1]
        is_clear = len(word) > 2 and word not in _AMBIGUOUS_UNITS and word != "min"
        if is_clear or (word in _TWO_LETTER_UNITS and word != name.strip()):
            return [word]
    return []


def seconds_in(name: str) -> float | None:
    """Return the unit of time in the name of a column of times, in s: 0.001 for `Time [ms]`.

    The result is None if the name contains no unit of time, or several different ones. Units longer than a minute or
    shorter than a nanosecond (`h`, `hours`, `day`, `ps`) count only if the rest of the name means times, or if the name
    is only "hours" or "days".
    """
    units = [unit for unit in map(_normalise_time_unit, _unit_candidates(name)) if unit in SECONDS]
    if not units and (joined := _JOINED.search(name.strip())):
        units = [(joined[1] or joined[2]).lower()]
    seconds = set[float]()
    for unit in units:
        if unit in _ONLY_OF_TIMES and name.strip().lower() not in ("hours", "days", "stunden", "tage"):
            rest = re.sub(r"[\s_/(\[{]+(in\s+)?$", "", name[: name.lower().rindex(unit.removesuffix("s"))])
            if not TIMES.search(rest.rpartition(".")[2].strip()):
                continue
        seconds.add(SECONDS[unit])
    return seconds.pop() if len(seconds) == 1 else None


def seconds_written(unit: str) -> float | None:
    """Return a unit of time in s: 3600 for the text `h`, 0.001 for `ms since 2024-01-01`; None for other units."""
    return SECONDS.get(_normalise_time_unit(re.sub(r"\s+since\s.*$", "", unit.strip(" ()[]"))))


def hertz_written(unit: str) -> float | None:
    """Return a unit of frequency or of sampling rates in Hz: 1000 for `kHz`, 1 for no text; None for other units.

    Upper and lower case are distinguished only in the prefix m: `mHz` is 0.001 Hz, `MHz` is 1e6 Hz. `mhz` may mean both
    and counts as an unknown unit.
    """
    if unit.startswith("m"):
        return 1e-3 if unit == "mHz" else None
    return _HERTZ.get(unit.lower())


def may_be_unit(cell: str, name: str) -> bool:
    """Return whether a cell may be the unit of a column: the cell in the line below the column's name.

    It may be if it is empty, "-", a known unit, or a unit per time, such as `1/s`. A unit such as `d`, which may also
    mean a depth, counts as a unit of time only if the name means times.
    """
    text = cell.strip("()[] ")
    if _normalise_time_unit(text) in SECONDS:
        return _normalise_time_unit(text) not in _ONLY_OF_TIMES or bool(TIMES.search(name))
    return text in ("", "-") or unit_written(text) is not None or bool(_quantity_per_time(text))


def unit_and_quantity(name: str) -> tuple[str, str] | None:
    """Return the unit and the quantity that a column's name states: for `omega (deg/s)`, "deg" and "velocity".

    The unit is a name in UNITS; the quantity is that of `unit_written`. For a unit without a known scale (V, counts),
    words of the name may state the quantity. The result is None unless the name contains exactly one known unit.
    """
    units = {unit for unit in map(unit_written, _unit_candidates(name)) if unit is not None}
    if len(units) != 1:
        return None
    unit, quantity = units.pop()
    return unit, quantity if UNITS[unit].physical else _quantity_of(name) or quantity


def _quantity_of(name: str) -> str | None:
    """Return "velocity" or "acceleration" if words of a name state exactly one of them; else None."""
    name = re.sub(r"_(?=d?dot)", "", re.sub(r"([a-z])([A-Z])", r"\1 \2", name).lower())
    words = re.findall(r"[^\W\d_]+", name)
    quantities = {_QUANTITIES[word] for word in words if word in _QUANTITIES}
    quantities |= {"acceleration" if m[1] else "velocity" for m in map(_STATING.fullmatch, words) if m}
    return quantities.pop() if len(quantities) == 1 else None


def _quantity_per_time(unit: str) -> str:
    """Return "velocity" or "acceleration" for a unit per time (`1/s`, `dm/s²`), also if it is not known; else ""."""
    return next((quantity for quantity, per in _PER if per.search(_normalise_unit(unit))), "")


def unit_written(text: str) -> tuple[str, str] | None:
    """Return the unit (a name in UNITS) and the quantity for the text of a unit; None if the unit is not known.

    The quantity of a displacement is "angle": `°` gives "deg" and "angle". A velocity or acceleration gives the unit of
    its displacement: `deg/s` gives "deg" and "velocity". But a velocity or acceleration with its own name keeps it:
    `rpm` gives "rpm" and "velocity".
    """
    text = _normalise_unit(text)
    if text in _WRITTEN:
        return _WRITTEN[text].name, _WRITTEN[text].quantity or "angle"
    for quantity, per in _PER:
        unit = _WRITTEN.get(text[: at.start()]) if (at := per.search(text)) else None
        if unit is not None and unit.quantity is None:
            return unit.name, quantity
    return None


def unit_by_name(unit: str | None, quantity: str | None) -> tuple[str | None, str | None]:
    """Convert a unit that a user gives to its name in `UNITS`, and return it with the quantity.

    Parameters
    ----------
    unit
        Unit in any way of writing: `°`, `degrees`, or `deg/s`, which also states the quantity. None if the user gives
        none.
    quantity
        Quantity that the user gives, which has priority over that of the unit; None if the user gives none.

    Returns
    -------
    tuple
        Unit (unchanged if unknown) and quantity, each None if not stated. If the user gives no quantity, it is
        None for a unit of displacement, and for every unit that is given by its name in `UNITS`, even for rpm, dps, g
        and mg.
    """
    if unit is None or unit in UNITS or (written := unit_written(unit)) is None:
        return unit, quantity
    name, what = written
    return name, quantity or (what if what != "angle" else None)


def split_run(column: Column) -> tuple[str, str]:
    """Return a column's name without the mark of its run, and the label of the run: `angle Run 2` gives `angle`, `2`.

    A run is one of several measurements in a file. The label is the column's `run`. If this is empty, the label is read
    from the name, or else from the column's group (`Run 2`). If there is a run, the group is also removed from the
    name. Without a run, the name is unchanged and the label is "".
    """
    bare = column.name.removeprefix(f"{column.group}.") if column.group else column.name
    if column.run:
        bare = bare.removeprefix(f"{column.run}.")  # a list in which each element is a run
    for pattern, run, rest in ((_RUN_BEHIND, 2, 1), (_RUN_BEFORE, 1, 2)):
        at = pattern.match(bare)
        if at is not None:
            return at[rest].strip(), column.run or str(int(at[run][:9]))
    latest = _RUN_LATEST.match(bare)
    if latest is not None:
        return latest[2].strip(), column.run or "latest"
    alone = _RUN_ALONE.match(column.group)
    if column.run or (alone and not column.group.isdigit()):
        return bare, column.run or str(int(alone[1][:9]) if alone else "")
    return column.name, ""


def seconds_of_unit(column: Column) -> float | None:
    """Return the unit of a column of times in s (0.001 for ms), from its name or `unit`; None if no unit is stated."""
    seconds = seconds_in(split_run(column)[0]) or seconds_written(column.unit)
    return 1.0 if seconds is None and _SECONDS_ALONE.match(column.name) else seconds


def unit_of_column(column: Column) -> tuple[str, str]:
    """Return the unit and the quantity of a column, such as "deg" and "velocity"; each is "" if it is not stated.

    The unit is a name in UNITS. An unknown unit is returned as the file writes it, if it is shorter than 20 characters.
    """
    name = split_run(column)[0]
    named = _quantity_of(name) or column.quantity
    if column.unit:
        written = unit_written(column.unit.strip("()[]"))
        if written is None:
            return (column.unit if len(column.unit) < 20 else ""), named or _quantity_per_time(column.unit)
        unit, quantity = written
        return unit, (quantity if UNITS[unit].quantity or quantity != "angle" else named or quantity)
    known = unit_and_quantity(name)
    if known is not None:
        return known
    behind = _BRACKETS.search(name) or _OTHER_UNIT.search(name)
    unknown = behind[1].strip() if behind and not behind[1].strip().isdigit() else ""
    return unknown, named or _quantity_per_time(unknown)


def names_time(column: Column) -> bool:
    """Return whether a column's name or unit says that it contains times, or its cells are times of day."""
    bare = re.sub(r"[(\[{].*?[)\]}]", "", split_run(column)[0]).rpartition(".")[2].strip()
    return bool(TIMES.search(bare)) or column.clock or seconds_of_unit(column) is not None


def names_index(column: Column) -> bool:
    """Return whether a column's name says that it numbers the samples, such as `index`, `frame` or `No`."""
    return bool(_INDEX.match(split_run(column)[0].rpartition(".")[2].strip()))


def selector(columns: Sequence[Column], column: Column) -> str | int:
    """Return how a user selects a column: by its name, or by its number from 1 if the name is empty or not unique.

    columns: all columns of the file. In messages, `repr` of the result puts a name in quotes.
    """
    if column.name and sum(c.name == column.name for c in columns) == 1:
        return column.name
    return next(i for i, c in enumerate(columns, start=1) if c is column)


def list_names(columns: Sequence[Column]) -> str:
    """Return the names of the columns (numbers for those without) in one line for a message, shortened if many."""
    if not any(column.name for column in columns):
        return f"1 to {len(columns)} (they have no names)" if len(columns) > 1 else "1 (it has no name)"
    names = [repr(c.name) if c.name else str(i) for i, c in enumerate(columns, start=1)]
    shown: list[str] = []
    for name in names:
        if len(shown) == MOST_NAMES or len(", ".join([*shown, name])) > LIST_WIDTH:
            return f"{', '.join(shown)} and {len(names) - len(shown)} more"
        shown.append(name)
    return ", ".join(shown)


def find_columns(columns: Sequence[Column], wanted: str | int) -> list[Column]:
    """Return the columns that a user selects.

    Parameters
    ----------
    columns
        All columns of the file.
    wanted
        A name, or a number from 1. Digits are a number unless a column has them as its name. The name may be written in
        upper or lower case, with or without the unit. In a file with several runs (measurements), a name without run
        selects one column of each run that has it.

    Raises
    ------
    InputError
        If there is no such column (the message suggests a similar name), or if several have exactly this name.
    """
    name = str(wanted).strip()
    exact = [column for column in columns if name and column.name == name]
    if len(exact) == 1:
        return exact
    if exact:
        raise InputError(f"{len(exact)} columns are named {name!r}; give the column's number")
    if name.isdigit():
        if len(name) < 9 and 1 <= int(name) <= len(columns):
            return [columns[int(name) - 1]]
        raise InputError(f"there is no column {name[:20]}; the file has {len(columns)} columns")
    forms = []  # forms of each name: as it is, with its unit, without run, and without run and unit
    for column in columns:
        bare = split_run(column)[0]
        without_unit = re.sub(r"\s*[(\[{][^()\[\]{}]*[)\]}]\s*$", "", bare).strip() or bare
        if column.name:
            forms.append((column, (column.name, column.label, bare, without_unit)))
    for i in range(4):
        same = [column for column, names in forms if names[i].casefold() == name.casefold()]
        if same and len({split_run(column)[1] for column in same}) == len(same):
            return same
    valid = list(dict.fromkeys(column.name for column, _ in forms))
    bare = [text for _, names in forms for text in names[2:]]
    close = get_close_matches(name, [*valid, *bare], n=1, cutoff=0.6)
    if close:
        raise InputError(f"unknown column {name[:60]!r}; did you mean {close[0]!r}?")
    what = f"columns are {list_names(columns)}"
    if 0 < len(valid) <= MOST_NAMES:
        what = f"valid are {', '.join(valid)}"
    raise InputError(f"unknown column {name[:60]!r}; {what}")


def select_runs(text: str, labels: Sequence[str]) -> list[str]:
    """Return the labels of the runs (measurements in a file) that a user selects.

    Parameters
    ----------
    text
        The selection: labels and ranges of numbers, separated by commas, such as `1,3-5`.
    labels
        Labels of all runs of the file.

    Returns
    -------
    list of str
        The labels in the order of the selection, each once.

    Raises
    ------
    InputError
        If a part of the text is not a label or a range, or selects no run.
    """
    wanted: list[str] = []
    for part in [piece.strip() for piece in text.split(",") if piece.strip()] or [""]:
        at = re.fullmatch(r"(\d{1,6})(?:\s*-\s*(\d{1,6}))?", part)
        numbers = range(int(at[1]), int(at[2] or at[1]) + 1) if at else ()
        selected = [label for label in labels if label == part or (label.isdigit() and int(label) in numbers)]
        if not selected:
            more = f" and {len(labels) - MOST_NAMES} more" if len(labels) > MOST_NAMES else ""
            choice = f"give numbers such as 1,3-5; there are runs {', '.join(labels[:MOST_NAMES])}{more}"
            choice = choice if labels else "there are none to choose from"
            raise InputError(f"no runs {text[:40]!r}; {choice}", arguments=["runs"])
        wanted += selected
    return list(dict.fromkeys(wanted))


def header_facts(lines: Iterable[str]) -> dict[str, Fact]:
    """Return the facts (named numbers and texts) in the lines above a table, as texts by name.

    Lines with facts have one of these forms: `key: value`; `key = value`; `key,value,unit`; `key,value unit`;
    `key,value,value` with the same value for each channel; or a line of names followed by a line of as many values.
    """
    facts: dict[str, Fact] = {}
    before, unit = list[str](), r"(\s+[A-Za-zµμ/]+)?"
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
        elif (
            named and len(cells) in (2, 3) and numbers < 2 and re.fullmatch(_NUMBER.pattern + unit, cells[1])
        ):
            facts[cells[0]] = " ".join(cells[1:])
        before = cells
    return trim_facts(facts)


def trim_facts(facts: Mapping[str, object]) -> dict[str, Fact]:
    """Return the first MOST_FACTS usable facts of a file; names and texts are cut to LONGEST_FACT characters.

    A usable fact is a finite number or a text, with its name. facts: values by name.
    """
    trimmed: dict[str, Fact] = {}
    for name, value in facts.items():
        text = " ".join(str(name).split())[:LONGEST_FACT]
        if not text or len(trimmed) >= MOST_FACTS:
            continue
        if isinstance(value, int | float) and not isinstance(value, bool) and np.isfinite(value):
            trimmed[text] = float(value)
        elif isinstance(value, str) and value.strip():
            trimmed[text] = " ".join(value.split())[:LONGEST_FACT]
    return trimmed


def sampling_rate(facts: Mapping[str, Fact]) -> tuple[float, str] | None:
    """Return the sampling rate that the facts of a file state.

    Parameters
    ----------
    facts
        Facts (named numbers and texts in the file's header), such as `Sample rate`, in Hz if it has no unit, or `Sample
        interval (ms)`, in s if it has no unit.

    Returns
    -------
    tuple or None
        The rate in Hz and the name of the fact. The result is None if no fact states a rate or interval, or if several
        state different ones. A fact does not count if its unit is unknown, or if the comma in its number may be a
        decimal mark or separate thousands.
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
            start = thousands or (None if _AMBIGUOUS_COMMA.match(value) else _NUMBER.match(value))
            if start is None:
                continue
            number = float(start[0].replace(",", "" if thousands else "."))
            unit = re.split("[,;]", value[start.end() :])[0].strip(" ()[]") or unit
        scale = hertz_written(unit) if is_rate else SECONDS.get(unit.lower() or "s")
        number = float(number) * (scale or 0.0)
        if number > 1e-300 and np.isfinite(rate := number if is_rate else 1 / number):
            rates.setdefault(float(f"{rate:.9g}"), name)
    return next(iter(rates.items())) if len(rates) == 1 else None


def _split_unit(name: str) -> tuple[str, str]:
    """Split a fact's name into a bare name and a unit: `Sample interval (ms)` gives `sampleinterval`, `ms`.

    The bare name is the part after the last dot or slash (`Horizontal.sample_interval_ms` gives the same result),
    without the unit, reduced to its letters in lower case. A dot at the end of the name is ignored, as in `freq. (Hz)`.
    The unit is "" if there is none.
    """
    at = re.search(r"[(\[]([^)\]]*)[)\]]\s*$", name)
    last = re.split(r"[./](?=.*\w)", name[: at.start()] if at else name)[-1]
    unit = at[1].strip() if at else ""
    if at is None and (behind := _UNDERSCORED.fullmatch(last)):
        last, unit = behind[1], behind[2]
    bare = re.sub(r"[^a-z]", "", last.lower())
    ending = None if unit else re.fullmatch(r"(.+?)(?:in)?(khz|hz)", bare)
    return (ending[1], ending[2]) if ending else (bare, unit)


def stated_unit(facts: Mapping[str, Fact]) -> str:
    """Return the unit of the values, as written, that a file's facts (named texts) state; "" if none or several.

    A fact states it if its name (after the last dot) is "unit", "y unit", "vertical units" or similar.
    """
    wanted = ("unit", "units", "yunit", "yunits", "verticalunits", "angleunit")
    units = {str(value) for name, value in facts.items() if _split_unit(name)[0] in wanted}
    return units.pop() if len(units) == 1 else ""
