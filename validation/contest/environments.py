"""Run peers that need other packages: each has its own virtual environment and a child process that answers records."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from bayesdamp.types import Refusal
from validation.contest.peers.shared import Reply

APART = Path(__file__).parent / "apart"
ROOT = Path(__file__).parents[2] / ".contest"
ONE_THREAD = {
    "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MPLBACKEND": "agg",
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
}  # fmt: skip


@dataclass(frozen=True)
class Environment:
    """A virtual environment in the folder .contest/name, into which pip installs the packages."""

    name: str
    packages: tuple[str, ...]

    @property
    def python(self) -> Path:
        """The interpreter of the environment."""
        return ROOT / self.name / "bin" / "python"

    def make(self) -> str:
        """Make the environment if it is missing; return "" on success, else the reason of the failure."""
        ready = ROOT / self.name / ".ready"
        if ready.is_file():
            return ""
        pip = (str(self.python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check")
        commands = ((sys.executable, "-m", "venv", str(ROOT / self.name)), (*pip, *self.packages))
        for command in commands:
            done = subprocess.run(command, capture_output=True, text=True)
            if done.returncode:
                errors = [x for x in done.stderr.splitlines() if x.startswith("ERROR")] or ["it failed"]
                return f"{' '.join(self.packages)} did not install: {errors[-1]}"
        ready.touch()
        return ""


@dataclass
class Child:
    """A peer that runs as a program of `apart` in its own environment.

    The program is started with the first record, and started again if it has ended.
    """

    environment: Environment
    program: str
    arguments: Sequence[str] = ()
    _process: subprocess.Popen[str] | None = field(default=None, repr=False)
    seconds: float = 0.0

    def __call__(self, t: np.ndarray, y: np.ndarray, amplitudes: tuple[float, ...]) -> Reply:
        """Return the reply of the program to a record: times in s, displacements and amplitudes in rad.

        The attribute `seconds` is then the CPU time of this reply, NaN if the program reached its limit. Raises Refusal
        with the reason if there is no answer.
        """
        if self._process is None:
            command = [str(self.environment.python), str(APART / self.program), *self.arguments]
            hidden = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
                env=hidden | ONE_THREAD,
            )  # fmt: skip
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "record.npz"
            np.savez(path, t=t, y=y, amplitudes=np.array(amplitudes))
            process.stdin.write(f"{path}\n")
            process.stdin.flush()
            line = process.stdout.readline()
        if not line:
            self.close()
            self.seconds = float("nan")
            raise Refusal("it reached its limit of CPU time")
        reply = json.loads(line)
        self.seconds = float(reply["seconds"])
        if reply["outcome"] != "ok":
            raise Refusal(reply["outcome"])
        low, high = reply.get("low", ()), reply.get("high", ())
        return Reply(tuple(reply["values"]), tuple(low), tuple(high), reply.get("named", ""))

    def close(self) -> None:
        """End the program."""
        if self._process is not None:
            self._process.communicate()  # closes its input and the other pipes
        self._process = None
