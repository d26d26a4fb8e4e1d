"""The commands; an error becomes one clear line and an exit status."""

from __future__ import annotations

import os
import re
import sys
import traceback
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bayesdamp import __version__
from bayesdamp.cli.commands.init import init
from bayesdamp.cli.commands.look import look
from bayesdamp.cli.options import bound as _bound
from bayesdamp.machine.processes import processes
from bayesdamp.types import BayesdampError, InputError

if TYPE_CHECKING:
    from bayesdamp.config import Study

FAULT, WRONG_INPUT, INTERRUPTED = 1, 2, 130
FIRST_WORDS = 5
"""Records of one command whose first words are printed."""

app = typer.Typer(
    name="bayesdamp",
    help="How large is the damping of a decaying oscillation, which damping is it, and how sure may one be?",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command()(look)
app.command()(init)


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


@app.command()
def study(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A study file (TOML).")],
    out: Annotated[
        Path | None, typer.Option(help="The run's folder; reports/NAME where it is not given.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes; as many as there are cores where it is not given.")
    ] = None,
    scheduler: Annotated[str | None, typer.Option(help="Address of a Dask scheduler to run on.")] = None,
    plugin: Annotated[
        list[Path] | None,
        typer.Option(help="A Python file with plug-ins of your own; may be given again."),
    ] = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="Compute everything again.")] = False,
    quick: Annotated[bool, typer.Option("--quick", help="Only the answers; no sampling.")] = False,
) -> int:
    """Run what a study still lacks, and write its report."""
    from rich.console import Console

    loaded = _load(file, plugin)
    folder = _folder(out, loaded.name)
    from bayesdamp.pipeline import run_study
    from bayesdamp.report.terminal import answered

    status = run_study(
        loaded,
        folder,
        workers=workers,
        scheduler=scheduler,
        fresh=fresh,
        console=Console(stderr=True),
        quick=quick,
        answered=None if len(loaded.signals) > FIRST_WORDS else lambda verdict: answered(verdict, Console()),
    )
    report = folder / "report.html"
    if report.is_file():
        typer.echo(report)
    return status


