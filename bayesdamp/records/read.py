"""Read records from a file of any supported format. A record consists of times and one recorded quantity.

Any problem of a file is reported as an error with a one-line message. Readers that use compiled libraries run in a
child process, because a damaged file may crash them."""

import json
import pickle
import signal
import stat
import subprocess
import sys
import tempfile
import threading
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from difflib import get_close_matches
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from bayesdamp.records.columns import (
    LARGEST_VALUE,
    MIN_SAMPLES,
    RecordColumns,
    choose_columns,
    separate_clocks,
)
from bayesdamp.records.files import contents as file_contents
from bayesdamp.records.files.contents import (
    DAY,
    SECONDS,
    TIMES,
    Column,
    Contents,
    Reader,
    seconds_of_unit,
    selector,
    split_run,
    stated_unit,
    unit_of_column,
    unit_written,
)
from bayesdamp.records.readers import READERS
from bayesdamp.records.record import RawRecord
from bayesdamp.types import InputError, Provenance

Loaded = TypeVar("Loaded")
TIME_LIMIT = 300.0
"""A reader in a child process is stopped, and its file is refused, if it has not finished after this time in s
(conventional)."""
HEAD_BYTES = 65536
"""Number of bytes at the start of a file by which its format is recognised."""
LONGEST_MESSAGE = 280
"""Largest number of characters of an error message about a file; longer messages are cut."""
MOST_LISTED = 5000
"""Largest number of files in a folder that are examined for the suggestion in an error message. If a file is missing,
the message suggests a similar name; if the user gives a folder, it suggests the most frequent kind of readable file
(conventional)."""
FALLBACK = "text"
"""Name of the reader that is tried last, because it accepts any text."""
_ONE_AT_A_TIME = threading.Lock()
"""Lock for `warnings.catch_warnings`, which changes a state of the whole process and is not thread-safe."""
_OPEN = "a text table, .mat, .npy, .npz, .uff, .tdms, .lvm, .labx, .wav, .h5, .parquet, .xlsx or .json file"
_AGAIN = "the file may be damaged, or its ending may not suit its content: save it again, or export it as a text table"
_CHILD = """
import json, pickle, sys
from importlib import import_module
from pathlib import Path
module, function, path, out, options, sys.path[:] = json.loads(sys.argv[1])
from bayesdamp.types import InputError
try:
    result = getattr(import_module(module), function)(Path(path), **options)
except InputError as error:
    result = error
Path(out).write_bytes(pickle.dumps(result))
"""


def load_isolated(
    load: Callable[..., Loaded], path: Path, patience: float = TIME_LIMIT, **options: bool
) -> Loaded:
    """Call a function that reads a file, in a child process, so that a crash does not end this process.

    Parameters
    ----------
    load
        Function that reads the file, called as `load(path, **options)`. It must be at the top level of a module.
    path
        The file.
    patience
        Time in s after which the child process is stopped.
    **options
        Keyword arguments for `load`.

    Returns
    -------
    object
        What `load` returns; it must be picklable.

    Raises
    ------
    InputError
        If `load` raises an error, crashes, or does not finish; the message has one line.
    """
    with tempfile.TemporaryDirectory(prefix="bayesdamp-") as folder:
        out = Path(folder) / "result"
        called = (load.__module__, load.__qualname__)
        task = json.dumps([*called, str(path.resolve()), str(out), options, sys.path])
        try:
            command = [sys.executable, "-c", _CHILD, task]
            child = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, timeout=patience)
        except subprocess.TimeoutExpired:
            raise InputError(f"its reader did not end within {patience:g} s; {_AGAIN}", path.name) from None
        if child.returncode == 0 and out.is_file():
            result = pickle.loads(out.read_bytes())
            if isinstance(result, InputError):
                raise result
            return result
    if child.returncode < 0:
        names = {number.value: number.name for number in signal.Signals}
        end = f"its reader crashed ({names.get(-child.returncode, f'signal {-child.returncode}')})"
    else:
        lines = child.stderr.decode(errors="replace").strip().splitlines()
        end = f"cannot be read ({lines[-1] if lines else f'status {child.returncode}'})"
    raise InputError(f"{end}; {_AGAIN}", path.name)


