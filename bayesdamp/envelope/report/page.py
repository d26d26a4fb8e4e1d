"""The page of a comparison of envelopes: a sentence, a table and a picture a record."""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping, Sequence

from bayesdamp.envelope.pooled import Pooled
from bayesdamp.envelope.results import EnvelopeResult
from bayesdamp.envelope.words import damping_words, number, probability_words

EMBEDDED = 24
"""Records up to which the page holds its pictures itself; beyond, it shows those in figures/."""
STYLE = """
body { margin: 0; color: #1d1d1f; font: 16px/1.5 system-ui, sans-serif; }
main { max-width: 1008px; margin: 0 auto; padding: 40px 24px 64px; }
h1 { font-size: 28px; } h2 { font-size: 17px; margin: 40px 0 6px; padding-top: 12px; border-top: 1px solid #dcdce0; }
table { border-collapse: collapse; font-size: 13.5px; }
th, td { padding: 3px 14px 3px 0; text-align: right; white-space: nowrap; }
th:first-child, td:first-child { text-align: left; } th { border-bottom: 1px solid #1d1d1f; }
img { max-width: 100%; } .quiet, li { color: #6b6b70; font-size: 13.5px; }
h2 { overflow-wrap: anywhere; } a { color: inherit; } .scroll { overflow-x: auto; }
/* A picture is drawn in ink on white: turned round it is light on the dark page, and its hues stay. */
@media screen and (prefers-color-scheme: dark) {
  body { color: #f2f2f4; background: #151517; } h2 { border-color: #3a3a3e; } th { border-color: #f2f2f4; }
  .quiet, li { color: #a0a0a6; } img { filter: invert(0.922) hue-rotate(180deg); }
}
@media print {
  body { font-size: 10pt; } main { max-width: none; padding: 0; } h2 { break-after: avoid; }
  img, tr { break-inside: avoid; } .scroll { overflow: visible; }
}
"""


def page(
    title: str,
    found: Sequence[EnvelopeResult],
    pictures: Mapping[str, bytes],
    files: Mapping[str, str],
    pooled: Pooled | None,
    settings: Sequence[str],
) -> bytes:
    """HTML. pictures: record's key to PNG (used where there are few); files: key to the picture's path."""
    parts = [
        "<!DOCTYPE html>", '<html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{html.escape(title)} – bayesdamp</title><style>{STYLE}</style></head><body><main>",
        f"<h1>{html.escape(title)}</h1>",
    ]  # fmt: skip
    if pooled is not None:
        parts.append(f"<p>{html.escape(pooled.sentence)}</p>")
    if len(found) > 1:
        parts.append(_overview(list(files), found))
    for key, one in zip(files, found, strict=True):
        parts += [
            f'<h2 id="{html.escape(key)}">{html.escape(one.name)}</h2>',
            f"<p>{html.escape(one.sentence)}</p>",
        ]
        if key in pictures and len(found) <= EMBEDDED:
            source = f"data:image/png;base64,{base64.b64encode(pictures[key]).decode()}"
        else:
            source = files[key]
        parts.append(
            f'<img loading="lazy" src="{html.escape(source)}" alt="{html.escape(one.name)}: level over time">'
        )
        if one.rate is not None:
            parts.append(_table(one))
        parts.append(_remarks(one))
    parts += [
        "<h2>What was assumed</h2><ul>",
        *(f"<li>{html.escape(line)}</li>" for line in settings),
        "</ul>",
    ]
    parts.append("</main></body></html>")
    return "\n".join(parts).encode()


def _overview(keys: Sequence[str], found: Sequence[EnvelopeResult]) -> str:
    """A row a record, its name a link to it: Q, or the rate where the frequency is not known, damping and power."""
    quality = any(one.quality_factor is not None for one in found)
    rows = [
        _row(
            "th",
            ["record", "Q" if quality else "rate / (1/s)", "95 %", "damping", "probability", "power", "95 %"],
        )
    ]
    for key, one in zip(keys, found, strict=True):
        link = f'<td><a href="#{html.escape(key)}">{html.escape(one.name)}</a></td>'
        size = one.quality_factor if quality else one.rate
        cells = (
            ["–", "–"] if size is None else [number(size.value), f"{number(size.low)} to {number(size.high)}"]
        )
        cells += (
            [damping_words(one.damping), probability_words(one.probability)] if one.damping else ["–", "–"]
        )
        p = one.exponent
        cells += ["–", "–"] if p is None else [f"{p.value:.2f}", f"{p.low:.2f} to {p.high:.2f}"]
        rows.append(f"<tr>{link}{''.join(f'<td>{html.escape(cell)}</td>' for cell in cells)}</tr>")
    return f'<div class="scroll"><table>{"".join(rows)}</table></div>'


def _table(one: EnvelopeResult) -> str:
    quality = one.quality_factor is not None
    heads = ["amplitude", "rate / (1/s)", "95 %", *(["Q", "95 %"] if quality else [])]
    rows = []
    for at in one.at:
        cells = [
            f"{number(at.amplitude)} {at.unit}",
            number(at.rate.value),
            f"{number(at.rate.low)} to {number(at.rate.high)}",
        ]
        if at.quality_factor is not None:
            q = at.quality_factor
            cells += [number(q.value), f"{number(q.low)} to {number(q.high)}"]
        rows.append(cells)
    shown = [_row("th", heads), *(_row("td", cells) for cells in rows)]
    dampings = ", ".join(
        f"{damping_words(name)} {probability_words(p)}"
        for name, p in sorted(one.probabilities.items(), key=lambda item: -item[1])
        if p >= 0.005
    )
    terms = ", ".join(f"{damping_words(name)} {probability_words(p)}" for name, p in one.terms.items())
    said = f"Probabilities: {dampings}. Of each term, in any sum: {terms}."
    return (
        f'<div class="scroll"><table>{"".join(shown)}</table></div><p class="quiet">{html.escape(said)}</p>'
    )


def _row(tag: str, cells: Sequence[str]) -> str:
    return "<tr>" + "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in cells) + "</tr>"


def _remarks(one: EnvelopeResult) -> str:
    lines = [*(one.cut.why if one.cut else ()), *one.remarks]
    return "<ul>" + "".join(f"<li>{html.escape(line)}</li>" for line in lines) + "</ul>"
