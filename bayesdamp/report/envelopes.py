"""The page of a comparison of envelopes: a sentence, a picture and a table a record, out of its verdicts."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from markupsafe import Markup

from bayesdamp.report.html import fill
from bayesdamp.table import Line, Table
from bayesdamp.types import InputError
from bayesdamp.verdict.files import JSON, read
from bayesdamp.verdict.parts import AtAmplitude, Estimate, Interval
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.words import by_ten, named, probability, with_interval

EMBEDDED = 24
"""Records up to which the page holds their pictures itself; beyond, it shows those in figures/."""
NONE = "–"


def sections(folder: Path, info: Mapping[str, Any]) -> list[dict[str, object]]:
    """Sections of the page, as its template takes them. info: run.json.

    Raises InputError where the verdicts are not as `compare` wrote them.
    """
    try:
        found = read(folder / JSON)
        pictures, settings = list(info["pictures"]), list(info.get("settings", ()))
        if len(pictures) not in (
            len(found),
            len(found) - 1,
        ):  # a specimen's stands behind those of the records
            raise ValueError
    except OSError as error:
        raise InputError(f"{folder / JSON}: {(error.strerror or str(error)).lower()}") from None
    except (AttributeError, KeyError, TypeError, ValueError):
        raise InputError(
            f"{folder}: its {JSON} and run.json are not as compare wrote them; compare the records again"
        ) from None
    own = dict(zip(pictures, found, strict=False))
    body = fill(
        "envelopes.html",
        specimens=found[len(own) :],
        overview=_overview(own) if len(own) > 1 else "",
        records=[
            {
                "key": key,
                "verdict": one,
                "source": _source(folder, f"figures/{key}.png", len(own)),
                "table": _table(one) if one.rate else "",
                "lines": [*([f"The decay {one.window.why}."] if one.window else []), *one.remarks],
            }
            for key, one in own.items()
        ],
    )
    assumed = Markup("<ul>{}</ul>").format(Markup().join(Markup("<li>{}</li>").format(s) for s in settings))
    return [
        {"name": "answer", "title": "The answer", "body": body},
        {"name": "assumed", "title": "What was assumed", "body": assumed},
    ]


def _source(folder: Path, picture: str, records: int) -> str:
    if records > EMBEDDED or not (folder / picture).is_file():
        return picture
    return f"data:image/png;base64,{base64.b64encode((folder / picture).read_bytes()).decode()}"


def _overview(own: Mapping[str, Verdict]) -> Table:
    """A row a record, its name a link to it: Q, or the rate where the frequency is not known, damping and power."""
    quality = any(one.quality_factor is not None for one in own.values())
    lines = []
    for key, one in own.items():
        link = Markup('<a href="#{}">{}</a>').format(key, one.record)
        weighed = [named(one.damping), probability(one.probability)] if one.damping else [NONE, NONE]
        size = one.quality_factor if quality else one.rate
        lines.append(Line([link, _number(size), *weighed, _number(one.exponent)]))
    size = "Q (95 %)" if quality else "rate / (1/s) (95 %)"
    return Table(["record", size, "damping", "probability", "power (95 %)"], lines, left=frozenset({0, 2}))


def _table(one: Verdict) -> Table:
    """The decay at amplitudes of the record, and how probable each damping is."""
    lines = [Line([f"{by_ten(f'{at.amplitude:.4g}')} {at.unit}", _number(at)]) for at in one.decay_rate]
    heads = ["amplitude", "rate / (1/s) (95 %)"]
    if one.quality_factor_at:
        heads.append("Q (95 %)")
        lines = [Line([*line, _number(q)]) for line, q in zip(lines, one.quality_factor_at, strict=True)]
    sums = _listed({name: p for name, p in one.probabilities.items() if p >= 0.005})
    terms = _listed({share.term: share.probability for share in one.energy})
    return Table(heads, lines, caption=f"Probabilities: {sums}. Of each term, in any sum: {terms}.")


def _listed(probabilities: Mapping[str, float]) -> str:
    return ", ".join(f"{named(name)} {probability(p)}" for name, p in probabilities.items())


def _number(one: Estimate | Interval | AtAmplitude | None) -> str:
    return NONE if one is None else by_ten(with_interval(one.value, one.low, one.high))
