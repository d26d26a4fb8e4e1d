"""What the figures rest on: thinning that keeps extremes, densities that respect zero, a palette of few colours."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from bayesdamp.report.drawing import Drawings
from bayesdamp.report.figures.answer import answer
from bayesdamp.report.figures.curves import contours
from bayesdamp.report.figures.posterior import marginals
from bayesdamp.report.figures.record import thinned
from bayesdamp.report.style import colour, dash, looks


def test_thinning_keeps_the_extremes():
    t = np.linspace(0, 100, 100_001)
    y = np.sin(40 * t)
    y[50_123] = 7.0
    at, values = thinned(t, y, 2000)
    assert len(at) <= 2100
    assert y[::50].max() < 7.0  # control: plain decimation loses it
    assert values.max() == 7.0
    assert (at[0], at[-1]) == (t[0], t[-1])
    assert np.all(np.diff(at) > 0)


def test_the_record_of_an_acceleration_is_labelled_as_one() -> None:
    t = np.linspace(0.0, 1.0, 50)
    arrays = {name: np.cos(t) for name in ("record", "fit", "residual")} | {"t": t}
    arrays |= {name: 1 + t for name in ("amplitude", "ratio", "low", "high", "work/viscous")}
    labels = [ax.get_ylabel() for ax in answer(arrays, "m", "viscous", "m/s²").axes]
    assert labels == ["m/s²", "%", "m/s²", "m²/s²"]
    assert [ax.get_ylabel() for ax in answer(arrays, "m", "viscous").axes][::2] == ["m", "m"]


def test_no_law_is_drawn_where_none_is_the_answer() -> None:
    """Only what is measured: the record, the damping ratio and the energy that is lost, as `free/*` have them."""
    t = np.linspace(0.0, 1.0, 50)
    arrays = {"t": t, "record": np.cos(t), "amplitude": 1 + t}
    arrays |= {f"free/{name}": 1 + t for name in ("amplitude", "ratio", "ratio_low", "ratio_high", "lost")}
    for narrow in (False, True):
        record, ratio, energy = answer(arrays, "m", "viscous", narrow=narrow).axes
        assert [ax.get_title(loc="left") or ax.get_title() for ax in (record, ratio, energy)] == [
            "Record",
            "Equivalent damping ratio, measured without a law",
            "Energy lost in a cycle, without a law",
        ]
        assert [len(ax.lines) for ax in (record, ratio, energy)] == [1, 1, 1]


def test_contours_enclose_their_mass():
    """20,000 normal pairs: the share within a level's smooth contour is within 0.03 of it."""
    x, y = np.random.default_rng(4).normal(size=(2, 20_000))
    gx, gy, smooth, levels = contours(x, y)
    assert levels[0] < levels[1]
    inside = smooth[np.searchsorted(gy, y).clip(0, 79), np.searchsorted(gx, x).clip(0, 79)]
    for level, mass in zip(levels, (0.9, 0.5), strict=True):
        assert np.mean(inside >= level) == pytest.approx(mass, abs=0.03)


def _draw() -> Figure:
    figure = Figure(figsize=(3, 2))
    figure.add_subplot().plot([0, 1], [0, 1])
    return figure


def test_one_sum_under_several_laws_is_told_apart():
    """The first has the sum's own colour, the others are ever paler; another sum is not touched. Negative control:
    colours of the sums alone are one."""
    names = ["coulomb@pendulum", "viscous@linear", "coulomb@linear", "coulomb@duffing"]
    styles = [looks(names)[name] for name in names]
    assert styles[0] == (colour("coulomb").lower(), dash("coulomb"))
    assert styles[1][0] == colour("viscous").lower()
    first, _, second, third = (np.array(to_rgb(shade)) for shade, _ in styles)
    assert np.all(second - first > -0.01)
    assert np.sum(second - first) > 0.3
    assert np.sum(third - second) > 0.2
    assert len({colour(n) for n in names if n.startswith("coulomb")}) == 1


def test_a_figure_is_the_same_in_every_report(tmp_path):
    first = Drawings(tmp_path / "a").add("x", "a < b", _draw)
    second = Drawings(tmp_path / "b").add("x", "a < b", _draw)
    assert first == second
    assert "a &lt; b" in first
    for kind in ("svg", "png"):
        assert (tmp_path / "a" / f"x.{kind}").read_bytes() == (tmp_path / "b" / f"x.{kind}").read_bytes()
    assert 'width="216pt"' in (tmp_path / "a" / "x.svg").read_text()


def test_a_figures_name_cannot_leave_the_folder(tmp_path):
    Drawings(tmp_path / "figures").add("../up/x", "caption", _draw)
    assert {p.parent.name for p in tmp_path.rglob("*.svg")} == {"figures"}


def test_the_density_of_any_coefficient_ends_at_zero():
    """That of a user's term too; a parameter that may be negative is drawn beyond it (the negative control)."""
    half = np.abs(np.random.default_rng(0).standard_normal((2, 1000)))
    figure = marginals("sticky", {"nuts": {"c_sticky": half, "slope": half}}, {}, {}, ["c_sticky"])
    coefficient, other = (ax.lines[0].get_xdata() for ax in figure.axes[:2])
    assert np.min(coefficient) >= 0 > np.min(other)
