"""Compute, read and combine the rows of the contest, one for each record and peer."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any

import pandas as pd

from bayesdamp.types import OK, Refusal
from validation.answers import relation
from validation.contest.environments import Child
from validation.contest.peers.shared import Peer
from validation.contest.records import Record
from validation.rows import read_frame

COLUMNS = (
    "record", "group", "kind", "damping", "restoring", "peer", "outcome", "seconds", "named", "relation",
    *(f"{what}_{i}" for i in (1, 2, 3) for what in ("amplitude", "ratio", "value", "low", "high")),
)  # fmt: skip


def row_of(record: Record, name: str, peer: Peer) -> dict[str, Any]:
    """Let a peer answer a record, and return a row with its reply, the truth and the CPU seconds.

    If the peer refuses the record or raises an exception, the outcome is the message.
    """
    row: dict[str, Any] = {
        "record": record.name, "group": record.group, "kind": record.kind, "damping": record.damping,
        "restoring": record.restoring, "peer": name, "named": "", "relation": "",
    }  # fmt: skip
    for i, (amplitude, ratio) in enumerate(zip(record.amplitudes, record.ratios, strict=True), 1):
        row |= {f"amplitude_{i}": amplitude, f"ratio_{i}": ratio}
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
        row["outcome"] = OK
        row |= {f"value_{i}": v for i, v in enumerate(reply.values, 1)}
        row |= {f"low_{i}": v for i, v in enumerate(reply.low, 1)}
        row |= {f"high_{i}": v for i, v in enumerate(reply.high, 1)}
        if reply.named and record.damping:
            row |= {"named": reply.named, "relation": relation(reply.named, record.damping)}
    row["seconds"] = peer.seconds if isinstance(peer, Child) else time.process_time() - began
    return row


def read(table: Path) -> pd.DataFrame:
    """Return the rows of a table; an empty table if there is no file. Raises InputError if the columns differ."""
    frame = read_frame(table, COLUMNS)
    return frame.astype({"named": "string", "relation": "string"}).fillna({"named": "", "relation": ""})


def of_others(rows: pd.DataFrame, records: Iterable[Record], peers: Collection[str]) -> pd.DataFrame:
    """Return the rows of all other peers, for the records whose truth is unchanged."""
    truth = {r.name: [float(f"{x:.6g}") for x in (*r.amplitudes, *r.ratios)] for r in records}
    columns = [f"{what}_{i}" for what in ("amplitude", "ratio") for i in (1, 2, 3)]
    same = [truth.get(n) == v for n, v in zip(rows["record"], rows[columns].values.tolist(), strict=True)]
    return rows.iloc[[i for i, peer in enumerate(rows["peer"]) if same[i] and peer not in peers]]


def together(rows: pd.DataFrame, other: pd.DataFrame, peers: list[str]) -> pd.DataFrame:
    """Return the rows of both tables; the rows of each record are in the order of the peers."""
    both = pd.concat([rows, other], ignore_index=True) if len(other) else rows
    place = {name: i for i, name in enumerate(dict.fromkeys(both["record"]))}
    keys = [(place[r], peers.index(p)) for r, p in zip(both["record"], both["peer"], strict=True)]
    return both.iloc[sorted(range(len(both)), key=keys.__getitem__)].reset_index(drop=True)
