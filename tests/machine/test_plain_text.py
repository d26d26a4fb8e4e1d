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


def test_the_message_on_a_large_file_keeps_its_unit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = tmp_path / "large.toml"
    path.write_bytes(b" " * (2**20 + 1))
    monkeypatch.setattr(plain_text, "MOST_BYTES", 2**20)
    message = "cannot be read: it has more than 1 MiB; give a study file"
    with pytest.raises(InputError, match=re.escape(message)):
        read_plain(path, "a study file")


def test_the_message_on_a_pipe_is_a_sentence(tmp_path: Path):
    path = tmp_path / "pipe"
    os.mkfifo(path)
    message = "cannot be read: it is a device or a pipe, not a file; give a study file"
    with pytest.raises(InputError, match=re.escape(message)):
        read_plain(path, "a study file")


def test_the_message_on_a_folder_begins_in_lower_case(tmp_path: Path):
    with pytest.raises(InputError, match="cannot be read: is a directory; give a study file"):
        read_plain(tmp_path, "a study file")
