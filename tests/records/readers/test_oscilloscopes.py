"""Files as oscilloscopes write them, and several tables next to each other, as spreadsheets contain them."""

from pathlib import Path

import numpy as np
import pytest

from bayesdamp.records.read import read_records
from bayesdamp.types import InputError
from tests.records.tables import write_lines

T = -0.02 + 4e-4 * np.arange(1200)
V = np.where(T < 0, 0.8, 0.8 * np.exp(-2 * T) * np.cos(90 * T))
PAIRS = [f"{t:.6f},{v:.5f}" for t, v in zip(T.tolist(), V.tolist(), strict=True)]
SETTINGS = [
    "Model,MSO54", "Horizontal Units,s", "Sample Interval,0.0004", "Record Length,1200", "Vertical Units,V", ",",
    "Labels,",
]  # fmt: skip
TDS = [
    "Record Length,1.2e+03", "Sample Interval,4e-04", "Source,CH2", "Vertical Units,V", "Horizontal Units,s",
]  # fmt: skip

FILES = {
    "Tektronix TDS": [f"{TDS[i] if i < len(TDS) else ','},,{pair}," for i, pair in enumerate(PAIRS)],
    "Tektronix MSO": [*SETTINGS, "TIME,CH1", *PAIRS],
    "Tektronix DPO, two channels": [
        "Point Format,Y,,", "Sample Interval,0.0004,,", "Filter Frequency,1e+08,,", "Record Length,1200,,",
        "Vertical Units,V,,V", "Vertical Scale,0.5,,0.5", ",,,", "TIME,CH1,CH1 Peak Detect,CH2",
        *(f"{pair},,3.3" for pair in PAIRS),
    ],
    "Siglent": [
        "Record Length,Analog:1200", "Sample Interval,Analog:0.0004", "Vertical Units,CH1:V", "Vertical Scale,CH1:0.5",
        "Source,CH1", "Second,Value", *PAIRS,
    ],
    "Rigol, numbered": [
        "X,CH1,Start,Increment,", "Sequence,Volt,-0.02,4e-04", *(f"{i},{v:.5f}," for i, v in enumerate(V.tolist())),
    ],
    "Rigol, times": ["Time(s),CH1V,", *(f"{pair}," for pair in PAIRS)],
    "LeCroy": ["LECROYHDO4054,1,Waveform", "Segments,1,SegmentSize,1200", "Time,Ampl", *PAIRS],
    "Keysight": ["x-axis,1", "second,Volt", *PAIRS],
    "PicoScope": ["Time,Channel A", "(s),(V)", "", *PAIRS],
}  # fmt: skip


NO_UNIT = ("Rigol, times", "LeCroy", "Tektronix DPO, two channels")
"""Files whose head or column names do not give the unit of the chosen column."""


@pytest.mark.parametrize("instrument", FILES)
def test_times_values_and_unit_are_those_of_the_instrument(tmp_path: Path, instrument: str) -> None:
    (raw,) = read_records(write_lines(tmp_path / "a.csv", FILES[instrument]))
    np.testing.assert_allclose(raw.t, T, atol=1e-9)  # type: ignore[arg-type]
    np.testing.assert_allclose(raw.y, V, atol=1e-5)
    assert raw.unit == ("" if instrument in NO_UNIT else "V")


@pytest.mark.parametrize("instrument", ["Tektronix TDS", "Tektronix MSO", "Rigol, numbered"])
def test_a_cell_that_is_not_a_number_is_refused(tmp_path: Path, instrument: str) -> None:
    lines = list(FILES[instrument])
    lines[-2] = lines[-2].replace(f"{V[-2]:.5f}", "clipped")
    with pytest.raises(InputError, match=f"line {len(lines) - 1}: 'clipped'"):
        read_records(write_lines(tmp_path / "a.csv", lines))


def test_a_plain_table_is_not_taken_for_a_file_of_an_oscilloscope(tmp_path: Path) -> None:
    """Negative control: two settings above a table are only facts; numbers in a column without Start are not counts."""
    (plain,) = read_records(write_lines(tmp_path / "a.csv", [*SETTINGS[2:4], "TIME,CH1", *PAIRS]))
    assert (plain.columns, plain.unit, plain.rate) == (("TIME", "CH1"), "", None)
    rows = [f"{i},{v:.5f}" for i, v in enumerate(V.tolist())]
    (raw,) = read_records(write_lines(tmp_path / "b.csv", ["X,CH1", "Sequence,Volt", *rows]))
    assert raw.t[1] == 1


@pytest.mark.parametrize("later", [0, 1])
def test_tables_side_by_side_are_records_with_their_own_times(tmp_path: Path, later: int) -> None:
    """The times may be the same in all tables."""
    t = np.arange(500) / 50
    ys = [a * np.exp(-0.2 * t) * np.cos(6 * t) for a in (20.0, 15.0, 10.0)]
    names = ["Time (s)", "Angle (deg)", ""] * 3
    cells = np.stack([column for k, y in enumerate(ys) for column in (t + later * k, y)], axis=1).astype(str)
    rows = [[*row[:2], "", *row[2:4], "", *row[4:]] for row in cells]
    for separator, labels, runs, tables in (
        (",", ("Run 1", "Run 2", "Run 3"), ["1", "2", "3"], [""] * 3),
        ("\t", ("soft", "stiff", "none"), [""] * 3, ["soft.", "stiff.", "none."]),
        (",", (), [""] * 3, ["pair 1.", "pair 2.", "pair 3."]),
    ):
        top = [cell for label in labels for cell in (label, "", "")][:-2] or ["Operator", "Smith", "rig"]
        lines = [separator.join(row) for row in [top, names[:-1], *rows]]
        raws = read_records(write_lines(tmp_path / "a.csv", lines))
        assert [(raw.unit, raw.run) for raw in raws] == [("deg", run) for run in runs]
        assert [raw.channel for raw in raws] == [f"{table}Angle (deg)" for table in tables]
        for k, raw in enumerate(raws):
            np.testing.assert_allclose(raw.t, t + later * k, atol=1e-9)  # type: ignore[arg-type]
            np.testing.assert_allclose(raw.y, ys[k], atol=1e-6)
