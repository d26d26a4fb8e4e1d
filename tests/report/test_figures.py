"""Figures keep extremes, show all labels, and show posteriors where their draws are."""

import numpy as np
import pytest
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import StepPatch

from bayesdamp.physics.damping import all_sums
from bayesdamp.report.drawing import RC, Drawings, fix_margins
from bayesdamp.report.figures.answer import answer, overview
from bayesdamp.report.figures.estimators import estimate_panels
from bayesdamp.report.figures.posterior import marginals
from bayesdamp.report.figures.record import ModelFit, draw_raw_record, record, thin_line
from bayesdamp.report.results.estimators import CoefficientEstimates


def test_thinning_keeps_the_extremes():
    """Control: plain decimation loses them."""
    t = np.linspace(0, 100, 100_001)
    y = np.sin(40 * t)
    y[50_123] = 7.0
    at, values = thin_line(t, y, 2000)
    assert len(at) <= 2100
    assert y[::50].max() < 7.0
    assert values.max() == 7.0
    assert (at[0], at[-1]) == (t[0], t[-1])
    assert np.all(np.diff(at) > 0)


def labels_inside(figure: Figure) -> bool:
    FigureCanvasAgg(figure).draw()
    width, height = figure.bbox.size
    boxes = [box for ax in figure.axes if (box := ax.get_tightbbox()) is not None]
    return all(b.x0 >= 0 and b.y0 >= 0 and b.x1 <= width and b.y1 <= height for b in boxes)


@pytest.mark.parametrize("scale", [3e-7, 1.2e-3, 1.2e4])
def test_labels_of_any_size_are_inside_a_figure_with_fixed_margins(scale: float) -> None:
    """Control: margins that are too narrow."""
    t = np.linspace(0.0, 20.0, 400)
    y = scale * np.exp(-0.1 * t) * np.cos(6 * t)
    arrays = {"t": t, "record": y, "fit": y, "residual": 0.01 * y}
    arrays |= {name: scale * (1 + t) for name in ("amplitude", "free/amplitude")}
    arrays |= dict.fromkeys(("ratio", "low", "high", "free/ratio_low", "free/ratio_high"), 0.01 + 0.001 * t)
    arrays |= {f"law/{name}": 0.01 + 0.0 * t for name in all_sums()} | {"work/viscous": scale**2 * (1 + t)}
    with rc_context(RC):
        figure = answer(arrays, "m", "viscous", "m/s²")
        assert labels_inside(figure)
        assert labels_inside(draw_raw_record(t, y, "acceleration / (m/s²)", 2.0, 15.0))
        without = {name: array for name, array in arrays.items() if name not in ("fit", "residual")}
        assert labels_inside(answer(without, "m", "viscous", ""))
        fix_margins(figure, left=0.2)
        assert not labels_inside(figure)


def test_a_figure_has_its_size_an_escaped_caption_and_a_name_inside_the_folder(tmp_path):
    drawings = Drawings(tmp_path / "figures")
    figure = drawings.add("../up/x", "a < b", lambda: Figure(figsize=(3, 2)).add_subplot().figure)
    assert "a &lt; b" in figure
    (path,) = tmp_path.rglob("*.svg")
    assert path.parent.name == "figures"
    assert 'width="216pt"' in path.read_text()


def test_a_histogram_has_the_area_one_where_the_draws_are() -> None:
    """That of a coefficient does not reach below zero. Control: that of another parameter does."""
    draws = np.random.default_rng(0).standard_normal((2, 1000))
    figure = marginals("sticky", {"nuts": {"c_sticky": np.abs(draws), "slope": draws}}, {}, {"slope": 0.7})
    steps = [next(p for p in ax.patches if isinstance(p, StepPatch)).get_data() for ax in figure.axes[:2]]
    assert [np.sum(s.values * np.diff(s.edges)) for s in steps] == pytest.approx([1, 1])
    assert steps[0].edges[0] >= 0 > steps[1].edges[0]
    assert [line.get_xdata() for ax in figure.axes for line in ax.lines] == [[0.7, 0.7]]  # the true value


def test_a_damping_ratio_and_its_interval_are_drawn_in_per_cent() -> None:
    a, ratio = np.array([0.1, 0.2]), np.array([0.01, 0.02])
    curve = {"amplitude": a, "ratio": ratio, "low": 0.9 * ratio, "high": 1.2 * ratio}
    laws = {"work/viscous": a, "law/viscous": 3 * ratio}
    of_record = answer({"t": a, "record": a, **laws, **curve}, "rad", "viscous", "")
    assert of_record.axes[1].lines[1].get_ydata() == pytest.approx([3, 6])
    for ax in (of_record.axes[1], *overview({"a": list(curve.values())}, "rad").axes):
        ends = ax.collections[0].get_datalim(ax.transData).intervaly
        assert [*ax.lines[0].get_ydata(), *ends] == pytest.approx([1, 2, 0.9, 2.4])


def test_a_panel_of_estimates_says_which_name_is_the_records() -> None:
    """Also if the record has the name of another model."""
    values = {"envelope": 0.031}, {"envelope": 0.05}
    estimate = CoefficientEstimates("viscous", "coulomb", "mu_c", "rad/s²", 0.03, *values, None)
    (ax,) = (ax for ax in estimate_panels([estimate]).axes if ax.get_visible())
    assert ax.get_title() == "record viscous,\nmodel Coulomb"
    assert [line.get_xdata() for line in ax.lines if line.get_marker() == "o"] == [[0.031]]
    assert [text.get_text() for text in ax.texts] == ["0.0500 ▸"]


def test_the_parts_of_a_record_and_the_band_of_white_noise_are_where_they_belong() -> None:
    """95 % of the autocorrelation of white noise is within 2/√n; here n is 400."""
    t = np.linspace(0.0, 20.0, 400)
    used, other = draw_raw_record(t, t, "", 2.0, 15.0, [slice(16.0, 19.0)]).axes[0].patches
    assert [used.get_x(), used.get_width(), other.get_x(), other.get_width()] == [2, 13, 16, 3]
    figure = record(t, t, [ModelFit("viscous", t, t, np.ones(3), "1 rad")], "", "rad", 1.0)
    (band,) = figure.axes[-1].patches
    assert [band.get_y(), band.get_height()] == pytest.approx([-0.1, 0.2])
