# ruff: noqa: E501
"""Commands that are typed wrongly, and paths that are no files."""

from __future__ import annotations

import os
from pathlib import Path

from tests.bad_input.case import Case, raw, rows
from tests.bad_input.studies import control

LONG = "9" * 5000
WORD = "x" * 5000


def looked(name: str, *options: str) -> list[Case]:
    """The same options of every command that reads a file."""
    return [
        Case(f"{command} {name}", (command, "FILE", *options, *more), write=rows)
        for command, more in (("look", ()), ("compare", ("--quick", "--workers", "1")), ("init", ()))
    ]


def given(option: str, *values: str, more: tuple[str, ...] = ()) -> list[Case]:
    return [case for value in values for case in looked(f"{option} {value[:20]}", f"{option}={value}", *more)]


READING = [
    *given("--rate", "0", "-1", "nan", "inf", "1e-308", "1e308", "5e-324", "x", LONG, more=("--angle=2",)),
    *given("--time", "0", "-1", "9", "none", LONG, WORD),
    *given("--angle", "0", "-1", "9", "none", LONG, WORD),
    *given("--unit", "parsec", WORD, "\x1b[31m", "lines\nof text"),
    *given("--quantity", "speed", WORD),
    *given("--clock", "sundial", WORD),
    *given("--time-unit", "fortnight", WORD),
    *given("--runs", "1", "a-b", "3-1", "1-99999999999", LONG, "-"),
    *given("--channel", "none", WORD),
    *given("--start", "x", "nan", "inf", "-inf", LONG),
    *given("--stop", "x", "nan", "-inf", LONG),
    *looked("a stop before the start", "--start=2", "--stop=1"),
    *looked("a rate and times", "--rate=50", "--time=1"),
]

SIMULATE = ("simulate", "--out", "b.csv", "--restoring", "linear")
SET = ("--set", "stiffness=20,rest_angle=0")


def simulated(name: str, *options: str) -> Case:
    return Case(f"simulate {name}", (*SIMULATE, *options), write=rows)


VISCOUS = ("--damping", "viscous=0.05")
SIMULATED = [
    simulated("a term as an option", "--viscous", "0.1"), simulated("a parameter as an option", "--stiffness=20"),
    *(simulated(f"damping {v[:20]}", "--damping", v, *SET) for v in (
        "viscous", "viscous=", "viscous=x", "viscous=nan", "viscous=inf", "viscous=-1", "none=1", "=1", "viscous=1=2",
        f"viscous={LONG}", "viscous=1e308", "viscous=0.1,viscous=0.2", WORD, "viscous=1e-400x",
    )),
    *(simulated(f"set {v}", *VISCOUS, "--set", v) for v in (
        "stiffness=20,rest_angle=0,none=1", "stiffness=0,rest_angle=0", "stiffness=-20,rest_angle=0",
        "stiffness=nan,rest_angle=0", "stiffness=1e308,rest_angle=0", "theta0=0,stiffness=20,rest_angle=0",
        "theta0=1e308,stiffness=20,rest_angle=0", "stiffness=20,rest_angle=inf", "stiffness=1e-308,rest_angle=0",
    )),
    *(simulated(f"duration {v}", *VISCOUS, *SET, f"--duration={v}") for v in ("0", "-1", "nan", "inf", "1e308", "1e-308", "x")),
    *(simulated(f"samples {v[:9]}", *VISCOUS, *SET, f"--samples={v}") for v in ("0", "-1", "3", "x", "1e3", str(10**12), LONG)),
    *(simulated(f"noise {v}", *VISCOUS, *SET, f"--noise-sd={v}") for v in ("-1", "nan", "inf", "x", "1e308")),
    *(simulated(f"seed {v[:9]}", *VISCOUS, *SET, f"--seed={v}") for v in ("-1", "x", "1.5", "nan")),
    Case("simulate an unknown law", ("simulate", "--out", "b.csv", "--restoring", "rubber", *VISCOUS)),
    Case("simulate a law of 5,000 letters", ("simulate", "--out", "b.csv", "--restoring", WORD, *VISCOUS)),
    *(Case(f"simulate to {out[:20]}", ("simulate", "--out", out, "--restoring", "linear", *VISCOUS, *SET), write=rows)
      for out in ("/", "/dev/full", "/dev/null", "a.csv/b.csv", "b" * 5000, "b\0c", "/proc/b.csv", "/sys/b.csv")),
]  # fmt: skip

