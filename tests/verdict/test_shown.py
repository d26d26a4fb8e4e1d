"""What is shown of a verdict: its table in a notebook, and the arrays of its picture in a record's own unit."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bayesdamp.units import UNITS
from bayesdamp.verdict.parts import DampingRatio, Grade
from bayesdamp.verdict.table import html_table
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.units import LENGTHS, picture_in_unit


def test_a_verdict_is_a_table_in_a_notebook() -> None:
    ratio = DampingRatio(0.2, "rad", 0.01, 1e-4, 1e-4, 0.008, 0.0125)
    shown = Verdict(
        "a", Grade.EXACT, True, "viscous", 0.99, damping_ratio=(ratio,), sentence="Viscous & sure."
    )
    assert shown._repr_html_() == (
        "<table><caption>Viscous &amp; sure.</caption>"
        "<tr><th>amplitude</th><th>equivalent damping ratio</th><th>95 % interval</th></tr>"
        "<tr><td>0.2 rad</td><td>1 %</td><td>0.8 to 1.25 %</td></tr></table>"
    )


def test_rows_of_a_table_are_in_their_order() -> None:
    assert html_table("c", ("a<b",), [("1",), ("2",)]) == (
        "<table><caption>c</caption><tr><th>a&lt;b</th></tr><tr><td>1</td></tr><tr><td>2</td></tr></table>"
    )


def test_lengths_and_energies_of_a_picture_are_in_the_records_unit() -> None:
    """Energies per unit of inertia go with the square of the unit, times and ratios stay."""
    length = sorted(LENGTHS)[0]
    arrays = {length: np.array([0.5]), "work/viscous": np.array([2.0]), "free/ratio": np.array([0.01])}
    shown = picture_in_unit(arrays, UNITS["deg"])
    per = 180 / math.pi
    assert shown[length] == pytest.approx([0.5 * per])
    assert shown["work/viscous"] == pytest.approx([2.0 * per**2])
    assert shown["free/ratio"] is arrays["free/ratio"]