@app.command()
def compare(
    records: Annotated[list[Path], typer.Argument(metavar="RECORD...", help="Files of measured decays.")],
    angle: Annotated[
        str | None, typer.Option(help="Column of the recorded quantity, by name or number from 1.")
    ] = None,
    time: Annotated[str | None, typer.Option(help="Column of the times in s, by name or number.")] = None,
    rate: Annotated[float | None, typer.Option(help="Sampling rate in Hz, for a file without times.")] = None,
    unit: Annotated[
        str | None,
        typer.Option(
            help="rad, deg, m, mm, V, g and others (a wrong one lists them): of the displacement itself, or g, rpm, "
            "dps; else as the column's name says, else rad."
        ),
    ] = None,
    quantity: Annotated[
        str | None,
        typer.Option(
            help="angle, velocity, acceleration, or envelope (amplitude, power or level alone); else as the column's "
            "name says, else angle."
        ),
    ] = None,
    frequency: Annotated[
        float | None,
        typer.Option(help="Of the oscillation in Hz, for an envelope; else as the file's head says."),
    ] = None,
    clock: Annotated[str, typer.Option(help="auto, as_logged or uniform.")] = "auto",
    start: Annotated[str, typer.Option(help="Where the free decay starts, in s, or auto.")] = "auto",
    stop: Annotated[str, typer.Option(help="Where it stops, in s, or auto.")] = "auto",
    runs: Annotated[
        str | None, typer.Option(help="Runs of a file that has several: 1,3-5; all by default.")
    ] = None,
    channel: Annotated[
        list[str] | None, typer.Option(help="A channel of a file that has several, may be given again.")
    ] = None,
    time_unit: Annotated[str | None, typer.Option(help="Unit of the times: s, ms, us, ns or min.")] = None,
    restoring: Annotated[
        list[str] | None, typer.Option(help="A restoring law to compare, may be given again; all by default.")
    ] = None,
    damping: Annotated[
        list[str] | None,
        typer.Option(
            help="Damping sums to compare, such as stribeck,viscous+cubic, may be given again; by default all of "
            "viscous, Coulomb and quadratic damping."
        ),
    ] = None,
    noise: Annotated[str, typer.Option(help="A noise model, or auto: chosen for each record.")] = "auto",
    repeats: Annotated[
        bool,
        typer.Option(
            "--repeats", help="The records are of one specimen: fit them jointly, each from its own start."
        ),
    ] = False,
    seed: Annotated[int, typer.Option(min=0, help="Every random number follows from it.")] = 0,
    out: Annotated[Path | None, typer.Option(help="The folder to write; reports/NAME by default.")] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes; as many as cores by default.")
    ] = None,
    plugin: Annotated[
        list[Path] | None,
        typer.Option(help="A Python file with plug-ins of your own; may be given again."),
    ] = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="Compute everything again.")] = False,
    quick: Annotated[
        bool, typer.Option("--quick", help="Only the answer, within seconds; no sampling to confirm it.")
    ] = False,
    deviation: Annotated[
        str, typer.Option(help="auto or law: laws may hold approximately; none: they hold exactly.")
    ] = "auto",
    sensor: Annotated[
        float, typer.Option(help="The sensor's relative linearity, a floor of every rate.")
    ] = 0.002,
) -> int:
    """Say which damping records have, how large it is, how well its law holds, and how sure that is."""
    from bayesdamp.envelope.command import compare_envelopes, recognised

    if recognised(records, angle, unit, quantity):
        return compare_envelopes(
            records,
            folder=lambda name: _folder(out, name),
            say=typer.echo,
            time=time,
            value=angle,
            rate=rate,
            unit=unit,
            frequency=frequency,
            start=_bound(start, "--start"),
            stop=_bound(stop, "--stop"),
            repeats=repeats,
            seed=seed,
        )
    if frequency is not None:
        raise InputError("--frequency: is for envelopes; give --quantity envelope, or leave it out")
    from bayesdamp.cli.asking import Options, as_signals, chosen_records, first_words_on
    from bayesdamp.plugins import read_modules

    plugins = read_modules(plugin or ())
    sums = [one.strip() for given in damping or () for one in given.split(",")]
    bounds = _bound(start, "--start"), _bound(stop, "--stop")
    reading = Options(
        time, angle, rate, time_unit, unit, quantity, clock, *bounds, runs, tuple(channel or ())
    )
    found, said = chosen_records(records, reading)
    for line in said:
        typer.echo(line, err=True)
    with _early_processes(workers, sums, restoring or ()) as pool:
        from rich.console import Console

        from bayesdamp.config.compare import comparison

        made = comparison(
            as_signals(found, reading),
            restoring=restoring or (),
            damping=sums,
            noise=noise,
            seed=seed,
            repeats=repeats,
            plugins=plugins,
            deviation=deviation,
            sensor=sensor,
        )
        if len(found) <= FIRST_WORDS:
            for line in first_words_on(found, reading):
                typer.echo(line, err=True)
        folder = _folder(out, made.name)
        from bayesdamp.pipeline import run_study

        console = Console(stderr=True)
        from bayesdamp.report.terminal import answered, conclude

        status = run_study(
            made, folder, workers=workers, fresh=fresh, console=console, pool=pool, quick=quick,
            answered=lambda verdict: answered(verdict, Console()),
        )  # fmt: skip
    conclude(folder, Console())
    return status


@contextmanager
def _early_processes(
    workers: int | None, damping: Sequence[str], restoring: Sequence[str]
) -> Iterator[Executor | None]:
    """Processes that begin while the command is still read; None where one candidate needs none."""
    workers = workers or len(os.sched_getaffinity(0))
    if workers == 1 or len(damping) == len(restoring) == 1:
        yield None
    else:
        with processes(workers, "bayesdamp.pipeline") as pool:
            yield pool


