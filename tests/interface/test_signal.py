"""Records and signals: reading, simulating, drawing."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import bayesdamp as bd
from tests.interface.problems import TIMES, TRUTH, closed_form, not_refused, record
from tests.records.tables import write_table

EXACT = closed_form(TIMES, TRUTH)


def test_a_simulation_is_the_closed_form() -> None:
    """Control: a damping that is 0.2 % larger."""
    options = {"stiffness": 20.0, "duration": 6.0, "samples": 150}
    exact, control = (bd.simulate({"viscous": zeta}, "linear", **options).y for zeta in (0.05, 0.0501))
    assert np.max(np.abs(exact - EXACT)) < 1e-7
    assert np.max(np.abs(control - EXACT)) > 1e-5
    oscillator = bd.Oscillator("viscous", "linear")
    assert oscillator == bd.Oscillator(("viscous",), "linear")
    assert bd.trajectory(oscillator, TRUTH, TIMES) == pytest.approx(EXACT, abs=1e-7)


def test_a_signal_is_cut_from_arrays_or_has_all_their_values() -> None:
    t, y = TIMES + 7.0, np.degrees(EXACT)
    assert bd.signal(t, y, unit="deg", cleaned=False).y == pytest.approx(EXACT)
    signal = bd.signal(np.r_[t, np.linspace(13.05, 20.0, 100)], np.r_[y, np.full(100, y[-1])], unit="deg")
    assert signal.t[0] == 0.0
    assert signal.t[-1] < 6.5
    assert signal.whole_t.size == 250
    assert signal.notes
    assert bd.signal(np.cos(4 * np.arange(200_000) / 2000), rate=2000.0).whole_t.size < 50_000, "decimated"


def test_a_rate_may_replace_times_and_a_unit_may_be_written_out() -> None:
    y, options = np.degrees(EXACT), {"rate": (TIMES.size - 1) / TIMES[-1], "unit": "degrees"}
    for signal in (bd.signal(y, **options), bd.signal(y=y, cleaned=False, **options)):
        assert signal.t == pytest.approx(TIMES)
        assert signal.y == pytest.approx(EXACT)
        assert signal.own_unit.name == "deg"


def test_the_unit_determines_the_quantity() -> None:
    expected = {"rad": "angle", "deg/s": "velocity", "g": "acceleration"}
    assert {u: bd.signal(TIMES, EXACT, unit=u, cleaned=False).quantity for u in expected} == expected


def test_a_file_is_read_saved_and_printed(tmp_path: Path) -> None:
    path = write_table(tmp_path / "rig.csv", "t (s),phi (deg)", TIMES, np.degrees(EXACT))
    rig = bd.read(path)
    assert (rig.unit, rig.quantity, rig.runs) == ("deg", "angle", (1,))
    assert rig.units == {"t (s)": "s", "phi (deg)": "deg"}
    assert bd.read(path, unit="degrees").unit == "deg"
    assert rig.signal().y == pytest.approx(EXACT)
    assert len(rig.signals()) == 1
    assert np.array_equal(bd.Record.load(rig.save(tmp_path / "rig.record")).signal().y, rig.signal().y)
    assert "phi" in repr(rig)
    assert "<table>" in rig._repr_html_()


REFUSED: list[tuple[Callable[[], object], str]] = [
    (lambda: bd.signal([1, 2], [3, 4]), "2 samples; a signal needs at least 10"),
    (lambda: bd.signal(TIMES, TIMES[1:]), "vectors of equal length"),
    (lambda: bd.signal(TIMES, np.full(150, np.nan)), "not a finite number"),
    (lambda: bd.signal(TIMES, np.ones(150)), "constant"),
    (lambda: bd.signal(TIMES, TIMES, quantity="angel"), "did you mean 'angle'"),
    (lambda: bd.signal(TIMES[::-1], TIMES, cleaned=False), "times must increase"),
    (lambda: bd.simulate({"viscous": 1.0}, duration=1.0, samples=99), "give stiffness=NUMBER"),
    (lambda: bd.simulate({"viscous": 1}, duration=1, samples=99, stifness=3), "did you mean 'stiffness'"),
    (
        lambda: bd.simulate({"viscous": 1}, "liner", duration=1, samples=99),
        "^simulate: unknown restoring law 'liner'",
    ),
]


def test_misuse_is_refused_in_one_line() -> None:
    assert not_refused(REFUSED) == []


def test_a_file_that_is_not_the_result_is_refused(tmp_path: Path) -> None:
    (tmp_path / "torn").write_bytes(b"PK nothing")
    with pytest.raises(bd.InputError, match="not a result"):
        bd.Fit.load(tmp_path / "torn")
    with pytest.raises(bd.InputError, match="contains a Signal, not a Fit"):
        bd.Fit.load(record().save(tmp_path / "signal"))


def test_releases_are_the_free_decays_of_each_run(tmp_path: Path) -> None:
    """Run 1 is released at 0 and at 40 s, run 2 never."""
    t = np.arange(1600) / 20
    decays = np.exp(-0.1 * (t % 40)) * np.cos(3 * (t % 40))
    noise = np.random.default_rng(1).normal(0, 0.01, (2, t.size))
    head = "Time (s) Run #1,x (m) Run #1,Time (s) Run #2,x (m) Run #2"
    logger = bd.read(write_table(tmp_path / "a.csv", head, t, decays + noise[0], t, noise[1]))
    assert list(logger.releases) == [1, 2]
    with pytest.raises(bd.InputError, match="has no run 4; its runs are"):
        logger.signal(4)
    assert logger.releases[2] == ()
    (first, _), (second, last) = logger.releases[1]
    assert first < 2
    assert 39 < second < 42 < 60 < last
    assert logger.signal(start=second).provenance.start == pytest.approx(second, abs=0.1)
