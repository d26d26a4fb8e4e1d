"""[[sweep]]: all signals that have a key, repeated over its values."""

from __future__ import annotations

import copy
import math
import re
from itertools import product
from typing import Any

from bayesdamp.config.checks import StudyError, below, section, shown
from bayesdamp.config.sections import SignalTable, SweepTable

MOST = 100_000
"""Signals that the sweeps of a study may make (conventional)."""
_TABLES = ("simulate", "system")
_FILE_KEYS = tuple(n for n in SignalTable.model_fields if n not in ("name", *_TABLES))


def expand(signals: list[dict[str, Any]], sweeps: list[Any]) -> list[dict[str, Any]]:
    """The raw [[signal]] tables, repeated over every combination of the sweeps' values.

    A signal's name gets `-key-value` of each sweep that touches it (`0.003` reads `0p003`): `simulate.*`
    touches the simulated signals, a file's key those that are read, `system.*` all. Raises StudyError.
    """
    tables = [
        (section(SweepTable, raw, f"sweep[{i}]"), f"sweep[{i}]") for i, raw in enumerate(sweeps, start=1)
    ]
    for sweep, key in tables:
        _check(sweep, key, signals)
    expanded = []
    counts = [math.prod(len(w.values) for w, _ in tables if _touches(w.key, signal)) for signal in signals]
    if sum(counts) > MOST:
        raise StudyError(
            "sweep", f"makes {sum(counts)} signals of these; it must be at most {MOST}: sweep fewer values"
        )
    for signal in signals:
        touching = [sweep for sweep, _ in tables if _touches(sweep.key, signal)]
        for values in product(*(sweep.values for sweep in touching)):
            one = copy.deepcopy(signal)
            for sweep, value in zip(touching, values):
                _set(one, sweep.key, value)
                if isinstance(one.get("name"), str):
                    one["name"] += suffix(sweep.key, value, sweep.values)
            expanded.append(one)
    return expanded


def _check(sweep: SweepTable, key: str, signals: list[dict[str, Any]]) -> None:
    head, _, tail = sweep.key.partition(".")
    right = (bool(tail) and "." not in tail) if head in _TABLES else (head in _FILE_KEYS and not tail)
    if not right:
        right = 'it must be like "simulate.noise_sd", "system.gravity" or "start"'
        raise StudyError(below(key, "key"), f"is {shown(sweep.key)}, which is no key of a signal; {right}")
    if not any(_touches(sweep.key, signal) for signal in signals):
        raise StudyError(
            below(key, "key"), f"is {shown(sweep.key)}, which no signal has; sweep a key that one has"
        )
    names = [suffix(sweep.key, value, sweep.values) for value in sweep.values]
    if len(set(names)) != len(names):
        raise StudyError(
            below(key, "values"), f"holds a value twice: {shown(list(sweep.values))}; once is enough"
        )


def _touches(key: str, signal: dict[str, Any]) -> bool:
    head = key.partition(".")[0]
    return head == "system" or (head in signal if head == "simulate" else "file" in signal)


def _set(signal: dict[str, Any], key: str, value: object) -> None:
    head, _, tail = key.partition(".")
    if not tail:
        signal[head] = value
    elif isinstance(inner := signal.setdefault(head, {}), dict):
        inner[tail] = value


def suffix(key: str, value: object, values: tuple[Any, ...]) -> str:
    """`-noise_sd-0p003` for simulate.noise_sd = 0.003; a table or a list goes by its place in the values."""
    if isinstance(value, dict | list):
        text = str(values.index(value) + 1)
    elif isinstance(value, float):
        text = repr(value).removesuffix(".0")
    else:
        text = str(value)
    text = re.sub(r"[^A-Za-z0-9_-]", "_", text.replace("-", "m", text.startswith("-")).replace(".", "p"))
    return f"-{key.rpartition('.')[2]}-{text}"
