"""What a task is about, told from its name."""

from __future__ import annotations

from bayesdamp.store import CellResult
from bayesdamp.store.cells import Place


def test_a_task_s_name_says_what_it_is_about() -> None:
    for name, place in {
        "signal/bench/0": Place("signal", "bench", 0),
        "mode/bench/12/viscous+coulomb@pendulum": Place("mode", "bench", 12, "viscous+coulomb@pendulum"),
        "evidence/0/1/viscous/bridge": Place("evidence", "0", 1, "viscous", "bridge"),
        "joint/rig": Place("joint", "rig"),
        "population": Place("population"),
    }.items():
        assert CellResult(name, "").place == place
