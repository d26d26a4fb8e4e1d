"""Answers records until its input ends: a file's name a line in, a JSON object a line out."""

import json
import os
import signal
import sys
import time

import numpy as np


def serve(answer, limit):
    """Answer each .npz (t in s, y and amplitudes in rad) with `answer(t, y, amplitudes)`.

    answer: to a dictionary of values, and low, high or named where it has them; ValueError where it has none. limit:
    CPU seconds for one record, at which the process ends.
    """
    out = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # what a package prints is no answer
    for line in sys.stdin:
        with np.load(line.strip()) as given:
            record = given["t"], given["y"], given["amplitudes"]
        began = time.process_time()
        signal.setitimer(signal.ITIMER_PROF, limit)
        try:
            said = {"outcome": "ok", **answer(*record)}
        except Exception as fault:
            said = {"outcome": " ".join(f"{type(fault).__name__}: {fault}".split())[:200]}
        signal.setitimer(signal.ITIMER_PROF, 0)
        out.write(json.dumps(said | {"seconds": time.process_time() - began}) + "\n")
        out.flush()
