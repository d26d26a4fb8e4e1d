"""Which of a file's columns were taken for its records, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

MOST = 6
"""Columns that are named of those that are left out."""


class Why(Enum):
    """What a column has that those beside it have not, in words."""

    DIES = "swings and dies down"
    DIES_FOR_GOOD = "swings and dies down for good"


@dataclass(frozen=True)
class Choice:
    """The column that alone was taken, or of several records those beside them that were left out.

    taken: its name; why: what told it from the others; changing: how many columns change, it among them; still: how
    many beside it do not. left_out: names of columns that do not swing and die down, where several were taken.
    """

    taken: str = ""
    why: Why = Why.DIES
    changing: int = 1
    still: int = 0
    left_out: Sequence[str] = ()

    def __str__(self) -> str:
        """In a sentence."""
        if self.left_out:
            return f"Left out are columns that do not swing and die down: {', '.join(self.left_out[:MOST])}."
        return f"Column {self.taken} is taken: {self._reason()}."

    def _reason(self) -> str:
        if self.changing > 1:
            alone = f"of {self.changing} that change it alone {self.why.value}"
            return f"{alone}, but for copies and derivatives of it"
        if not self.still:
            return "nothing else goes with these times"
        one = self.still == 1
        said = "is only one column that does" if one else f"are only {self.still} columns that do"
        return f"beside it {said} not change"