def file_error(path: Path, text: object, arguments: Sequence[str] = ()) -> InputError:
    """Return an InputError that names a file; its message is one line of at most LONGEST_MESSAGE characters.

    Parameters
    ----------
    path
        The file.
    text
        What is wrong, and what to do.
    arguments
        Names of the arguments of `read` with which the user can solve the problem.
    """
    name = " ".join((path.name or str(path)).split())
    where = name if len(name) <= 80 else f"{name[:50]}...{name[-27:]}"
    what = " ".join(str(text).split())
    room = LONGEST_MESSAGE - len(str(InputError("", where, arguments=arguments)))
    short = what if len(what) <= room else f"{what[: room - 3]}..."
    return InputError(short, where, arguments=arguments)


def read_contents(path: Path | str, isolate: bool = True) -> Contents:
    """Read all columns and facts (named numbers and texts) of a file, with the reader for its format.

    Parameters
    ----------
    path
        The file.
    isolate
        Whether a reader that uses compiled code runs in a child process, because a damaged file may crash it.

    Returns
    -------
    Contents
        The contents, with at least one column of numbers.

    Raises
    ------
    InputError
        If the file cannot be read; the message is one line of less than 300 characters.
    """
    path = Path(path)
    reader: Reader | None = None
    try:
        reader = reader_of(path)
        if isolate and reader.foreign:
            content = load_isolated(read_contents, path, isolate=False)
        else:
            with _ONE_AT_A_TIME, warnings.catch_warnings():
                warnings.simplefilter("ignore")
                content = reader.read(path)
        if not content.columns:
            right = "give a file with times and values"
            raise InputError(f"contains no column of numbers (it was read as {reader.format}); {right}")
        return content
    except InputError as error:
        raise file_error(path, error.what, error.arguments) from error.__cause__
    except MemoryError as error:
        right = "give a part of it, or a lower sampling rate"
        raise file_error(path, f"is larger than the memory; {right}") from error
    except ImportError as error:
        missing = error.name or "bayesdamp"
        library = f"bayesdamp[{reader.extra}]" if reader is not None and reader.extra else missing
        what = "cannot be read here" if reader is None else f"this is {reader.format}"
        raise file_error(path, f'{what}: pip install "{library}"') from error
    except Exception as error:  # a library may raise anything for a damaged file
        if isinstance(error, OSError) and error.errno is not None:
            what = f"cannot be read ({error.strerror or error}); correct this, or give another file"
            raise file_error(path, what) from error
        cause = " ".join(str(error).split())[:120] or type(error).__name__
        what = "is damaged or not what its name says"
        if reader is not None:
            what = f"not readable as {reader.format}, damaged or cut off"
        raise file_error(path, f"{what} ({cause}); export it again, or as CSV") from error


def read_each(
    paths: Sequence[Path], read: Callable[[Path], Loaded], run: Callable[..., Iterable[Any]] = map
) -> tuple[list[Loaded], list[InputError]]:
    """Read several files, and continue with the other files if one cannot be read.

    Parameters
    ----------
    paths
        The files, at least one.
    read
        Function that takes the path of a file and returns its content. It raises InputError if the file cannot be read.
    run
        Function that is called like `map`, such as that of an executor that reads files in parallel.

    Returns
    -------
    tuple of lists
        The results of the files that could be read, and the errors of the others, each in the order of `paths`.

    Raises
    ------
    InputError
        The first error, if no file could be read.
    """
    results: list[Loaded] = []
    errors: list[InputError] = []
    for result in run(partial(_content_or_error, read), paths):
        errors.append(result) if isinstance(result, InputError) else results.append(result)
    if not results:
        raise errors[0]
    return results, errors


def _content_or_error(read: Callable[[Path], Loaded], path: Path) -> Loaded | InputError:
    """Return the content of a file, or the InputError that `read` raises."""
    try:
        return read(path)
    except InputError as error:
        return error


