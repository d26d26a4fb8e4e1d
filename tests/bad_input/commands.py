# ruff: noqa: E501
"""Wrong commands, and paths that are not files."""

import os
from pathlib import Path

from tests.bad_input.case import Case, raw, rows
from tests.bad_input.studies import control

LONG = "9" * 5000
WORD = "x" * 5000
LOOK = ("look",)
COMMANDS = (LOOK, ("compare", "--quick", "--workers", "1"), ("init",))
"""Commands that read a file, with the same options."""


def given(option: str, *values: str, commands: tuple[tuple[str, ...], ...] = (LOOK,)) -> list[Case]:
    return [
        Case(f"{command} {option} {value[:20]}", (command, "FILE", f"{option}={value}", *more), write=rows)
        for value in values
        for command, *more in commands
    ]


READING = [
    *given("--rate", "0", commands=COMMANDS), *given("--rate", "nan", "1e-308", "1e308", "x", LONG),
    *given("--time", "none", commands=COMMANDS), *given("--time", "0", "-1", "9", LONG, WORD),
    *given("--angle", "none", commands=COMMANDS), *given("--angle", "0", "9", WORD),
    *given("--unit", "parsec", commands=COMMANDS), *given("--unit", "\x1b[31m", "lines\nof text", WORD),
    *given("--quantity", "speed"), *given("--clock", "sundial"), *given("--time-unit", "fortnight"),
    *given("--runs", "1", commands=COMMANDS), *given("--runs", "a-b", "3-1", "1-99999999999", LONG, "-"),
    *given("--channel", "none", WORD), *given("--start", "nan", commands=COMMANDS), *given("--start", "x", "inf", LONG),
    *given("--stop", "x", "nan", "-inf"),
]  # fmt: skip

SIMULATE = ("simulate", "--out", "b.csv", "--restoring", "linear")
SET = ("--set", "stiffness=20,rest_angle=0")


def simulated(name: str, *options: str) -> Case:
    return Case(f"simulate {name}", (*SIMULATE, *options), write=rows)


VISCOUS = ("--damping", "viscous=0.05")
SIMULATED = [
    *(simulated(f"damping {v[:20]}", "--damping", v, *SET) for v in (
        "viscous=", "viscous=x", "viscous=inf", "none=1", "=1", "viscous=1=2", f"viscous={LONG}", "viscous=1e308", WORD,
    )),
    *(simulated(f"set {v}", *VISCOUS, "--set", v) for v in (
        "stiffness=20,rest_angle=0,none=1", "stiffness=-20,rest_angle=0", "stiffness=nan,rest_angle=0",
        "stiffness=1e308,rest_angle=0", "stiffness=1e-308,rest_angle=0", "theta0=0,stiffness=20,rest_angle=0",
    )),
    *(simulated(f"{option} {v[:9]}", *VISCOUS, *SET, f"{option}={v}") for option, values in {
        "--duration": ("0", "nan", "inf", "1e308", "1e-308"), "--samples": ("0", "3", "1e3", str(10**12), LONG),
        "--noise-sd": ("-1", "nan", "x", "1e308"), "--seed": ("-1", "1.5"),
    }.items() for v in values),
    Case("simulate a law of 5,000 letters", ("simulate", "--out", "b.csv", "--restoring", WORD, *VISCOUS)),
    *(Case(f"simulate to {out[:20]}", ("simulate", "--out", out, "--restoring", "linear", *VISCOUS, *SET), write=rows)
      for out in ("/dev/full", "a.csv/b.csv", "b" * 5000, "b\0c")),
]  # fmt: skip

COMPARED = [
    Case(f"compare {' '.join(options)[:30]}", ("compare", "FILE", "--quick", "--workers=1", *options), write=rows)
    for options in (
        (f"--damping={WORD}",), ("--damping=viscous+viscous",), ("--damping=+",), ("--damping=",), (f"--noise={WORD}",),
        (f"--restoring={WORD}",), ("--seed=-1",), (f"--seed={LONG}",), ("--deviation=some",), ("--sensor=-1",),
        ("--sensor=nan",), ("--sensor=1e308",), ("--frequency=5",), ("--start=1e308",), ("--stop=1e-308",), ("--out=a.csv",),
        ("--out=a.csv/b",), ("--out=/dev/null",), (f"--out={WORD}",), ("--out=a\0b",), ("--plugin=none.py",),
        ("--plugin=/dev/zero",), ("--plugin=/",), (f"--plugin={WORD}",), ("--plugin=a.csv",), (f"--workers={LONG}",),
        (f"--{WORD}",), ("--damping=viscous", "--damping=viscous"),
    )
]  # fmt: skip

STUDIED = [
    Case(f"study {options[:24]}", ("study", "FILE", options), "a.toml", control)
    for options in ("--workers=0", "--out=a.toml", "--out=a.toml/b", "--out=/dev/null", f"--out={WORD}", "--out=a\0b", "more")
] + [
    Case(f"calibrate {options[:24]}", ("calibrate", "FILE", options), "a.toml", control)
    for options in ("--records=0", f"--records={LONG}", "--out=a.toml", "--none")
]  # fmt: skip

USAGE = [
    Case(f"words {i}: {' '.join(words)[:24]}", words, write=rows)
    for i, words in enumerate((
        ("none",), (WORD,), ("--none",), ("look",), ("look", "a", "b"), ("look", ""), ("compare", ""), ("check", ""),
        ("init", ""), ("report", ""), ("report", "none"), ("report", "FILE"), ("report", "/dev/zero"),
        ("report", "a\0b"), ("claims", "--paper", "none"), ("claims", "--out", "/"), ("claims", "--out", "a\0b"),
    ))
]  # fmt: skip


PLACES = {
    "a device": "/dev/zero", "a full device": "/dev/full", "a name too long": "a" * 5000 + ".csv",
    "a path too long": "a/" * 5000, "a zero": "a\0b.csv", "not there": "none.csv", "not there, in a line": "no\nne.csv",
    "a process's memory": "/proc/self/mem", "colours": "\x1b[31mred.csv", "half a letter": "a\udcff.csv",
}  # fmt: skip
FOLDER = {"look": "", "check": "is a directory; give"}
PATHS = [
    case
    for command in ("look", "check")
    for case in (
        *(Case(f"{command} {what}", (command, place)) for what, place in PLACES.items()),
        Case(f"{command} a link to itself", (command, "FILE"), write=lambda path: path.symlink_to(path.name)),
        Case(f"{command} a pipe", (command, "FILE"), write=os.mkfifo, line="a device or a pipe, not a file"),
        Case(f"{command} a folder", (command, "FILE"), write=Path.mkdir, line=FOLDER[command]),
        Case(f"{command} below a file", (command, "a.csv/b.csv"), write=raw(b"1")),
    )
] + [Case(f"{command} not there", (command, "none.csv")) for command in ("compare", "init", "study", "calibrate")]  # fmt: skip

CASES = [*READING, *SIMULATED, *COMPARED, *STUDIED, *USAGE, *PATHS]
