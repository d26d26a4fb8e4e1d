"""List the measured decays and the options to read their files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from bayesdamp.cli.records import ReadingOptions

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
RIG = ReadingOptions(time="Time_Elapsed(s)", angle="Angle(deg)", unit="deg")
SPRING = ReadingOptions(time="1", angle="2", unit="m")


@dataclass(frozen=True)
class Measured:
    """A record: its name, its file in the data folder, and the options that select its columns and unit."""

    name: str
    file: str
    options: ReadingOptions

    @property
    def path(self) -> Path:
        """The file."""
        return DATA / self.file


RECORDS = (
    Measured(
        "rotary", "rotary_pendulum/pendulum_free_swing_data_01.txt", ReadingOptions(rate=1000.0, unit="deg")
    ),
    Measured("video", "video_pendulum/lab1_data.txt", ReadingOptions(time="1", angle="2")),
    Measured(
        "disc", "spring_disc/molla_dura_discopieno_0.1223kg.csv",
        ReadingOptions(time="Time (s) Run #1", angle="Position (m) Run #1", unit="m"),
    ),
    Measured(
        "encoder", "encoder_pendulum/SingleDataFreeSwing_1_Dt_0_0001.mat",
        ReadingOptions(time="Theta1.time", angle="Theta1.signals.values"),
    ),
    Measured("rig-80P", "horizontal_pendulum/80P.txt", RIG),
    Measured("rig-60", "horizontal_pendulum/60.txt", RIG),
    Measured("rig-100", "horizontal_pendulum/100.txt", RIG),
    Measured("stiff-disc-2", "spring_disc/molla_durissima_discopieno_14.91945_0.2016_2.csv", SPRING),
    Measured("stiff-disc-3", "spring_disc/molla_durissima_discopieno_14.91945_0.2016_3.csv", SPRING),
    Measured("ship", "ship_roll/model_test_21338.csv", ReadingOptions(time="time", angle="phi")),
)  # fmt: skip
RUNS = Measured("ten-runs", "ten_runs/Run_1-10_no_magnet.csv", ReadingOptions())
"""Ten runs of one rig in one file."""
