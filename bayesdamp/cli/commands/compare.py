"""`bayesdamp compare`: the damping of unknown records."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from bayesdamp.cli.asked import FIRST_WORDS, run_folder
from bayesdamp.cli.options import bound as _bound
from bayesdamp.machine.processes import processes
from bayesdamp.types import InputError


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
        list[str] | None, typer.Option(help="A damping sum to compare, may be given again; all by default.")
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
    exact: Annotated[
        bool,
        typer.Option(
            "--exact",
            help="Also a second opinion under laws that hold exactly: NUTS, bridge sampling; minutes.",
        ),
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
            folder=lambda name: run_folder(out, name),
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
    bounds = _bound(start, "--start"), _bound(stop, "--stop")
    reading = Options(
        time, angle, rate, time_unit, unit, quantity, clock, *bounds, runs, tuple(channel or ())
    )
    found, said = chosen_records(records, reading)
    for line in said:
        typer.echo(line, err=True)
    with _early_processes(workers, damping or (), restoring or ()) as pool:
        from rich.console import Console

        from bayesdamp.config.compare import comparison

        made = comparison(
            as_signals(found, reading),
            restoring=restoring or (),
            damping=damping or (),
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
        folder = run_folder(out, made.name)
        from bayesdamp.pipeline import Depth, run_study

        console = Console(stderr=True)
        from bayesdamp.report.terminal import Told, conclude

        depth = Depth.ANSWER if quick else Depth.WHOLE if exact else Depth.SAMPLED
        status = run_study(
            made, folder, workers=workers, fresh=fresh, console=console, pool=pool, depth=depth,
            answered=Told(Console()),
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
