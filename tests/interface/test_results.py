"""Every result is printed in a few lines, has a table of pandas, and can be saved and loaded."""

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest

import bayesdamp as bd
from bayesdamp.store.files import write_json
from bayesdamp.types import InputError
from bayesdamp.verdict.parts import DampingRatio, Grade
from bayesdamp.verdict.types import Verdict
from tests.interface.problems import MODEL, fit, record
from tests.report.pages import numbers

mpl.use("Agg")
LINES, WIDTH = 20, 200


@pytest.fixture
def verdict() -> Verdict:
    ratio = DampingRatio(0.3, "rad", 0.011, 1e-4, 2e-4, 0.0105, 0.0115)
    return Verdict("rig", Grade.EXACT, True, "viscous", 0.97, damping_ratio=(ratio,), sentence="Viscous.")


@pytest.fixture(scope="module")
def results() -> dict[str, Any]:
    return {
        "signal": record(),
        "model": MODEL,
        "fit": fit(),
        "density": fit().density,
        "prediction": fit().predict(np.linspace(0.0, 12.0, 50)),
        "estimate": bd.estimate(record(), "least_squares", MODEL),
        "evidence": bd.evidence(fit(), "laplace"),
    }


def test_each_result_is_printed_with_its_numbers(results: dict[str, Any], verdict: Verdict) -> None:
    for name, result in {**results, "verdict": verdict}.items():
        lines = repr(result).splitlines()
        assert len(lines) <= LINES, name
        assert max(map(len, lines)) <= WIDTH, name
        assert result._repr_html_().startswith("<"), name
        table = result.summary()
        assert isinstance(table, pd.DataFrame), name
        assert len(table) > 0, name
        rows = {str(label): row for label, row in (table if len(table) > 1 else table.T).iterrows()}
        for label, *cells in map(str.split, filter(None, lines)):
            stored = [v for v in rows.get(label, ()) if isinstance(v, float) and np.isfinite(v)]
            shown = numbers(" ".join(cells))[: len(stored)]
            assert all(n.is_right(v) for n, v in zip(shown, stored, strict=True)), (name, label)
    prediction = repr(results["prediction"]).splitlines()
    assert prediction[0].endswith(f": {len(prediction) - 2} of 50 times")


def test_each_result_is_saved_and_loaded(results: dict[str, Any], verdict: Verdict, tmp_path: Path) -> None:
    files = {**{f"{n}.bd": r for n, r in results.items() if n != "density"}, "verdict.json": verdict}
    for name, result in files.items():
        loaded = bd.load(result.save(tmp_path / name))
        assert type(loaded) is type(result), name
        pd.testing.assert_frame_equal(loaded.summary(), result.summary())


def test_one_of_several_verdicts_is_loaded_by_its_record(verdict: Verdict, tmp_path: Path) -> None:
    path = tmp_path / "verdict.json"
    write_json(path, [verdict.to_dict(), {**verdict.to_dict(), "record": "ship"}])
    assert Verdict.load(path, "ship").record == "ship"
    with pytest.raises(InputError, match="rig, ship; record= must name one of them"):
        bd.load(path)


@pytest.mark.parametrize("text", ["", '[{"grade": "no"}]'])
def test_a_file_without_a_verdict_is_refused_in_one_line(text: str, tmp_path: Path) -> None:
    path = tmp_path / "broken.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as caught:
        bd.load(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
