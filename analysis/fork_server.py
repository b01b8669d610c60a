"""Fast start of processes: a server that has everything loaded runs each call in a fork of itself.

A process can run only one simulation, and takes seconds to import everything and to load the compiled
kernels. The server does so once; it neither starts SUMO nor any thread. Kernels that a call compiles or loads
for the first time are then loaded by the server, for later calls.

The server ends with the process that started it, and the running calls end with the server, even if it is
killed.
"""

import contextlib
import gc
import importlib
import os
import pickle
import selectors
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple, NoReturn

_MOST_WORDS = 20_000  # bytes kept of a call's standard error
LOADED = ("analysis.campaign.one", "analysis.simulate", "libsumo", "traci", "sumolib")
_DIED = "the process that starts the runs was ended"


class Outcome(NamedTuple):
    """Result of one call."""

    value: Any  # returned by the function
    error: BaseException | None  # raised by the function
    ended_by: int  # number of the signal that ended the process, else 0
    words: str  # the end of its standard error
    seconds: float  # wall-clock, from the fork to the end
    cpu_s: float  # of the process and its children


class ServerError(RuntimeError):
    """The process of a call, or the server, ended without an answer."""


class ForkServer:
    """Runs functions in separate processes, concurrently if called from several threads."""

    def __init__(self, modules: Iterable[str] = LOADED) -> None:
        """modules : names of those that the server imports."""
        self._modules = tuple(modules)
        self._server: tuple[subprocess.Popen[bytes], socket.socket] | None = None
        self._lock = threading.Lock()
        self._closed: set[int] = set()  # pids of servers ended by this process

    def call(self, function: Callable[..., Any], *arguments: Any) -> Outcome:
        """Run an importable function. Raises ServerError if the server was killed twice in a row."""
        request = pickle.dumps((function, arguments))
        for _ in range(2):
            pid, reply = self._ask(request)
            if reply:
                outcome: Outcome = pickle.loads(reply)
                return outcome
            self._end(pid)
            if pid in self._closed:
                break
        raise ServerError(_DIED)

    def result(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Value of the function, raising its error; ServerError if its process was killed."""
        outcome = self.call(function, *arguments)
        if outcome.error is not None:
            raise outcome.error
        if outcome.ended_by:
            raise ServerError(f"the process of the run was ended by signal {outcome.ended_by}")
        return outcome.value

    @property
    def pid(self) -> int | None:
        """Process id of the running server."""
        return None if self._server is None else self._server[0].pid

    def close(self) -> None:
        """End the server and the running calls, which raise ServerError."""
        pid = self.pid
        if pid is not None:
            self._closed.add(pid)
            self._end(pid)

    def __enter__(self) -> "ForkServer":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _ask(self, request: bytes) -> tuple[int, bytes]:
        """Process id of the server, and its reply; b'' if it was killed."""
        ours, theirs = socket.socketpair()
        with ours:
            with theirs, self._lock:
                if self._server is None:
                    self._server = _start(self._modules)
                process, control = self._server
                with contextlib.suppress(OSError):
                    socket.send_fds(control, [b"call"], [theirs.fileno()])
            with contextlib.suppress(OSError):  # killed before reading; the server reports how
                ours.sendall(request)
                ours.shutdown(socket.SHUT_WR)
            return process.pid, _read_all(ours)

    def _end(self, pid: int) -> None:
        with self._lock:
            if self._server is None or self._server[0].pid != pid:
                return  # already done by another thread
            (process, control), self._server = self._server, None
            process.kill()
            process.wait()
            control.close()


def _start(modules: tuple[str, ...]) -> tuple[subprocess.Popen[bytes], socket.socket]:
    ours, theirs = socket.socketpair()
    with theirs:
        process = subprocess.Popen(
            [sys.executable, "-m", "analysis.fork_server", *modules],
            stdin=theirs.fileno(),
            stdout=subprocess.DEVNULL,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        )
    return process, ours


def _read_all(connection: socket.socket) -> bytes:
    parts = []
    with contextlib.suppress(ConnectionResetError):
        while part := connection.recv(1 << 20):
            parts.append(part)
    return b"".join(parts)


# --- in the server


class _Call(NamedTuple):
    """One running call."""

    child: int
    asker: socket.socket  # receives the outcome
    answer: int  # pipe from the child
    parts: list[bytes]  # of its answer so far
    words: Any  # file with its standard error
    begin_s: float


class _Loaded:
    """Kernels that the server has loaded, by module and name, so that forks need not load them again."""

    def __init__(self) -> None:
        self._known: set[tuple[str, str, Any]] = set()

    def news(self) -> list[tuple[str, str, Any]]:
        """In a fork: the kernels compiled or loaded in it."""
        if "sumo_net.compile" not in sys.modules:
            return []
        from sumo_net.compile import KERNELS

        every = [(one.py_func.__module__, one.py_func.__qualname__, one.signatures) for one in KERNELS]
        found = [(module, name, signature) for module, name, all_ in every for signature in all_]
        return [one for one in found if one not in self._known]

    def load(self, news: list[tuple[str, str, Any]]) -> None:
        """In the server: load them from the cache on disk."""
        for one in [one for one in news if one not in self._known]:
            self._known.add(one)
            module, name, signature = one
            with contextlib.suppress(Exception):  # then each fork loads it itself
                getattr(importlib.import_module(module), name).compile(signature)
        if news:
            _share()


def serve() -> None:
    """Take calls from the socket that is standard input, until it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is handled by the forks and the caller
    control = socket.socket(fileno=os.dup(0))
    os.dup2(1, 0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # libsumo's wheel warns about other Arrow versions
        for module in sys.argv[1:]:
            importlib.import_module(module)
    _share()
    _Server(control).serve()


class _Server:
    def __init__(self, control: socket.socket) -> None:
        self._control, self._loaded = control, _Loaded()
        self._alive, self._hold = os.pipe()  # forks hold the read end, only the server the write end
        self._calls: dict[int, _Call] = {}  # by the pipe from the child
        self._ready = selectors.DefaultSelector()

    def serve(self) -> None:
        self._ready.register(self._control, selectors.EVENT_READ)
        while True:
            for key, _ in self._ready.select():
                if key.fileobj is self._control:
                    _, connections, _, _ = socket.recv_fds(self._control, 4, 1)
                    if not connections:
                        return  # the forks end too
                    self._begin(socket.socket(fileno=connections[0]))
                else:
                    self._go_on(self._calls[key.fd])

    def _begin(self, asker: socket.socket) -> None:
        answer, write = os.pipe()
        # closed when the call has ended
        words = tempfile.TemporaryFile()  # noqa: SIM115
        begin = time.monotonic()
        child = os.fork()
        if child == 0:
            self._in_fork(asker, answer, write, words.fileno())
        os.close(write)
        self._calls[answer] = _Call(child, asker, answer, [], words, begin)
        self._ready.register(answer, selectors.EVENT_READ)

    def _in_fork(self, asker: socket.socket, answer: int, write: int, words: int) -> NoReturn:
        try:
            # copies would keep these open, and others wait for their end
            for one in self._calls.values():
                os.close(one.answer)
                one.asker.close()
            for end in (answer, self._hold, self._control.fileno()):
                os.close(end)
            os.dup2(words, 2)
            _work(asker, write, self._alive, self._loaded)
        finally:
            os._exit(1)

    def _go_on(self, call: _Call) -> None:
        part = os.read(call.answer, 1 << 20)
        if part:
            call.parts.append(part)
            return
        self._ready.unregister(call.answer)
        os.close(call.answer)
        del self._calls[call.answer]
        _, status, usage = os.wait4(call.child, 0)
        outcome, news = _outcome(call, status, usage.ru_utime + usage.ru_stime)
        with call.asker, contextlib.suppress(OSError):  # the caller may be gone
            call.asker.sendall(pickle.dumps(outcome))
        self._loaded.load(news)


def _share() -> None:
    gc.collect()
    gc.freeze()  # keeps these pages shared: the forks' collectors do not touch them


def _outcome(call: _Call, status: int, cpu_s: float) -> tuple[Outcome, list[Any]]:
    ended_by = os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0
    value, error, news = None, None, []
    if not ended_by:
        try:
            value, error, news = pickle.loads(b"".join(call.parts))
        except Exception:  # the function called os._exit
            error = ServerError(f"the process of the run ended without an answer, status {status >> 8}")
    with call.words as words:
        words.seek(max(words.seek(0, os.SEEK_END) - _MOST_WORDS, 0))
        said = words.read().decode("utf-8", "replace")
    return Outcome(value, error, ended_by, said, time.monotonic() - call.begin_s, cpu_s), news


def _work(asker: socket.socket, write: int, alive: int, loaded: _Loaded) -> NoReturn:
    """In a fork: one call."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    threading.Thread(target=_end_with_server, args=(alive,), daemon=True).start()
    value, error = None, None
    try:
        with asker:
            request = _read_all(asker)
        function, arguments = pickle.loads(request)
        value = function(*arguments)
        pickle.dumps(value)
    except BaseException as raised:
        value, error = None, _sendable(raised)
    sys.stderr.flush()
    with os.fdopen(write, "wb") as reply:
        reply.write(pickle.dumps((value, error, loaded.news())))
    os._exit(0)


def _end_with_server(alive: int) -> NoReturn:
    os.read(alive, 1)  # nothing is ever written: returns when the server ends
    os._exit(1)


def _sendable(error: BaseException) -> BaseException:
    try:
        pickle.loads(pickle.dumps(error))
    except Exception:
        return RuntimeError(f"{type(error).__name__}: {error}")
    return error


if __name__ == "__main__":
    # imported by name, so that pickled classes are found by other processes
    importlib.import_module("analysis.fork_server").serve()