def reader_of(path: Path) -> Reader:
    """Return the reader for a file, which is recognised by the first bytes of its content (`Reader.claims`).

    The reader of text tables is tried last, because it accepts any text. Raises InputError if no reader accepts the
    file, or if it is missing, a folder or a device, empty or blank, or too large; OSError if it cannot be opened.
    """
    head = _read_head(path)
    readers = {name: READERS.get(name) for name in READERS.names() if name != FALLBACK}
    text = READERS.get(FALLBACK)  # text is read as a table whatever the extension
    claiming = next((reader for reader in (*readers.values(), text) if reader.claims(head, path)), None)
    if claiming is not None:
        return claiming
    named = next((r for r in readers.values() if path.suffix.lower() in r.extensions), None)
    if named is not None:
        raise InputError(
            f"not readable: named {path.suffix}, but its content is not {named.format}; export it again"
        )
    raise InputError(f"a binary file of an unknown format; give {_OPEN}")


def _read_head(path: Path) -> bytes:
    """Return the first `HEAD_BYTES` bytes of a file.

    Raises InputError if the file is missing, empty, larger than LARGEST_FILE or not a regular file, or if these bytes
    contain only blanks. Raises OSError if it cannot be opened.
    """
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        names = [other.name for other in islice(path.parent.glob("*"), MOST_LISTED)]
        close = get_close_matches(path.name, names, 1)
        right = f"did you mean {close[0]!r}?" if close else "give the path of a record"
        raise InputError(f"no such file; {right}") from None
    except ValueError:
        raise InputError("cannot be read: its path contains a NUL character") from None
    if stat.S_ISDIR(mode):
        readable = {extension for name in READERS.names() for extension in READERS.get(name).extensions}
        kinds = Counter(p.suffix for p in islice(path.iterdir(), MOST_LISTED) if p.suffix.lower() in readable)
        right = "one of the files in it"
        for kind, count in kinds.most_common(1):
            right = f"the files in it: {str(path)[:80]}/*{kind} ({count} file{'s' if count > 1 else ''})"
        raise InputError(f"is a folder, not a file; give {right}")
    if not stat.S_ISREG(mode):
        raise InputError("is a device or a pipe, not a file; write its data to a file first")
    size = path.stat().st_size
    if size == 0:
        raise InputError("the file is empty; export the record again")
    if size > file_contents.LARGEST_FILE:
        most = f"files of more than {file_contents.LARGEST_FILE / 2**30:g} GiB are not read"
        raise InputError(f"has {size / 2**30:.1f} GiB; {most}; split it, and give a smaller file")
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    if not head.strip(b" \t\r\n\0\xef\xbb\xbf"):
        raise InputError("contains nothing but blanks; export the record again")
    return head


SLOWEST_RATE, FASTEST_RATE = 1e-9, 1e12
"""Smallest and largest sampling rate in Hz; others are refused (conventional)."""

FAR = 10.0
"""A record is refused if a repeated value of nines, such as −9999, seems to mark missing samples. It does if it differs
from the median of all other values by more than this many times the range of these values (conventional)."""

FIRST_DATE = 1e4
"""Times in days that begin at this number or later are taken for dates. They are then counted from midnight of the
first day (conventional)."""

FIRST_EPOCH = 1e8
"""Times in s that begin at this number (about three years) or later count from an epoch such as 1970. They are then
counted from the first sample (conventional)."""
FROM_FIRST = "Times are counted from the first sample"
"""First words of the note that is added to a record if the times in its file count from an epoch such as 1970."""

ColumnName = str | int
"""A column of a file: its name, or its number, counted from 1."""


