"""Several restoring laws in one study: a candidate is a damping sum under a law."""

from __future__ import annotations

import json
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from bayesdamp.config import load_study
from bayesdamp.pipeline import answering, cells, run_study, tables
from bayesdamp.pipeline.jobs import NOT_SAMPLED, Contest
from bayesdamp.store import CellResult, Store, read_table
from bayesdamp.store.contents import WeighedCandidate
from bayesdamp.types import Evidence, InputError, candidate_name, candidate_parts

TWO_LAWS = """
version = 1
name = "laws"
[system]
restoring = "linear"
stiffness = 20.0
cubic = 1.0
theta0 = 0.3
omega0 = 0.0
epsilon = 0.05
[[signal]]
name = "swing"
simulate = { viscous = 0.05, coulomb = 0.02, duration = 6.0, samples = 300, rest_angle = 0.0, noise_sd = 0.0 }
[estimators]
use = ["least_squares"]
stages = ["initial"]
[models]
compare = ["viscous", "coulomb"]
restoring = ["linear", "duffing"]
[posterior]
samplers = []
[evidence]
methods = []
"""


def load(folder: Path, text: str = TWO_LAWS):
    file = folder / "laws.toml"
    file.write_text(text, encoding="utf-8")
    return load_study(file)


def test_a_candidates_name_reads_back() -> None:
    assert candidate_parts(candidate_name("viscous+coulomb", "pendulum")) == ("viscous+coulomb", "pendulum")
    assert candidate_parts(candidate_name("viscous")) == ("viscous", "")


def test_every_damping_meets_every_law_with_what_is_known_of_that_law(tmp_path) -> None:
    study = load(tmp_path)
    spec = study.signals[0]
    assert study.compare(spec) == (
        "viscous@linear", "viscous@duffing", "coulomb@linear", "coulomb@duffing",
    )  # fmt: skip
    assert spec.under("duffing").known["cubic"] == 1.0
    assert "cubic" not in spec.under("linear").known
    assert spec.under("duffing").known["stiffness"] == 20.0


def test_one_law_leaves_all_names_and_keys_as_they_were(tmp_path) -> None:
    plain = load(
        tmp_path, TWO_LAWS.replace('restoring = ["linear", "duffing"]\n', "").replace("cubic = 1.0\n", "")
    )
    named = load(
        tmp_path, TWO_LAWS.replace('["linear", "duffing"]', '["linear"]').replace("cubic = 1.0\n", "")
    )
    assert plain.compare(plain.signals[0]) == named.compare(named.signals[0]) == ("viscous", "coulomb")
    assert cells(plain) == cells(named)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('["linear", "duffing"]', '["linear", "dufing"]', "did you mean 'duffing'"),
        ('["linear", "duffing"]', '["linear", "linear"]', "twice"),
        ('["linear", "duffing"]', "[]", "one or more"),
        ("samples = 300", 'samples = 300, unit = "m"', None),
        ('["linear", "duffing"]', '["linear", "pendulum"]', "cubic"),
        ("noise_sd = 0.0 }", 'noise_sd = 0.0 }\nrestoring = ["pendulm"]', "did you mean 'pendulum'"),
    ],
)
def test_a_wrong_law_is_one_line(tmp_path, old: str, new: str, said: str | None) -> None:
    if said is None:  # the negative control: both laws translate
        assert load(tmp_path, TWO_LAWS.replace(old, new))
        return
    with pytest.raises(InputError, match=said) as caught:
        load(tmp_path, TWO_LAWS.replace(old, new))
    assert "\n" not in str(caught.value)


def test_a_pendulum_in_metres_is_refused(tmp_path) -> None:
    text = TWO_LAWS.replace("samples = 300", 'samples = 300, unit = "m"').replace("cubic = 1.0\n", "")
    with pytest.raises(InputError, match="translation, which pendulum is not"):
        load(tmp_path, text.replace('"duffing"', '"pendulum"'))


def test_tables_say_which_law_and_the_report_tells_them_apart(tmp_path) -> None:
    study = load(tmp_path)
    assert run_study(study, tmp_path / "out", workers=1) == 0
    rows = read_table(tmp_path / "out" / "estimates.csv")
    found = {(r["model"], r["restoring"], r["parameter"]) for r in rows}
    assert ("viscous", "linear", "zeta") in found
    assert ("viscous", "duffing", "zeta") in found
    assert ("viscous", "duffing", "rest_angle") in found
    for r in rows:  # another law's own parameters have no truth; the damping has
        other = r["restoring"] == "duffing" and r["parameter"] in ("stiffness", "rest_angle", "cubic")
        assert math.isnan(r["truth"]) == other, r
    about = json.loads((tmp_path / "out" / "run.json").read_text())["signals"]["swing"]
    assert about["restoring"] == ["linear", "duffing"]
    page = (tmp_path / "out" / "report.html").read_text()
    assert "viscous (Duffing)" in page
    assert "viscous (linear)" in page


