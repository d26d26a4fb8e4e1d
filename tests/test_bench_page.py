"""The benchmarks' page: ratios beside those of the run before, and what was lost."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.benchmarks import ledger as ledgers
from tests.benchmarks.ledger import FROM_BEFORE, Ledger, before, losses, ratio, write


def ledger(**ratios: float) -> Ledger:
    return Ledger([("Seconds", ["solver", "s"], [["odeint", "1"]])], dict(ratios))


def test_a_loss_is_shown_and_a_gain_or_a_little_less_is_not(tmp_path: Path) -> None:
    assert write(ledger(slower=10.0, same=10.0, faster=10.0), tmp_path) == []
    assert "since the page before: none." in (tmp_path / "README.md").read_text(encoding="utf-8")
    (line,) = write(ledger(slower=7.9, same=8.1, faster=20.0), tmp_path)
    assert line == "slower: 7.9, was 10 (-21 %)"
    assert f"- {line}" in (tmp_path / "README.md").read_text(encoding="utf-8")
    assert before(tmp_path) == {"slower": 7.9, "same": 8.1, "faster": 20.0}
    assert losses({"new": 1.0}, before(tmp_path)) == []


def test_what_was_not_measured_again_is_kept(tmp_path: Path) -> None:
    write(ledger(one=10.0, other=3.0), tmp_path)
    write(ledger(one=11.0), tmp_path)
    assert before(tmp_path) == {"one": 11.0, "other": 3.0}
    page = (tmp_path / "README.md").read_text(encoding="utf-8")
    assert "| one | 11 |  | 10 |" in page
    assert "| other | 3 |  | kept |" in page
    assert FROM_BEFORE not in page
    write(Ledger([("Others", ["solver"], [["diffrax"]])], {"one": 12.0}), tmp_path)
    page = (tmp_path / "README.md").read_text(encoding="utf-8")
    assert f"## Seconds\n{FROM_BEFORE}| solver | s |" in page
    assert "## Others\n| solver |" in page


def test_a_measurement_beside_itself_is_no_ratio(monkeypatch: pytest.MonkeyPatch) -> None:
    """The control: another that is hardly better."""
    noted = Ledger()
    monkeypatch.setattr(ledgers, "LEDGER", noted)
    seconds = {"ours": 0.3, "theirs": 0.3000001}
    with pytest.raises(ValueError, match="compared with itself"):
        ratio("theirs / ours", seconds["ours"] / seconds["ours"])
    assert noted.ratios == {}
    ratio("theirs / ours", seconds["theirs"] / seconds["ours"])
    assert list(noted.ratios) == ["theirs / ours"]
