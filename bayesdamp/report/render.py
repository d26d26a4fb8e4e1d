"""From a run's folder to report.html."""

from __future__ import annotations

from pathlib import Path

from markupsafe import Markup

from bayesdamp.report.html import fill
from bayesdamp.report.run import Run
from bayesdamp.report.sections import in_order
from bayesdamp.store import write_bytes


def render(folder: Path) -> Path:
    """Write report.html (one self-contained file) and figures/ into a run's folder; return the report's path.

    Reads nothing but the folder. Raises InputError where the folder is no run.
    """
    run = Run(folder)
    sections = [
        {"name": section.name, "title": section.title, "body": Markup(section.render(run))}
        for section in in_order()
        if section.applies(run)
    ]
    css = Markup((Path(__file__).parent / "templates" / "style.css").read_text(encoding="utf-8"))
    name = run.info.get("name") or run.folder.resolve().name
    page = fill(
        "report.html", name=name, description=run.info.get("description") or "", css=css, sections=sections
    )
    _sweep_figures(run)
    path = run.folder / "report.html"
    write_bytes(path, page.encode())
    return path


def _sweep_figures(run: Run) -> None:
    """Remove the figures of an earlier report that this one does not have."""
    kept = {f"{name}.{kind}" for name in run.drawings.names for kind in ("svg", "png")}
    for path in run.drawings.folder.glob("*.*"):
        if path.suffix in (".svg", ".png") and path.name not in kept:
            path.unlink()