COMPARED = [
    Case(f"compare {' '.join(options)[:30]}", ("compare", "FILE", "--quick", "--workers=1", *options), write=rows)
    for options in (
        ("--damping=none",), (f"--damping={WORD}",), ("--damping=viscous+viscous",), ("--damping=+",), ("--damping=",),
        ("--restoring=rubber",), (f"--restoring={WORD}",), ("--noise=loud",), (f"--noise={WORD}",), ("--seed=-1",),
        ("--seed=x",), (f"--seed={LONG}",), ("--deviation=some",), (f"--deviation={WORD}",), ("--sensor=-1",),
        ("--sensor=nan",), ("--sensor=1e308",), ("--sensor=x",), ("--frequency=5",), ("--start=1e308",), ("--stop=-1",), ("--stop=1e-308",),
        ("--out=a.csv",), ("--out=a.csv/b",), ("--out=/dev/null",), (f"--out={WORD}",), ("--out=a\0b",),
        ("--plugin=none.py",), ("--plugin=/dev/zero",), ("--plugin=/",), (f"--plugin={WORD}",), ("--plugin=a.csv",),
        ("--workers=0",), ("--workers=x",), (f"--workers={LONG}",), ("--none",), (f"--{WORD}",), ("--damping=viscous", "--damping=viscous"),
    )
]  # fmt: skip

STUDIED = [
    Case(f"{command} {' '.join(options)[:24]}", (command, "FILE", *options), "a.toml", control)
    for command in ("study", "calibrate")
    for options in (
        ("--workers=0",), ("--workers=x",), ("--workers=-1",), ("--out=a.toml",), ("--out=a.toml/b",), ("--out=/dev/null",),
        (f"--out={WORD}",), ("--out=a\0b",), ("--out=/proc/none",), ("--none",), ("more",),
    )
] + [
    Case(f"calibrate --records={n[:9]}", ("calibrate", "FILE", f"--records={n}"), "a.toml", control)
    for n in ("0", "-1", "x", LONG)
]  # fmt: skip

USAGE = [
    Case(f"words {i}: {' '.join(words)[:24]}", words, write=rows)
    for i, words in enumerate((
        ("none",), (WORD,), ("--none",), ("look",), ("look", "a", "b"), ("look", ""), ("compare",), ("compare", ""),
        ("study",), ("study", ""), ("study", "a", "b"), ("check",), ("check", ""), ("init",), ("init", ""), ("report",),
        ("report", ""), ("report", "none"), ("report", "FILE"), ("report", "."), ("report", WORD), ("report", "/dev/zero"),
        ("report", "a\0b"), ("claims", "--paper", "none"), ("claims", "--noise", "none"), ("claims", "--paper", WORD),
        ("claims", "--out", "/dev/full"), ("claims", "--out", "/"), ("claims", "--out", "FILE/b"), ("look", "FILE", "--html", "/dev/full"),
        ("look", "FILE", "--html", "/"), ("look", "FILE", "--html", WORD),
        ("look", "FILE", "--html", "a\0b"), ("look", "FILE", "--html"), ("look", "FILE", "--rate"), ("simulate",),
    ))
]  # fmt: skip


def pipe(path: Path) -> None:
    os.mkfifo(path)


def circle(path: Path) -> None:
    path.symlink_to(path.name)


def dangling(path: Path) -> None:
    path.symlink_to("none")


def folder(path: Path) -> None:
    path.mkdir()


def shut(path: Path) -> None:
    """A file that may not be read."""
    path.write_bytes(b"1,2\n")
    path.chmod(0)


COMMANDS = (("look",), ("compare",), ("init",), ("study",), ("check",), ("calibrate",))
PLACES = {
    "a device": "/dev/zero", "another device": "/dev/null", "a full device": "/dev/full", "a name too long": "a" * 5000 + ".csv",
    "a path too long": "a/" * 5000, "a zero": "a\0b.csv", "not there": "none.csv", "not there, in a line": "no\nne.csv",
    "a process's memory": "/proc/self/mem", "colours": "\x1b[31mred.csv", "half a letter": "a\udcff.csv",
}  # fmt: skip
PATHS = [
    Case(f"{command[0]} {what}", (*command, place)) for what, place in PLACES.items() for command in COMMANDS
] + [
    Case(f"{command[0]} {make.__name__}", (*command, "FILE"), "a.csv", make)
    for make in (pipe, circle, dangling, folder)
    for command in COMMANDS
] + [
    Case(f"{command[0]} below a file", (*command, "a.csv/b.csv"), "a.csv", raw(b"1")) for command in COMMANDS
]  # fmt: skip
UNREADABLE = [Case(f"{command[0]} unreadable", (*command, "FILE"), "a.csv", shut) for command in COMMANDS]

CASES = [*READING, *SIMULATED, *COMPARED, *STUDIED, *USAGE, *PATHS]
