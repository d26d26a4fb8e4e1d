# ruff: noqa: E501
"""Study files with wrong values of every key, and files that are not studies."""

from pathlib import Path

from pydantic import BaseModel

from bayesdamp.config import study as s
from tests.bad_input.case import Case, raw, text
from tests.config.studies import GOOD, SIGNAL, SYSTEM

LEVELS = "[" * 2000 + "]" * 2000
VALUES = {"400 digits": "9" * 400, "a day": "2024-02-28", "a list of lists": "[[[1]]]"}
TABLES: dict[str, type[BaseModel]] = {
    "estimators": s.EstimatorsTable, "models": s.ModelsTable, "posterior": s.PosteriorTable,
    "evidence": s.EvidenceTable, "calibration": s.CalibrationTable, "recovery": s.RecoveryTable,
    "plugins": s.PluginsTable,
}  # fmt: skip
HUGE = ("samples", "repeats", "draws", "chains", "warmup", "records", "gaps", "bins", "best")


def study(content: str, name: str, line: str = "") -> Case:
    return Case(name, ("check", "FILE"), "a.toml", text(content), line)


IN_TABLES = [
    study(f"{GOOD}[{table}]\n{key} = {value}\n", f"{table}.{key} of {what}")
    for table, model in TABLES.items()
    for key in model.model_fields
    for what, value in VALUES.items()
]


def _in_signals() -> list[Case]:
    cases = []
    for key in s.SignalTable.model_fields:
        kept = "" if key == "name" else 'name = "a"\n'
        source = "" if key == "simulate" else 'file = "a.toml"\n' if key not in ("file", "system") else ""
        for what, value in VALUES.items():
            content = f"version = 1\n{SYSTEM}[[signal]]\n{kept}{source}{key} = {value}\n"
            cases.append(study(content, f"signal.{key} of {what}"))
    for key in s.SimulateTable.model_fields:
        rest = {"viscous": "0.05", "duration": "5.0", "samples": "100", "noise_sd": "0.01"}
        for what, value in VALUES.items():
            inner = ", ".join(f"{k} = {v}" for k, v in {**rest, key: value}.items())
            content = f'version = 1\n{SYSTEM}[[signal]]\nname = "a"\nsimulate = {{ {inner} }}\n'
            cases.append(study(content, f"simulate.{key} of {what}"))
    return cases


def _in_system() -> list[Case]:
    lines = dict(line.split(" = ") for line in SYSTEM.splitlines()[2:])
    cases = []
    for key in (*lines, "epsilon", "amplitude", "frequency", "inertia"):
        for what, value in {**VALUES, "words": '"x"', "infinity": "inf"}.items():
            body = "".join(f"{k} = {v}\n" for k, v in {**lines, key: value}.items())
            cases.append(study(f"version = 1\n[system]\n{body}{SIGNAL}", f"system.{key} of {what}"))
    return cases


SWEEP = '[[sweep]]\nkey = "simulate.{0}"\nvalues = [' + ", ".join(f"0.{i:03d}" for i in range(1, 301)) + "]\n"
BEYOND = [
    study(GOOD.replace("samples = 100", "samples = 1000000000"), "samples of 1e9"),
    study(GOOD.replace("samples = 100", f"samples = 100, repeats = {10**18}"), "repeats of 1e18"),
    *(study(f"{GOOD}[{table}]\n{key} = {10**12}\n", f"{table}.{key} of 1e12")
      for table, model in TABLES.items() for key in model.model_fields if key in HUGE and table != "estimators"),
    study(GOOD + "".join(SWEEP.format(k) for k in ("noise_sd", "viscous", "coulomb")), "sweeps of 27e6"),
]  # fmt: skip
"""Counts that no machine can compute."""

OTHERS = {
    "2,000 levels": f"version = 1\nx = {LEVELS}\n",
    "an integer of 5,000 digits": "version = 1\nseed = " + "9" * 5000 + "\n",
    "a key of 100,000 letters": "version = 1\n" + "k" * 100000 + " = 1\n",
    "an escaping published file": 'published = "../../../etc/passwd"\n' + GOOD,
    "a plug-in that is a device": GOOD + '[plugins]\nmodules = ["/dev/zero"]\n',
    "a plug-in that is not Python": GOOD + '[plugins]\nmodules = ["a.toml"]\n',
}


FILES = [
    study(f'version = 1\n{SYSTEM}[[signal]]\nname = "a"\nfile = "{file}"\n', f"a signal's file: {what}")
    for what, file in {
        "a device": "/dev/zero", "a folder": "/", "not there": "none.csv", "too long": "f" * 5000, "a zero": "a\\u0000b",
        "below a file": "a.toml/b", "a home of nobody": "~nobody-at-all/x.csv", "a line": "a\\nb",
    }.items()
]  # fmt: skip

CASES = [
    *IN_TABLES, *_in_signals(), *_in_system(), *BEYOND, *FILES, *(study(text, name) for name, text in OTHERS.items()),
    Case("a study of random bytes", ("check", "FILE"), "a.toml", raw(bytes(range(256)) * 9), "text in UTF-8"),
    study(" " * (17 * 2**20), "a study of 17 MiB", "it has more than 16 MiB"),
    Case("a study of blanks", ("check", "FILE"), "a.toml", raw(b"\n \n" * 99), "is empty"),
]  # fmt: skip


def control(path: Path) -> None:
    """A study without a fault."""
    path.write_text(GOOD, encoding="utf-8")