def read_record(
    path: Path | str,
    *,
    time: ColumnName | None = None,
    value: ColumnName | None = None,
    rate: float | None = None,
    run: str | int | None = None,
    channel: str | None = None,
    time_unit: str | None = None,
) -> RawRecord:
    """Read one record from a file: that of the given run and channel, or the only record of the file.

    The arguments are those of `read_records`, but with only one `run` and one `channel`. `value` and `channel` both
    select the column of the recorded quantity, so only one of them may be given. Raises InputError also if the
    arguments select several records.
    """
    records = read_records(
        path,
        time=time,
        value=value,
        rate=rate,
        runs=None if run is None else str(run),
        channels=() if channel is None else (channel,),
        time_unit=time_unit,
    )
    if len(records) > 1:
        names = [f"run {r.run} {r.channel!r}" if r.run else repr(r.channel) for r in records]
        several = ", ".join(names[:8]) + (f" and {len(names) - 8} more" if len(names) > 8 else "")
        raise file_error(Path(path), f"has {len(records)} records; give the run or channel of one: {several}")
    return records[0]


def read_records(
    path: Path | str,
    *,
    time: ColumnName | None = None,
    value: ColumnName | None = None,
    rate: float | None = None,
    runs: str | None = None,
    channels: Sequence[str] = (),
    time_unit: str | None = None,
) -> list[RawRecord]:
    """Read the records of a file: one for each selected run and each channel, given or chosen automatically.

    Parameters
    ----------
    path
        The file.
    time, value
        Column of the times and of the recorded quantity: a name, or a number from 1. In MATLAB, HDF5, NumPy and JSON
        files a name is a path with dots, such as `Theta1.signals.values`; a number at its end is a column of a matrix.
        A column that is not given is chosen automatically if the choice is clear. If there are several possible
        columns, a note in the record states the choice.
    rate
        Sampling rate in Hz; replaces the times and the rate that the file states. Only one of `time` and `rate` may be
        given.
    runs
        Which runs to read, such as `1,3-5`; all by default.
    channels
        Further columns of recorded quantities, each as in `value`; each gives a record for each run.
    time_unit
        Unit of the times in the file (s, ms, us, ns, ps, min, h or d); no effect with `rate`. By default it is the unit
        that the file states, or s if it states none.

    Returns
    -------
    list of RawRecord
        The records. If `value` or `channels` are given: in their order, and for each of them in the order of the runs
        in the file. If the columns are chosen automatically: in the order of `runs` (by default that of the file), and
        for each run in that of its columns.

    Raises
    ------
    InputError
        If the file or a column cannot be read or used, or an argument is invalid; the message is one line that says
        what to do.
    """
    path = Path(path)
    if rate is not None and not (np.isfinite(rate) and SLOWEST_RATE <= rate <= FASTEST_RATE):
        right = f"a positive number of samples per second from {SLOWEST_RATE:g} to {FASTEST_RATE:g}"
        raise file_error(path, f"rate must be {right}, not {rate!r}")
    if rate is not None and time is not None:
        raise file_error(path, "give either time (a column) or rate (in Hz), not both")
    if time_unit is not None and time_unit.lower() not in SECONDS:
        valid = "s, ms, us, ns, ps, min, h, d"
        raise file_error(path, f"unknown unit of time {time_unit[:20]!r}; valid are {valid}")
    if path.suffix == ".toml":
        raise file_error(path, "is a study, not a record; compute it with `bayesdamp study`")
    content = separate_clocks(read_contents(path))
    try:
        values = (*([value] if value is not None else []), *channels)
        chosen = choose_columns(content, time=time, values=values, rate=rate, runs=runs)
        return [_record(content, columns, time_unit) for columns in chosen]
    except InputError as error:
        raise file_error(path, error.what, error.arguments) from None


