"""What several of these tests need: functions for other processes, and a Dask cluster."""

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = str(Path(__file__).parent)
sys.path.append(FOLDER)  # Workers get this process's path.

import worker_functions  # noqa: E402


class Cluster:
    """A Dask scheduler and workers, each a process of its own on this machine."""

    def __init__(self, folder):
        self._folder = folder
        self.processes = []
        file = folder / "scheduler.json"
        self.scheduler = self._start(
            "scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", file
        )
        self.address = worker_functions.wait_for(lambda: self._address(file), "the scheduler")

    @staticmethod
    def _address(file):
        with contextlib.suppress(FileNotFoundError, ValueError):
            return json.loads(file.read_text())["address"]

    def _start(self, kind, *arguments):
        path = os.pathsep.join([FOLDER, os.environ.get("PYTHONPATH", "")])
        with (self._folder / f"{kind}{len(self.processes)}.log").open("w") as log:
            process = subprocess.Popen(
                [sys.executable, "-m", "dask", kind, *map(str, arguments), "--no-dashboard"],
                cwd=self._folder, stdout=log, stderr=log, start_new_session=True,
                env=os.environ | {
                    "PYTHONPATH": path, "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1",
                },
            )  # fmt: skip
        self.processes.append(process)
        return process

    def add_worker(self, *, threads=1):
        """Starts a worker, which is this very process: no nanny starts another in its place."""
        options = ["--nthreads", threads, "--no-nanny", "--local-directory", self._folder]
        return self._start("worker", self.address, *options)

    def worker_address(self, worker):
        """Where a worker listens, as its log says when it does."""
        log = self._folder / f"worker{self.processes.index(worker)}.log"
        found = worker_functions.wait_for(
            lambda: re.search(r"Start worker at: +(tcp\S+)", log.read_text()), "the worker's start"
        )
        return found[1]

    def end(self):
        """Kills everything: there is nothing to be saved."""
        for process in self.processes:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


@pytest.fixture
def cluster(tmp_path_factory):
    """A scheduler without workers."""
    cluster = Cluster(tmp_path_factory.mktemp("dask"))
    yield cluster
    cluster.end()
