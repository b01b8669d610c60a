"""Calls in forks of a loaded process: results, errors, and every way to kill them."""

import os
import signal
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import psutil
import pytest

from analysis.fork_server import ForkServer, ServerError
from sumo_net.settings import SettingsError

LIGHT = ("libsumo",)  # quick to load, and enough for these tests


@pytest.fixture(scope="module")
def server() -> ForkServer:
    with ForkServer(LIGHT) as made:
        yield made


def give(value: int) -> tuple[int, int]:
    return os.getpid(), value


def complain(text: str) -> None:
    print("said on the way", file=sys.stderr)
    raise SettingsError(text)


def kill_myself() -> None:
    print("about to go", file=sys.stderr, flush=True)
    os.kill(os.getpid(), signal.SIGKILL)


def leave() -> None:
    os._exit(3)


def wait(file: str) -> None:
    Path(file).write_text(str(os.getpid()))
    time.sleep(60.0)


def inside() -> tuple[int, bool]:
    import libsumo

    return threading.active_count(), libsumo.isLoaded()


def started(file: Path) -> int:
    """Pid of the call that wrote the file."""
    patience = time.monotonic() + 60.0
    while not (file.exists() and file.read_text()):
        assert time.monotonic() < patience
        time.sleep(0.02)
    return int(file.read_text())


def ended(pid: int) -> bool:
    patience = time.monotonic() + 30.0
    while time.monotonic() < patience:
        if not psutil.pid_exists(pid) or psutil.Process(pid).status() == psutil.STATUS_ZOMBIE:
            return True
        time.sleep(0.02)
    return False


def test_every_call_is_a_process_of_its_own_with_no_simulation_in_it(server: ForkServer) -> None:
    (one, first), (other, second) = server.result(give, 1), server.result(give, 2)
    assert (first, second) == (1, 2)
    assert len({one, other, server.pid, os.getpid()}) == 4
    threads, loaded = server.result(inside)
    assert threads == 2  # its own, and the one that watches the server
    assert not loaded


def test_several_at_once(server: ForkServer) -> None:
    with ThreadPoolExecutor(4) as pool:
        values = list(pool.map(lambda k: server.result(give, k)[1], range(12)))
    assert values == list(range(12))


def test_what_is_raised_and_said_comes_back(server: ForkServer) -> None:
    outcome = server.call(complain, "no such road")
    assert isinstance(outcome.error, SettingsError)
    assert "said on the way" in outcome.words
    with pytest.raises(SettingsError, match="no such road"):
        server.result(complain, "no such road")


def test_a_call_that_is_killed_says_so_and_the_next_one_runs(server: ForkServer) -> None:
    outcome = server.call(kill_myself)
    assert outcome.ended_by == signal.SIGKILL
    assert "about to go" in outcome.words
    with pytest.raises(ServerError, match="signal 9"):
        server.result(kill_myself)
    with pytest.raises(ServerError, match="status 3"):
        server.result(leave)
    assert server.result(give, 5)[1] == 5


def test_killed_while_others_wait_the_others_go_on(server: ForkServer, tmp_path: Path) -> None:
    with ThreadPoolExecutor(2) as pool:
        doomed = pool.submit(server.call, wait, str(tmp_path / "pid"))
        pid = started(tmp_path / "pid")
        assert server.result(give, 7)[1] == 7
        os.kill(pid, signal.SIGKILL)
        assert doomed.result(30.0).ended_by == signal.SIGKILL


def test_a_killed_server_ends_its_calls_and_they_are_run_again(tmp_path: Path) -> None:
    with ForkServer(LIGHT) as server, ThreadPoolExecutor(1) as pool:
        waiting = pool.submit(server.call, wait, str(tmp_path / "pid"))
        pid = started(tmp_path / "pid")
        (tmp_path / "pid").unlink()
        os.kill(server.pid, signal.SIGKILL)
        assert ended(pid)
        again = started(tmp_path / "pid")
        assert again != pid
        server.close()
        with pytest.raises(ServerError):
            waiting.result(30.0)
        assert ended(again)


def test_they_end_with_who_asked(tmp_path: Path) -> None:
    """kill -9 of a worker leaves neither the server nor a run behind."""
    import subprocess

    code = "from tests.analysis.test_fork_server import *; ForkServer(LIGHT).call(wait, sys.argv[1])"
    asker = subprocess.Popen([sys.executable, "-c", code, str(tmp_path / "pid")])
    pid = started(tmp_path / "pid")
    above = psutil.Process(pid).ppid()
    asker.kill()
    asker.wait()
    assert ended(pid)
    assert ended(above)