def test_a_candidate_that_cannot_be_weighed_leaves_the_others_theirs(tmp_path, monkeypatch) -> None:
    """Odds of e² among the two that were weighed, one pruned with nothing; a method that is still to come to a
    candidate gives nobody a share (negative control)."""
    study = load(tmp_path)

    def of(method: str, *logs: float, said: str = "ok") -> dict[str, Evidence]:
        names = study.compare(study.signals[0])
        return {
            name: Evidence(name, method, log, 0.01, outcome="ok" if math.isfinite(log) else said)
            for name, log in zip(names, logs)
        }

    nan = math.nan
    found = {
        "laplace": of("laplace", -5.0, -7.0, nan, nan, said="the posterior has no curvature at its mode"),
        "importance": of(
            "importance", -5.0, -7.0, nan, nan, said="the posterior has no curvature at its mode"
        ),
        "bridge": of("bridge", -5.0, nan, nan, nan, said="no draws"),
    }
    for method in found.values():
        method["coulomb@duffing"] = Evidence("coulomb@duffing", "any", outcome="pruned: far behind")
    monkeypatch.setattr(tables, "evidence_by_method", lambda *_: found)
    rows = list(tables._evidence(study, Store(tmp_path / "run")))
    shares = {(r["method"], r["model"], r["restoring"]): r["probability"] for r in rows}
    first = 1 / (1 + math.exp(-2.0))
    assert shares["importance", "viscous", "linear"] == pytest.approx(first)
    assert shares["importance", "viscous", "duffing"] == pytest.approx(1 - first)
    assert math.isnan(shares["importance", "coulomb", "linear"])
    assert shares["importance", "coulomb", "duffing"] == 0.0
    assert math.isnan(shares["bridge", "viscous", "linear"])


def test_what_evidence_depends_on_is_told_of_all_that_are_not_far_behind(monkeypatch) -> None:
    """Beside those that are sampled; a candidate far behind is left out."""
    heights = {"a": -1.0, "b": -2.0, "c": -5.5, "d": -6.5}
    monkeypatch.setattr(Contest, "_heights", lambda _: heights)
    doubted: set[str] = set()
    monkeypatch.setattr(Contest, "_is_doubtful", lambda _, name: name in doubted)
    study: Any = SimpleNamespace(
        posterior=SimpleNamespace(best=1), compare=lambda _: tuple("dcba"), models=SimpleNamespace(prune=None)
    )
    contest = Contest(study, None, 0, None)  # type: ignore[arg-type]
    assert contest.best_of() == ("a",)
    assert contest.likely() == ("a", "b", "c")
    doubted |= {"c", "d"}  # sampled too, so that bridge and referee can decide; not where it is far behind
    assert contest.best_of() == ("a", "c")
    study.posterior.best = None
    assert set(contest.likely()) == set("abcd")


@pytest.mark.parametrize(
    ("said", "doubtful"),
    [
        *(("ok", False), ("not to be trusted: Pareto k 0.8", True), ("no mode was found", True)),
        *((NOT_SAMPLED, False), ("pruned: far behind", False)),
    ],
)
def test_evidence_in_doubt_is_what_was_tried_and_is_not_trusted(tmp_path, said, doubtful) -> None:
    store = Store(tmp_path)
    for method, outcome in (("laplace", "no curvature"), ("importance", said)):
        store.write(CellResult(f"evidence/swing/0/viscous@linear/{method}", "", outcome=outcome))
    study: Any = SimpleNamespace(
        evidence=SimpleNamespace(methods=("laplace", "importance", "bridge")),
        compare=lambda _: (),
        models=SimpleNamespace(prune=None),
    )
    contest = Contest(study, load(tmp_path).signals[0], 0, store)
    assert contest._is_doubtful("viscous@linear") == doubtful


@pytest.mark.parametrize(("law", "kept"), [(True, {"a", "c"}), (False, {"a", "b"})])
def test_the_first_weighing_leaves_out_by_the_evidence_of_the_laws_that_are_sampled(law, kept, monkeypatch):
    """The best under approximate laws stays either way."""
    rows = [("a", 0.0, -5.0), ("b", -30.0, 0.0), ("c", -3.0, -40.0)]
    weighed = tuple(WeighedCandidate(d, "linear", about, exact) for d, about, exact in rows)
    content = SimpleNamespace(candidates=weighed)
    monkeypatch.setattr(answering.AnswerContent, "maybe", lambda _: content)
    store: Any = SimpleNamespace(find=lambda _: None)
    assert answering.shortlist(store, "s", 0, 20.0, law) == {(d, "linear") for d in kept}
