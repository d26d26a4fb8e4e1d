"""Answer records until the input ends: each input line is a file name, each output line a JSON object."""

import json
import os
import signal
import sys
import time

import numpy as np


def serve(answer, limit):
    """Answer each .npz file named on stdin (t in s, y and amplitudes in rad) with `answer(t, y, amplitudes)`.

    Parameters
    ----------
    answer : callable
        Returns a dictionary with the fields of `Reply` in `validation.contest.peers.shared`: values, and optionally
        low, high and named. Raises ValueError if it has no answer; the message becomes the outcome.
    limit : float
        CPU seconds after which the process ends without an answer to the record.
    """
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # so that the output of a package is not taken for an answer
    for line in sys.stdin:
        with np.load(line.strip()) as given:
            record = given["t"], given["y"], given["amplitudes"]
        began = time.process_time()
        signal.setitimer(signal.ITIMER_PROF, limit)
        try:
            reply = {"outcome": "ok", **answer(*record)}
        except Exception as fault:
            reply = {"outcome": " ".join(f"{type(fault).__name__}: {fault}".split())[:200]}
        signal.setitimer(signal.ITIMER_PROF, 0)
        out.write(json.dumps(reply | {"seconds": time.process_time() - began}) + "\n")
        out.flush()