def _record(content: Contents, chosen: RecordColumns, time_unit: str | None) -> RawRecord:
    """Return the record that the chosen columns of a file contain: times in s or sampling rate, values, unit and notes.

    Rows with an empty cell are left out. Times from `FIRST_EPOCH` on are counted from the first sample. Raises
    InputError if the times or values cannot be used. content: contents of the file. chosen: its columns of times and
    values, or the sampling rate. time_unit: unit of the times that the user gives; None to use that of the file, or s
    if it states none.
    """
    value, time = chosen.value, chosen.time
    value_name = selector(content.columns, value)
    time_name = None if time is None else selector(content.columns, time)
    if time is not None and time.values.size != value.values.size:
        raise InputError(
            f"the times {time_name!r} have {time.values.size} samples, but {value_name!r} has {value.values.size}; "
            "give columns of the same length"
        )
    complete, notes = _complete_rows(value, time, content)
    y, t = value.values[complete], None if time is None else time.values[complete]
    lines = np.arange(value.values.size) if content.lines is None else content.lines
    if y.size < MIN_SAMPLES:
        raise InputError(f"only {y.size} samples; a record needs at least {MIN_SAMPLES}")
    _refuse_unusable(y)
    notes = [*notes, *content.notes, *chosen.why]
    unit_from = ""  # who states the unit of the times
    if t is not None and time is not None:
        by_file = time.clock or seconds_of_unit(time) is not None
        unit_from = "given" if time_unit is not None else "file" if by_file else ""
        t = _in_seconds(t, time, time_unit, notes)
    rate = chosen.rate
    if rate is not None and not SLOWEST_RATE <= rate <= FASTEST_RATE:
        what = f"a sampling rate of {rate:g} Hz is implausible; give the right rate in Hz"
        raise InputError(what, arguments=["rate"])
    if rate is not None and value.start and value.rate == rate:
        t, rate = value.start + np.arange(y.size) / rate, None
    if t is not None and t[0] >= FIRST_EPOCH:
        notes.append(f"{FROM_FIRST} ({t[0]:.15g} s).")
        t = t - t[0]
    unit, quantity = _stated_unit(value, time, content)
    provenance = Provenance(
        warnings=content.warnings,
        notes=tuple(notes),
        header_lines=(content.first_line or 1) - 1,
        facts=content.facts,
        time_column="" if time is None else time.label or f"column {time_name}",
        value_column=value.label or f"column {value_name}",
        time_unit=unit_from,
        first_line=content.first_line,
    )
    return RawRecord(
        t,
        y,
        rate,
        lines[complete],
        provenance,
        run=chosen.run,
        channel=split_run(value)[0],
        unit=unit,
        quantity=quantity,
        columns=(time_name, value_name),
        choice=chosen.choice,
    )


def _stated_unit(value: Column, time: Column | None, content: Contents) -> tuple[str, str]:
    """Return the unit and the quantity that a file states for a column of values; each is "" if it states none.

    The unit of the column itself comes first. Otherwise the unit is searched in the facts (named numbers and texts) of
    the file. If the file has only this column of values, all facts are searched except those about the times. If the
    column is the only one in its structure or group, the facts of this structure or group are searched.
    """
    unit, quantity = unit_of_column(value)
    if unit:
        return unit, quantity
    facts, inside = content.facts, f"{value.name.rpartition('.')[0]}."
    if len(content.columns) <= 2:
        of_times = f"{time.name}." if time is not None and time.name else "\0"
        facts = {name: fact for name, fact in facts.items() if not name.startswith(of_times)}
    elif inside != "." and sum(c.name.startswith(inside) for c in content.columns) <= 2:
        facts = {name: fact for name, fact in facts.items() if name.startswith(inside)}
    else:
        facts = {}
    if written := stated_unit(facts):
        return unit_written(written) or (written[:20], quantity)
    return unit, quantity


