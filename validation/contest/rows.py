"""Compute and combine the rows of the contest's table, one for each record and peer."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Iterable, Sequence
from typing import Any

import pandas as pd

from bayesdamp.types import OK, Refusal
from validation.contest.environments import Child
from validation.contest.records import Record
from validation.contest.roster import ROSTER
from validation.scoring import in_columns, relation

COLUMNS = (
    "record", "group", "kind", "damping", "restoring", "peer", "outcome", "seconds", "named", "relation",
    *(f"{what}_{i}" for i in (1, 2, 3) for what in ("amplitude", "ratio", "value", "low", "high")),
)  # fmt: skip


def row_of(record: Record, name: str) -> dict[str, Any]:
    """Let the peer `name` answer a record, and return a row with its reply, the truth and the CPU seconds.

    The column `outcome` is `ok`, or the message if the peer refuses the record or raises an exception.
    """
    row: dict[str, Any] = {
        "record": record.name, "group": record.group, "kind": record.kind, "damping": record.damping,
        "restoring": record.restoring, "peer": name, **record.truth,
    }  # fmt: skip
    peer = ROSTER[name].peer
    began = time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # warnings of other packages are not our concern
            reply = peer(record.t, record.y, record.amplitudes)
        if not all(map(math.isfinite, reply.values)):
            raise Refusal("its ratio is not finite")
    except Refusal as refusal:
        row["outcome"] = str(refusal)
    except Exception as fault:
        row["outcome"] = " ".join(f"{type(fault).__name__}: {fault}".split())[:200]
    else:
        row |= {"outcome": OK, **in_columns(value=reply.values, low=reply.low, high=reply.high)}
        if reply.named and record.damping:
            row |= {"named": reply.named, "relation": relation(reply.named, record.damping)}
    row["seconds"] = peer.seconds if isinstance(peer, Child) else time.process_time() - began
    return row


def with_others(
    rows: pd.DataFrame, kept: pd.DataFrame, records: Iterable[Record], peers: Sequence[str]
) -> pd.DataFrame:
    """Return rows of these peers together with the rows of all other peers from the table `kept`.

    From `kept` only the rows are used whose record is among `records` and has the same truth there. The rows of each
    record are in the order of the roster.
    """
    truth = pd.DataFrame([
        {"record": r.name, **{name: float(f"{value:.6g}") for name, value in r.truth.items()}} for r in records
    ])  # fmt: skip
    other = kept[~kept["peer"].isin(peers)].merge(truth)
    both = pd.concat([rows, other], ignore_index=True)
    order = {"record": list(both["record"].unique()), "peer": list(ROSTER)}
    return both.sort_values(["record", "peer"], key=lambda column: column.map(order[str(column.name)].index))
