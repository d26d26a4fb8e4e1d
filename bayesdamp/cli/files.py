"""Check the files and folders that a command reads or writes.

A command overwrites a file only if an earlier run of the same command wrote it.
"""

from collections.abc import Sequence
from pathlib import Path

from bayesdamp.store.files import refuse_special
from bayesdamp.types import InputError


def check_folder(out: Path | None, name: str) -> Path:
    """Return the folder of a run, `out` or by default reports/`name`, and check that it can be a folder.

    The folder is not created.

    Raises
    ------
    InputError
        If the path, or the nearest folder above it that exists, is not a folder.
    OSError
        If the operating system refuses the path.
    """
    folder = Path("reports") / name if out is None else out
    present = next(p for p in (folder, *folder.absolute().parents) if p.is_symlink() or p.exists())
    if not present.is_dir():
        what = f"the results would be written to {str(folder)!r}, and {present} is not a folder"
        raise InputError(f"{what}; give another folder with --out")
    return folder


def check_names(paths: Sequence[Path]) -> None:
    """Raise InputError if a file name is not valid UTF-8, because run.json must contain the names of its inputs."""
    for path in paths:
        try:
            str(path).encode()
        except UnicodeEncodeError:
            raise InputError(f"{path}: the file name is not valid UTF-8; rename the file") from None


def check_replaceable(path: Path, first_line: str) -> None:
    """Raise InputError if a path exists but is not a regular file that begins with `first_line`."""
    refuse_special(path)
    if path.exists():
        with path.open("rb") as handle:
            head = handle.read(len(first_line))
        if head != first_line.encode():
            what = "already exists and was not made by bayesdamp"
            raise InputError(f"--out {path}: {what}; give another name, or delete that file")
