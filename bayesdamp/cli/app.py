"""The commands; an error becomes one clear line and an exit status."""

from __future__ import annotations

import os
import re
import sys
import traceback
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Annotated

import typer

from bayesdamp import __version__
from bayesdamp.cli.border import one_line, present, refused_by_the_machine, say, silence
from bayesdamp.cli.commands.calibrate import calibrate
from bayesdamp.cli.commands.check import check
from bayesdamp.cli.commands.claims import claims
from bayesdamp.cli.commands.compare import compare
from bayesdamp.cli.commands.completion import completion, prepare
from bayesdamp.cli.commands.doctor import doctor
from bayesdamp.cli.commands.init import init
from bayesdamp.cli.commands.look import look
from bayesdamp.cli.commands.report import report
from bayesdamp.cli.commands.simulate import simulate
from bayesdamp.cli.commands.study import study
from bayesdamp.machine import kill_as_interrupt
from bayesdamp.types import BayesdampError, InputError

FAULT, WRONG_INPUT, INTERRUPTED = 1, 2, 130
UNREAD = 141
"""What a shell says of a process that SIGPIPE ends: `bayesdamp look rig.csv | head -3` is no mistake."""
app = typer.Typer(
    name="bayesdamp",
    help="How large is the damping of a decaying oscillation, which damping is it, and how sure may one be?",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
EXAMPLES = {
    look: "bayesdamp look rig.csv",
    init: "bayesdamp init rig.csv",
    study: "bayesdamp study quickstart",
    compare: "bayesdamp compare rig.csv --quick",
    calibrate: "bayesdamp calibrate studies/calibration.toml --records 100",
    check: "bayesdamp check rig.toml",
    simulate: "bayesdamp simulate --damping viscous=0.1,coulomb=0.05 --restoring pendulum --out play.csv",
    report: "bayesdamp report reports/rig",
    claims: "bayesdamp claims --paper reports/paper --noise reports/noise",
    doctor: "bayesdamp doctor",
    completion: "bayesdamp completion bash > ~/.local/share/bash-completion/completions/bayesdamp",
}
"""The commands in the order of the help, each with an example."""
for command, example in EXAMPLES.items():
    app.command(epilog=f"Example: {example}")(command)


def _help_of(given: Sequence[str]) -> str:
    """The help of the command that was typed, or of all."""
    known = given[:1] and given[0] in {command.__name__ for command in EXAMPLES}
    return f"bayesdamp {given[0]} --help" if known else "bayesdamp --help"


def _of_one_kind(said: str) -> str:
    """What the parser of the command line says of an option's value, in the form of all other lines."""
    at = re.fullmatch(r"Invalid value for '(--[\w-]+)[^']*': Input should be ([^,]*)(,.*)?", said)
    return f"{at[1]}: must be {at[2]}" if at else said


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"bayesdamp {__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    del version


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit status.

    0 done, 1 a fault of the program, 2 the input is wrong, 3 done but with failed tasks, 130 interrupted,
    141 what reads the output has closed it.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    present()
    prepare()
    try:
        if any("\0" in word for word in given):
            raise InputError(
                "a word of the command holds a zero byte, which no path or name has; leave it out"
            )
        with kill_as_interrupt():
            status = _commands()(args=given, standalone_mode=False)
        sys.stdout.flush()
    except BayesdampError as error:
        _trace()
        return _refused(error)
    except KeyboardInterrupt:
        status = INTERRUPTED
    except (
        SystemExit
    ) as left:  # what parses commands and what draws tables leave so where their output is closed
        if not isinstance(left.__context__, BrokenPipeError):
            raise
        silence()
        return UNREAD
    except Exception as error:
        usage = getattr(error, "format_message", None)
        if usage is not None:
            said = _of_one_kind(usage().rstrip("."))
            if given[:1] == ["simulate"]:
                from bayesdamp.cli.simulated import meant

                said += meant(getattr(error, "option_name", None) or "")
            if not said:
                return WRONG_INPUT
            return _refused(f"{said}{'' if said.endswith('?') else ';'} see {_help_of(given)}")
        _trace()
        said = refused_by_the_machine(error)
        silence()
        if said is not None:
            return _refused(said)
        what = f"{type(error).__name__}: {error}"
        hint = "BAYESDAMP_DEBUG=1 shows where"
        say(one_line(f"bayesdamp: a fault of the program: {what} ({hint})"))
        return FAULT
    if status == INTERRUPTED:
        say("interrupted; the same command resumes what was done")
    return int(status or 0)


@lru_cache(maxsize=1)
def _commands() -> Callable[..., int | None]:
    """The commands as they are parsed, built once a process: a test runs hundreds."""
    return typer.main.get_command(app)


def _refused(what: object) -> int:
    say(one_line(what))
    return WRONG_INPUT


def _trace() -> None:
    if os.environ.get("BAYESDAMP_DEBUG") == "1":
        traceback.print_exc()
