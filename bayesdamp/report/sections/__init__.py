"""Define the sections of a report, fill their templates, and write report.html from the files in a run's folder."""

import threading
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from functools import partial
from itertools import pairwise
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from bayesdamp.formatting import symbols
from bayesdamp.plugins import Plugin, Registry, has_added_plugins
from bayesdamp.report import words
from bayesdamp.report.results.run import Row, RunFolder
from bayesdamp.store.files import write_bytes
from bayesdamp.store.results import OtherVersionError, claim, remove_listed
from bayesdamp.types import InputError

TEMPLATES = Path(__file__).parents[1] / "templates"
ENVIRONMENT = Environment(
    loader=FileSystemLoader(TEMPLATES),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
ENVIRONMENT.filters["symbols"] = symbols
_MOST = 4
"""Largest number of signals whose content is visible without unfolding it. It is also the largest number of models of a
signal that are drawn: the most probable ones. The tables contain all models."""
MOST_DRAWN = 20
"""Largest number of signals for which the report has figures: the first ones of the study. A figure takes 0.2 s and
adds 0.1 MB to the page (measured), so those of a thousand signals would make it too large for a browser."""
DRAWN_AT_ONCE, WRITTEN_AT_ONCE = 3, 60
"""Numbers of parts of sections, with and without figures, that a process of a pool makes at once (conventional)."""
WITHOUT_FIGURES = (
    f"Only the first {MOST_DRAWN} of {{}} signals have figures. To see others, compare their files alone."
)
"""Note in sections whose figures are left out for some signals; the number of signals is inserted."""
ONE_MODEL = "There are many signals: the figures show only the most probable model of each, the tables show all models."
"""Note in sections with figures of models, if there are more than `_MOST` signals."""
DRAWN_LIST = ".drawn"
"""Name of the file in `figures/` that lists the figure files of the last report, one in each line."""
_ONE_AT_A_TIME = threading.Lock()
"""Held while parts are made for a pool: a Dask worker may have several threads, for which Matplotlib is not made."""


def fill(template: str, **values: object) -> Markup:
    """Fill a template (a file in the folder `TEMPLATES`) with named values, and return the HTML. Text is escaped."""
    return Markup(ENVIRONMENT.get_template(template).render(values))


def stack(*parts: object) -> Markup:
    """Return the parts as HTML, one on each line. Plain text is escaped, and empty parts are left out."""
    return Markup("\n").join(escape(part) for part in parts if part)


def collapsible(summary: str, *content: object) -> Markup:
    """Return content that is hidden behind a summary line until the reader clicks on it."""
    return Markup("<details>\n<summary>{}</summary>\n{}\n</details>").format(summary, stack(*content))


def paragraph(text: object, look: str = "") -> Markup:
    """Return a text as an HTML paragraph. It is escaped unless it is Markup. `look`: its class; "" for none."""
    return Markup("<p{}>{}</p>").format(Markup(f' class="{look}"') if look else "", text)


def repeat_column(repeats: Sequence[int]) -> dict[str, Callable[[Row], str]]:
    """Return the column of a table with the number of the repeat, from 1; {} if there is only one repeat.

    Repeats are simulations of one signal that differ only in their random numbers. The result maps the column's header
    "repeat" to the function that writes the cell of a row.
    """
    return {"repeat": lambda r: str(r["repeat"] + 1)} if len(repeats) > 1 else {}


def bullets(texts: Iterable[str]) -> Markup:
    """Return texts, escaped, as an HTML list with bullets; empty if there are no texts."""
    items = Markup("").join(Markup("<li>{}</li>").format(text) for text in texts)
    return items and Markup("<ul>{}</ul>").format(items)


def heading(text: str) -> Markup:
    """Return a text, escaped, as an HTML heading within a section."""
    return Markup("<h3>{}</h3>").format(text)


class Section(Plugin, ABC):
    """A section of the report."""

    order: int
    """Number by which the sections of a report are sorted, the smallest first."""
    name: str
    """Name of the section; links in the page use it as the anchor."""
    title: str
    """Heading of the section."""

    def applies(self, run: RunFolder) -> bool:
        """Return whether the report of this run has the section; by default every report has it."""
        return True

    @abstractmethod
    def render(self, run: RunFolder) -> str:
        """Return the section's HTML, without its heading."""


SECTIONS = Registry[Section]("bayesdamp.report.sections", "section")


class SignalSection(Section):
    """A section that has a part for each signal for which `shows` returns true."""

    lead: str | Markup = ""
    """Introduction before the parts of the signals; "" for none."""
    anchor = ""
    """Prefix of the anchors to which other sections link; the signal's name follows it. "" for no anchors."""
    draws_models = False
    """Whether the section has figures of models. If true, the note `ONE_MODEL` is shown for more than `_MOST`
    signals."""

    @abstractmethod
    def shows(self, run: RunFolder, signal: str) -> bool:
        """Return whether the section has content on a signal."""

    @abstractmethod
    def part(self, run: RunFolder, signal: str) -> Markup:
        """Return the section's content on one signal as HTML."""

    def applies(self, run: RunFolder) -> bool:
        """Return whether the section has content on any signal."""
        return any(self.shows(run, signal) for signal in run.signals)

    def render(self, run: RunFolder) -> Markup:
        """Return the section as HTML: the introduction, then the content on each signal that has any (`shows`)."""
        signals = [signal for signal in run.signals if self.shows(run, signal)]
        note = paragraph(ONE_MODEL, "small") if self.draws_models and len(run.signals) > _MOST else ""
        return stack(self.lead and paragraph(self.lead), note, self.by_signal(run, signals))

    def by_signal(self, run: RunFolder, signals: Sequence[str]) -> Markup:
        """Return the content on each signal as HTML, under the signal's name if there are several signals.

        From the fifth signal on, the content is hidden until the reader clicks on the name.
        """
        parts: list[Markup] = []
        for i, signal in enumerate(signals):
            body = run.parts.get((self.name, signal)) or self.part_with_figures(run, signal)
            if i >= _MOST:
                body = collapsible(signal, body)
            elif len(signals) > 1:
                body = heading(signal) + body
            parts.append(
                Markup('<div id="{}">{}</div>').format(self.anchor + signal, body) if self.anchor else body
            )
        is_partly_drawn = len(run.signals) > MOST_DRAWN and any("<figure" in part for part in parts)
        return stack(is_partly_drawn and paragraph(WITHOUT_FIGURES.format(len(run.signals)), "small"), *parts)

    def part_with_figures(self, run: RunFolder, signal: str) -> Markup:
        """Return the section's content on one signal, with figures only for the first `MOST_DRAWN` signals of a run."""
        with run.drawings.left_out(signal not in run.signals[:MOST_DRAWN]):
            return self.part(run, signal)


def is_drawn(run: RunFolder, place: int) -> bool:
    """Return whether the figures show the model with this place in the ranking (0: the most probable model).

    If the run has up to four signals, the four most probable models are shown, otherwise only the most probable one.
    """
    return place == 0 or max(place + 1, len(run.signals)) <= _MOST


def by_model(models: Mapping[str, Sequence[object]]) -> Markup:
    """Return the content on each model as HTML, under the name of the model in words, in the given order.

    Models without content are left out. Only the content of the first model is visible without a click on its name.
    """
    parts: list[Markup] = []
    for model, content in models.items():
        name = words.model(model)
        name = name[:1].upper() + name[1:]
        if any(content):
            first = Markup("<h4>{}</h4>\n{}").format(name, stack(*content))
            parts.append(collapsible(name, *content) if parts else first)
    return stack(*parts)


def render(folder: Path, pool: Executor | None = None) -> Path:
    """Write report.html (one self-contained file) and figures/ into a run's folder.

    Figures of an earlier report that this report does not contain are deleted.

    Parameters
    ----------
    folder
        The run's folder. No other files are read.
    pool
        Executor that makes the parts of the sections in parallel; None to make them in this process.

    Returns
    -------
    Path
        The path of report.html.

    Raises
    ------
    InputError
        If the folder does not contain a run, if an incompatible version of bayesdamp wrote the run, or if `claim`
        refuses the folder.
    """
    run = RunFolder(folder)
    claim(run.folder)
    try:
        page, files = page_of(run, pool)
    except OtherVersionError as error:
        raise InputError(error.what, str(folder)) from None
    drawn = run.folder / "figures" / DRAWN_LIST
    before = drawn.read_text(encoding="utf-8").split("\n") if drawn.is_file() else []
    remove_listed(drawn.parent, [name for name in before if name and name not in files])
    if files or before:
        write_bytes(drawn, "\n".join(sorted(files)).encode())
    path = folder / "report.html"
    write_bytes(path, page.encode())
    return path


def page_of(run: RunFolder, pool: Executor | None = None) -> tuple[str, set[str]]:
    """Return the HTML page of a run, and the names of the files of its figures.

    `pool` makes in parallel those parts of the sections that show a single signal. They are made in this process if it
    is None, or if the user has added plug-ins, which exist only in this process. Raises OtherVersionError if an
    incompatible version of bayesdamp wrote the run.
    """
    sections = [section for name in SECTIONS.names() if (section := SECTIONS.get(name)).applies(run)]
    sections.sort(key=lambda section: section.order)
    files: list[str] = []
    if pool is not None and not has_added_plugins():  # a user's own section exists in this process only
        wanted = [
            (section.name, signal)
            for signal in run.signals
            for section in sections
            if isinstance(section, SignalSection) and section.shows(run, signal)
        ]
        drawn = sum(signal in run.signals[:MOST_DRAWN] for _, signal in wanted)
        starts = [*range(0, drawn, DRAWN_AT_ONCE), *range(drawn, len(wanted), WRITTEN_AT_ONCE)]
        pieces = [wanted[i:j] for i, j in pairwise([*starts, len(wanted)])]
        for parts, names in pool.map(partial(_parts, RunFolder(run.folder.resolve())), pieces):
            run.parts |= parts
            files += names
    bodies = [section.render(run) for section in sections]
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
            for section, body in zip(sections, bodies, strict=True)
        ],
    )
    return page, {*files, *run.drawings.files}


def _parts(
    run: RunFolder, wanted: Sequence[tuple[str, str]]
) -> tuple[dict[tuple[str, str], Markup], list[str]]:
    """Return the content of sections on signals, and the names of the files of the figures in it.

    wanted: pairs of a section's name and a signal, which are also the keys of the result.
    """
    parts = {}
    with _ONE_AT_A_TIME:
        for name, signal in wanted:
            section = SECTIONS.get(name)
            assert isinstance(section, SignalSection)
            parts[name, signal] = section.part_with_figures(run, signal)
    return parts, run.drawings.files
