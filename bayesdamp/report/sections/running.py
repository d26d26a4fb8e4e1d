"""Running estimates of the damping by a Kalman filter."""

from __future__ import annotations

from functools import partial

import numpy as np
from markupsafe import Markup

from bayesdamp.report import words
from bayesdamp.report.figures.posterior import running
from bayesdamp.report.markup import folded, stack
from bayesdamp.report.results.reading import coefficients, models_by_rank, truth
from bayesdamp.report.results.run import RunFolder
from bayesdamp.report.sections import SignalSection, is_drawn
from bayesdamp.store import CellResult
from bayesdamp.store.contents import PosteriorContent


class RunningSection(SignalSection):
    """Estimate and band of each coefficient against time, if a sampler filtered the record."""

    order = 55
    title = "The damping estimate during the record"
    lead = (
        "The estimate of a Kalman filter after each sample. Its first pass uses every sample once. Each further pass "
        "starts from the same priors and linearises about the result of the pass before."
    )

    def shows(self, run: RunFolder, signal: str) -> bool:
        """Return whether a sampler filtered a record."""
        return any("running/t" in cell.arrays for cell in run.cells("posterior", signal))

    def part(self, run: RunFolder, signal: str) -> Markup:
        """Return the coefficients against time, with their bands."""
        repeat = run.repeats(signal)[0]
        parts: list[Markup] = []
        for place, model in enumerate(models_by_rank(run, signal, repeat)):
            for cell in run.cells("posterior", signal, repeat, model) if is_drawn(run, place) else ():
                if "running/t" in cell.arrays:
                    figure = _figure(run, signal, model, cell)
                    parts.append(folded(words.model(model), figure) if parts else figure)
        return stack(*parts)


def _figure(run: RunFolder, signal: str, model: str, cell: CellResult) -> Markup:
    content = PosteriorContent.of(cell)
    listed = content.posterior.running
    names = [n for n in coefficients(run, model) if n in listed]

    def passed(label: str) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        mean, sd = (cell.arrays[f"running/{label}/{what}"] for what in ("mean", "sd"))
        return {n: (mean[:, i], sd[:, i]) for i, n in enumerate(listed) if n in names}

    first, last = passed("online"), passed("restarted")
    true = {n: truth(run, signal, n) for n in names}
    caption = f"{signal}, {words.model(model)}: running estimate of the damping by {words.method(cell.place.method)}."
    draw = partial(running, model, names, cell.arrays["running/t"], last, first, content.units, true)
    return run.drawings.add(f"running-{signal}-{model}", caption, draw)


PLUGIN = RunningSection()
