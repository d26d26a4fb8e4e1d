"""Every column that is written is in the dictionary, and the dictionary has no column that is not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pytest

from bayesdamp import store
from bayesdamp.calibrate import probabilities
from bayesdamp.calibrate import tables as calibrated
from bayesdamp.physics.damping import all_sums
from bayesdamp.store.columns import SCHEMA, described, unused

WRITTEN: Mapping[str, Sequence[str]] = {
    **store.TABLES,
    **store.SPECIMEN_TABLES,
    "verdicts.csv": store.VERDICTS,
    "damping_curves.csv": ("record", "unit", *store.DAMPING_CURVES),
    "calibration.csv": calibrated.COLUMNS,
    "ranks.csv": calibrated.RANK_COLUMNS,
    "recovery.csv": (*probabilities.RECORD_COLUMNS, *all_sums()),
}


@pytest.mark.parametrize("table", WRITTEN)
def test_the_dictionary_is_whole(table: str) -> None:
    found = described(table, WRITTEN[table])
    assert [c.name for c in found] == list(WRITTEN[table])
    assert all(c.meaning for c in found)
    assert not unused(table, WRITTEN[table])


def test_a_column_that_is_not_there_is_seen() -> None:
    with pytest.raises(KeyError, match="new_column"):
        described("fits.csv", ("signal", "new_column"))
    assert unused("fits.csv", ("signal", "rms")) >= {"rms_unit", "verdict"}


def test_intervals_say_of_what() -> None:
    low, ratio = described("verdicts.csv", ("exponent_low", "ratio_2_high"))
    assert low.meaning == "lower end of the 95 % interval of `exponent`"
    assert ratio.meaning == "upper end of the 95 % interval of `ratio_2`"


def test_the_version_is_a_number() -> None:
    assert isinstance(SCHEMA, int)
