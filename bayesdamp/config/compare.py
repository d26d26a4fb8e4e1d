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
"""Nats behind the best at which a candidate is pruned: a probability of 2e-9. Laplace's evidence, by which candidates
are pruned, is a few nats off at most where a posterior is not normal."""
BEST = 2
"""Number of candidates whose posterior is sampled: the conclusion and its nearest rival."""
WARMUP, DRAWS = 100, 500
"""Of each of four chains: NUTS is whitened from the start and its draws are nearly independent, so that these are worth
2,000; where they are not, the sampler draws more by itself."""
LEAST_NOISE = 1e-3
"""Noise that is added to a record without noise, as a share of the amplitude: that of a good encoder. Without noise
there is no likelihood, and nothing could be weighed."""
METHODS = ("laplace", "importance", "bridge")
JOINT_METHODS = ("laplace", "importance")
"""Evidence methods of the single records, where they are fitted jointly."""
SPECIMEN = "specimen"
"""The name of the specimen, where all records are of one."""


Asked = Mapping[str, Any]
"""A record's file and how to read it, with the keys of a study's [[signal]] (None for no value), and a label where the
file has several records. Without a unit, an envelope has that of its file, and a motion is in rad."""


def laws_for(unit: str) -> tuple[str, ...]:
    """Return the restoring laws that an unknown record is compared under.

    These are all laws, for a translation all that describe one. The user named no law, and a law that is left out would
    leave its misfit to the damping.
    """
    along = unit in UNITS and UNITS[unit].translates
    return tuple(n for n in LAWS.present() if not along or LAWS.get(n).translates)


def comparison(records: Sequence[Asked], *, plugins: Sequence[PluginModule] = (), **settings: Any) -> Study:
    """Return the study that compares damping sums under restoring laws on each record.

    Parameters
    ----------
    records
        Files and how to read them.
    plugins
        The user's modules. Each damping term in them is compared alone and together with each one that ships, each law
        as one more.
    settings
        As `comparison_tables` has them.

    Raises
    ------
    InputError
        One line in the terms of the command's options.
    """
    use(plugins)
    try:
        return resolve_study(comparison_tables(records, **settings), Path("compare"), plugins)
    except StudyError as error:
        option = re.sub(r"^signal\[[^\]]*\]\.(system\.)?|^models\.|^posterior\.", "", error.key)
        option = "damping" if option == "compare" else option
        raise InputError(error.what, f"--{option}" if option else "") from None


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
    """Return the tables of that study's file.

    Parameters
    ----------
    records
        Files and how to read them.
    restoring, damping
        Restoring laws and damping sums; all of them where empty.
    repeats
        Whether all records are of one specimen. The records one by one then get modes and evidence, but no draws.
        Otherwise each record is a specimen of its own.
    noise, seed, deviation, sensor
        As a study has them.

    Raises
    ------
    InputError
        There is one record to repeat.
    """
    if repeats and len(records) < 2:
        raise InputError("--repeats: there is one record; give two or more of one specimen")
    signals: dict[str, dict[str, Any]] = {}
    for record in records:
        label = f"{Path(record['file']).stem} {record.get('label', '')}".strip()
        stem = _as_name(label) or "record"
        name, number = stem, 2
        while name in signals:
            name, number = f"{stem}-{number}", number + 1
        given = {k: v for k, v in record.items() if k not in ("label", "specimen") and v is not None}
        signals[name] = signal = {"name": name, **given}
        is_envelope = record.get("quantity") == "envelope"
        if not is_envelope:
            laws = list(restoring) or list(laws_for(record.get("unit", "rad")))
            signal |= {"least_noise": LEAST_NOISE, "restoring": laws, "system": {"restoring": laws[0]}}
        if repeats:
            signal["specimen"] = SPECIMEN
        elif len(records) > 1 and not is_envelope:
            signal["specimen"] = _as_name(record.get("specimen", "")) or name
    first, files = next(iter(signals)), list(dict.fromkeys(Path(record["file"]).name for record in records))
    study = first if len(records) == 1 else f"{first}-and-{len(records) - 1}-more"
    if len(records) > 1 and len({record["file"] for record in records}) == 1:
        study = f"{_as_name(Path(records[0]['file']).stem) or 'record'}-{len(records)}-records"
    own = TERMS.added()
    sums = all_sums() + [sum_ for term in own for sum_ in (term, *(f"{t}+{term}" for t in PAPER_TERMS))]
    # The joint fit reads the answers: nobody would read draws of each record by itself, or evidence from these.
    samplers, methods = ([], JOINT_METHODS) if repeats else (["nuts"], METHODS)
    return {
        "version": 1,
        "name": study,
        "seed": seed,
        "description": f"Which damping has {', '.join(files)}?"[:200],
        "signal": list(signals.values()),
        "estimators": {"use": ["least_squares"], "stages": ["initial"]},
        "models": {"compare": list(damping) or sums, "prune": PRUNE},
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


def _as_name(label: str) -> str:
    """Return a label as a name of letters, digits, - and _; of a long one both its ends."""
    name = re.sub(r"[^A-Za-z0-9_-]", "_", label)
    name = name if len(name) <= 56 else f"{name[:30]}-{name[-25:]}"
    return name if not name or re.match(r"[A-Za-z0-9_]", name) else f"_{name}"
