"""The program as a process that is forked from one which has imported everything: what it does is the same, 0.4 s of
processor time sooner. That it starts as `python -m arva_hil` is for the tests of its start.

As a program it is the server, which forks, one for all workers of a run; `Forked` is what a test sees of a process, as
it does of a `Popen`.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import gc
import importlib
import json
import os
import pkgutil
import select
import selectors
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from typing import IO, Any, Final, NoReturn

_PIPE, _DEVNULL = subprocess.PIPE, subprocess.DEVNULL


_NO_MATTER: Final = {"PYTHONDONTWRITEBYTECODE", "PYTHONUNBUFFERED"}  # to a program that is imported already


def _of_python(environment: Mapping[str, str]) -> dict[str, str]:
    """What another interpreter would take from its environment; an empty value is none."""
    return {
        name: value
        for name, value in environment.items()
        if name.startswith("PYTHON") and value and name not in _NO_MATTER
    }


_AT_START: Final = _of_python(os.environ)


def possible(options: Mapping[str, Any]) -> bool:
    """Whether a process with these options of `Popen` may be forked: it would have had no other interpreter."""
    return (
        hasattr(os, "pidfd_open")
        and options.keys() <= {"stdin", "stdout", "stderr", "env", "cwd"}
        and _of_python(options.get("env", os.environ)) == _AT_START
    )


class Forked:
    """One process. `stdin`, `stdout`, `stderr`: as for Popen, PIPE for the last two at most. `closed`: descriptors of
    these three that it does not have.
    """

    def __init__(
        self,
        arguments: list[str],
        *,
        stdin: Any,
        stdout: Any,
        stderr: Any,
        env: Mapping[str, str] | None,
        cwd: str | os.PathLike[str] | None = None,
        closed: Sequence[int] = (),
    ) -> None:
        self.args = arguments
        self.returncode: int | None = None
        null = os.open(os.devnull, os.O_RDWR)
        pipes = {stream: os.pipe() for stream, wanted in (("out", stdout), ("err", stderr)) if wanted == _PIPE}
        ends = (_fd(stdin, null), _fd(stdout, null, pipes.get("out")), _fd(stderr, null, pipes.get("err")))
        environment = dict(os.environ if env is None else env)
        folder = os.fspath(cwd or os.getcwd())
        request = json.dumps({"arguments": arguments, "env": environment, "cwd": folder, "closed": [*closed]})
        self._status, theirs = os.pipe()
        try:
            self.pid, self._pidfd = _fork(request.encode(), [*ends, theirs])
        except ConnectionError:  # the server saw its last client leave before it saw this one come: there is another
            _server.cache_clear()
            self.pid, self._pidfd = _fork(request.encode(), [*ends, theirs])
        for fd in (null, theirs, *(writer for _, writer in pipes.values())):
            os.close(fd)
        self.stdin = None
        self.stdout, self.stderr = (_reader(pipes.get(stream)) for stream in ("out", "err"))

    def poll(self) -> int | None:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.wait(0)
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        if self.returncode is None:
            if not select.select([self._status], [], [], timeout)[0]:
                raise subprocess.TimeoutExpired(self.args, timeout or 0)
            code = os.read(self._status, 16)
            assert code, "the server that forks has ended"
            self.returncode = int(code)
            os.close(self._status)
            os.close(self._pidfd)
        return self.returncode

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            with contextlib.suppress(ProcessLookupError):
                signal.pidfd_send_signal(self._pidfd, number)

    def terminate(self) -> None:
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)


def _fork(request: bytes, fds: list[int]) -> tuple[int, int]:
    """The id and the pidfd of a new process. Raises ConnectionError if the server has ended."""
    server = _server()
    socket.send_fds(server, [len(request).to_bytes(4, "big")], fds)
    server.sendall(request)
    answer, pidfds, _, _ = socket.recv_fds(server, 4, 1)
    if not answer:
        raise ConnectionError("the server that forks has ended")
    return int.from_bytes(answer, "big"), pidfds[0]


def _fd(wanted: Any, null: int, pipe: tuple[int, int] | None = None) -> int:
    if pipe:
        return pipe[1]
    if wanted == _DEVNULL:
        return null
    return int(wanted) if isinstance(wanted, int) else int(wanted.fileno())


def _reader(pipe: tuple[int, int] | None) -> IO[bytes] | None:
    return open(pipe[0], "rb") if pipe else None


_started: Final[list[subprocess.Popen[bytes]]] = []  # nobody waits for it: it outlives this worker


@functools.cache
def _server() -> socket.socket:
    """Started by the first worker that wants it; it ends with the last one."""
    run = os.environ.get("PYTEST_XDIST_TESTRUNUID", str(os.getpid()))
    address = f"\0arva-hil-{run}"  # of no file
    here = socket.socket(socket.AF_UNIX)
    with socket.socket(socket.AF_UNIX) as there:
        while True:
            try:
                there.bind(address)
                break
            except OSError:  # another worker was first; it listens a moment later, or its server has just ended
                if not here.connect_ex(address):
                    return here
                time.sleep(0.01)
        there.listen(64)
        here.connect(address)
        os.set_inheritable(there.fileno(), True)
        environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
        command = [sys.executable, "-P", __file__, str(there.fileno())]
        _started.append(subprocess.Popen(command, pass_fds=[there.fileno()], env=environment, stdin=_DEVNULL))
    return here


# -- the server --------------------------------------------------------------------------------------------


def _import_everything() -> None:
    import matplotlib.backends.backend_agg  # noqa: F401 (half a second for each program that draws)

    import arva_hil

    for module in pkgutil.walk_packages(arva_hil.__path__, "arva_hil."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)


def _serve(listening: socket.socket) -> list[str]:
    """Fork a process for each request. Comes back in the new process, with its arguments; ends with the last client."""
    waiting = selectors.DefaultSelector()
    waiting.register(listening, selectors.EVENT_READ)
    clients: set[socket.socket] = set()
    while True:
        for key, _ in waiting.select():
            requests = key.fileobj
            if isinstance(requests, int):
                pid, status = key.data
                code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
                waiting.unregister(requests)
                os.close(requests)
                with contextlib.suppress(BrokenPipeError):  # nobody wants to know it any more
                    os.write(status, str(code).encode())
                os.close(status)
                continue
            assert isinstance(requests, socket.socket)
            if requests is listening:
                client = listening.accept()[0]
                if _is_ours(client):
                    clients.add(client)
                    waiting.register(client, selectors.EVENT_READ)
                continue
            fds: list[int] = []
            text = b""
            with contextlib.suppress(ConnectionError):
                size, fds, _, _ = socket.recv_fds(requests, 4, 4)
                text = _exactly(requests, int.from_bytes(size, "big"))
            if not text:
                for fd in fds:
                    os.close(fd)
                waiting.unregister(requests)
                requests.close()
                clients.remove(requests)
                if not clients:
                    os._exit(0)
                continue
            request = json.loads(text)
            pid = os.fork()
            if not pid:
                for key in list(waiting.get_map().values()):
                    os.close(key.fd)
                    if key.data:
                        os.close(key.data[1])
                for other in (listening, *clients):
                    other.detach()
                waiting.close()
                _become(request["env"], request["cwd"], fds, request["closed"])
                return list(request["arguments"])
            *streams, status = fds
            for fd in streams:
                os.close(fd)
            pidfd = os.pidfd_open(pid)
            waiting.register(pidfd, selectors.EVENT_READ, (pid, status))
            with contextlib.suppress(ConnectionError):  # it has gone: what it was waits for nobody
                socket.send_fds(requests, [pid.to_bytes(4, "big")], [pidfd])


def _is_ours(client: socket.socket) -> bool:
    """Whether it is a process of this user: an address that is no file is everybody's."""
    _, user, _ = struct.unpack("3i", client.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))
    return bool(user == os.geteuid())


