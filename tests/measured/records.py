"""The measured decays and how their files are read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

DATA = Path(__file__).resolve().parents[2] / ".." / "shared" / "data"
RIG = {"time": "Time_Elapsed(s)", "angle": "Angle(deg)", "unit": "deg"}


@dataclass(frozen=True)
class Measured:
    """A record's name, its file below the data's folder, and its columns and unit."""

    name: str
    file: str
    options: dict[str, Any]

    @property
    def path(self) -> Path:
        return (DATA / self.file).resolve()


RECORDS = (
    Measured("rotary", "rotary_pendulum/pendulum_free_swing_data_01.txt", {"rate": 1000.0, "unit": "deg"}),
    Measured("video", "video_pendulum/lab1_data.txt", {"time": 1, "angle": 2}),
    Measured(
        "disc",
        "spring_disc/molla_dura_discopieno_0.1223kg.csv",
        {"time": "Time (s) Run #1", "angle": "Position (m) Run #1", "unit": "m"},
    ),
    Measured(
        "encoder",
        "encoder_pendulum/SingleDataFreeSwing_1_Dt_0_0001.mat",
        {"time": "Theta1.time", "angle": "Theta1.signals.values"},
    ),
    Measured("rig-80P", "horizontal_pendulum/80P.txt", RIG),
    Measured("rig-60", "horizontal_pendulum/60.txt", RIG),
    Measured("rig-100", "horizontal_pendulum/100.txt", RIG),
    Measured(
        "stiff-disc-2",
        "spring_disc/molla_durissima_discopieno_14.91945_0.2016_2.csv",
        {"time": 1, "angle": 2, "unit": "m"},
    ),
    Measured(
        "stiff-disc-3",
        "spring_disc/molla_durissima_discopieno_14.91945_0.2016_3.csv",
        {"time": 1, "angle": 2, "unit": "m"},
    ),
    Measured("ship", "ship_roll/model_test_21338.csv", {"time": "time", "angle": "phi"}),
)
RUNS = Measured("ten-runs", "ten_runs/Run_1-10_no_magnet.csv", {})
"""Ten runs of one rig in one file."""
