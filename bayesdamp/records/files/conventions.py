"""Numbers that are stored packed, as the Climate and Forecast conventions (CF-1.11, 2.5.1 and 8.1) have it: netCDF, and
what xarray writes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

MISSING = ("_FillValue", "missing_value")


def unpacked(stored: np.ndarray, attributes: Mapping[str, Any]) -> tuple[np.ndarray, str, bool]:
    """(the numbers that stored ones stand for, NaN where a sample is missing; what was done, empty for nothing; whether
    samples are missing).

    attributes: those of the array, of which `scale_factor`, `add_offset`, `_FillValue` and `missing_value` count.
    """
    if stored.dtype.kind not in "fiu":
        return stored, "", False
    said: list[str] = []
    missing = np.zeros(stored.shape, bool)
    for name in MISSING:
        for value in _numbers(attributes, name):
            missing |= stored == value if np.isfinite(value) else np.isnan(stored)
    factor, offset = (_numbers(attributes, name) for name in ("scale_factor", "add_offset"))
    values = stored.astype(float) if factor.size == 1 or offset.size == 1 or missing.any() else stored
    if factor.size == 1:
        values = values * float(factor[0])
        said.append(f"× {float(factor[0]):.6g} (scale_factor)")
    if offset.size == 1:
        values = values + float(offset[0])
        said.append(f"+ {float(offset[0]):.6g} (add_offset)")
    if missing.any():
        values[missing] = np.nan
        said.append(f"{int(missing.sum())} missing (_FillValue)")
    return values, ", ".join(said), bool(missing.any())


def _numbers(attributes: Mapping[str, Any], name: str) -> np.ndarray:
    """The numbers of an attribute, none where it has others."""
    found = np.ravel(attributes[name]) if name in attributes else np.empty(0)
    return found if found.dtype.kind in "fiu" else np.empty(0)
