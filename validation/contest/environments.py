"""Peers with packages of their own: an environment for each, and a child process that answers records."""

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
from validation.contest.reply import Reply

APART = Path(__file__).parent / "apart"
ROOT = Path(__file__).parents[2] / ".contest"
ONE_THREAD = {
    "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MPLBACKEND": "agg",
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
}  # fmt: skip


@dataclass(frozen=True)
class Environment:
    """name: its folder in .contest, made with `packages` by pip."""

    name: str
    packages: tuple[str, ...]

    @property
    def python(self) -> Path:
        """Its interpreter."""
        return ROOT / self.name / "bin" / "python"

    @property
    def ready(self) -> bool:
        """Whether all packages are installed."""
        return (ROOT / self.name / ".ready").is_file()

    def make(self) -> str:
        """Make it where it is not there; "" or why it could not be made."""
        if self.ready:
            return ""
        pip = (str(self.python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check")
        commands = ((sys.executable, "-m", "venv", str(ROOT / self.name)), (*pip, *self.packages))
        for command in commands:
            done = subprocess.run(command, capture_output=True, text=True)
            if done.returncode:
                said = [x for x in done.stderr.splitlines() if x.startswith("ERROR")] or ["it failed"]
                return f"{' '.join(self.packages)} did not install: {said[-1]}"
        (ROOT / self.name / ".ready").touch()
        return ""


@dataclass
class Child:
    """A program in `apart`, run by an environment's Python; begun with the first record, and again where it ends."""

    environment: Environment
    program: str
    arguments: Sequence[str] = ()
    _process: subprocess.Popen[str] | None = field(default=None, repr=False)
    seconds: float = 0.0

    def __call__(self, t: np.ndarray, y: np.ndarray, amplitudes: tuple[float, ...]) -> Reply:
        """Raises Refusal with what the program says instead of an answer; `seconds` has the CPU time it took."""
        process = self._begun()
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
            raise Refusal("it was not done within its CPU time")
        said = json.loads(line)
        self.seconds = float(said["seconds"])
        if said["outcome"] != "ok":
            raise Refusal(said["outcome"])
        low, high = said.get("low", ()), said.get("high", ())
        return Reply(tuple(said["values"]), tuple(low), tuple(high), said.get("named", ""))

    def close(self) -> None:
        """End the program."""
        if self._process is not None:
            self._process.communicate()  # closes its input, and what is left of its pipes
        self._process = None

    def _begun(self) -> subprocess.Popen[str]:
        if self._process is None:
            command = [str(self.environment.python), str(APART / self.program), *self.arguments]
            hidden = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
                env=hidden | ONE_THREAD,
            )  # fmt: skip
        return self._process