def _exactly(source: socket.socket, size: int) -> bytes:
    """So many bytes; none if the other side has gone before."""
    data = b""
    while len(data) < size:
        if not (more := source.recv(size - len(data))):
            return b""
        data += more
    return data


def _become(environment: dict[str, str], folder: str, fds: list[int], closed: list[int]) -> None:
    """What an interpreter does at its start, as far as it depends on who starts it."""
    os.chdir(folder)
    for target, fd in enumerate(fds[:3]):
        os.dup2(fd, target)
    for fd in fds:
        os.close(fd)
    os.environ.clear()
    os.environ.update(environment)
    sys.stdin = sys.__stdin__ = open(0, closefd=False)  # noqa: SIM115 (for as long as the program runs)
    sys.stdout = sys.__stdout__ = open(1, "w", closefd=False)  # noqa: SIM115
    sys.stderr = sys.__stderr__ = open(2, "w", 1, errors="backslashreplace", closefd=False)  # noqa: SIM115
    for fd in closed:
        os.close(fd)
        for name in ("stdin", "stdout", "stderr")[fd : fd + 1]:
            setattr(sys, name, None)
            setattr(sys, f"__{name}__", None)


def _end(code: int) -> NoReturn:
    """As an interpreter ends, but its modules go with the process: to take them down takes longer than a command."""
    threading._shutdown()  # type: ignore[attr-defined]
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        if not stream.closed:
            stream.flush()
    os._exit(code)


def _main() -> NoReturn:
    listening = socket.socket(fileno=int(sys.argv[1]))
    _import_everything()
    gc.freeze()
    try:
        arguments = _serve(listening)
    except KeyboardInterrupt:  # typed at the terminal of the tests
        os._exit(130)
    from arva_hil.__main__ import main

    sys.argv = ["arva_hil/__main__.py", *arguments]
    _end(main())


if __name__ == "__main__":
    _main()
