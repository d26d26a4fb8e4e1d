"""The page of a comparison of envelopes: a sentence, a table and a picture a record."""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping, Sequence

from bayesdamp.verdict.parts import AtAmplitude, Estimate, Interval
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.words import by_ten, named, probability, with_interval

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
    found: Sequence[Verdict],
    pictures: Mapping[str, bytes],
    files: Mapping[str, str],
    settings: Sequence[str],
) -> bytes:
    """HTML. found: of the records, and of the specimen behind them; pictures: record's key to PNG (used where there are
    few); files: key to the picture's path."""
    own, common = found[: len(files)], found[len(files) :]
    parts = [
        "<!DOCTYPE html>", '<html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{html.escape(title)} – bayesdamp</title><style>{STYLE}</style></head><body><main>",
        f"<h1>{html.escape(title)}</h1>",
    ]  # fmt: skip
    for one in common:
        parts += [f"<p>{html.escape(one.sentence)}</p>", _listed(one.remarks)]
    if len(own) > 1:
        parts.append(_overview(list(files), own))
    for key, one in zip(files, own, strict=True):
        parts += [
            f'<h2 id="{html.escape(key)}">{html.escape(one.record)}</h2>',
            f"<p>{html.escape(one.sentence)}</p>",
        ]
        if key in pictures and len(found) <= EMBEDDED:
            source = f"data:image/png;base64,{base64.b64encode(pictures[key]).decode()}"
        else:
            source = files[key]
        parts.append(
            f'<img loading="lazy" src="{html.escape(source)}" alt="{html.escape(one.record)}: level over time">'
        )
        if one.rate is not None:
            parts.append(_table(one))
        why = [f"The decay {one.window.why}."] if one.window else []
        parts.append(_listed([*why, *one.remarks]))
    parts += ["<h2>What was assumed</h2>", _listed(settings), "</main></body></html>"]
    return "\n".join(parts).encode()


def _overview(keys: Sequence[str], found: Sequence[Verdict]) -> str:
    """A row a record, its name a link to it: Q, or the rate where the frequency is not known, damping and power."""
    quality = any(one.quality_factor is not None for one in found)
    size = "Q (95 %)" if quality else "rate / (1/s) (95 %)"
    rows = [_row("th", ["record", size, "damping", "probability", "power (95 %)"])]
    for key, one in zip(keys, found, strict=True):
        link = f'<td><a href="#{html.escape(key)}">{html.escape(one.record)}</a></td>'
        weighed = [named(one.damping), probability(one.probability)] if one.damping else ["–", "–"]
        cells = [_number(one.quality_factor if quality else one.rate), *weighed, _number(one.exponent)]
        rows.append(f"<tr>{link}{''.join(f'<td>{html.escape(cell)}</td>' for cell in cells)}</tr>")
    return f'<div class="scroll"><table>{"".join(rows)}</table></div>'


def _table(one: Verdict) -> str:
    """The decay at amplitudes of the record, and how probable each damping is."""
    quality = one.quality_factor_at or (None,) * len(one.decay_rate)
    heads = ["amplitude", "rate / (1/s) (95 %)", *(["Q (95 %)"] if one.quality_factor_at else [])]
    rows = [_row("th", heads)]
    for at, q in zip(one.decay_rate, quality, strict=True):
        amplitude = f"{by_ten(f'{at.amplitude:.4g}')} {at.unit}"
        rows.append(_row("td", [amplitude, _number(at), *([_number(q)] if q else [])]))
    dampings = ", ".join(
        f"{named(name)} {probability(p)}" for name, p in one.probabilities.items() if p >= 0.005
    )
    terms = ", ".join(f"{named(share.term)} {probability(share.probability)}" for share in one.energy)
    said = f"Probabilities: {dampings}. Of each term, in any sum: {terms}."
    return f'<div class="scroll"><table>{"".join(rows)}</table></div><p class="quiet">{html.escape(said)}</p>'


def _number(one: Estimate | Interval | AtAmplitude | None) -> str:
    return "–" if one is None else by_ten(with_interval(one.value, one.low, one.high))


def _row(tag: str, cells: Sequence[str]) -> str:
    return "<tr>" + "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in cells) + "</tr>"


def _listed(lines: Sequence[str]) -> str:
    return "<ul>" + "".join(f"<li>{html.escape(line)}</li>" for line in lines) + "</ul>"
