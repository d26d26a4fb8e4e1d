"""From a run's folder to report.html."""

from __future__ import annotations

from concurrent.futures import Executor
from pathlib import Path

from markupsafe import Markup

from bayesdamp.plugins import extended
from bayesdamp.report.html import fill
from bayesdamp.report.results.run import Run
from bayesdamp.report.sections import SECTIONS, in_order
from bayesdamp.store import write_bytes
from bayesdamp.store.contents import OtherVersionError
from bayesdamp.store.folders import claim, remove_listed
from bayesdamp.types import InputError

TEMPLATES = Path(__file__).parent / "templates"
DRAWN = ".drawn"
"""In `figures/`, the names of those that the report has, a line each."""


Rendered = tuple[str, tuple[str, ...]]
"""A section's HTML, and the names of the figures that it wrote."""


def render(folder: Path, pool: Executor | None = None) -> Path:
    """Write report.html (one self-contained file) and figures/ into a run's folder; return the report's path.

    pool: where sections are drawn side by side; None for this process. Reads nothing but the folder. Raises
    InputError where the folder is no run, or one of a version that stored other things.
    """
    run = Run(folder)
    if run.info.get("kind") == "envelopes":
        what = "compares envelopes as an earlier version of bayesdamp did; compare the records again"
        raise InputError(what, str(folder))
    claim(run.folder)
    try:
        page, figures = page_of(run, pool)
    except OtherVersionError as error:
        raise InputError(error.what, str(folder)) from None
    _sweep_figures(run.folder / "figures", figures)
    path = folder / "report.html"
    write_bytes(path, page.encode())
    return path


def page_of(run: Run, pool: Executor | None = None) -> tuple[str, set[str]]:
    """Return the page of a run, and the names of its figures."""
    wanted = in_order(run)
    names = [section.name for section in wanted]
    if pool is None or extended():  # a user's own section is known to this process alone
        bodies = [_section(run, name) for name in names]
    else:
        own = Run(run.folder.resolve())
        bodies = [f.result() for f in [pool.submit(_section, own, name) for name in names]]
    sections = [
        {"name": section.name, "title": section.title, "body": Markup(body)}
        for section, (body, _) in zip(wanted, bodies, strict=True)
    ]
    css, script = (
        Markup((TEMPLATES / name).read_text(encoding="utf-8")) for name in ("style.css", "page.js")
    )
    page = fill(
        "report.html",
        name=run.info.get("name") or run.folder.resolve().name,
        description=run.info.get("description") or "",
        css=css,
        script=script,
        sections=sections,
    )
    return page, {name for _, figures in bodies for name in figures}


def _section(run: Run, name: str) -> Rendered:
    before = len(run.drawings.names)
    body = SECTIONS.get(name).render(run)
    return str(body), tuple(run.drawings.names[before:])


def _sweep_figures(folder: Path, names: set[str]) -> None:
    """Remove the figures that an earlier report wrote and this one does not have."""
    kept = {f"{name}.{kind}" for name in names for kind in ("svg", "png")}
    try:
        before = (folder / DRAWN).read_text(encoding="utf-8").split("\n")
    except OSError:
        before = []
    remove_listed(folder, [name for name in before if name and name not in kept])
    if kept or before:
        write_bytes(folder / DRAWN, "\n".join(sorted(kept)).encode())
