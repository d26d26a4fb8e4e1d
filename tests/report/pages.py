"""Parse a page of HTML: what it loads, its identifiers, its text, its tables and the numbers in them."""

import math
import re
from dataclasses import dataclass, field
from html.parser import HTMLParser
from typing import NamedTuple

_RAISED = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹−", "-0123456789-")
_NUMBER = re.compile(
    r"([<>] )?([−-]?\d[\d\u202f]*(?:\.(\d+))?)(?:e([+−-]?\d+))?(?: × 10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+))?( ms\b)?"
)


class Shown(NamedTuple):
    """A number as it is shown: its bound (< or > or nothing), its value, and half a unit of its last digit."""

    bound: str
    value: float
    half: float

    def is_right(self, stored: float) -> bool:
        """Return whether the stored number is shown as this one, or is beyond this bound."""
        if self.bound:
            return stored > self.value if self.bound == ">" else stored < self.value
        return abs(self.value - stored) <= self.half * (1 + 1e-9)


def numbers(text: str) -> list[Shown]:
    """Return the numbers in a text, in its order; milliseconds in s. A cell of 0 alone is exactly 0."""
    parsed = []
    for bound, digits, decimals, e, raised, ms in _NUMBER.findall(text):
        power = 10.0 ** (int((e or raised or "0").translate(_RAISED)) - 3 * bool(ms))
        value = float(digits.translate(_RAISED).replace("\u202f", "")) * power
        half = 0.0 if text == "0" else 0.5 * power * 10.0 ** -len(decimals)
        parsed.append(Shown(bound.strip(), value, half))
    return parsed


class Page(HTMLParser):
    """Collects what a page loads, its identifiers and its text, and checks that tags close in order."""

    VOID = frozenset({"meta", "img", "br", "link", "input", "hr", "source"})

    def __init__(self, html: str) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.ids: list[str] = []
        self.text: list[str] = []
        self.open: list[str] = []
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        if tag not in self.VOID:
            self.open.append(tag)
        for name, value in attrs:
            if name in ("src", "href", "data", "srcset", "action"):
                self.loads.append(value or "")
            if name == "id":
                self.ids.append(value or "")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)

    @property
    def words(self) -> str:
        return re.sub(r"\s+", " ", " ".join(self.text))


def foreign(html: str) -> list[str]:
    """Return everything that a browser would load from outside the page."""
    loads = [load for load in Page(html).loads if not load.startswith(("data:", "#"))]
    return loads + re.findall(r"@import[^;]*|url\([^)]*\)|https?://[^\s\"'<]+", html)


@dataclass
class PageTable:
    """A table of a page. path: the section, the signal, and the headings and folds that the table is under."""

    path: list[str]
    caption: str
    headers: list[str] = field(default_factory=list)
    rows: list[list[str]] = field(default_factory=list)


class Tables(Page):
    """Collects the tables of a page as cells of text, and the paragraphs, list items and numbers of its answers."""

    CAUGHT = frozenset({"h3", "h4", "summary", "th", "td", "p", "li"})

    def __init__(self, html: str) -> None:
        self.tables: list[PageTable] = []
        self.texts: list[tuple[list[str], str, str]] = []
        """Path, tag (`claim` for an answer's sentence) and text of what is not in a table."""
        self._section = self._signal = self._model = self._caption = self._look = ""
        self._folds: list[str] = []
        self._caught: list[str] = []
        super().__init__(html)

    @property
    def path(self) -> list[str]:
        return [self._section, self._signal, self._model, *self._folds]

    def handle_starttag(self, tag, attrs):
        super().handle_starttag(tag, attrs)
        known = dict(attrs)
        if tag == "section":
            self._section, self._signal, self._model = known["id"], "", ""
        elif tag == "details":
            self._folds.append("")
        elif tag == "table":
            self.tables.append(PageTable(self.path, self._caption))
        elif tag == "tr" and "tbody" in self.open:
            self.tables[-1].rows.append([])
        elif tag == "div" and known.get("class") == "table":
            self._caption = ""
        if tag in self.CAUGHT:
            self._caught, self._look = [], known.get("class") or ""

    def handle_data(self, data):
        super().handle_data(data)
        self._caught.append(data)

    def handle_endtag(self, tag):
        super().handle_endtag(tag)
        text = re.sub(r"[ \n]+", " ", "".join(self._caught)).strip()
        if tag == "h3":
            self._signal, self._model = text, ""
        elif tag == "h4":
            self._model = text
        elif tag == "summary":
            self._folds[-1] = text
        elif tag == "details":
            self._folds.pop()
        elif tag == "th":
            self.tables[-1].headers.append(text)
        elif tag == "td" and "tbody" in self.open:
            self.tables[-1].rows[-1].append(text)
        elif tag == "p" and self._look == "caption":
            self._caption = text
        elif tag in self.CAUGHT:
            self.texts.append((self.path, "claim" if self._look == "claim" else tag, text))


Stored = dict[str, float] | str
"""Numbers of a text by their names, in the order in which they are read; or the text itself."""

IDENTIFYING = {
    "repeat", "record", "model", "damping", "restoring law", "method", "estimator", "stage", "parameter", "sampler",
    "coefficient", "signal", "origin", "recorded",
}  # fmt: skip
"""Headers of the cells that say what a row is about."""


class Comparison:
    """The names of the numbers that were compared, and what is shown and stored for those that are wrong."""

    def __init__(self) -> None:
        self.compared: set[str] = set()
        self.wrong: dict[str, str] = {}

    def check(self, name: str, text: str, stored: Stored) -> None:
        """Compare a text with the stored numbers by their names, in the order in which they are read."""
        if isinstance(stored, str):
            return self.mark(name, text == stored, f"{text!r}, stored {stored!r}")
        stored = {part: value for part, value in stored.items() if not math.isnan(value)}
        shown = numbers(text)
        complete = len(shown) == len(stored) and (bool(stored) or text in ("", "–"))
        self.mark(f"{name}: count", complete, f"{text!r}, stored {stored}")
        for number, (part, value) in zip(shown, stored.items()):
            self.mark(f"{name}: {part}", number.is_right(value), f"{text!r}, stored {value}")

    def mark(self, name: str, right: bool, why: str) -> None:
        self.compared.add(name)
        if not right:
            self.wrong[name] = why

    def row(self, table: str, cells: dict[str, str], stored: dict[str, Stored]) -> None:
        """Compare the cells of a row, except those that identify it."""
        for header in cells.keys() - IDENTIFYING:
            name = re.sub("ζ|μc", "coefficient", header)
            self.check(f"{table}, {name}", cells[header], stored[header])
