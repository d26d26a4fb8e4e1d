"""A cell's content as a value, and back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Self

from bayesdamp.serial import join, split
from bayesdamp.store.cells import CellResult
from bayesdamp.types import InputError


class OtherVersionError(InputError, ValueError):
    """What is stored is not what this version stores."""


@dataclass(frozen=True)
class Content:
    """What a cell of one kind holds beside its arrays. Subclasses are frozen dataclasses of what JSON can hold."""

    @classmethod
    def of(cls, cell: CellResult) -> Self:
        """Of a cell that has a content of this kind. Raises OtherVersionError where it holds something else."""
        return cls.of_meta(cell.meta)

    @classmethod
    def maybe(cls, cell: CellResult | None) -> Self | None:
        """Of a cell that may be missing, or hold nothing but why there is no result: None then."""
        return cls.of_meta(cell.meta) if cell is not None and cell.meta else None

    @classmethod
    def of_meta(cls, meta: Mapping[str, Any]) -> Self:
        """What `meta` gave, after a file. Raises OtherVersionError."""
        try:
            own = {f.name for f in fields(cls)}
            return join(cls, {name: value for name, value in meta.items() if name in own})
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            what = "was stored by another version of bayesdamp; compute it again with this one"
            raise OtherVersionError(f"{what} ({error})") from None

    def meta(self) -> dict[str, Any]:
        """As a cell holds it."""
        return split(self)
