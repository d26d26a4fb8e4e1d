"""How the report names where a search started."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bayesdamp.report import render
from bayesdamp.store import Store
from bayesdamp.types import Seed
from tests.report.pages import Page


@pytest.mark.parametrize(
    ("seed", "text"),
    [
        (Seed("envelope", "initial", grown=True), "envelope (own estimate, over growing windows)"),
        (Seed("prior 1", drawn=True), "prior 1"),
    ],
)
def test_a_start_has_its_source_and_its_stage(maker, seed: Seed, text: str) -> None:
    folder = maker.make()
    store = Store(folder)
    with store.lock():
        cell = store.read("mode/sim/0/viscous")
        climb = {
            "seed": vars(seed), "same": [], "start": 90.0, "end": 100.0, "evaluations": 7, "volume": 0.0,
            "converged": True, "distance": 1.0, "mode": 0,
        }  # fmt: skip
        store.write(replace(cell, meta={**cell.meta, "climbs": [climb]}))
    assert text.lower() in Page(render(folder).read_text()).words.lower()