@app.command()
def calibrate(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A study file (TOML).")],
    out: Annotated[
        Path | None, typer.Option(help="The run's folder; reports/NAME where it is not given.")
    ] = None,
    models: Annotated[
        bool, typer.Option("--models", help="Put the probabilities of the models to the test.")
    ] = False,
    records: Annotated[
        int | None,
        typer.Option(min=1, help="Records of each model (of all with --models); else the study's."),
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes; as many as there are cores where it is not given.")
    ] = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="Compute everything again.")] = False,
    no_report: Annotated[
        bool, typer.Option("--no-report", help="Leave report.html to `bayesdamp report`.")
    ] = False,
) -> int:
    """Are the intervals what they say? Draw from a study's own prior, simulate, infer, compare with the truth."""
    from rich.console import Console

    loaded = _load(file)
    folder = _folder(out, loaded.name)
    from bayesdamp.validation.calibration import run_calibration

    status = run_calibration(
        loaded,
        folder,
        records=records,
        models=models,
        workers=workers,
        fresh=fresh,
        report=not no_report,
        console=Console(stderr=True),
    )
    typer.echo(folder if no_report else folder / "report.html")
    return status


def _folder(out: Path | None, name: str) -> Path:
    """A run's folder. Raises InputError where a file has its name."""
    folder = out if out is not None else Path("reports") / name
    if folder.exists() and not folder.is_dir():
        raise InputError(f"--out {folder}: is a file; it must be a folder, or a new name")
    return folder


@app.command()
def check(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A study file (TOML).")],
    plugin: Annotated[
        list[Path] | None,
        typer.Option(help="A Python file with plug-ins of your own; may be given again."),
    ] = None,
) -> int:
    """Read a study, list its cells, say what is wrong; run nothing."""
    from rich.console import Console
    from rich.table import Table

    loaded = _load(file, plugin)
    from bayesdamp.pipeline import cells

    counts = Counter(re.split(r"[/:]", cell.name)[0] for cell in cells(loaded))
    console = Console()
    summary = Table("", "what the study asks for", title=f"{loaded.name}: {file}", title_justify="left")
    for label, names in _asked(loaded):
        summary.add_row(label, ", ".join(names) or "none")
    console.print(summary)
    table = Table("cells", "number")
    for kind, number in counts.items():
        table.add_row(kind, str(number))
    table.add_row("all", str(sum(counts.values())), style="bold")
    console.print(table)
    typer.echo(f"{file}: ok")
    return 0


