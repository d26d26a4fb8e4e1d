"""Workers of a Dask cluster: clusters without workers, wrong addresses, interrupted runs, files."""

import io
import threading
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray

from bayesdamp.pipeline.workers import cluster
from bayesdamp.store.files import netcdf_bytes
from bayesdamp.types import InputError


def local_cluster(workers: int, folder: Path, processes: bool = False) -> Any:
    """Start a Dask cluster, by default within this process."""
    return pytest.importorskip("distributed").LocalCluster(
        n_workers=workers, threads_per_worker=1, processes=processes, protocol="tcp://", host="127.0.0.1",
        dashboard_address=":0", local_directory=str(folder),
    )  # fmt: skip


@pytest.mark.parametrize("workers", [0, 1])
def test_a_cluster_without_workers_is_reported(workers: int, tmp_path: Path) -> None:
    """Control: a cluster with a worker is not."""
    lines: list[str] = []
    with local_cluster(workers, tmp_path) as dask, cluster(dask.scheduler_address, lines.append):
        pass
    assert len(lines) == 1 - workers
    assert all("it has no worker; waiting for one" in line and len(line) < 300 for line in lines)


@pytest.mark.parametrize(
    "address", ["nowhere://x", pytest.param("tcp://127.0.0.1:1", marks=pytest.mark.slow)]
)
def test_an_address_without_a_scheduler_is_refused(address: str) -> None:
    pytest.importorskip("distributed")
    with pytest.raises(InputError, match="no Dask scheduler answers there"), cluster(address, print):
        pass


def test_a_run_that_waits_for_workers_can_be_interrupted(tmp_path: Path) -> None:
    def interrupted(address: str) -> None:
        with suppress(KeyboardInterrupt), cluster(address, print) as pool:
            pool.submit(abs, -1)
            raise KeyboardInterrupt

    with local_cluster(0, tmp_path) as dask:
        run = threading.Thread(target=interrupted, args=(dask.scheduler_address,), daemon=True)
        run.start()
        run.join(30)
        assert not run.is_alive()


def _draws() -> bytes:
    draws = xarray.Dataset({"zeta": (("chain", "draw"), np.arange(100.0).reshape(2, 50))})
    return netcdf_bytes(xarray.DataTree.from_dict({"posterior": draws}))


def test_draws_are_written_on_a_worker_as_in_one_process(tmp_path: Path) -> None:
    """xarray requests a lock of the file from the cluster, by the file's name."""
    with local_cluster(1, tmp_path) as dask, cluster(dask.scheduler_address, print) as pool:
        content = pool.submit(_draws).result(timeout=120)
    tree = xarray.open_datatree(io.BytesIO(content), engine="h5netcdf")
    assert tree.posterior["zeta"].values.tolist() == np.arange(100.0).reshape(2, 50).tolist()
