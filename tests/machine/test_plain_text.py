"""Tests of the messages on files of the user that cannot be read."""

import os
import re
from pathlib import Path

import pytest

from bayesdamp import plain_text
from bayesdamp.plain_text import read_plain
from bayesdamp.types import InputError


def test_reads_a_file_with_a_byte_order_mark(tmp_path: Path):
    path = tmp_path / "study.toml"
    path.write_bytes("﻿name = 'ä'\n".encode())
    assert read_plain(path, "a study file") == "name = 'ä'\n"


@pytest.mark.parametrize(
    ("write", "why"),
    [
        (lambda path: path.write_bytes(b" " * (2**20 + 1)), "it has more than 1 MiB"),
        (os.mkfifo, "it is a device or a pipe, not a file"),
        (Path.mkdir, "is a directory"),
    ],
)
def test_what_cannot_be_read_says_why(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, write, why: str):
    monkeypatch.setattr(plain_text, "MOST_BYTES", 2**20)
    write(tmp_path / "a.toml")
    with pytest.raises(InputError, match=re.escape(f"cannot be read: {why}; give a study file")):
        read_plain(tmp_path / "a.toml", "a study file")
