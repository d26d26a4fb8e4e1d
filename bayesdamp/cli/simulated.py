"""A simulated record from the words of a command: checked as a study's own would be, and written as CSV."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from bayesdamp.cli.options import wrong
from bayesdamp.cli.single_file import FIRST_LINE
from bayesdamp.config import Simulation
from bayesdamp.config.checks import StudyError
from bayesdamp.config.signals import resolve_signal, term_keys
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS
from bayesdamp.plugins import nearest
from bayesdamp.records.simulate import simulate_signal
from bayesdamp.types import InputError, Signal

DAMPING = {"viscous": 0.1}
"""What damps where nothing is given, in 1/s: Q of about 30."""
START = {"theta0": 0.3, "omega0": 0.0, "epsilon": 0.0}
LAW = {"stiffness": 40.0, "gravity": 4.0, "cubic": 40.0, "rest_angle": 0.0, "spring_angle": 0.0}
"""What holds where it is not given, of the laws that have it: about 1 Hz, and bends that one sees."""


def pairs(texts: Sequence[str], option: str) -> dict[str, float]:
    """`a=1,b=2` as a mapping. Raises InputError."""
    found: dict[str, float] = {}
    for part in ",".join(texts).split(","):
        name, _, value = (piece.strip() for piece in part.partition("="))
        if not part.strip():
            continue
        try:
            number = float(value)
        except ValueError:
            example = "viscous=0.05" if option == "--damping" else "stiffness=20"
            raise wrong(option, part.strip(), f"NAME=NUMBER, such as {example}") from None
        if name in found:
            raise InputError(f"{option}: {name[:40]!r} is given twice; once is enough")
        found[name] = number
    return found


def terms_and_set(
    damping: Mapping[str, float], other: Mapping[str, float], restoring: str
) -> dict[str, object]:
    """Coefficients by damping term and other parameters by name, as a study's `simulate` has them in one table.

    Raises InputError for a term that there is not.
    """
    further = {key for name in TERMS.names() for key in TERMS.get(name).further}
    for term in damping:
        if term not in TERMS.names() and term not in further:
            raise InputError(f"--damping: unknown damping term {term[:40]!r}{nearest(term, TERMS.names())}")
    law = LAWS.get(restoring).parameters if restoring in LAWS.names() else ()
    keys = {term: name for name, term in term_keys(law).items()}
    return {**{keys.get(term, term): value for term, value in (damping or DAMPING).items()}, **other}


def taken(damping: Mapping[str, float], other: Mapping[str, float], restoring: str) -> str:
    """What was not given and is not zero, as one would type it; empty where there is nothing."""
    system = {name: LAW[name] for name in LAWS.get(restoring).parameters if name in LAW} | START
    left = {name: value for name, value in system.items() if value and name not in other}
    options = {"--damping": {} if damping else DAMPING, "--set": left}
    typed = ((option, [f"{n}={v:g}" for n, v in values.items()]) for option, values in options.items())
    return " ".join(f"{option} {','.join(words)}" for option, words in typed if words)


def meant(option: str) -> str:
    """What is typed for an option that there is not but that names a damping term or a parameter; empty elsewhere."""
    name = option.lstrip("-").replace("-", "_")
    if name in TERMS.names():
        return f"--damping {name}=NUMBER"
    parameters = {*START, *(p for law in LAWS.names() for p in LAWS.get(law).parameters)}
    return f"--set {name}=NUMBER" if name in parameters else ""


NOISE = 0.01
"""Share of the amplitude that the noise has where it is not given: a record without any has no likelihood."""


def simulated(given: Mapping[str, object], restoring: str, seed: int) -> tuple[Signal, float]:
    """The record of one simulation, whose entries are those of a study's `simulate`, and its noise's sd in rad.

    Without `noise_sd` the sd is a hundredth of the amplitude. Raises InputError in the terms of the command's options.
    """
    own = {key for name in TERMS.names() if name in given for key in _own(name)}
    if lacking := sorted(own - set(given)):
        needed = ",".join(f"{name}=NUMBER" for name in lacking)
        raise InputError(f"--set: the damping has parameters of its own; give --set {needed} too")
    made = _checked({"noise_sd": 0.0, **given}, restoring)
    sd = made.truth["noise_sd"]
    if "noise_sd" not in given:
        clean = _record(made, restoring, 0.0, seed)
        sd = float(f"{NOISE * np.ptp(clean.y) / 2:.1e}")
        if sd == 0:
            raise InputError("simulate: nothing moves; start away from rest, such as --set theta0=0.3")
    return _record(made, restoring, sd, seed), sd


def _own(term: str) -> tuple[str, ...]:
    return tuple(parameter.name for parameter in TERMS.get(term).inferred)


def _record(made: Simulation, restoring: str, noise_sd: float, seed: int) -> Signal:
    return simulate_signal(
        Oscillator(made.damping, restoring),
        dict(made.truth),
        duration=made.duration,
        samples=made.samples,
        noise_sd=noise_sd,
        name="simulated",
        rng=np.random.default_rng(seed),
    )


def as_csv(signal: Signal) -> str:
    """The record as CSV, behind a line by which it is known as ours."""
    rows = (f"{float(t)!r},{float(y)!r}" for t, y in zip(signal.t, signal.y, strict=True))
    return FIRST_LINE + "\n".join(["t (s),angle (rad)", *rows]) + "\n"


def _checked(given: Mapping[str, object], restoring: str) -> Simulation:
    if restoring not in LAWS.names():
        raise InputError(
            f"--restoring: unknown restoring law {restoring[:40]!r}{nearest(restoring, LAWS.names())}"
        )
    needed = LAWS.get(restoring).parameters
    given = {**{name: value for name, value in LAW.items() if name in needed}, **given}
    missing = [name for name in needed if name not in given]
    if missing:
        raise InputError(f"--set: {restoring} needs {', '.join(f'{name}=NUMBER' for name in missing)} too")
    entry = {"name": "simulated", "simulate": {**START, **given}, "system": {"restoring": restoring}}
    try:
        made = resolve_signal(entry, {}, Path(), "").source
    except StudyError as error:
        raise InputError(error.within("simulate"), "simulate") from None
    assert isinstance(made, Simulation)
    return made
