"""What a Dask scheduler's address may be instead, and schedulers that nothing comes from."""

import os
import signal
import socket
import subprocess
import sys
import threading
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from mffdrake.experiment.runs.executors.cluster import ClusterError, DaskCluster

GRID = """
scenario: {duration: 0.1, renderer: flat, camera: {width: 64, height: 48}}
grid: {method: [ga, mff]}
"""


class Quiet(BaseHTTPRequestHandler):
    def log_message(self, *_):
        pass


@contextmanager
def web_server():
    with ThreadingHTTPServer(("127.0.0.1", 0), Quiet) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server.server_port
        server.shutdown()
        thread.join()


@contextmanager
def silent_port():
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server.getsockname()[1]


@contextmanager
def greeting_port(greeting=b"SSH-2.0-OpenSSH_9.9\r\n"):
    """It says something first, as many servers do."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        connections = []

        def greet():
            try:
                while True:
                    connections.append(server.accept()[0])
                    connections[-1].sendall(greeting)
            except OSError:  # The end.
                pass

        thread = threading.Thread(target=greet)
        thread.start()
        yield server.getsockname()[1]
        server.shutdown(socket.SHUT_RDWR)
        thread.join()
        for connection in connections:
            connection.close()


@contextmanager
def closed_port():
    with silent_port() as port:
        pass
    yield port


TROUBLES = {
    web_server: "(something else answers there|has not answered within 10 s)",
    silent_port: "something listens there, but has not answered within 10 s",
    greeting_port: "something else answers there",
    closed_port: "Connection refused",
}


@pytest.mark.parametrize("place", TROUBLES, ids=lambda place: place.__name__)
def test_what_is_no_scheduler_is_said_in_a_line(place):
    with place() as port:
        start = f"no Dask scheduler at 'tcp://127.0.0.1:{port}': "
        with pytest.raises(ClusterError) as error, DaskCluster(f"tcp://127.0.0.1:{port}"):
            pass
    assert str(error.value).startswith(start)
    assert error.match(f"{TROUBLES[place]}; an address is such as tcp://127.0.0.1:8786")
    assert "\n" not in str(error.value)


def test_a_workers_address_is_told_from_a_schedulers(cluster):
    with DaskCluster(cluster.address):
        pass
    worker = cluster.worker_address(cluster.add_worker())
    with pytest.raises(ClusterError, match="a Dask worker answers there"), DaskCluster(worker):
        pass


@contextmanager
def sweep(folder, address):
    (folder / "grid.yaml").write_text(GRID)
    with subprocess.Popen(
        [sys.executable, "-m", "mffdrake", "sweep", "grid.yaml", "--scheduler", address],
        cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        env=os.environ | {"TQDM_DISABLE": "1"},
    ) as process:  # fmt: skip
        try:
            yield process
        finally:
            process.kill()


def test_a_sweep_on_a_web_server_ends_with_one_line_and_status_2(tmp_path):
    with web_server() as port, sweep(tmp_path, f"127.0.0.1:{port}") as process:
        (line,) = process.stderr
        assert process.wait() == 2
    assert line.startswith(f"mffdrake: error: no Dask scheduler at '127.0.0.1:{port}': ")


def test_ctrl_c_while_nobody_answers_needs_no_traceback(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as server:
        with sweep(tmp_path, f"127.0.0.1:{server.getsockname()[1]}") as process:
            accepted = [server.accept()[0] for _ in range(2)]  # The second one asks.
            process.send_signal(signal.SIGINT)
            assert process.stderr.read() == "mffdrake: interrupted\n"
            assert process.wait() == 130
        for connection in accepted:
            connection.close()


def test_a_sweep_without_workers_says_so_and_goes_on_when_one_joins(cluster, tmp_path):
    with sweep(tmp_path, cluster.address) as process:
        assert "has no workers; waiting for some to join" in process.stderr.readline()
        cluster.add_worker()
        assert process.stderr.read() == ""
        assert process.wait() == 0


def test_a_scheduler_that_hangs_is_told_and_ctrl_c_ends_the_sweep(cluster, tmp_path):
    with sweep(tmp_path, cluster.address) as process:
        assert "has no workers" in process.stderr.readline()
        cluster.scheduler.send_signal(signal.SIGSTOP)
        assert "has not answered for 10 s; waiting for it" in process.stderr.readline()
        process.send_signal(signal.SIGINT)
        assert process.stderr.read() == "mffdrake: interrupted\n"
        assert process.wait() == 130
