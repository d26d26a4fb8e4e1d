"""Write report.html from the files in a run's folder."""

from __future__ import annotations

from concurrent.futures import Executor
from functools import partial
from pathlib import Path

from markupsafe import Markup

from bayesdamp.plugins import has_added_plugins
from bayesdamp.report.results.run import RunFolder
from bayesdamp.report.sections import SECTIONS, TEMPLATES, fill
from bayesdamp.store.contents import OtherVersionError
from bayesdamp.store.files import write_bytes
from bayesdamp.store.results import claim, remove_listed
from bayesdamp.types import InputError

DRAWN_LIST = ".drawn"
"""File in `figures/` that lists the figure files of the last report, one in each line."""


def render(folder: Path, pool: Executor | None = None) -> Path:
    """Write report.html (one self-contained file) and figures/ into a run's folder.

    Figures of an earlier report that this report does not contain are deleted.

    Parameters
    ----------
    folder
        The run's folder. No other files are read.
    pool
        Executor that draws the sections in parallel; None to draw them in this process.

    Returns
    -------
    Path
        The path of report.html.

    Raises
    ------
    InputError
        If the folder does not contain a run, or if an incompatible version of bayesdamp wrote the run.
    """
    run = RunFolder(folder)
    claim(run.folder)
    try:
        page, figures = page_of(run, pool)
    except OtherVersionError as error:
        raise InputError(error.what, str(folder)) from None
    drawn = run.folder / "figures" / DRAWN_LIST
    files = {f"{name}.{kind}" for name in figures for kind in ("svg", "png")}
    before = drawn.read_text(encoding="utf-8").split("\n") if drawn.is_file() else []
    remove_listed(drawn.parent, [name for name in before if name and name not in files])
    if files or before:
        write_bytes(drawn, "\n".join(sorted(files)).encode())
    path = folder / "report.html"
    write_bytes(path, page.encode())
    return path


def page_of(run: RunFolder, pool: Executor | None = None) -> tuple[str, set[str]]:
    """Return the HTML page of a run, and the names of its figures without their endings.

    `pool` draws the sections in parallel; None to draw them in this process, which is also done if the user has added
    plug-ins, because these exist in this process only. Raises OtherVersionError if an incompatible version of bayesdamp
    wrote the run.
    """
    sections = [section for name in SECTIONS.names() if (section := SECTIONS.get(name)).applies(run)]
    sections.sort(key=lambda section: section.order)
    names = [section.name for section in sections]
    if pool is None or has_added_plugins():  # a user's own section exists in this process only
        bodies = [_section(run, name) for name in names]
    else:
        bodies = list(pool.map(partial(_section, RunFolder(run.folder.resolve())), names))
    css, script = (
        Markup((TEMPLATES / name).read_text(encoding="utf-8")) for name in ("style.css", "page.js")
    )
    page = fill(
        "report.html",
        name=run.info.get("name") or run.folder.resolve().name,
        description=run.info.get("description") or "",
        css=css,
        script=script,
        sections=[
            {"name": section.name, "title": section.title, "body": Markup(body)}
            for section, (body, _) in zip(sections, bodies, strict=True)
        ],
    )
    return page, {name for _, figures in bodies for name in figures}


def _section(run: RunFolder, name: str) -> tuple[str, tuple[str, ...]]:
    """Return a section's HTML, and the names of the figures that it drew."""
    before = len(run.drawings.names)
    body = SECTIONS.get(name).render(run)
    return str(body), tuple(run.drawings.names[before:])
