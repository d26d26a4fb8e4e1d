"""Damage of files: a few random edits of their bytes, which Hypothesis draws and shrinks."""

from dataclasses import dataclass

from hypothesis import strategies as st

MOST_EDITS = 5
LONGEST_SPAN = 400
WORDS = (
    b"nan", b"-inf", b"1e308", b"1e-320", b"9" * 400, b"-", b".", b",", b";", b"\t", b"\n", b"\r", b'"', b"'",
    b"[", b"]", b"{", b"=", b"#", b"%", b"=A1+1", b"99:99", b"2024-02-30", b"deg",
    b"\xc2\xb5", b"\xef\xbb\xbf", b"\x1b[31m",
    b"\x00" * 8, b"\xff" * 8, b"\xff\xff\xff\x7f", b"\x00\x00\x00\x80", b"../", b"true",
)  # fmt: skip
"""Bytes that readers of text and of lengths may not expect."""


@dataclass(frozen=True)
class Edit:
    """An edit of `span` bytes at a fraction `at` of the file; `word` is what some kinds write."""

    kind: str
    at: float
    span: int
    word: bytes

    def of(self, whole: bytes) -> bytes:
        """Return the file with this edit."""
        a = int(self.at * len(whole))
        b = min(a + self.span, len(whole))
        pieces = {
            "insert": (whole[:a], self.word, whole[a:]),
            "overwrite": (whole[:a], self.word, whole[a + len(self.word) :]),
            "remove": (whole[:a], whole[b:]),
            "repeat": (whole[:b], whole[a:b] * 3, whole[b:]),
            "cut off": (whole[:a],),
            "turn bits": (whole[:a], bytes(255 - c for c in whole[a : a + 1]), whole[a + 1 :]),
        }
        return b"".join(pieces[self.kind])


KINDS = ("insert", "overwrite", "remove", "repeat", "cut off", "turn bits")
EDITS = st.builds(
    Edit,
    kind=st.sampled_from(KINDS),
    at=st.floats(0, 1),
    span=st.integers(1, LONGEST_SPAN),
    word=st.sampled_from(WORDS) | st.binary(min_size=1, max_size=8),
)
DAMAGES = st.lists(EDITS, min_size=1, max_size=MOST_EDITS)


def damaged(whole: bytes, edits: list[Edit]) -> bytes:
    """Return the file with all edits, one after another."""
    for edit in edits:
        whole = edit.of(whole)
    return whole
