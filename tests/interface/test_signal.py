"""Records and signals: what is read, made and drawn."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest

import bayesdamp as bd
from tests.interface.problems import TIMES, TRUTH, closed_form, not_refused, record


def test_simulated_is_the_closed_form() -> None:
    made = bd.simulate({"viscous": 0.05}, "linear", stiffness=20.0, duration=6.0, samples=150)
    assert np.max(np.abs(made.y - closed_form(TIMES, TRUTH))) < 1e-7
    # The negative control.
    made = bd.simulate({"viscous": 0.0501}, "linear", stiffness=20.0, duration=6.0, samples=150)
    assert np.max(np.abs(made.y - closed_form(TIMES, TRUTH))) > 1e-5


def test_arrays_as_they_are_and_cleaned() -> None:
    t, y = TIMES + 7.0, np.degrees(closed_form(TIMES, TRUTH))
    rest = np.linspace(13.05, 20.0, 100)
    assert bd.signal(t, y, unit="deg", cleaned=False).y == pytest.approx(closed_form(TIMES, TRUTH))
    whole = bd.signal(np.r_[t, rest], np.r_[y, np.full(100, y[-1])], unit="deg")
    assert whole.t[0] == 0.0
    assert whole.t[-1] < 6.5
    assert whole.whole_t.size == 250
    assert whole.notes


def test_a_rate_in_place_of_times_and_a_unit_as_it_is_written() -> None:
    unit = "degrees"
    rate, y = (TIMES.size - 1) / TIMES[-1], np.degrees(closed_form(TIMES, TRUTH))
    for made in (bd.signal(y, rate=rate, unit=unit), bd.signal(y=y, rate=rate, unit=unit, cleaned=False)):
        assert made.t == pytest.approx(TIMES)
        assert made.y == pytest.approx(closed_form(TIMES, TRUTH))
        assert made.own_unit.name == "deg"


def test_a_unit_of_another_quantity_says_which() -> None:
    y = closed_form(TIMES, TRUTH)
    said = [bd.signal(TIMES, y, unit=unit, cleaned=False) for unit in ("rad", "deg/s", "g")]
    assert [s.quantity for s in said] == ["angle", "velocity", "acceleration"]


def test_a_trajectory_of_an_oscillator_by_its_names() -> None:
    body = bd.Oscillator("viscous", "linear")
    assert body == bd.Oscillator(("viscous",), "linear")
    assert bd.trajectory(body, TRUTH, TIMES) == pytest.approx(closed_form(TIMES, TRUTH), abs=1e-7)


def test_a_file(tmp_path: Path) -> None:
    path = tmp_path / "rig.csv"
    table = np.c_[TIMES, np.degrees(closed_form(TIMES, TRUTH))]
    np.savetxt(path, table, delimiter=",", header="t (s),phi (deg)", comments="")
    found = bd.read(path)
    assert (found.unit, found.quantity, found.runs) == ("deg", "angle", (1,))
    assert found.units == {"t (s)": "s", "phi (deg)": "deg"}
    assert bd.read(path, unit="degrees").unit == "deg"
    assert found.signal().y == pytest.approx(closed_form(TIMES, TRUTH))
    assert len(found.signals()) == 1
    again = bd.Record.load(found.save(tmp_path / "rig.record"))
    assert np.array_equal(again.signal().y, found.signal().y)
    assert "phi" in repr(found)
    assert "<table>" in found._repr_html_()
    assert found.plot().get_xlabel() == "time / s"
    plt.close("all")


WRONG: list[tuple[Callable[[], object], str]] = [
    (lambda: bd.signal([1, 2], [3, 4]), "2 samples; a signal needs at least 10"),
    (lambda: bd.signal(TIMES, TIMES[1:]), "vectors of equal length"),
    (lambda: bd.signal(TIMES, np.full(150, np.nan)), "not a finite number"),
    (lambda: bd.signal(TIMES, np.ones(150)), "constant"),
    (lambda: bd.signal(TIMES, TIMES, unit="degre"), "did you mean 'deg'"),
    (lambda: bd.signal(TIMES, TIMES, quantity="angel"), "did you mean 'angle'"),
    (lambda: bd.signal(TIMES[::-1], TIMES, cleaned=False), "times must increase"),
    (lambda: bd.simulate({"viscous": 1.0}, duration=1.0, samples=99), "give stiffness=NUMBER"),
    (lambda: bd.simulate({"viscous": 1}, duration=1, samples=99, stifness=3), "did you mean 'stiffness'"),
    (
        lambda: bd.simulate({"viscous": 1}, "liner", duration=1, samples=99),
        "^simulate: unknown restoring law 'liner'",
    ),
    (lambda: bd.simulate({"viscos": 1}, duration=1, samples=99), "^simulate: unknown damping term 'viscos'"),
    (lambda: bd.read("nowhere.csv"), "no such file"),
]


def test_misuse_is_one_line() -> None:
    assert not_refused(WRONG) == []


def test_a_file_that_is_no_result(tmp_path: Path) -> None:
    (tmp_path / "torn").write_bytes(b"PK nothing")
    with pytest.raises(bd.InputError, match="not a result"):
        bd.Fit.load(tmp_path / "torn")
    with pytest.raises(bd.InputError, match="contains a Signal, not a Fit"):
        bd.Fit.load(record().save(tmp_path / "signal"))


def test_a_file_of_several_runs_is_a_record_of_several_runs(tmp_path: Path) -> None:
    path = tmp_path / "logger.csv"
    y = closed_form(TIMES, TRUTH)
    header = ",".join(f"Time (s) Run #{i},Angle (deg) Run #{i}" for i in (1, 2, 3))
    np.savetxt(path, np.c_[TIMES, y, TIMES, 2 * y, TIMES, 3 * y], delimiter=",", header=header, comments="")
    record = bd.read(path)
    assert (record.runs, record.unit) == ((1, 2, 3), "deg")
    sizes = [float(np.ptp(signal.y)) for signal in record.signals()]
    assert np.allclose(np.array(sizes) / sizes[0], [1, 2, 3], rtol=1e-2)
    assert [one.run for one in bd.read(path, runs="1,3").raw] == ["1", "3"]
    with pytest.raises(bd.InputError, match="has no run 4; its runs are"):
        record.signal(4)


def test_releases_are_the_free_decays_of_each_run(tmp_path: Path) -> None:
    """Run 1 is let go at 0 and at 40 s, run 2 never."""
    path, t = tmp_path / "a.csv", np.arange(1600) / 20
    twice = np.exp(-0.1 * (t % 40)) * np.cos(3 * (t % 40))
    noise = np.random.default_rng(1).normal(0, 0.01, (2, t.size))
    columns = np.c_[t, twice + noise[0], t, noise[1]]
    header = "Time (s) Run #1,x (m) Run #1,Time (s) Run #2,x (m) Run #2"
    np.savetxt(path, columns, delimiter=",", header=header, comments="")
    record = bd.read(path)
    assert list(record.releases) == [1, 2]
    assert record.releases[2] == ()
    (first, _), (second, last) = record.releases[1]
    assert first < 2
    assert 39 < second < 42 < 60 < last
    assert record.signal(start=second).provenance.start == pytest.approx(second, abs=0.1)
