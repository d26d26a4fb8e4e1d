"""Run a command, and report an error as one line and an exit status."""

import os
import re
import sys
import traceback
from collections.abc import Sequence
from functools import lru_cache
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

import bayesdamp as bd
from bayesdamp.cli.border import discard_output, machine_refusal, one_line, prepare_streams, print_error
from bayesdamp.machine import collect_garbage_rarely, kill_as_interrupt

INTERNAL_ERROR, WRONG_INPUT, INTERRUPTED = 1, 2, 130
"""Exit statuses: an internal error, wrong input or a fault of the machine, and an interrupt (Ctrl-C)."""
OUTPUT_CLOSED = 141
"""Exit status if the reader of the output closes it, as in `bayesdamp look rig.csv | head -3`. Shells use this number
for a process that SIGPIPE has ended."""
COMMANDS = {
    "look": (
        "Show how a file is read: columns, units, clock, the free decay in it, and what looks wrong.",
        "bayesdamp look rig.csv",
    ),
    "init": (
        "Write a commented study file for records, next to them; nothing is computed or overwritten.",
        "bayesdamp init rig.csv",
    ),
    "study": (
        "Run the tasks of a study file that have no stored result yet, and write the report.",
        "bayesdamp study quickstart",
    ),
    "compare": (
        "Find the kind of damping in records, how large it is, how well its law holds, and how certain that is.",
        "bayesdamp compare rig.csv --quick",
    ),
    "calibrate": (
        "Check the credible intervals on simulated records, whose true parameters are drawn from the study's prior.",
        "bayesdamp calibrate studies/calibration.toml --records 100",
    ),
    "check": (
        "Check a study file and its records: show what the study asks for, or the first error. Nothing is run.",
        "bayesdamp check rig.toml",
    ),
    "simulate": (
        "Write a simulated record to try the program on: a CSV of times in s and angles in rad.",
        "bayesdamp simulate --damping viscous=0.1,coulomb=0.05 --restoring pendulum --out play.csv",
    ),
    "report": ("Write the report of a run again; nothing is computed.", "bayesdamp report reports/rig"),
    "claims": (
        "Test a published paper's claims about eleven damping estimators, and report which of them hold.",
        "bayesdamp claims --paper reports/paper --noise reports/noise",
    ),
    "doctor": (
        "Check the installation: machine, cache, compiled kernels, and the answer on a small record.",
        "bayesdamp doctor",
    ),
}
"""The commands in the order of the help, each with a summary and an example. The function of a command has the same
name as the command; it is in the module of this name in `bayesdamp.cli.commands`."""
SETTINGS = {"help_option_names": ["-h", "--help"]}


class Commands(TyperGroup):
    """The group of all commands, which imports the module of a command only when this command runs."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands = {name: TyperCommand(name, help=summary) for name, (summary, _) in COMMANDS.items()}

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """Return the name of the command to run, the command with its options, and the arguments after its name.

        An unknown name raises a usage error.
        """
        name, _, rest = super().resolve_command(ctx, args)
        return name, command(str(name)), rest


@lru_cache(maxsize=len(COMMANDS))
def command(name: str) -> Any:
    """Return the Click command of this name, whose options follow from the signature of its function.

    The result is cached, because tests run hundreds of commands in one process.
    """
    function = getattr(import_module(f"bayesdamp.cli.commands.{name}"), name)
    alone = typer.Typer(add_completion=False, pretty_exceptions_enable=False, context_settings=SETTINGS)
    alone.command(name, epilog=f"Example: {COMMANDS[name][1]}")(function)
    return typer.main.get_command(alone)


app = typer.Typer(
    name="bayesdamp",
    cls=Commands,
    help="Find the kind of damping in a decaying oscillation, how large it is, and how certain that is.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings=SETTINGS,
)


build_parser = lru_cache(maxsize=1)(typer.main.get_command)
"""Function that converts the Typer app to a Click command, which parses and runs a command line. The result is cached,
because tests run hundreds of commands in one process."""


def _show_version(wanted: bool) -> None:
    """Print the version and exit, if the option --version is given."""
    if wanted:
        typer.echo(f"bayesdamp {bd.__version__}")
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
    """Run a command and return its exit status; an error is printed on stderr as one line.

    Parameters
    ----------
    arguments
        The words of the command line after `bayesdamp`; by default those of this process.

    Returns
    -------
    int
        0: success; 1: internal error, or a failed check of `doctor`; 2: wrong input, or a fault of the machine such as
        a full disk; 3: finished, but tasks have failed or files could not be read; 130: interrupted; 141: the reader of
        the output has closed it.
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    prepare_streams()
    collect_garbage_rarely()
    try:
        if any("\0" in word for word in given):
            raise bd.InputError(
                "an argument contains a zero byte, which is not allowed in paths and names; remove it"
            )
        with kill_as_interrupt():
            status = build_parser(app)(args=given, standalone_mode=False)
        sys.stdout.flush()
    except (bd.InputError, bd.Refusal) as error:
        # These classes, and NumPy, are imported only if there was an exception.
        _trace()
        print_error(one_line(error))
        return WRONG_INPUT
    except KeyboardInterrupt:
        status = INTERRUPTED
    except SystemExit as error:  # typer and rich raise this if their output is closed
        if not isinstance(error.__context__, BrokenPipeError):
            raise
        discard_output()
        return OUTPUT_CLOSED
    except Exception as error:
        if hasattr(error, "format_message"):
            if line := _usage_error(error, given):
                print_error(one_line(line))
            return WRONG_INPUT
        _trace()
        refusal = machine_refusal(error)
        discard_output()
        what = f"{type(error).__name__}: {error}"
        line = f"bayesdamp: internal error: {what} (please report it; BAYESDAMP_DEBUG=1 shows where)"
        print_error(one_line(refusal or line))
        return WRONG_INPUT if refusal else INTERNAL_ERROR
    if status == INTERRUPTED:
        resumes = given[:1] in (["study"], ["compare"], ["calibrate"])
        print_error("interrupted" + "; the same command resumes the run" * resumes)
    return int(status or 0)


def _usage_error(error: Any, given: Sequence[str]) -> str:
    """Return one line that describes an error in the command line and names the help to read.

    `error` is the exception that Click raised, and `given` contains the words of the command line. The line is empty if
    the exception has no message, because the help was already printed.
    """
    line = error.format_message().rstrip(".")
    at = re.fullmatch(r"Invalid value for '(--[\w-]+)[^']*': Input should be ([^,]*)(,.*)?", line)
    line = f"{at[1]}: must be {at[2]}" if at else line
    if given[:1] == ["simulate"]:
        from bayesdamp.cli.commands.simulate import suggest_option

        line += suggest_option(getattr(error, "option_name", None) or "")
    if not line:
        return ""
    help_on = f"bayesdamp {given[0]} --help" if given and given[0] in COMMANDS else "bayesdamp --help"
    return f"{line}{'' if line.endswith('?') else ';'} see {help_on}"


def _trace() -> None:
    """Print the traceback of the current exception on stderr, if BAYESDAMP_DEBUG=1."""
    if os.environ.get("BAYESDAMP_DEBUG") == "1":
        traceback.print_exc()
