"""A verdict on the terminal, in a table and in a notebook, and the arrays of its figures in the record's unit."""

import io
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from bayesdamp.report.terminal import VerdictPrinter
from bayesdamp.types import UNITS
from bayesdamp.verdict.parts import DampingRatio, Grade, Oscillation
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.units import LENGTH_ARRAYS, picture_in_unit

SURE = Verdict("a", Grade.EXACT, True, "viscous", 0.99)


def printed(*verdicts: Verdict) -> str:
    console = Console(record=True, file=io.StringIO(), width=200)
    show = VerdictPrinter(console)
    for verdict in verdicts:
        show(verdict)
    return console.export_text()


def test_a_verdict_is_a_table_in_a_notebook() -> None:
    ratio = DampingRatio(0.2, "rad", 0.01, 1e-4, 1e-4, 0.008, 0.0125)
    html = replace(SURE, damping_ratio=(ratio,), sentence="Viscous & sure.")._repr_html_()
    assert "Viscous &amp; sure." in html
    assert '<th class="t">amplitude</th><th>equivalent damping ratio (95 %)</th>' in html
    assert '<td class="t">0.2 rad</td><td>1.00 % (0.80 to 1.25)</td>' in html


def test_the_noise_is_on_the_terminal_and_in_the_table() -> None:
    verdict = replace(SURE, noise_pct=0.345)
    assert "Noise: 0.34 % of the first amplitude." in printed(verdict)
    assert verdict.row()["noise_pct"] == 0.345
    assert "Noise" not in printed(SURE)  # control: not known, not shown


def test_other_motions_are_in_a_table() -> None:
    mode = Oscillation(1.1, 0.01, 0.009, 0.011, 0.2, 0.13, "rad")
    lines = printed(replace(SURE, grade=Grade.NO_FREE_DECAY, modes=(mode,))).splitlines()
    cells = [[cell.strip() for cell in line.split("│")[1:-1]] for line in lines if line.startswith("│")]
    assert cells == [["1.1 Hz", "1.00 % (0.90 to 1.10)", "0.2 rad", "0.13 rad"]]


def test_the_sampled_sentence_is_printed_too() -> None:
    """Once each, so that the terminal has the numbers of the page; also if it corrects the first one."""
    first = DampingRatio(0.1, "rad", 0.02, 1e-4, 0.0, 0.0198, 0.0202)
    answers = (first, "The first."), (replace(first, value=0.02004), "The sampled.")
    text = printed(*(replace(SURE, sentence=s, damping_ratio=(r,)) for r, s in answers))
    assert text.count("The first.") == text.count("The sampled.") == 1
    confirmed = text.index("the damping ratios differ by at most 0.4 standard deviations.")
    assert confirmed < text.index("The sampled.")
    assert "Another." in printed(SURE, replace(SURE, damping="coulomb", sentence="Another."))


def test_lengths_and_energies_of_a_figure_are_in_the_unit_of_the_record() -> None:
    """Energies per unit of inertia change with the square of the unit; damping ratios do not change."""
    energies = ("work/viscous", "work/coulomb", "free/lost")
    arrays = {name: np.array([0.5]) for name in (*LENGTH_ARRAYS, *energies, "free/ratio")}
    per = np.degrees(1.0)
    factors = dict.fromkeys(LENGTH_ARRAYS, per) | dict.fromkeys(energies, per**2) | {"free/ratio": 1.0}
    converted = {n: x.item() for n, x in picture_in_unit(arrays, UNITS["deg"]).items()}
    assert converted == pytest.approx({n: 0.5 * f for n, f in factors.items()})
