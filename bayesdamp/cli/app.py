"""Run a command; an error becomes one clear line and an exit status."""

from __future__ import annotations

import os
import re
import sys
import traceback
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Annotated, Any

import typer

from bayesdamp import __version__
from bayesdamp.cli.border import discard_output, machine_refusal, one_line, prepare_streams, print_error
from bayesdamp.cli.commands.claims import claims
from bayesdamp.cli.commands.compare import compare
from bayesdamp.cli.commands.completion import answer_shell, completion
from bayesdamp.cli.commands.doctor import doctor
from bayesdamp.cli.commands.init import init
from bayesdamp.cli.commands.look import look
from bayesdamp.cli.commands.simulate import simulate
from bayesdamp.cli.commands.study import calibrate, check, report, study
from bayesdamp.machine import kill_as_interrupt
from bayesdamp.types import BayesdampError, InputError

FAULT, WRONG_INPUT, INTERRUPTED = 1, 2, 130
UNREAD = 141
"""Exit status in a shell of a process that SIGPIPE ends: `bayesdamp look rig.csv | head -3` is not a mistake."""
app = typer.Typer(
    name="bayesdamp",
    help="Find which damping a decaying oscillation has, how large it is, and how certain that is.",
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


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"bayesdamp {__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and exit."),
    ] = False,
) -> None:
    del version


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit status.

    0: done; 1: internal error; 2: wrong input; 3: done, but with failed tasks; 130: interrupted; 141: the reader of
    the output has closed it.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    prepare_streams()
    answer_shell()
    try:
        if any("\0" in word for word in given):
            raise InputError(
                "a word of the command contains a zero byte, which no path or name has; remove it"
            )
        with kill_as_interrupt():
            status = _commands()(args=given, standalone_mode=False)
        sys.stdout.flush()
    except BayesdampError as error:
        _trace()
        print_error(one_line(error))
        return WRONG_INPUT
    except KeyboardInterrupt:
        status = INTERRUPTED
    except SystemExit as error:  # typer and rich exit so where their output is closed
        if not isinstance(error.__context__, BrokenPipeError):
            raise
        discard_output()
        return UNREAD
    except Exception as error:
        if hasattr(error, "format_message"):
            if line := _usage_error(error, given):
                print_error(one_line(line))
            return WRONG_INPUT
        _trace()
        refusal = machine_refusal(error)
        discard_output()
        if refusal is not None:
            print_error(one_line(refusal))
            return WRONG_INPUT
        what = f"{type(error).__name__}: {error}"
        print_error(one_line(f"bayesdamp: internal error: {what} (BAYESDAMP_DEBUG=1 shows where)"))
        return FAULT
    if status == INTERRUPTED:
        print_error("interrupted; the same command resumes the run")
    return int(status or 0)


def _usage_error(error: Any, given: Sequence[str]) -> str:
    """Return the line on a wrong command line, in the form of all other errors; empty where there is none to print."""
    line = error.format_message().rstrip(".")
    at = re.fullmatch(r"Invalid value for '(--[\w-]+)[^']*': Input should be ([^,]*)(,.*)?", line)
    line = f"{at[1]}: must be {at[2]}" if at else line
    if given[:1] == ["simulate"]:
        from bayesdamp.cli.simulated import suggest_option

        line += suggest_option(getattr(error, "option_name", None) or "")
    if not line:
        return ""
    known = given[:1] and given[0] in {command.__name__ for command in EXAMPLES}
    command = f"bayesdamp {given[0]} --help" if known else "bayesdamp --help"
    return f"{line}{'' if line.endswith('?') else ';'} see {command}"


@lru_cache(maxsize=1)
def _commands() -> Callable[..., int | None]:
    """Return the parsed commands, built once in a process: a test runs hundreds."""
    return typer.main.get_command(app)


def _trace() -> None:
    if os.environ.get("BAYESDAMP_DEBUG") == "1":
        traceback.print_exc()
