"""A task that fails says why, tasks that depend on it name it, and the other tasks and the report are made."""

from bayesdamp.pipeline import records
from bayesdamp.pipeline.run import run_study
from bayesdamp.store.files import read_table
from bayesdamp.store.results import Store
from tests.studies import ESTIMATED, signal_text, study_text, write_study

SIMULATE = "viscous = 0.1, duration = 10.0, samples = 200, noise_sd = 0.003"
STUDY = study_text(
    ESTIMATED,
    'models = { compare = ["viscous"] }',
    'posterior = { samplers = ["nuts"], noise = ["gaussian", "student_t"] }',
    'evidence = { methods = ["laplace", "importance"], referee = "never" }',
    simulate=SIMULATE,
    name="good",
) + signal_text("bad", SIMULATE)


def test_tasks_that_depend_on_a_failed_record_name_it_and_are_computed_later(tmp_path, monkeypatch, capsys):
    monkeypatch.delenv("BAYESDAMP_DEBUG", raising=False)
    study, simulate = write_study(tmp_path, STUDY), records.simulate_source

    def failing(source, restoring, truth, name, rng):
        if name == "bad":
            raise ArithmeticError("made to fail")
        return simulate(source, restoring, truth, name, rng)

    out = tmp_path / "out"
    with monkeypatch.context() as patch:
        patch.setattr(records, "simulate_source", failing)
        assert run_study(study, out, workers=1) == 3
    printed = capsys.readouterr().err.replace("\n", " ")
    assert "signal/bad/0: failed: ArithmeticError: made to fail" in printed
    assert "bad/0/viscous" not in printed  # one failure, one line
    store = Store(out)
    dependent = [n for n in store.names() if n.split("/")[1] == "bad" and n != "signal/bad/0"]
    assert len(dependent) >= 4
    for name in dependent:
        assert store.read(name).outcome == "not computed: signal/bad/0 failed: ArithmeticError: made to fail"
    assert {r["outcome"] for r in read_table(out / "estimates.csv") if r["signal"] == "good"} == {"ok"}
    assert "made to fail" in (out / "report.html").read_text(encoding="utf-8")
    assert run_study(study, out, workers=1) == 0
    assert {store.read(n).outcome for n in store.names()} == {"ok"}
