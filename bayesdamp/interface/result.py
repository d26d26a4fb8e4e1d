"""Define the base classes of all results, which can be printed, saved and loaded, and helpers for their plots."""

from __future__ import annotations

import os
import sys
import zipfile
from abc import ABC, abstractmethod
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypeAlias

import numpy as np

from bayesdamp import __version__
from bayesdamp.calls import CheckedMethods
from bayesdamp.formatting import Table, digits
from bayesdamp.plugins import nearest
from bayesdamp.serial import join, split
from bayesdamp.store.files import READ_ERRORS, pack, save_bytes, unpack
from bayesdamp.types import InputError

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

GivenAxes: TypeAlias = "Axes | Sequence[Axes] | NDArray[Any] | None"
"""Axes that a user may pass: one, several, the array from `plt.subplots`, or None."""
VALUES_FILE = "result.json"
"""Name of the file with the plain values in a saved result, which is a zip archive; its other files are the arrays."""
KINDS = (
    "Record", "Signal", "Model", "Estimate", "Fit", "Posterior", "Evidence", "Comparison", "Prediction",
)  # fmt: skip
"""Names of the classes whose results can be saved."""


class ResultView(CheckedMethods, ABC):
    """Base class of values that print as a short table (`_table`), also in a notebook.

    Its methods reject misspelt keywords with a one-line error.
    """

    @abstractmethod
    def _table(self) -> Table: ...

    def __repr__(self) -> str:
        return self._table().text()

    def _repr_html_(self) -> str:
        return self._table().__html__()


class Result(ResultView):
    """Base class of results: they are printed as a short table, and can be saved and loaded."""

    def save(self, path: str | Path) -> Path:
        """Save the result in a file and return its path. An interrupted save leaves no incomplete file.

        An existing file is replaced. The name can have any ending except .json, because `bayesdamp.load` reads files
        with this ending as verdicts.

        Raises
        ------
        InputError
            If the file cannot be written.
        """
        arrays = dict[str, np.ndarray]()
        head = {"kind": type(self).__name__, "version": __version__, "value": split(self, arrays)}
        return save_bytes(path, pack(VALUES_FILE, head, arrays, zipfile.ZIP_DEFLATED))

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a result from a file that `save` wrote.

        Raises
        ------
        InputError
            If the file is missing, damaged, not a result of this class, or cannot be read by this version.
        """
        result = _read(path)
        if not isinstance(result, cls):
            raise InputError(
                f"{path}: contains a {type(result).__name__}, not a {cls.__name__}; use bayesdamp.load"
            )
        return result


def load(path: str | Path) -> Any:
    """Load a result, a verdict or a run.

    The path is a file that `save` wrote, a verdict in a file that ends in .json, or the folder of a run. The method
    `load` of a class, such as `Fit.load(path)`, also checks the type.

    Raises
    ------
    InputError
        If the path is none of these, or the file contains several verdicts (use `Verdict.load(path, record)`).
    """
    path = Path(path)
    if path.is_dir():
        return import_module("bayesdamp").Run.load(path)
    if path.suffix == ".json":
        from bayesdamp.verdict.types import Verdict

        return Verdict.load(path)
    return _read(path)


def _read(path: str | Path) -> Any:
    """Load a result from a file.

    Raises InputError if the file is missing, damaged, contains something else, or cannot be read by this version.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; give a file that save() wrote")
    try:
        head, arrays = unpack(path, VALUES_FILE)
        kind, version = head["kind"], head["version"]
    except READ_ERRORS:
        raise InputError(
            f"{path}: is not a result of bayesdamp, or is damaged; give a file that save() wrote"
        ) from None
    if kind not in KINDS:
        raise InputError(
            f"{path}: contains a {kind!r}, which this version does not know{nearest(kind, list(KINDS))}"
        )
    try:
        return join(getattr(import_module("bayesdamp"), kind), head["value"], arrays)
    except READ_ERRORS:
        raise InputError(
            f"{path} was saved by bayesdamp {version}, and this version cannot read it; compute the result again"
        ) from None


def frame_table(frame: pd.DataFrame, caption: str, notes: Sequence[str] = ()) -> Table:
    """Convert a data frame to a table for printing: its index, then its columns; floats have up to five digits.

    `caption` is the text above the table, and `notes` are sentences below it.
    """
    lines = [
        [str(name), *(digits(v, n=5) if isinstance(v, float) else str(v) for v in row)]
        for name, *row in frame.astype(object).itertuples()
    ]
    return Table([str(frame.index.name or ""), *map(str, frame.columns)], lines, caption=caption, notes=notes)


def outcome_notes(outcome: str, notes: Sequence[str] = ()) -> tuple[str, ...]:
    """Return the sentences below a table: "Outcome: ..." if the outcome is not "ok", then the notes."""
    return (*([f"Outcome: {outcome}"] if outcome != "ok" else []), *notes)


INVISIBLE_BACKENDS = ("agg", "cairo", "pdf", "pgf", "ps", "svg", "template")
"""Backends of Matplotlib that do not show figures."""
INK, QUIET, FAINT, BLUE = "#222222", "#8a8a8a", "#d9d9d9", "#0072B2"
"""Colours of plots: three greys from dark to light, and blue."""


def get_axes(
    ax: GivenAxes,
    count: int = 1,
    columns: int = 1,
    heights: Sequence[float] | None = None,
    size: tuple[float, float] | None = None,
) -> tuple[Axes, ...]:
    """Return the axes to draw on, row by row.

    Parameters
    ----------
    ax
        The axes that the user passed; None to create a figure.
    count
        Number of axes that are needed.
    columns, heights, size
        Number of columns, relative heights of the rows, and size in inches of a new figure. `count` must be a
        multiple of `columns`.

    Raises
    ------
    InputError
        If `ax` contains another number of axes, or objects that are not axes.
    """
    if ax is not None:
        given = list_axes(ax)
        if len(given) != count:
            raise InputError(f"plot: ax contains {len(given)} axes; give {count}, or leave ax out")
        return given
    import matplotlib.pyplot as plt

    show_in_notebook()
    figure = plt.figure(figsize=size, layout="constrained")
    grid = figure.subplots(-(-count // columns), columns, squeeze=False, height_ratios=heights)
    return tuple(grid.ravel().tolist())


def list_axes(ax: Axes | Sequence[Axes] | NDArray[Any]) -> tuple[Axes, ...]:
    """Return the axes that a user passed, row by row. Raises InputError if an element is not axes."""
    from matplotlib.axes import Axes

    elements: list[Any] = np.ravel(np.asarray(ax, dtype=object)).tolist()
    for element in elements:
        if not isinstance(element, Axes):
            raise InputError(f"plot: ax contains a {type(element).__name__}; it must contain Matplotlib axes")
    return tuple(elements)


def show_in_notebook() -> None:
    """Make a notebook show figures below the cell, even if MPLBACKEND names a backend that does not show figures.

    This variable is set on many servers. A backend that was chosen in the notebook is not changed. Do not call this
    inside `rc_context`, which would restore the backend at its end.
    """
    import matplotlib as mpl

    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    named = os.environ.get("MPLBACKEND", "").lower()
    if shell is None or not hasattr(shell, "kernel") or named not in INVISIBLE_BACKENDS:
        return
    if mpl.get_backend().lower() == named:
        shell.run_line_magic("matplotlib", "inline")
