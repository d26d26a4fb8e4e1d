"""A comparison of envelopes resumes."""

from bayesdamp.cli import main
from bayesdamp.interface import envelopes
from tests.envelope.test_command import written


def test_a_comparison_computes_only_what_depends_on_a_changed_file(tmp_path, monkeypatch):
    names: list[str] = []
    analyse = envelopes.analyse

    def counted(record, *rest):
        names.append(record.name)
        return analyse(record, *rest)

    monkeypatch.setattr(envelopes, "analyse", counted)
    files = [str(written(tmp_path / f"r{k}.txt", k)) for k in (1, 2, 3)]
    command = ["compare", *files, "--workers", "1", "--out", str(tmp_path / "out")]
    assert main(command) == 0
    assert names == ["r1", "r2", "r3"]
    written(tmp_path / "r2.txt", 5)
    for again in (["r2"], []):
        names.clear()
        assert main(command) == 0
        assert names == again
