"""A cluster's workers: in what order they sum, and what is said where there are none."""

from __future__ import annotations

import io
import threading
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray

from bayesdamp.inference import diagnostics
from bayesdamp.pipeline.workers import cluster
from bayesdamp.types import InputError, Posterior


def local_cluster(workers: int, folder: Path, processes: bool = False) -> Any:
    """A Dask cluster of so many workers, by default within this process."""
    return pytest.importorskip("distributed").LocalCluster(
        n_workers=workers, threads_per_worker=1, processes=processes, protocol="tcp://", host="127.0.0.1",
        dashboard_address=":0", local_directory=str(folder),
    )  # fmt: skip


@pytest.mark.parametrize("workers", [0, 1])
def test_that_there_are_no_workers_is_said(workers: int, tmp_path: Path) -> None:
    """Negative control: nothing is said where there is one."""
    said: list[str] = []
    with local_cluster(workers, tmp_path) as made, cluster(made.scheduler_address, said.append):
        pass
    assert len(said) == 1 - workers
    assert all("it has no worker; waiting for one" in line and len(line) < 300 for line in said)


@pytest.mark.parametrize(
    "address", ["nowhere://x", pytest.param("tcp://127.0.0.1:1", marks=pytest.mark.slow)]
)
def test_an_address_that_no_scheduler_answers_is_refused(address: str) -> None:
    pytest.importorskip("distributed")
    with pytest.raises(InputError, match="no Dask scheduler answers there"), cluster(address, print):
        pass


def test_a_run_that_waits_for_workers_can_be_ended(tmp_path: Path) -> None:
    def interrupted(address: str) -> None:
        with suppress(KeyboardInterrupt), cluster(address, print) as pool:
            pool.submit(abs, -1)
            raise KeyboardInterrupt

    with local_cluster(0, tmp_path) as made:
        run = threading.Thread(target=interrupted, args=(made.scheduler_address,), daemon=True)
        run.start()
        run.join(30)
        assert not run.is_alive()


def _draws() -> bytes:
    posterior = Posterior("nuts", ("zeta",), np.arange(100.0).reshape(2, 50, 1), np.zeros((2, 50)), {})
    return diagnostics.to_netcdf(posterior)


def test_draws_are_written_on_a_worker_as_in_one_process(tmp_path: Path) -> None:
    """xarray asks the cluster for a lock of the file, by its name."""
    with local_cluster(1, tmp_path) as made, cluster(made.scheduler_address, print) as pool:
        found = pool.submit(_draws).result(timeout=120)
    read = xarray.open_datatree(io.BytesIO(found), engine="h5netcdf")
    assert read.posterior["zeta"].values.tolist() == np.arange(100.0).reshape(2, 50).tolist()
