"""How a record was read: the same after a file, and as earlier runs wrote it."""

from __future__ import annotations

import json

from bayesdamp.types import FreeDecay, Provenance

WHOLE = Provenance(
    warnings=("no unit is said.",),
    notes=("Kept are 100 samples.",),
    header_lines=2,
    facts={"Fs": 100.0, "who": "me"},
    time_column="t",
    value_column="phi (deg)",
    time_unit="file",
    first_line=3,
    constant_columns=("temperature",),
    unit="deg",
    start=1.5,
    stop=9.0,
    offset=0.01,
    decays=(FreeDecay(1.5, 9.0), FreeDecay(12.0, 20.0)),
    more={"format": "text", "samples": 100},
)


def test_it_is_the_same_after_a_file() -> None:
    for one in (WHOLE, Provenance(), Provenance(more={"simulated": True})):
        assert Provenance.of(json.loads(json.dumps(one.to_dict()))) == one
