"""Build the study that the command `compare` runs; all parameters are inferred, and none is taken as known.

By default the study compares all damping sums (sums of damping terms, such as viscous+coulomb) under all restoring
laws.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bayesdamp.config.checks import StudyError
from bayesdamp.config.load import resolve_study
from bayesdamp.config.study import Study, as_name
from bayesdamp.physics.damping import PAPER_TERMS, TERMS, all_sums
from bayesdamp.physics.restoring import LAWS
from bayesdamp.plugins import PluginModule, use_modules
from bayesdamp.types import SENSOR, InputError
from bayesdamp.units import UNITS

PRUNE_NATS = 20.0
"""A candidate (a damping sum under a restoring law) is left out if its log evidence is at least this far below the
largest, in nats: a relative probability of 2e-9. The evidence is that of the answer, by linear approximations."""
SAMPLED_CANDIDATES = 2
"""Number of candidates (damping sums under a restoring law) whose posterior is sampled, the most probable ones."""
WARMUP, DRAWS = 100, 500
"""Numbers of warm-up draws, which are discarded, and of draws of each of four chains. Draws in whitened coordinates are
nearly independent; if they are not, the sampler adds draws."""
LEAST_NOISE = 1e-3
"""Standard deviation of the noise that is added to a record without noise, because a likelihood needs noise: a fraction
of the amplitude, typical of a good encoder."""
SPECIMEN = "specimen"
"""Name of the specimen (the tested object) if all records are repeats on the same one."""


RecordOptions = Mapping[str, Any]
"""A record's file and how to read it, with the keys of [[signal]] in a study (None for no value), and a label if the
file has several records. Without a unit, an envelope has the unit of its file, and a motion is in rad."""


def laws_for(unit: str) -> tuple[str, ...]:
    """Return the restoring laws that are compared if the user names none.

    `unit` is that of the displacement, such as "mm". For an angle or an unknown unit these are all laws, for any other
    unit those that also describe a translation.

    All are needed, because the misfit of a wrong restoring law would be explained by damping.
    """
    along = unit in UNITS and UNITS[unit].translates
    return tuple(n for n in LAWS.present() if not along or LAWS.get(n).translates)


def comparison(
    records: Sequence[RecordOptions], *, plugins: Sequence[PluginModule] = (), **settings: Any
) -> Study:
    """Return the study that compares damping sums under restoring laws on each record.

    Parameters
    ----------
    records
        Files and how to read them (`RecordOptions`).
    plugins
        The user's modules. Each damping term in them is compared alone and together with viscous, Coulomb and quadratic
        damping; each restoring law in them is added to the laws that are compared.
    settings
        Further arguments of `comparison_tables`.

    Returns
    -------
    Study
        The checked study.

    Raises
    ------
    InputError
        A setting is wrong. The message names the option of the command.
    """
    use_modules(plugins)
    try:
        return resolve_study(comparison_tables(records, **settings), Path("compare"), plugins)
    except StudyError as error:
        option = re.sub(r"^signal\[[^\]]*\]\.(system\.)?|^models\.|^posterior\.", "", error.where)
        option = {"compare": "damping", "specimen": "repeats"}.get(option, option)
        raise InputError(error.what, f"--{option}" if option else "") from None


def comparison_tables(
    records: Sequence[RecordOptions],
    *,
    restoring: Sequence[str] = (),
    damping: Sequence[str] = (),
    noise: str = "auto",
    seed: int = 0,
    repeats: bool = False,
    deviation: str = "auto",
    sensor: float = SENSOR,
) -> dict[str, Any]:
    """Return the content of the study file for a comparison.

    Parameters
    ----------
    records
        Files and how to read them (`RecordOptions`).
    restoring, damping
        Names of restoring laws, and damping sums such as "viscous+cubic"; all if empty.
    repeats
        Whether all records belong to one specimen. If false, oscillations with the same key `specimen` belong to one
        specimen, and the others have none.
    noise, seed, deviation, sensor
        Name of the noise model, or "auto" to choose one for each record; seed of all random numbers; whether laws hold
        with deviations ("law"), exactly ("none"), or with deviations for measured records ("auto"); relative linearity
        error of the sensor (standard deviation).

    Raises
    ------
    InputError
        `repeats` with fewer than two records.
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
        specimen = _as_name(record.get("specimen", ""))
        if repeats:
            signal["specimen"] = SPECIMEN
        elif specimen and len(records) > 1 and not is_envelope:
            signal["specimen"] = specimen
    first, files = next(iter(signals)), list(dict.fromkeys(Path(record["file"]).name for record in records))
    study = first if len(records) == 1 else f"{first}-and-{len(records) - 1}-more"
    if len(records) > 1 and len({record["file"] for record in records}) == 1:
        study = f"{_as_name(Path(records[0]['file']).stem) or 'record'}-{len(records)}-records"
    added = TERMS.added()
    sums = all_sums() + [sum_ for term in added for sum_ in (term, *(f"{t}+{term}" for t in PAPER_TERMS))]
    return {
        "version": 1,
        "name": study,
        "seed": seed,
        "description": f"Damping of {', '.join(files)}"[:200],
        "signal": list(signals.values()),
        "estimators": {"use": ["least_squares"], "stages": ["initial"]},
        "models": {"compare": list(damping) or sums, "prune": PRUNE_NATS},
        "posterior": {
            "samplers": ["nuts"],
            "noise": noise,
            "deviation": deviation,
            "sensor": sensor,
            "best": SAMPLED_CANDIDATES,
            "warmup": WARMUP,
            "draws": DRAWS,
        },
        "evidence": {"methods": ["importance", "bridge"], "referee": "auto"},
    }


def _as_name(label: str) -> str:
    """Convert a label to a valid name (`as_name`). If it has more than 48 characters, its middle is left out."""
    name = as_name(label)
    name = name if len(name) <= 48 else f"{name[:24]}-{name[-23:]}"
    return name if not name or re.match(r"\w", name) else f"_{name}"
