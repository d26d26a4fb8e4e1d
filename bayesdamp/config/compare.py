"""An unknown record as a study: everything of its system free, every damping sum under every restoring law."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bayesdamp.config.checks import StudyError
from bayesdamp.config.load import resolve_study
from bayesdamp.config.study import Study
from bayesdamp.physics.damping import PAPER_TERMS, TERMS, all_sums
from bayesdamp.physics.restoring import LAWS
from bayesdamp.plugins import PluginModule, use
from bayesdamp.types import InputError
from bayesdamp.units import UNITS

PRUNE = 20.0
"""Nats behind the best at which a candidate is pruned: a probability of 2e-9, and Laplace's evidence, by which it is
judged, is a few nats off at most where a posterior is not normal."""
BEST = 2
"""Candidates whose posterior is sampled: what is concluded, and what it is weighed against."""
WARMUP, DRAWS = 100, 500
"""Of each of four chains: NUTS is whitened from the start and its draws are nearly independent, so that these are worth
2,000; where they are not it takes more by itself."""
LEAST_NOISE = 1e-3
"""Share of the amplitude that a record without noise is given: what a good encoder has. Without any there is no
likelihood, and nothing could be weighed."""
METHODS = ("laplace", "importance", "bridge")
JOINT_METHODS = ("laplace", "importance")
"""Of the records one by one, where they are fitted jointly."""
SPECIMEN = "specimen"
"""The name of the one specimen that all records are of."""


Asked = Mapping[str, Any]
"""A record's file and how to read it, with the keys of a study's [[signal]] (None is no value), and a label where the
file has several records. Without a unit an envelope's file says it; a motion is then in rad."""


def laws_for(unit: str) -> tuple[str, ...]:
    """The restoring laws that an unknown record is compared under: all there are, of a translation all that describe
    one. Nobody said which it is, and a law left out would leave its misfit to the damping."""
    along = unit in UNITS and UNITS[unit].translates
    return tuple(n for n in LAWS.present() if not along or LAWS.get(n).translates)


def comparison(records: Sequence[Asked], *, plugins: Sequence[PluginModule] = (), **settings: Any) -> Study:
    """The study that compares all damping sums (or those given) under all restoring laws (or those given) on each
    record. plugins: the user's modules; each damping term in them is compared alone and beside each one that ships,
    each law as one more; settings: as `comparison_tables` has them. Raises InputError, one line in the terms of the
    command's options."""
    use(plugins)
    try:
        return resolve_study(comparison_tables(records, **settings), Path("compare"), plugins)
    except StudyError as error:
        raise _in_options(error) from None


def _sums() -> list[str]:
    """All sums of the paper's terms, and each of the user's own, alone and beside each of these."""
    own = TERMS.added()
    return all_sums() + [sum_ for name in own for sum_ in (name, *(f"{t}+{name}" for t in PAPER_TERMS))]


def comparison_tables(
    records: Sequence[Asked],
    *,
    restoring: Sequence[str] = (),
    damping: Sequence[str] = (),
    noise: str = "auto",
    seed: int = 0,
    repeats: bool = False,
    deviation: str = "auto",
    sensor: float = 0.002,
) -> dict[str, Any]:
    """The tables of that study's file.

    repeats: whether all records are of one specimen, of which one by one modes and evidence are found, without draws;
    otherwise each is a specimen of its own.
    """
    if repeats and len(records) < 2:
        raise InputError("--repeats: there is one record; give two or more of one specimen")
    names = _names([f"{Path(r['file']).stem} {r.get('label', '')}".strip() for r in records])
    signals = [_signal(asked, name, tuple(restoring)) for asked, name in zip(records, names, strict=True)]
    if len(records) > 1:
        for signal, asked in zip(signals, records, strict=True):
            if repeats or asked.get("quantity") != "envelope":
                signal["specimen"] = (
                    SPECIMEN if repeats else _name(asked.get("specimen", "")) or signal["name"]
                )
    # The joint fit reads the answers: draws of each record by itself, and evidence from these, would be read by nobody.
    samplers, methods = ([], JOINT_METHODS) if repeats else (["nuts"], METHODS)
    return {
        "version": 1,
        "name": _question(records, names),
        "seed": seed,
        "description": f"Which damping has {', '.join(dict.fromkeys(Path(r['file']).name for r in records))}?"[
            :200
        ],
        "signal": signals,
        "estimators": {"use": ["least_squares"], "stages": ["initial"]},
        "models": {"compare": list(damping) or _sums(), "prune": PRUNE},
        "posterior": {
            "samplers": samplers,
            "noise": noise,
            "deviation": deviation,
            "sensor": sensor,
            "best": BEST,
            "warmup": WARMUP,
            "draws": DRAWS,
        },
        "evidence": {"methods": list(methods), "referee": "auto"},
    }


def _question(records: Sequence[Asked], names: Sequence[str]) -> str:
    """A name for them all: of their one file, else of the first and how many follow."""
    if len(names) == 1:
        return names[0]
    if len({asked["file"] for asked in records}) == 1:
        return f"{_name(Path(records[0]['file']).stem) or 'record'}-{len(names)}-records"
    return f"{names[0]}-and-{len(names) - 1}-more"


def _signal(asked: Asked, name: str, restoring: tuple[str, ...]) -> dict[str, Any]:
    given = {k: v for k, v in asked.items() if k not in ("label", "specimen") and v is not None}
    if asked.get("quantity") == "envelope":
        return {"name": name, **given}
    laws = restoring or laws_for(asked.get("unit", "rad"))
    return {
        "name": name,
        **given,
        "least_noise": LEAST_NOISE,
        "restoring": list(laws),
        "system": {"restoring": laws[0]},
    }


def _names(labels: Sequence[str]) -> list[str]:
    """A signal's name for each record, from its file's own and its label; the same ones are numbered."""
    found: list[str] = []
    for label in labels:
        stem = _name(label) or "record"
        name, number = stem, 2
        while name in found:
            name, number = f"{stem}-{number}", number + 1
        found.append(name)
    return found


def _name(label: str) -> str:
    """A label as a name: letters, digits, - and _, from both its ends where it is long."""
    name = re.sub(r"[^A-Za-z0-9_-]", "_", label)
    name = name if len(name) <= 56 else f"{name[:30]}-{name[-25:]}"
    return name if not name or re.match(r"[A-Za-z0-9_]", name) else f"_{name}"


def _in_options(error: StudyError) -> InputError:
    """What is wrong with a key of the study, told of the command's option."""
    option = re.sub(r"^signal\[[^\]]*\]\.(system\.)?|^models\.|^posterior\.", "", error.key)
    option = {"compare": "damping"}.get(option, option)
    return InputError(error.what, f"--{option}" if option else "")
