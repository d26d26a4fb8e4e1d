"""A task that fails says why; what depends on it says which one failed; and the report goes on."""

from __future__ import annotations

import pytest

from bayesdamp.pipeline import records
from bayesdamp.pipeline.run import run_study
from bayesdamp.store import Store, read_table
from tests.studies import ESTIMATED, signal_text, study_text, write_study

SIMULATE = "viscous = 0.1, duration = 10.0, samples = 200, noise_sd = 0.003"
STUDY = study_text(
    ESTIMATED,
    'models = { compare = ["viscous"] }',
    'posterior = { samplers = ["laplace"], noise = ["gaussian", "student_t"] }',
    'evidence = { methods = ["laplace", "importance"], referee = "never" }',
    simulate=SIMULATE,
    name="good",
) + signal_text("bad", SIMULATE)


@pytest.fixture
def study(tmp_path, monkeypatch):
    monkeypatch.delenv("BAYESDAMP_DEBUG", raising=False)
    return write_study(tmp_path, STUDY)


def test_a_failed_record(study, tmp_path, monkeypatch, capsys):
    whole = records.simulate_source

    def failing(source, restoring, truth, name, rng):
        if name == "bad":
            raise ArithmeticError("made to fail")
        return whole(source, restoring, truth, name, rng)

    out = tmp_path / "out"
    with monkeypatch.context() as patch:
        patch.setattr(records, "simulate_source", failing)
        assert run_study(study, out, workers=1) == 3
    said = capsys.readouterr().err.replace("\n", " ")
    assert "signal/bad/0: failed: ArithmeticError: made to fail" in said
    assert "bad/0/viscous" not in said  # one failure, one line
    store = Store(out)
    below = [n for n in store.names() if n.split("/")[1] == "bad" and n != "signal/bad/0"]
    assert len(below) >= 4
    for name in below:
        assert store.read(name).outcome == "not computed: signal/bad/0 failed: ArithmeticError: made to fail"
    rows = read_table(out / "estimates.csv")
    assert {r["outcome"] for r in rows if r["signal"] == "good"} == {"ok"}
    assert "made to fail" in (out / "report.html").read_text(encoding="utf-8")
    # once it can be computed, it is, with all that depends on it
    assert run_study(study, out, workers=1) == 0
    assert {store.read(n).outcome for n in store.names()} == {"ok"}
