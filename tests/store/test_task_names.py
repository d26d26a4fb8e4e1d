"""What a task is about, told from its name."""

from __future__ import annotations

from bayesdamp.store import TaskResult
from bayesdamp.store.results import TaskName


def test_a_task_s_name_says_what_it_is_about() -> None:
    for name, place in {
        "signal/bench/0": TaskName("signal", "bench", 0),
        "mode/bench/12/viscous+coulomb@pendulum": TaskName("mode", "bench", 12, "viscous+coulomb@pendulum"),
        "evidence/0/1/viscous/bridge": TaskName("evidence", "0", 1, "viscous", "bridge"),
        "joint/rig": TaskName("joint", "rig"),
        "population": TaskName("population"),
    }.items():
        assert TaskResult(name, "").parts == place
