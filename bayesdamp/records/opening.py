"""Open a file with the reader for its format, and report any problem of the file as an error with a one-line message.

Readers that use compiled libraries run in a child process, because a damaged file may crash them.
"""

from __future__ import annotations

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
from collections.abc import Callable, Sequence
from difflib import get_close_matches
from itertools import islice
from pathlib import Path
from subprocess import DEVNULL, PIPE
from typing import TypeVar

from bayesdamp.records.files import contents as file_contents
from bayesdamp.records.files.contents import Contents, Reader
from bayesdamp.records.readers import READERS
from bayesdamp.types import InputError

Loaded = TypeVar("Loaded")
TIME_LIMIT = 300.0
"""A reader in a child process is stopped, and its file is refused, if it has not finished after this time in s
(conventional)."""
HEAD_BYTES = 65536
"""Number of bytes at the start of a file by which its format is recognised."""
LONGEST_MESSAGE = 280
"""Largest number of characters of an error message about a file; longer messages are cut."""
MOST_LISTED = 5000
"""Largest number of files in a folder that are examined to suggest one: a name similar to that of a missing file, or
the most frequent kind of readable file if the user gives the folder."""
FALLBACK = "text"
"""Name of the reader that is tried last, because it accepts any text."""
_ONE_AT_A_TIME = threading.Lock()
"""Lock for `warnings.catch_warnings`, which changes a state of the whole process and is not thread-safe."""
_OPEN = "a text table, .mat, .npy, .npz, .uff, .tdms, .lvm, .labx, .wav, .h5, .parquet, .xlsx or .json file"
_AGAIN = "the file is damaged or of another kind: save it again, or export it as text"
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
    """Load a file in a child process.

    Parameters
    ----------
    load
        Function that takes the path and the options; it must be at the top level of a module.
    path
        The file.
    patience
        Time in s after which the child process is stopped.
    **options
        Keyword arguments for `load`.

    Returns
    -------
    object
        What `load` returns.

    Raises
    ------
    InputError
        If `load` raises an error, crashes, or does not finish; the message has one line.
    """
    with tempfile.TemporaryDirectory(prefix="bayesdamp-") as folder:
        out = Path(folder) / "result"
        task = json.dumps(
            [load.__module__, load.__qualname__, str(path.resolve()), str(out), options, sys.path]
        )
        try:
            command = [sys.executable, "-c", _CHILD, task]
            child = subprocess.run(command, stdin=DEVNULL, stdout=DEVNULL, stderr=PIPE, timeout=patience)
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
    """Return an error about a file whose message is one line, cut to LONGEST_MESSAGE characters.

    Parameters
    ----------
    path
        The file.
    text
        What is wrong, and what to do.
    arguments
        Arguments of `read` with which the user can solve the problem.
    """
    name = " ".join((path.name or str(path)).split())
    where = name if len(name) <= 80 else f"{name[:50]}...{name[-27:]}"
    what = " ".join(str(text).split())
    room = LONGEST_MESSAGE - len(str(InputError("", where, arguments=arguments)))
    short = what if len(what) <= room else f"{what[: room - 3]}..."
    return InputError(short, where, arguments=arguments)


def read_contents(path: Path | str, isolate: bool = True) -> Contents:
    """Read all columns and facts of a file, with the reader for its format.

    Parameters
    ----------
    path
        The file.
    isolate
        Whether readers that use compiled code run in a child process.

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


def read_each(paths: Sequence[Path], read: Callable[[Path], Loaded]) -> tuple[list[Loaded], list[InputError]]:
    """Read several files; one that cannot be read does not stop the others.

    Parameters
    ----------
    paths
        The files, at least one.
    read
        Function that reads the file with a given path.

    Returns
    -------
    tuple of lists
        The results of the files that could be read, and the errors of the others.

    Raises
    ------
    InputError
        The first error, if no file could be read.
    """
    results: list[Loaded] = []
    errors: list[InputError] = []
    for path in paths:
        try:
            results.append(read(path))
        except InputError as error:
            errors.append(error)
    if not results:
        raise errors[0]
    return results, errors


def reader_of(path: Path) -> Reader:
    """Return the first reader whose `claims` accepts the start of a file; that of text tables is asked last.

    Raises InputError if none does or the file is empty, OSError if it cannot be opened.
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

    Raises InputError if it is missing, empty, larger than LARGEST_FILE or not a regular file, or if these bytes are all
    blank; OSError if it cannot be opened.
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
        raise InputError(f"has {size / 2**30:.1f} GiB; {most}: give a part")
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    if not head.strip(b" \t\r\n\0\xef\xbb\xbf"):
        raise InputError("contains nothing but blanks; export the record again")
    return head