@app.command()
def simulate(
    out: Annotated[Path, typer.Option(help="The CSV file to write.")],
    damping: Annotated[
        list[str], typer.Option(help="Damping terms with coefficients: viscous=0.05,coulomb=0.03.")
    ],
    restoring: Annotated[str, typer.Option(help="The restoring law.")] = "horizontal_pendulum",
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="A parameter: stiffness=20,theta0=0.3.")
    ] = None,
    duration: Annotated[float, typer.Option(help="Length of the record in s.")] = 10.0,
    samples: Annotated[int, typer.Option(help="Number of samples.")] = 1001,
    noise_sd: Annotated[
        float | None,
        typer.Option(
            help="Standard deviation of the noise, in rad; 1 % of the amplitude by default, 0 for none."
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the noise.")] = 0,
    plugin: Annotated[
        list[Path] | None,
        typer.Option(help="A Python file with plug-ins of your own; may be given again."),
    ] = None,
) -> int:
    """Write a simulated record to play with: a CSV of times in s and angles in rad."""
    from bayesdamp.cli.simulated import pairs, simulated, terms_and_set, write_csv
    from bayesdamp.plugins import read_modules, use

    use(read_modules(plugin or ()))
    given = terms_and_set(pairs(damping, "--damping"), pairs(set_ or [], "--set"), restoring)
    given |= {"duration": duration, "samples": samples}
    given |= {} if noise_sd is None else {"noise_sd": noise_sd}
    record, sd = simulated(given, restoring, seed)
    write_csv(record, out)
    if "noise_sd" not in given:
        typer.echo(f"noise: sd {sd:g} rad, 1 % of the amplitude (--noise-sd 0 for none)", err=True)
    typer.echo(out)
    return 0


@app.command()
def report(folder: Annotated[Path, typer.Argument(metavar="DIR", help="A run's folder.")]) -> int:
    """Render a run's folder again; nothing is computed."""
    if not folder.is_dir():
        raise InputError(f"{folder}: there is no such folder; give the folder of a run, such as reports/NAME")
    from bayesdamp.report import render

    typer.echo(render(folder))
    return 0


def _load(file: Path, plugins: Sequence[Path] | None = None) -> Study:
    """A study with the options of its estimators checked too. plugins: files besides those that it names."""
    from bayesdamp.config import load_study
    from bayesdamp.plugins import read_modules

    loaded = load_study(file, read_modules(plugins or ()))
    for name in loaded.estimators.use:
        if name in loaded.estimators.options:
            loaded.estimator_options(name)
    return loaded


def _asked(loaded: Study) -> list[tuple[str, Sequence[str]]]:
    use = loaded.estimators
    return [
        ("signals", [f"{s.name} (x{s.repeats})" if s.repeats > 1 else s.name for s in loaded.signals]),
        ("models", loaded.models.compare),
        ("restoring laws", list(dict.fromkeys(law for s in loaded.signals for law in s.restoring))),
        ("estimators", use.use),
        ("stages", use.stages),
        ("samplers", loaded.posterior.samplers),
        ("noise", loaded.noises),
        ("evidence", loaded.evidence.methods),
    ]


@app.command()
def claims(
    paper: Annotated[Path | None, typer.Option(help="Folder of a run of studies/paper.toml.")] = None,
    noise: Annotated[
        list[Path] | None, typer.Option(help="Folder of a run of studies/noise*.toml; may be given again.")
    ] = None,
    out: Annotated[Path, typer.Option(help="The page to write (Markdown).")] = Path("reports/claims.md"),
) -> None:
    """Measure each claim of the paper, and say whether it holds."""
    from bayesdamp.store import write_bytes
    from bayesdamp.validation.claims import CLAIMS, judged, written
    from bayesdamp.validation.claims.judge import Runs

    for option, folder in (("--paper", paper), *(("--noise", folder) for folder in noise or ())):
        if folder is not None and not (folder / "run.json").is_file():
            raise InputError(f"{option} {folder}: holds no run; give the folder that bayesdamp study wrote")
    page = written(judged(CLAIMS, Runs(paper, tuple(noise or ()))))
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        write_bytes(out, page.encode())
    except InputError as error:
        raise InputError(f"--out {error}") from None
    except OSError as error:
        what = (error.strerror or str(error)).lower()
        raise InputError(f"--out {out}: cannot be written: {what}; give a new file's name") from None
    typer.echo(out)


def _line(error: BaseException) -> str:
    """An error's text as one line."""
    return " ".join(str(error).split())


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit status.

    0 done, 1 a fault of the program, 2 the input is wrong, 3 done but with failed cells, 130 interrupted.
    """
    try:
        status = app(args=list(sys.argv[1:] if arguments is None else arguments), standalone_mode=False)
    except BayesdampError as error:
        _trace()
        print(_line(error), file=sys.stderr)
        return WRONG_INPUT
    except KeyboardInterrupt:
        status = INTERRUPTED
    except Exception as error:
        usage = getattr(error, "format_message", None)
        if usage is not None:
            if usage():
                print(f"{' '.join(usage().split())} Try: bayesdamp --help", file=sys.stderr)
            return WRONG_INPUT
        _trace()
        what = f"{type(error).__name__}: {_line(error)}"
        hint = "BAYESDAMP_DEBUG=1 shows where"
        print(f"bayesdamp: a fault of the program: {what} ({hint})", file=sys.stderr)
        return FAULT
    if status == INTERRUPTED:
        print("interrupted; the same command resumes what was done", file=sys.stderr)
    return int(status or 0)


def _trace() -> None:
    if os.environ.get("BAYESDAMP_DEBUG") == "1":
        traceback.print_exc()
