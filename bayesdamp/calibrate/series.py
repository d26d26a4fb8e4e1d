"""Series of records, computed chunk by chunk until enough of them are accepted; resumed where they were cut off."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, as_completed
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console
from rich.progress import TimeRemainingColumn

from bayesdamp.calibrate import ranks, recovery
from bayesdamp.config import Study
from bayesdamp.inference.evidence import EVIDENCES
from bayesdamp.inference.noise import NOISES
from bayesdamp.inference.samplers import SAMPLERS
from bayesdamp.machine.threads import cores
from bayesdamp.outcomes import Status, status_of
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.restoring import LAWS
from bayesdamp.pipeline.progress import progress_bar
from bayesdamp.pipeline.tasks import Product, perform, task_key
from bayesdamp.pipeline.workers import pool_of
from bayesdamp.plugins import use
from bayesdamp.store import CellResult, Store
from bayesdamp.store.contents import ChunkContent

MOST = 20
"""Records tried for each that is wanted; with fewer accepted the series ends short, and says so."""


@dataclass(frozen=True)
class Series:
    """Records of one kind: "ranks" of a model, "recovery" or "single"; how many accepted ones are wanted."""

    kind: str
    wanted: int
    model: str = ""

    @property
    def name(self) -> str:
        """Its kind, and the model where it has one."""
        return f"{self.kind}/{self.model}" if self.model else self.kind

    @property
    def chunk(self) -> int:
        """Records in one task."""
        return {"ranks": ranks.CHUNK}.get(self.kind, recovery.CHUNK)

    def cell(self, study: Study, first: int) -> tuple[str, str]:
        """Name and key of the chunk that starts at a record."""
        asked = (ranks if self.kind == "ranks" else recovery).asked(study)
        key = task_key("calibration", self.kind, self.model, first, asked, _named(study))
        return f"{self.name}/{first:06d}", key

    def compute(self, study: Study, first: int) -> Product:
        """The chunk that starts at a record."""
        if self.kind == "ranks":
            return ranks.ranked(study, self.model, first)
        return recovery.recovered(study, self.kind, first)


def _named(study: Study) -> list[str]:
    """The source of all that a chunk may find by name."""
    terms = {t: None for s in study.signals for m in study.dampings(s) for t in m.split("+")}
    laws = dict.fromkeys(law for s in study.signals for law in s.restoring)
    found = [*map(TERMS.source, terms), *map(LAWS.source, laws), *map(NOISES.source, study.noises)]
    found += [SAMPLERS.source(name) for name in study.calibration.samplers]
    return [*found, EVIDENCES.source("importance")]


def gather(
    study: Study,
    wanted: Sequence[Series],
    store: Store,
    workers: int | None,
    console: Console,
) -> dict[str, list[CellResult]]:
    """The chunks of every series, in order; what the store lacks is computed in waves.

    A wave's size follows from how many records the waves before it accepted, not from what was stored already: a run
    that was cut off ends with the same records. Chunks that failed are tried again by the next run.
    """
    workers = workers or cores()
    found: dict[str, list[CellResult]] = {s.name: [] for s in wanted}
    with progress_bar(console, TimeRemainingColumn()) as progress, pool_of(workers, None) as pool:
        bars = {s.name: progress.add_task(s.name, total=s.wanted) for s in wanted}

        def advance(series: Series, result: CellResult) -> None:
            progress.update(bars[series.name], advance=sum(ChunkContent.of(result).accepted))

        while True:
            wave = [(s, first) for s in wanted for first in _wave(s, found[s.name])]
            if not wave:
                return found
            results = _run(study, wave, store, pool, advance)
            for one in wave:
                found[one[0].name].append(results[one])


def accepted(results: Sequence[CellResult]) -> int:
    """How many records of these chunks count."""
    return sum(sum(ChunkContent.of(r).accepted) for r in results)


def _wave(series: Series, results: Sequence[CellResult]) -> list[int]:
    """First records of the chunks of the next wave; none where the series is done, short or has failed."""
    tried, good = len(results) * series.chunk, accepted(results)
    if good >= series.wanted or tried >= MOST * series.wanted or any(is_failed(r) for r in results):
        return []
    rate = max(good / tried, 1 / MOST) if tried else 1.0
    count = math.ceil((series.wanted - good) / rate / series.chunk)
    return [tried + i * series.chunk for i in range(count)]


def is_failed(result: CellResult) -> bool:
    """Whether the program failed on a chunk."""
    return status_of(result.outcome) is Status.FAILED


def _run(
    study: Study,
    wave: Sequence[tuple[Series, int]],
    store: Store,
    pool: Executor | None,
    advance: Callable[[Series, CellResult], None],
) -> dict[tuple[Series, int], CellResult]:
    found: dict[tuple[Series, int], CellResult] = {}
    folder = store.folder.resolve()
    if pool is None:
        for one in wave:
            found[one] = _chunk(study, folder, *one)
            advance(one[0], found[one])
        return found
    futures = {pool.submit(_chunk, study, folder, *one): one for one in wave}
    try:
        for future in as_completed(futures):
            one = futures[future]
            found[one] = future.result()
            advance(one[0], found[one])
    except BaseException:
        for future in futures:
            future.cancel()
        raise
    return found


def _chunk(study: Study, folder: Path, series: Series, first: int) -> CellResult:
    """Return one chunk, computed and stored where the folder lacks it."""
    use(study.plugins)
    store, (name, key) = Store(folder), series.cell(study, first)
    stored = store.find(name)
    if stored is None or stored.key != key or is_failed(stored):
        perform(store, name, key, lambda: series.compute(study, first))
    return store.read(name)
