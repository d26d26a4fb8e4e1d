"""What a file leaves open, with the one command that answers all of it."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from bayesdamp.cli.reading import Options
from bayesdamp.records.findings import findings
from bayesdamp.records.read import read_records
from bayesdamp.records.record import RawRecord, read_as
from bayesdamp.types import InputError
from bayesdamp.units import UNITS

LONGEST = 290
"""Characters of a refusal with its command."""
_ASKED = {"value": "angle", "rate": "rate"}
"""Arguments of `read` that a refusal may ask for, as the command's options; a rate stands in for a column of times."""
_UNKNOWN = {"rate": "HZ", "angle": "NAME"}
_INTRODUCED = "in one command (check its values): "
ROUNDS = 3
"""Refusals of one file that are answered, each with what was asked before."""


def read(path: Path, o: Options) -> list[RawRecord]:
    """Read the records of a file as options say. Raises InputError."""
    return read_records(
        path, time=o.time, value=o.angle, rate=o.rate, runs=o.runs, channels=o.channels, time_unit=o.time_unit
    )


def unstated(raw: RawRecord, unit: str, quantity: str, options: Options) -> bool:
    """Return whether rad is what is left where neither the file nor the user says a unit."""
    return options.unit is None and not raw.unit and (unit, quantity) == ("rad", "angle")


def all_at_once(error: InputError, path: Path, options: Options) -> InputError:
    """Return a refusal of a file with the command that answers it and whatever else the file leaves open."""
    answers: dict[str, str] = {}
    refused, trial = error, options
    for _ in range(ROUNDS):
        asked = {_ASKED[name]: name for name in refused.arguments if name in _ASKED}
        if not asked:
            break
        answers |= {option: refused.likely.get(name, _UNKNOWN[option]) for option, name in asked.items()}
        rate = answers.get("rate", "")
        trial = replace(trial, angle=answers.get("angle", options.angle))
        if rate:
            trial = replace(trial, rate=1.0 if rate == _UNKNOWN["rate"] else float(rate), time=None)
        try:
            raws = read(path, trial)
        except InputError as another:
            refused = another
            continue
        answers = _answers(raws[0], trial) | answers
        break
    if not answers:
        return error
    command = f"; {_INTRODUCED}{_command(path, options, answers)}"
    room = max(LONGEST - len(str(InputError("", error.where, error.at))) - len(command), 60)
    what = error.what if len(error.what) <= room else f"{error.what[: room - 3]}..."
    return InputError(what + command, error.where, error.at)


def one_command(found: Sequence[tuple[Path, RawRecord]], options: Options) -> list[str]:
    """Return a line for each file of which several things are doubted: the command that answers all of them."""
    said = []
    for path in dict.fromkeys(path for path, _ in found):
        answers: dict[str, str] = {}
        for other, raw in found:
            if other == path:
                answers = _answers(raw, options) | answers
        if len(answers) > 1:
            said.append(f"{path.name}: {_INTRODUCED}{_command(path, options, answers)}")
    return said


def _answers(raw: RawRecord, options: Options) -> dict[str, str]:
    """The likeliest values of the options that settle what a record leaves open."""
    unit, quantity = read_as(raw, options.unit, options.quantity)
    doubts = findings(raw, unit, quantity, options.unit is not None) if unit in UNITS else ()
    found = {"unit": unit} if unstated(raw, unit, quantity, options) else {}
    return found | dict(doubt.answer for doubt in doubts if doubt.answer is not None)


def _command(path: Path, options: Options, answers: Mapping[str, str]) -> str:
    """`bayesdamp compare` of a file with the options that were given and those that answer."""
    o = options
    given = {"time": o.time, "angle": o.angle, "rate": o.rate, "time-unit": o.time_unit, "unit": o.unit}
    given |= {"quantity": o.quantity, "clock": o.clock, "start": o.start, "stop": o.stop, "runs": o.runs}
    if "rate" in answers:
        del given["time"]
    said = {name: str(value) for name, value in given.items() if value not in (None, "auto")} | dict(answers)
    words = [word for name, value in said.items() for word in (f"--{name}", value)]
    words += [word for channel in o.channels for word in ("--channel", channel)]
    return shlex.join(["bayesdamp", "compare", str(path), *words])
