"""What `bayesdamp compare` does with records of envelopes: a line a record, many of them in several processes."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import BrokenExecutor
from functools import partial
from pathlib import Path
from typing import Any

from bayesdamp.envelope.analysis import analyse
from bayesdamp.envelope.asked import asked
from bayesdamp.envelope.folder import write_about
from bayesdamp.envelope.kept import Task, keep, kept
from bayesdamp.inference.deviation.gaussian.hyperparameters import EXACT, MEAN_G
from bayesdamp.inference.envelope.posterior import DRIFT, SENSOR
from bayesdamp.machine.processes import processes
from bayesdamp.machine.threads import cores
from bayesdamp.odds import FURTHER_TERM
from bayesdamp.plugins import use
from bayesdamp.priors import SHARED_SCALES
from bayesdamp.records.envelope.floor import ABOVE_FLOOR
from bayesdamp.records.envelope.reading import Column, is_envelope, read_envelope
from bayesdamp.records.envelope.record import EnvelopeRecord
from bayesdamp.records.envelope.window import Window, bounded
from bayesdamp.records.opening.opening import read_each
from bayesdamp.store.cells import Store
from bayesdamp.store.files import write_bytes
from bayesdamp.types import InputError, Refusal
from bayesdamp.verdict import files
from bayesdamp.verdict.envelope.answer import Answer

BATCH = 2
"""Records that a process is given at a time: handing over costs a millisecond, a record some 0.4 s."""
ALONE = 6
"""Records that are answered before another process would have begun."""
SETTINGS = (
    "Each term's equivalent damping ratio at the amplitude in the middle of the fall in dB has a half-normal prior. "
    "Its scale is the same for all terms of a sum and unknown: all orders of magnitude between "
    f"{SHARED_SCALES[0]:g} and {SHARED_SCALES[-1]:g} are equally probable. Where the frequency is not known, the "
    "rates have the same prior, with scales of which the middle one is one over the duration of the decay.",
    f"Prior odds of a sum: 1 for a single term, times {FURTHER_TERM:g} for each further term.",
    f"The law holds exactly with probability {EXACT:g}, else its rate is multiplied by 1 + g, g of sd τ, exponential "
    f"with mean {MEAN_G:g}.",
    f"Every rate is known to {100 * SENSOR:g} % (sd) at best (detector, clock); where readings are in dB, also to "
    f"{DRIFT:g} dB of drift or bend of the detector over half of the decay.",
    f"Readings count down to {ABOVE_FLOOR:g} dB above the noise floor. Q and the rate at the head are the law's, mean "
    "over the first half of the fall in dB; those at three amplitudes are as they were, with the deviation.",
)


def recognised(records: Sequence[Path], value: Column | None, unit: str | None, quantity: str | None) -> bool:
    """Whether the records are envelopes: as `quantity` says, else as all of their columns' names plainly do.

    Raises InputError where some are and some are not.
    """
    if quantity is not None:
        return quantity == "envelope"
    are = [is_envelope(path, value, unit) for path in records]
    if any(are) and not all(are):
        one, other = records[are.index(True)], records[are.index(False)]
        raise InputError(
            f"{one.name} is an envelope in dB, {other.name} is not plainly one; compare them in separate calls, "
            "or give --quantity envelope for all"
        )
    return all(are)


def compare_envelopes(
    paths: Sequence[Path],
    *,
    folder: Callable[[str, Mapping[str, Any]], Path],
    say: Callable[[str], object],
    time: Column | None = None,
    value: Column | None = None,
    rate: float | None = None,
    unit: str | None = None,
    frequency: float | None = None,
    start: float | str = "auto",
    stop: float | str = "auto",
    damping: Sequence[str] = (),
    plugins: Sequence[str] = (),
    repeats: bool = False,
    seed: int = 0,
    workers: int | None = None,
    fresh: bool = False,
) -> list[InputError]:
    """Say the damping of each record in a sentence; write verdicts.csv, verdict.json, report.html and a picture each.
    What is wrong with files that could not be read is returned.

    folder: the run's folder from the name it has by default and the options that make its question; say: prints a line.
    start, stop: of the decay in s, or "auto". damping, plugins: see `asked`. workers: processes, None for as many as
    cores. fresh: also what the folder has the answer of already. All records are read before anything is written.
    Raises InputError where no file can be read, and while another process writes into the folder.
    """
    if frequency is not None and not 0 < frequency < float("inf"):
        raise InputError(f"--frequency {frequency:g}: must be positive, in Hz")
    laws = asked(damping, plugins)  # before the files, which plug-ins may read

    def task_of(path: Path) -> tuple[Path, EnvelopeRecord, Window | None]:
        record = read_envelope(path, time=time, value=value, rate=rate, unit=unit, frequency=frequency)
        laws.of(record)
        return path, record, _window(record, start, stop)

    readable, failed = read_each(paths, task_of)
    paths, records, windows = zip(*readable, strict=True)
    if repeats and len(paths) < 2:
        raise InputError("--repeats: there is one record; give two or more of one specimen")
    keys = _keys(paths)
    options = {
        "time": time, "value": value, "rate": rate, "unit": unit, "frequency": frequency, "start": start,
        "stop": stop, "repeats": repeats, "seed": seed, "sums": laws.sums, "terms": laws.sources(),
    }  # fmt: skip
    out = folder(keys[0] if len(keys) == 1 else f"{keys[0]}-and-{len(keys) - 1}-more", options)
    store = Store(out)
    with store.lock():
        if fresh:
            store.clear()
        tasks = [
            Task(record, window, out / "figures" / f"{key}.png", seed, laws)
            for record, window, key in zip(records, windows, keys, strict=True)
        ]
        found: list[Answer] = []
        for one in _answers(store, tasks, workers or cores()):
            found.append(one)
            say(f"{one.verdict.record}: {one.verdict.sentence}")
        verdicts = [one.verdict for one in found]
        if repeats:
            from bayesdamp.envelope.specimen import specimen  # imports slowly

            common = specimen(out.name, found)
            if common is not None:
                verdicts.append(common)
                say("\n- ".join([common.sentence, *common.remarks]))
        files.write(out, verdicts)
        write_about(out, paths, options, keys, (*laws.settings(), *SETTINGS))
        from bayesdamp.report import render  # imports slowly

        say(str(render(out)))
    return failed


def _answers(store: Store, tasks: Sequence[Task], workers: int) -> Iterator[Answer]:
    """The results in their order, as they come; those that the folder has are not computed again."""
    there = [kept(store, task) for task in tasks]
    open_ = [task for task, result in zip(tasks, there, strict=True) if result is None]
    computed = _computed(store, open_, workers)
    for result in there:
        yield next(computed) if result is None else result


def _computed(store: Store, tasks: Sequence[Task], workers: int) -> Iterator[Answer]:
    answer = partial(_answer, store.folder)
    if workers == 1 or len(tasks) <= ALONE:
        yield from (result for task in tasks for result in answer([task]))
        return
    size = max(1, min(BATCH, len(tasks) // (2 * workers)))
    batches = [tasks[at : at + size] for at in range(0, len(tasks), size)]
    with processes(workers, "bayesdamp.envelope.picture") as pool:
        futures = [pool.submit(answer, batch) for batch in batches]
        for future, batch in zip(futures, batches, strict=True):
            try:
                yield from future.result()
            except BrokenExecutor:  # a process was killed; this one is still here
                yield from answer(batch)


def _answer(folder: Path, tasks: Sequence[Task]) -> list[Answer]:
    """The results, their pictures and they themselves written."""
    from bayesdamp.envelope.picture import picture  # imports slowly; most records are no envelopes

    found = []
    for task in tasks:
        use(task.asked.plugins)
        answer = analyse(task.record, task.window, task.seed, task.asked.sums)
        write_bytes(task.picture, picture(task.record, answer))
        keep(Store(folder), task, answer)
        found.append(answer)
    return found


def _window(record: EnvelopeRecord, start: float | str, stop: float | str) -> Window | None:
    """The bounds that were asked for; None where none is."""
    first = None if isinstance(start, str) else start
    last = None if isinstance(stop, str) else stop
    if first is None and last is None:
        return None
    try:
        return bounded(record.t, record.level, first, last)
    except Refusal as refusal:
        raise InputError(f"{record.name}: {refusal}") from None


def _keys(paths: Sequence[Path]) -> list[str]:
    """A picture's name for each file, from the file's own; the same ones are numbered."""
    found: dict[str, None] = {}
    for path in paths:
        stem = (re.sub(r"[^A-Za-z0-9_.=+-]+", "_", path.stem) or "record")[:80]
        key, count = stem, 2
        while key in found:
            key, count = f"{stem}-{count}", count + 1
        found[key] = None
    return list(found)
