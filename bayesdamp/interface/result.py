"""Define what all results can do: print as a short table, be saved and loaded, and find the axes to draw on."""

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
from bayesdamp.formatting import Table
from bayesdamp.plugins import nearest
from bayesdamp.serial import join, split
from bayesdamp.store.files import BROKEN, packed, save_bytes, unpacked
from bayesdamp.types import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    GivenAxes: TypeAlias = Axes | Sequence[Axes] | NDArray[Any] | None
    """Axes as a user gives them: one, several, those of `plt.subplots`, or none."""

META = "result.json"
KINDS = (
    "Record", "Signal", "Model", "Estimate", "Fit", "Posterior", "Evidence", "Comparison", "Prediction",
)  # fmt: skip
"""Public names of the results that are saved."""


class Shown(CheckedMethods, ABC):
    """A value that prints as a short table, also in a notebook; its methods refuse misspelt keywords in one line."""

    @abstractmethod
    def _table(self) -> Table: ...

    def __repr__(self) -> str:
        return self._table().text()

    def _repr_html_(self) -> str:
        return self._table().__html__()


class Result(Shown):
    """A frozen value that prints as a short table and can be saved and loaded."""

    def save(self, path: str | Path) -> Path:
        """Write the result to a file, completely or not at all, and return the path.

        Raises
        ------
        InputError
            Where the file cannot be written.
        """
        arrays = dict[str, np.ndarray]()
        head = {"kind": type(self).__name__, "version": __version__, "value": split(self, arrays)}
        return save_bytes(path, packed(META, head, arrays, zipfile.ZIP_DEFLATED))

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what `save` wrote.

        Raises
        ------
        InputError
            Where the file is not such a result.
        """
        return _read(path, cls)


def load(path: str | Path) -> Any:
    """Read the result that `save` wrote to a file, a verdict in JSON, or the run in a folder, whichever it is.

    A class's own `load`, such as `Fit.load(path)`, does the same with a type.

    Raises
    ------
    InputError
        Where the path is none of them.
    """
    path = Path(path)
    if path.is_dir():
        return import_module("bayesdamp").Run.load(path)
    if path.suffix == ".json":
        from bayesdamp.verdict.types import Verdict

        return Verdict.load(path)
    return _read(path, None)


def _read(path: str | Path, cls: type[Any] | None) -> Any:
    """Return the result in a file, which must be one of `cls` where that is given."""
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file; give one that a result's save() wrote")
    try:
        head, arrays = unpacked(path, META)
        kind, version = head["kind"], head["version"]
    except BROKEN:
        raise InputError(
            f"{path}: is not a result of bayesdamp, or not a whole one; give one that save() wrote"
        ) from None
    if cls is not None and kind != cls.__name__:
        raise InputError(f"{path}: holds a {kind}, not a {cls.__name__}; use bayesdamp.load")
    if cls is None:
        if kind not in KINDS:
            raise InputError(f"{path}: holds a {kind!r}, which is not known here{nearest(kind, list(KINDS))}")
        cls = getattr(import_module("bayesdamp"), kind)
    try:
        return join(cls, head["value"], arrays)
    except BROKEN:
        raise InputError(
            f"{path}: was saved by bayesdamp {version}, which this version does not read"
        ) from None


def outcome_notes(outcome: str, notes: Sequence[str] = ()) -> tuple[str, ...]:
    """Return the sentences below a table: the outcome, where it is not `ok`, and notes."""
    return (*([f"Outcome: {outcome}"] if outcome != "ok" else []), *notes)


INVISIBLE = ("agg", "cairo", "pdf", "pgf", "ps", "svg", "template")
"""Backends of matplotlib that show nothing."""
INK, QUIET, FAINT, BLUE = "#222222", "#8a8a8a", "#d9d9d9", "#0072B2"


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
        The axes that the user gives; None for those of a new figure.
    count
        How many are needed.
    columns, heights, size
        Of a new figure: columns, relative heights of the rows, and size in inches.

    Raises
    ------
    InputError
        Where another number of axes is given, or something else.
    """
    if ax is not None:
        given = list_axes(ax)
        if len(given) != count:
            raise InputError(f"plot: ax has {len(given)} axes; it must have {count}, or be left out")
        return given
    import matplotlib.pyplot as plt

    show_in_notebook()
    figure = plt.figure(figsize=size, layout="constrained")
    grid = figure.subplots(-(-count // columns), columns, squeeze=False, height_ratios=heights)
    return tuple(grid.ravel().tolist())


def list_axes(ax: Axes | Sequence[Axes] | NDArray[Any]) -> tuple[Axes, ...]:
    """Return the given axes, row by row. Raises InputError for anything else."""
    from matplotlib.axes import Axes

    elements: list[Any] = np.ravel(np.asarray(ax, dtype=object)).tolist()
    for element in elements:
        if not isinstance(element, Axes):
            raise InputError(f"plot: ax holds a {type(element).__name__}; it must be matplotlib's axes")
    return tuple(elements)


def show_in_notebook() -> None:
    """Let a notebook show pictures below the cell, even where the environment names a backend that shows nothing.

    Servers and test machines do so. A backend that the notebook itself chose stays. Call this outside of a context of
    settings.
    """
    import matplotlib as mpl

    shell = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    named = os.environ.get("MPLBACKEND", "").lower()
    if shell is None or not hasattr(shell, "kernel") or named not in INVISIBLE:
        return
    if mpl.get_backend().lower() == named:
        shell.run_line_magic("matplotlib", "inline")
