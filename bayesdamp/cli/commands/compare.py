"""Define `bayesdamp compare`, which finds the damping of records."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from bayesdamp.cli import options as o, records as r
from bayesdamp.cli.files import check_folder, check_names
from bayesdamp.config import Recording, Study
from bayesdamp.config.load import RecordOptions, comparison_study
from bayesdamp.interface.first_words import first_words, no_free_decay
from bayesdamp.machine import cores
from bayesdamp.pipeline.records import keep_free_decay, read_free_decay
from bayesdamp.pipeline.workers import open_pool
from bayesdamp.plugins import read_modules, use_modules
from bayesdamp.records.envelope.record import are_envelopes
from bayesdamp.records.read import read_each
from bayesdamp.types import SENSOR, UNITS, InputError, Refusal
from bayesdamp.verdict.units import in_unit

MOST_EARLY_LINES = 5
"""Largest number of records in one command for which a line on frequency and damping is printed before anything is
fitted (`early_lines`); for more records these lines are left out."""
MOST_ENVELOPES_HERE = 6
"""Largest number of envelope records that are computed in this process. More are shared among several processes; for
fewer, starting a second process takes longer than the computation (measured)."""


@r.with_reading_options
def compare(
    records: Annotated[list[Path], typer.Argument(metavar="RECORD...", help="Files of measured decays.")],
    frequency: Annotated[
        float | None,
        o.reading("Frequency of the oscillation in Hz, for an envelope; by default from the file's header."),
    ] = None,
    restoring: Annotated[
        list[str] | None,
        o.compared(
            "A restoring law to compare: linear, pendulum, duffing or horizontal_pendulum; may be repeated; by "
            "default all."
        ),
    ] = None,
    damping: Annotated[
        list[str] | None,
        o.compared(
            "Damping sums to compare, such as stribeck,viscous+cubic; may be repeated. By default the seven "
            "sums of viscous, Coulomb and quadratic damping, and other forms that may be more probable."
        ),
    ] = None,
    noise: Annotated[
        str,
        o.compared(
            "The noise model: gaussian, student_t, correlated or quantised, or auto to choose one for each record."
        ),
    ] = "auto",
    repeats: Annotated[
        bool, o.compared("The records are of one specimen: give their common answer too.", "--repeats")
    ] = False,
    seed: Annotated[int, o.compared("Seed of all random numbers.", min=0)] = 0,
    out: o.Out = None,
    workers: o.Workers = None,
    scheduler: o.Scheduler = None,
    plugin: o.Plugins = None,
    fresh: o.Fresh = False,
    quick: o.Quick = False,
    exact: Annotated[
        bool,
        o.running(
            "Also check the answer by MCMC chains (NUTS) and bridge sampling, which takes minutes. Both assume that "
            "the laws hold exactly; with --deviation law, they allow deviations from the laws.",
            "--exact",
        ),
    ] = False,
    deviation: Annotated[
        str,
        o.compared(
            "Whether the damping and restoring laws may hold only approximately (auto, law) or hold exactly (none)."
        ),
    ] = "auto",
    sensor: Annotated[
        float | None,
        o.compared(
            "Relative linearity error of the sensor (standard deviation), added in quadrature to the uncertainty of "
            f"every damping ratio; by default {SENSOR}, which is 0.2 %. Not for envelopes, nor with --deviation none."
        ),
    ] = None,
    quiet: o.Quiet = False,
    as_json: o.AsJson = False,
    **reading: Any,
) -> int:
    """Find the kind of damping in records, how large it is, how well its law holds, and how certain that is."""
    check_names([*records, *(plugin or ()), *([out] if out is not None else [])])
    if out is not None:
        check_folder(out, "")
    if quick and exact:
        raise InputError("--quick and --exact cannot be combined; give only one of them")
    if deviation == "none" and sensor is not None:
        raise InputError("--sensor: does not apply with --deviation none; remove it")
    sums = [name.strip() for given in damping or () for name in given.split(",")]
    plugins = read_modules(plugin or ())
    use_modules(plugins)  # they may contain readers
    chosen, options = r.SelectedRecords([], [], [], []), r.ReadingOptions()
    envelopes = are_envelopes(records, reading["angle"], reading["unit"], reading["quantity"])
    in_pool = len(records) > MOST_EARLY_LINES and not (envelopes or plugins)
    width = (workers or (cores() if exact else min(cores(), len(records)))) if in_pool else 1
    if in_pool and not quiet:
        typer.echo(f"reading {len(records)} files", err=True)
    # Many records are read, and later compared, by several processes.
    with open_pool(width, scheduler if in_pool else None, partial(typer.echo, err=True)) as pool:
        if envelopes:
            given = {"restoring": restoring, "exact": exact, "runs": reading["runs"]}
            given |= {"channel": reading["channels"], "time-unit": reading["time_unit"]}
            given |= {"deviation": deviation != "auto", "noise": noise != "auto"}
            given |= {"sensor": sensor is not None}
            for name, value in given.items():
                if value:
                    raise InputError(f"--{name}: does not apply to envelope records; remove it")
            from bayesdamp.pipeline.envelopes import read_recording  # imports slowly

            keys: dict[str, Any] = {name: reading[name] for name in ("time", "angle", "rate")}
            keys |= {end: o.parse_time(reading[end], f"--{end}") for end in ("start", "stop")}
            keys["frequency"] = frequency

            def check(path: Path) -> RecordOptions:
                # Not validated as a [[signal]], because its errors would name keys that the user did not write.
                unit = reading["unit"]
                source = Recording.model_construct(
                    file=path.name, path=path.resolve(), unit=unit or "", **keys
                )
                read_recording(source, path.name)
                return {"file": str(path), "unit": unit, "quantity": "envelope", **keys}

            signals, failed = read_each(records, check)
        else:
            if frequency is not None:
                raise InputError(
                    "--frequency: applies to envelopes only; give --quantity envelope, or remove it"
                )
            options = r.ReadingOptions(**reading)
            chosen = r.select_records(records, options, pool, quiet or not in_pool)
            failed = chosen.failed
            signals = r.study_signals(chosen.records, options)
        if repeats and failed and len(signals) == 1:
            raise InputError(f"--repeats: only one record is usable, but several are needed; {failed[0]}")
        # A single record is computed by the threads of this process; more processes would not make it faster.
        alone = len(signals) <= (MOST_ENVELOPES_HERE if envelopes else 1) and not exact and scheduler is None
        study = comparison_study(
            signals,
            restoring=restoring or (),
            damping=sums,
            noise=noise,
            seed=seed,
            repeats=repeats,
            plugins=plugins,
            deviation=deviation,
            sensor=SENSOR if sensor is None else sensor,
        )
        check_folder(out, study.name)
        for record, spec in zip(chosen.records, study.signals, strict=not envelopes):
            if record.signal is not None and isinstance(spec.source, Recording):
                keep_free_decay(spec.source, spec.name, replace(record.signal, name=spec.name))
        if not quiet:
            few = 0 < len(chosen.records) <= MOST_EARLY_LINES
            first = early_lines(read_by_study(chosen.records, study), options) if few else []
            # First the lines on what may be read wrongly, last the lines on how the file was read.
            for line in [*chosen.doubted, *first, *chosen.notes]:
                typer.echo(line, err=True)
        # Import this here, because it is slow, and the first lines should be printed at once.
        from bayesdamp.cli.runs import Depth, choose_folder, run_and_print

        folder = out if out is not None else choose_folder(study)
        if folder.name != study.name and out is None and not quiet:
            before = f"{folder.with_name(study.name)} contains a run with other records or settings"
            typer.echo(f"{before}; this run is written to {folder}", err=True)
        depth = Depth.ANSWER if quick else Depth.WHOLE if exact else Depth.SAMPLED
        running = {"workers": 1 if alone else workers, "scheduler": scheduler, "fresh": fresh, "quiet": quiet}
        running["checked"] = bool(chosen.records) and all(record.signal for record in chosen.records)
        chosen = r.SelectedRecords([], [], [], [])  # frees the memory of the records
        return run_and_print(study, folder, depth, as_json=as_json, failed=failed, pool=pool, **running)


def read_by_study(records: Sequence[r.FileRecord], study: Study) -> list[r.FileRecord]:
    """Return copies of the records with their free decays (`signal`), as the run of the study will read them.

    `records` are the records of the study's signals, in the same order. A record that already has a `signal` is not
    changed. A record whose free decay cannot be read is returned without one; the run will report the error.
    """
    read = []
    for record, spec in zip(records, study.signals, strict=True):
        assert isinstance(spec.source, Recording)
        with suppress(InputError):  # the run reports it
            if record.signal is None:
                record = replace(record, signal=read_free_decay(spec.source, spec.name))
        read.append(record)
    return read


def early_lines(records: Sequence[r.FileRecord], options: r.ReadingOptions) -> list[str]:
    """Return lines on records, to be printed before anything is fitted.

    For each record that oscillates, a line gives its frequency and its damping, measured without assuming a damping
    law (if the record is long enough), or says that it is not the free decay of one oscillator. For each record
    without an oscillation, a line suggests --quantity envelope if no value is negative. Last, there is a line for each
    file for which the unit rad is assumed.
    """
    lines = []
    assumed: dict[str, None] = {}
    for record in records:
        signal = record.signal
        if signal is None:
            if record.raw.y.min() >= 0:
                lines.append(f"{record.path.name}: {r.MAYBE_ENVELOPE}")
            continue
        is_rad = (record.unit, record.quantity) == ("rad", "angle")
        if is_rad and options.unit is None and not record.raw.unit:
            assumed[record.path.name] = None
        not_a_free_decay = no_free_decay(signal)
        label = ", ".join(filter(None, (record.path.name, r.distinguishing_label(record, records))))
        if not_a_free_decay is not None:
            lines.append(f"{label}: {in_unit(not_a_free_decay, UNITS[record.unit]).sentence}")
            continue
        with suppress(Refusal):
            lines.append(f"{label}: {first_words(signal, record.unit).sentence}")
    unit = "No unit given; assuming an angle in rad. Use --unit deg, m or mm to change this."
    return [*lines, *(f"{name}: {unit}" for name in assumed)]
