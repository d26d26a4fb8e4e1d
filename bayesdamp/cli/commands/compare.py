"""`bayesdamp compare`: find the damping of records."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from bayesdamp.cli import options as o
from bayesdamp.cli import records as r
from bayesdamp.cli.arguments import check_folder, check_names, choose_folder
from bayesdamp.cli.border import one_line, print_error
from bayesdamp.cli.options import READING, RUNNING, WEIGHED
from bayesdamp.cli.runs import FIRST_WORDS, run_and_print
from bayesdamp.config import Recording
from bayesdamp.config.compare import Asked, comparison
from bayesdamp.pipeline import Depth
from bayesdamp.pipeline.envelopes import read_recording
from bayesdamp.pipeline.run import WRONG_CELLS
from bayesdamp.plugins import read_modules, use
from bayesdamp.records.envelope.record import are_envelopes
from bayesdamp.records.opening import read_each
from bayesdamp.report.terminal import conclude
from bayesdamp.types import InputError

ALONE = 6
"""Number of envelopes that one process answers before a second one has started."""


def compare(
    records: Annotated[list[Path], typer.Argument(metavar="RECORD...", help="Files of measured decays.")],
    angle: o.Angle = None,
    time: o.Time = None,
    rate: o.Rate = None,
    unit: o.Unit = None,
    quantity: o.Quantity = None,
    frequency: Annotated[
        float | None,
        o.option(
            READING, "Frequency of the oscillation in Hz, for an envelope; by default from the file's head."
        ),
    ] = None,
    clock: o.Clock = "auto",
    start: o.Start = "auto",
    stop: o.Stop = "auto",
    runs: o.Runs = None,
    channel: o.Channels = None,
    time_unit: o.TimeUnit = None,
    restoring: Annotated[
        list[str] | None,
        o.option(WEIGHED, "A restoring law to compare; may be repeated; by default all."),
    ] = None,
    damping: Annotated[
        list[str] | None,
        o.option(
            WEIGHED,
            "Damping sums to compare, such as stribeck,viscous+cubic; may be repeated. By default the seven "
            "sums of viscous, Coulomb and quadratic damping, and other forms that may be more probable.",
        ),
    ] = None,
    noise: Annotated[
        str, o.option(WEIGHED, "A noise model, or auto to choose one for each record.")
    ] = "auto",
    repeats: Annotated[
        bool,
        o.option(
            WEIGHED,
            "The records are of one specimen: fit them jointly, each from its own start.",
            "--repeats",
        ),
    ] = False,
    seed: Annotated[int, o.option(WEIGHED, "Seed of all random numbers.", min=0)] = 0,
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
            "Also check the answer by NUTS and bridge sampling, assuming that laws hold exactly; takes minutes. "
            "With --deviation law, under the answer's own deviations. With --repeats, the joint fit "
            "under --deviation.",
            "--exact",
        ),
    ] = False,
    deviation: Annotated[
        str,
        o.option(WEIGHED, "auto or law: laws may hold approximately; none: laws hold exactly."),
    ] = "auto",
    sensor: Annotated[
        float,
        o.option(
            WEIGHED, "Linearity error of the sensor (0.002 is 0.2 %), the least error of a damping ratio."
        ),
    ] = 0.002,
    quiet: o.Quiet = False,
    as_json: o.AsJson = False,
) -> int:
    """Find which damping records have, how large it is, how well its law holds, and how certain that is."""
    check_names([*records, *(plugin or ()), *([out] if out is not None else [])])
    if out is not None:
        check_folder(out, "")
    sums = [name.strip() for given in damping or () for name in given.split(",")]
    plugins = read_modules(plugin or ())
    use(plugins)  # they may contain readers
    words: list[str] = []
    envelopes = are_envelopes(records, angle, unit, quantity)
    if envelopes:
        given = {"restoring": restoring, "exact": exact, "runs": runs, "channel": channel}
        given |= {"time-unit": time_unit, "deviation": deviation != "auto", "noise": noise != "auto"}
        for name, value in given.items():
            if value:
                raise InputError(f"--{name}: does not apply to envelope records; remove it")
        ends = {"start": o.bound(start, "--start"), "stop": o.bound(stop, "--stop")}
        signals, failed = _envelopes(
            records, unit, time=time, angle=angle, rate=rate, frequency=frequency, **ends
        )
    else:
        if frequency is not None:
            raise InputError("--frequency: applies to envelopes only; give --quantity envelope, or remove it")
        reading = r.ReadingOptions(
            time, angle, rate, time_unit, unit, quantity, clock, start, stop, runs, channel or ()
        )
        chosen = r.chosen_records(records, reading)
        failed = chosen.failed
        signals = r.as_signals(chosen.records, reading)
        if not quiet:
            few = len(chosen.records) <= FIRST_WORDS
            first = r.first_words_on(chosen.records, reading) if few else []
            # What may have been misread comes first, and how the file was read last.
            words = [*chosen.doubted, *first, *r.one_command(chosen.records, reading), *chosen.notes]
    # Threads of this process answer a single record: other processes would only wait.
    alone = len(signals) <= (ALONE if envelopes else 1) and not exact and scheduler is None
    study = comparison(
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
    folder = check_folder(out, study.name) if out is not None else choose_folder(study)
    if folder.name != study.name and out is None and not quiet:
        before = folder.with_name(study.name)
        typer.echo(f"{before} has the answer to another question; this one goes to {folder}", err=True)
    depth = Depth.ANSWER if quick else Depth.WHOLE if exact else Depth.SAMPLED
    options = {"workers": 1 if alone else workers, "scheduler": scheduler, "fresh": fresh, "quiet": quiet}
    status = run_and_print(study, folder, depth, conclude, as_json=as_json, **options)
    for error in failed:
        print_error(one_line(f"failed: {error}"))
    return WRONG_CELLS if failed else status


def _envelopes(
    paths: Sequence[Path], unit: str | None, **options: Any
) -> tuple[list[Asked], list[InputError]]:
    """Return the envelopes of files as entries of a study's [[signal]], and what is wrong with other files.

    Parameters
    ----------
    paths
        The files.
    unit
        Unit of the readings; None where the files give it.
    **options
        As in a [[signal]]: time, angle, rate, frequency, start, stop.

    Raises
    ------
    InputError
        Where none can be read.
    """

    def check(path: Path) -> Asked:
        # Not validated as a table of a study, because the user did not write its keys.
        source = Recording.model_construct(file=path.name, path=path.resolve(), unit=unit or "", **options)
        read_recording(source, path.name)
        return {"file": str(path), "unit": unit, "quantity": "envelope", **options}

    return read_each(paths, check)
