"""The program as a process that is forked from one which has imported everything: what it does is the same, 0.4 s of
processor time sooner. That it starts as `python -m arva_hil` is for the tests of its start.

As a program it is the server, which forks, one for each worker; `Forked` is what a test sees of a process, as it does
of a `Popen`.
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
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from typing import IO, Any, Final, NoReturn

_PIPE, _DEVNULL = subprocess.PIPE, subprocess.DEVNULL
_MOST: Final = 1 << 17  # bytes of a request


_NO_MATTER: Final = {"PYTHONDONTWRITEBYTECODE", "PYTHONPATH", "PYTHONUNBUFFERED"}  # to what is imported already


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
    these three that it does not have. `speed`: of its clocks. `draws`: its figures, for which it takes as long as to
    fly for 20 s; else their files have no picture.
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
        speed: float = 1.0,
        draws: bool = False,
    ) -> None:
        self.args = arguments
        self.returncode: int | None = None
        null = os.open(os.devnull, os.O_RDWR)
        pipes = {stream: os.pipe() for stream, wanted in (("out", stdout), ("err", stderr)) if wanted == _PIPE}
        ends = (_fd(stdin, null), _fd(stdout, null, pipes.get("out")), _fd(stderr, null, pipes.get("err")))
        environment = dict(os.environ if env is None else env)
        folder = os.fspath(cwd or os.getcwd())
        how = {"closed": [*closed], "speed": speed, "draws": draws}
        said = {"arguments": arguments, "env": environment, "cwd": folder, **how}
        self._status, theirs = os.pipe()
        self.pid, self._pidfd = _fork(json.dumps(said).encode(), [*ends, theirs])
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
    """The id and the pidfd of a new process."""
    server = _server()
    socket.send_fds(server, [request], fds)
    answer, pidfds, _, _ = socket.recv_fds(server, 4, 1)
    return int.from_bytes(answer, "big"), pidfds[0]


def _fd(wanted: Any, null: int, pipe: tuple[int, int] | None = None) -> int:
    if pipe:
        return pipe[1]
    if wanted == _DEVNULL:
        return null
    return int(wanted) if isinstance(wanted, int) else int(wanted.fileno())


def _reader(pipe: tuple[int, int] | None) -> IO[bytes] | None:
    return open(pipe[0], "rb") if pipe else None


_started: Final[list[subprocess.Popen[bytes]]] = []  # nobody waits for it: it ends with this worker


@functools.cache
def _server() -> socket.socket:
    """Started when it is wanted first."""
    here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    command = [sys.executable, "-P", __file__, str(there.fileno())]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    with there:
        _started.append(subprocess.Popen(command, pass_fds=[there.fileno()], env=environment, stdin=_DEVNULL))
    return here


# -- the server --------------------------------------------------------------------------------------------


_SELDOM: Final = ("arva_hil.records.fitting.", "arva_hil.records.ros_messages.")  # scipy and rosbags: a second


def _import_everything() -> None:
    import matplotlib.figure  # noqa: F401 (half a second for each program with figures)

    import arva_hil

    for module in pkgutil.walk_packages(arva_hil.__path__, "arva_hil."):
        if not module.name.endswith("__main__") and not module.name.startswith(_SELDOM):
            importlib.import_module(module.name)


def _serve(requests: socket.socket) -> list[str]:
    """Fork a process for each request. Comes back in the new process, with its arguments; ends with the worker."""
    waiting = selectors.DefaultSelector()
    waiting.register(requests, selectors.EVENT_READ)
    while True:
        for key, _ in waiting.select():
            if key.data:
                _bury(waiting, key)
                continue
            text, fds, _, _ = socket.recv_fds(requests, _MOST, 4)
            if not text:
                os._exit(0)
            *streams, status = fds
            pid = os.fork()
            if not pid:
                for other in list(waiting.get_map().values()):
                    os.close(other.fd)
                    if other.data:
                        os.close(other.data[1])
                requests.detach()
                waiting.close()
                return _become(fds, **json.loads(text))
            for fd in streams:
                os.close(fd)
            pidfd = os.pidfd_open(pid)
            waiting.register(pidfd, selectors.EVENT_READ, (pid, status))
            socket.send_fds(requests, [pid.to_bytes(4, "big")], [pidfd])


def _bury(waiting: selectors.BaseSelector, key: selectors.SelectorKey) -> None:
    """A process has ended: tell its code to who started it."""
    pid, status = key.data
    code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    waiting.unregister(key.fileobj)
    os.close(key.fd)
    with contextlib.suppress(BrokenPipeError):  # nobody wants to know it any more
        os.write(status, str(code).encode())
    os.close(status)


def _become(
    fds: list[int], arguments: list[str], env: dict[str, str], cwd: str, closed: list[int], speed: float, draws: bool
) -> list[str]:
    """What an interpreter does at its start, as far as it depends on who starts it; the arguments."""
    from matplotlib.figure import Figure

    from arva_hil.clock import RealClock

    if not draws:
        Figure.savefig = lambda figure, file, **options: file.write(b"<svg></svg>")
    RealClock.__init__.__defaults__ = (speed,)  # type: ignore[attr-defined]
    os.chdir(cwd)
    for target, fd in enumerate(fds[:3]):
        os.dup2(fd, target)
    for fd in fds:
        os.close(fd)
    os.environ.clear()
    os.environ.update(env)
    sys.path[:0] = [os.path.abspath(place) for place in env.get("PYTHONPATH", "").split(os.pathsep) if place]
    sys.stdin = sys.__stdin__ = open(0, closefd=False)  # noqa: SIM115 (for as long as the program runs)
    sys.stdout = sys.__stdout__ = open(1, "w", closefd=False)  # noqa: SIM115
    sys.stderr = sys.__stderr__ = open(2, "w", 1, errors="backslashreplace", closefd=False)  # noqa: SIM115
    for fd in closed:
        os.close(fd)
        for name in ("stdin", "stdout", "stderr")[fd : fd + 1]:
            setattr(sys, name, None)
            setattr(sys, f"__{name}__", None)
    return arguments


def _end(code: int) -> NoReturn:
    """As an interpreter ends, but its modules go with the process: to take them down takes longer than a command."""
    threading._shutdown()  # type: ignore[attr-defined]
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        if not stream.closed:
            stream.flush()
    os._exit(code)


def _main() -> NoReturn:
    requests = socket.socket(fileno=int(sys.argv[1]))
    _import_everything()
    gc.freeze()
    try:
        arguments = _serve(requests)
    except KeyboardInterrupt:  # typed at the terminal of the tests
        os._exit(130)
    from arva_hil.__main__ import main

    sys.argv = ["arva_hil/__main__.py", *arguments]
    _end(main())


if __name__ == "__main__":
    _main()