def _complete_rows(value: Column, time: Column | None, content: Contents) -> tuple[np.ndarray, list[str]]:
    """Return a mask (n,), true for rows with filled cells in the columns of times and values, and a list of notes.

    The list has one note with the number of rows that are left out, or none. Raises InputError if a filled cell is not
    a finite number (NA, null, nan), or if no row is complete.
    """
    columns = [(what, c) for what, c in (("time", time), ("value", value)) if c is not None]
    complete = np.ones(value.values.size, bool)
    for _, column in columns:
        if column.empty is not None:
            complete &= ~column.empty
    if not complete.any():
        both = "in both the column of times and that of values; give columns of the same table"
        alone = "in the column of values; give another column"
        raise InputError(f"no row has a filled cell {alone if time is None else both}")
    bad = np.flatnonzero(complete & ~np.all([np.isfinite(c.values) for _, c in columns], axis=0))
    if bad.size:
        row = int(bad[0])
        what, column = next((what, c) for what, c in columns if not np.isfinite(c.values[row]))
        number = next(i for i, c in enumerate(content.columns, start=1) if c is column)
        fault = f"the {what} is {column.values[row]}, not a finite number"
        if row in column.words:
            fault = f"{column.words[row]!r} in column {number} is not a number"
        position = f"sample {row} (from 0)"
        if content.first_line is not None and content.lines is not None:
            position = f"line {int(content.lines[row]) + content.first_line}"
        if time is not None and row in value.words and TIMES.search(time.words.get(row, "")):
            header = f"{time.words[row]!r} and {value.words[row]!r}"
            raise InputError(
                f"{position}: another table begins, with {header}; give each table a file of its own"
            )
        others = f" ({bad.size - 1} more like it)" if bad.size > 1 else ""
        raise InputError(f"{position}: {fault}; correct it or leave the row out{others}")
    many = int(np.sum(~complete))
    left_out = f"{many} row{'s' if many != 1 else ''} with an empty cell left out."
    return complete, [left_out] if many else []


def _refuse_unusable(y: np.ndarray) -> None:
    """Raise InputError for values y (n,) that are too large, constant, or have a range too small to compute with.

    It is also raised if a repeated value of nines, such as −9999, seems to mark missing samples: if it is far from all
    other values (`FAR`).
    """
    largest = float(np.abs(y).max())
    if largest > LARGEST_VALUE:
        raise InputError(f"values of up to {largest:.3g} are not a measurement; is it the right column?")
    for mark in (float(y.min()), float(y.max())):
        others = y[y != mark]
        is_nines = set(f"{abs(mark):.12g}") <= {"9", "."}
        if is_nines and y.size / 2 < others.size < y.size - 1:
            distance = abs(mark - float(np.median(others)))
            if distance > FAR * float(np.ptp(others)) > 0:
                raise InputError(
                    f"{y.size - others.size} values are {mark:g}, far from all others; if they mark missing samples, "
                    "leave these cells empty"
                )
    span = float(np.ptp(y))
    if span == 0:
        raise InputError(f"the values are constant ({y[0]:g}); is it the right column?")
    if span < 1 / LARGEST_VALUE:
        raise InputError(f"the values change by {span:.3g} at most, which is too little; give another unit")


def _in_seconds(t: np.ndarray, time: Column, given: str | None, notes: list[str]) -> np.ndarray:
    """Convert times (n,) to s. Raises InputError if they are implausibly large, or too close together.

    time: the column that contains the times. given: their unit, a key of SECONDS; None to use the unit that the column
    states, or s if it states none. Times in days that are dates (from FIRST_DATE on) are counted from midnight of the
    first day. notes: list to which a note is appended if the unit is not s.
    """
    seconds = SECONDS[given.lower()] if given is not None else seconds_of_unit(time)
    if seconds not in (None, 1.0):
        why = f"their column is named {time.label!r}"
        if given is not None:
            why = f"as specified, they are in {given}"
        begin = int(np.floor(t[0])) if seconds == DAY and t[0] >= FIRST_DATE else 0
        since = f" from day {begin} on" if begin else ""
        notes.append(f"Times are multiplied by {seconds:g}{since}, to get seconds: {why}.")
        t = (t - begin) * seconds
    span = float(np.abs(t).max())
    if not span < 1 / SLOWEST_RATE * 1e3:
        raise InputError(
            f"times of up to {span:.3g} s: is {time.name!r} the right column, or in another unit?"
        )
    if 0 < float(np.ptp(t)) < t.size / FASTEST_RATE:
        raise InputError(
            f"the times span {np.ptp(t):.3g} s, which no instrument resolves; give their unit or the rate"
        )
    return t
