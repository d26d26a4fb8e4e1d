"""`bayesdamp compare`: the damping of unknown records."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bayesdamp.cli import options as o
from bayesdamp.cli.asked import (
    FIRST_WORDS,
    describable,
    own_folder,
    run_asked,
    run_folder,
)
from bayesdamp.cli.border import one_line, say
from bayesdamp.cli.options import READING, RUNNING, WEIGHED
from bayesdamp.types import InputError

ALONE = 6
"""Envelopes that are answered before another process would have begun."""


def compare(
    records: Annotated[list[Path], typer.Argument(metavar="RECORD...", help="Files of measured decays.")],
    angle: o.Angle = None,
    time: o.Time = None,
    rate: o.Rate = None,
    unit: o.Unit = None,
    quantity: o.Quantity = None,
    frequency: Annotated[
        float | None,
        o.option(READING, "Of the oscillation, in Hz, for an envelope; else as the file's head says."),
    ] = None,
    clock: o.Clock = "auto",
    start: o.Start = "auto",
    stop: o.Stop = "auto",
    runs: o.Runs = None,
    channel: o.Channels = None,
    time_unit: o.TimeUnit = None,
    restoring: Annotated[
        list[str] | None,
        o.option(WEIGHED, "A restoring law to compare, may be given again; all by default."),
    ] = None,
    damping: Annotated[
        list[str] | None,
        o.option(
            WEIGHED,
            "Damping sums to compare, such as stribeck,viscous+cubic; may be given again. By default the "
            "seven sums of viscous, Coulomb and quadratic damping, and other forms that may be likelier.",
        ),
    ] = None,
    noise: Annotated[str, o.option(WEIGHED, "A noise model, or auto: chosen for each record.")] = "auto",
    repeats: Annotated[
        bool,
        o.option(
            WEIGHED,
            "The records are of one specimen: fit them jointly, each from its own start.",
            "--repeats",
        ),
    ] = False,
    seed: Annotated[int, o.option(WEIGHED, "Every random number follows from it.", min=0)] = 0,
    out: o.Out = None,
    workers: o.Workers = None,
    scheduler: o.Scheduler = None,
    plugin: o.Plugins = None,
    fresh: o.Fresh = False,
    quick: o.Quick = False,
    exact: Annotated[
        bool,
        o.option(
            RUNNING,
            "Also check the answer by NUTS and bridge sampling under laws that hold exactly; "
            "minutes. With --deviation law under the answer's own deviations. "
            "With --repeats the joint fit, whose laws hold as --deviation says.",
            "--exact",
        ),
    ] = False,
    deviation: Annotated[
        str,
        o.option(WEIGHED, "auto or law: laws may hold approximately; none: they hold exactly."),
    ] = "auto",
    sensor: Annotated[
        float,
        o.option(
            WEIGHED, "Linearity error of the sensor (0.002 is 0.2 %): no damping ratio is known better."
        ),
    ] = 0.002,
    quiet: o.Quiet = False,
    as_json: o.AsJson = False,
) -> int:
    """Say which damping records have, how large it is, how well its law holds, and how sure that is."""
    describable([*records, *(plugin or ()), *([out] if out is not None else [])])
    if out is not None:
        run_folder(out, "")
    sums = [one.strip() for given in damping or () for one in given.split(",")]
    from bayesdamp.cli.asking import Options, as_signals, chosen_envelopes, chosen_records, first_words_on
    from bayesdamp.cli.open_questions import one_command
    from bayesdamp.plugins import read_modules, use
    from bayesdamp.records.envelope.reading import are_envelopes

    plugins = read_modules(plugin or ())
    use(plugins)  # which may read the files
    words: list[str] = []
    envelopes = are_envelopes(records, angle, unit, quantity)
    if envelopes:
        given = {"restoring": restoring, "exact": exact, "runs": runs, "channel": channel}
        given |= {"time-unit": time_unit, "deviation": deviation != "auto", "noise": noise != "auto"}
        for name, value in given.items():
            if value:
                raise InputError(f"--{name}: does not apply to envelope records; remove it")
        ends = {"start": o.bound(start, "--start"), "stop": o.bound(stop, "--stop")}
        signals, failed = chosen_envelopes(
            records, unit, time=time, angle=angle, rate=rate, frequency=frequency, **ends
        )
    else:
        if frequency is not None:
            raise InputError("--frequency: is for envelopes; give --quantity envelope, or leave it out")
        reading = Options(
            time, angle, rate, time_unit, unit, quantity, clock, start, stop, runs, channel or ()
        )
        selection = chosen_records(records, reading)
        found, failed = selection.records, selection.failed
        signals = as_signals(found, reading)
        if not quiet:
            first = first_words_on(found, reading) if len(found) <= FIRST_WORDS else []
            # What may be read wrongly comes before the answer, and how the file was read after it.
            asked = one_command([(one.path, one.raw) for one in found], reading)
            words = [*selection.doubted, *first, *asked, *selection.said]
    # One record is answered by threads of this process: others would only begin to wait.
    alone = len(signals) <= (ALONE if envelopes else 1) and not exact and scheduler is None
    from bayesdamp.config.compare import comparison

    made = comparison(
        signals,
        restoring=restoring or (),
        damping=sums,
        noise=noise,
        seed=seed,
        repeats=repeats,
        plugins=plugins,
        deviation=deviation,
        sensor=sensor,
    )
    for line in words:
        typer.echo(line, err=True)
    folder = run_folder(out, made.name) if out is not None else own_folder(made)
    if folder.name != made.name and out is None and not quiet:
        before = folder.with_name(made.name)
        typer.echo(f"{before} has the answer to another question; this one goes to {folder}", err=True)
    from bayesdamp.pipeline import Depth
    from bayesdamp.pipeline.run import WRONG_CELLS
    from bayesdamp.report.terminal import conclude

    depth = Depth.ANSWER if quick else Depth.WHOLE if exact else Depth.SAMPLED
    how = {"workers": 1 if alone else workers, "scheduler": scheduler, "fresh": fresh, "quiet": quiet}
    status = run_asked(made, folder, depth, conclude, as_json=as_json, **how)
    for error in failed:
        say(one_line(f"failed: {error}"))
    return WRONG_CELLS if failed else status
