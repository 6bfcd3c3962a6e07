"""Processes forked from a warm interpreter, which has imported what they need.

A start of an interpreter costs 0.3 s of computing with rclpy, and 2 s with a command of this
project; a fork costs 10 ms. A forked process has its own environment, arguments, folder and
standard streams, runs its program as ``__main__`` and ends as an interpreter does, so that what
measures coverage writes its data. Use a real process where the start of an interpreter is tested.

    forking.py FD MODULE ...   serves users that connect to the socket FD; imports the modules first
"""

import atexit
import contextlib
import ctypes
import gc
import hashlib
import importlib
import inspect
import io
import json
import os
import re
import runpy
import select
import signal
import socket
import struct
import subprocess
import sys
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import IO, Any, Self

_MESSAGES = {
    "msg": "action builtin_interfaces diagnostic geometry marginguard sensor shape std tf2",
    "srv": "lifecycle marginguard rcl_interfaces std_srvs",
    "action": "marginguard tf2",
}
PLAIN = (
    *("numpy", "pyigtl", "rclpy.action", "rclpy.executors", "rclpy.serialization"),
    *("rosidl_generator_py", "type_description_interfaces.msg"),
    *(
        f"{name}.{folder}" if "_" in name else f"{name}_msgs.{folder}"
        for folder, names in _MESSAGES.items()
        for name in names.split()
    ),
)
"""Modules of peers with plain rclpy; they do not import the project."""

COMMAND = (
    *("app.cli.main", "app.cli.replay_report", "app.analysis", "app.report", "app.runtime"),
    *("app.bridge.calls", "app.bridge.control", "app.bridge.live", "app.case.readers.mrml"),
    *("app.cli.live_lines", "app.robot.link_kernel", "jinja2", "yaml", "yourdfpy"),
    "rosbags.typesys.stores.ros2_jazzy",
    "tests.loaded_kernels",
)
"""Modules of the commands of this project."""

VIEW = (
    *("app.bridge.displays", "app.cli.replay_page", "app.viewer.drawing.render_loop"),
    *("app.viewer.feeds", "app.viewer.live_operator", "app.viewer.page", "app.viewer.server"),
    *("app.viewer.timeline", "app.viewer.web_app", "trame_slicer.views", *COMMAND),
)
"""Modules of a server of the page."""

LIGHT = ("fcl", "mcap.reader", "numba", "scipy.spatial", "trimesh", "yaml", "app.cli.main")
"""Libraries of the commands. A test may observe or replace what the command imports itself."""

CYCLONE = ("cyclonedds.domain", "cyclonedds.idl", "cyclonedds.pub", "cyclonedds.sub")
"""Modules of peers without ROS."""

OTHER = ()
"""Modules of peers that import another version of ours."""

_SIZE = struct.Struct("<I")
_PID_OR_STATUS = struct.Struct("<i")
PR_SET_PDEATHSIG = 1
_LTTNG_THREADS = 2
"""Threads of the tracing library of ROS, which wait for a tracer."""


class ForkedProcess:
    """A process of a `WarmParent`, with the members of `subprocess.Popen` that tests use."""

    def __init__(self, status: int, stdin: IO[str], *outputs: IO[str] | None) -> None:
        self._status = status
        self.returncode: int | None = None
        self.stdin, (self.stdout, self.stderr) = stdin, outputs
        self.pid: int = _PID_OR_STATUS.unpack(os.read(status, _PID_OR_STATUS.size))[0]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.kill()
        self.wait()
        self.close()

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the end; `TimeoutError` after ``timeout`` s."""
        if self.returncode is None:
            if not select.select([self._status], [], [], timeout)[0]:
                raise TimeoutError(f"process {self.pid} still runs")
            data = os.read(self._status, _PID_OR_STATUS.size)
            # Without a parent there is no status: the process was killed with it.
            killed = -int(signal.SIGKILL)
            self.returncode = _PID_OR_STATUS.unpack(data)[0] if data else killed
            os.close(self._status)
        return self.returncode

    def poll(self) -> int | None:
        """The exit status, or None while the process runs."""
        with contextlib.suppress(TimeoutError):
            self.wait(0.0)
        return self.returncode

    def communicate(self) -> tuple[str, ...]:
        """Close the input and wait for the end; return the outputs, which must fit in pipes."""
        self.stdin.close()
        self.wait()
        return tuple("" if each is None else each.read() for each in (self.stdout, self.stderr))

    def send_signal(self, number: int) -> None:
        """Send the signal if the process still runs."""
        if self.poll() is None:
            with contextlib.suppress(ProcessLookupError):  # its parent reaps it before it tells
                os.kill(self.pid, number)

    def kill(self) -> None:
        """Send SIGKILL."""
        self.send_signal(signal.SIGKILL)

    def terminate(self) -> None:
        """Send SIGTERM."""
        self.send_signal(signal.SIGTERM)

    def close(self) -> None:
        """Close the streams."""
        with contextlib.suppress(BrokenPipeError):
            self.stdin.close()
        for output in (self.stdout, self.stderr):
            if output is not None:
                output.close()


class WarmParent:
    """An interpreter that has imported ``modules`` and forks processes on request.

    All workers of a run share it. It ends with the last of them.
    """

    def __init__(self, modules: Sequence[str]) -> None:
        run = os.environ.get("MARGINGUARD_TEST_RUN", os.getpid())
        digest = hashlib.sha256(" ".join(modules).encode()).hexdigest()[:16]
        self._socket = socket.socket(socket.AF_UNIX)
        self._server: subprocess.Popen[bytes] | None = None
        while True:
            try:
                self._socket.connect(f"\0marginguard-{run}-{digest}")
                return
            except ConnectionRefusedError:
                self._begin(f"\0marginguard-{run}-{digest}", modules)

    def _begin(self, address: str, modules: Sequence[str]) -> None:
        with socket.socket(socket.AF_UNIX) as listener:
            try:
                listener.bind(address)
            except OSError:
                return  # another worker begins it
            listener.listen()
            # One thread: the threads of a BLAS would not exist in a forked process. Its output is
            # buffered, as that of a user's command is.
            environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "PYTHONUNBUFFERED": ""}
            self._server = subprocess.Popen(
                [sys.executable, __file__, str(listener.fileno()), *modules],
                pass_fds=[listener.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                env=environment,
            )

    def start(
        self,
        arguments: Sequence[object],
        *,
        folder: Path | None = None,
        environment: Mapping[str, str] | None = None,
        stdout: int | None = None,
        stderr: int | None = None,
    ) -> ForkedProcess:
        """Start ``script.py ...``, ``-m module ...`` or ``-c program ...`` in this environment.

        Its standard streams are pipes, except outputs that are given as descriptors.
        """
        read_in, write_in = os.pipe()
        read_status, write_status = os.pipe()
        pipes = [os.pipe() if given is None else (None, given) for given in (stdout, stderr)]
        request = {
            "arguments": [str(each) for each in arguments],
            "environment": {**os.environ, **(environment or {})},
            "folder": str(folder or Path.cwd()),
        }
        payload = json.dumps(request).encode()
        given = [read_in, *(write for _, write in pipes), write_status]
        socket.send_fds(self._socket, [_SIZE.pack(len(payload))], given)
        self._socket.sendall(payload)
        for descriptor in (read_in, write_status, *(write for read, write in pipes if read)):
            os.close(descriptor)
        outputs = [None if read is None else os.fdopen(read) for read, _ in pipes]
        return ForkedProcess(read_status, os.fdopen(write_in, "w"), *outputs)

    def close(self) -> None:
        """Let the parent end with its last user; processes that still run then are killed."""
        self._socket.close()
        if self._server is not None:
            self._server.wait()


@cache
def warm_parent(modules: Sequence[str]) -> WarmParent:
    """The parent with these modules, started at the first call."""
    parent = WarmParent(modules)
    atexit.register(parent.close)
    return parent


def parent_of(arguments: Sequence[str]) -> WarmParent:
    """The parent for these arguments: modules are those of the project, scripts are peers."""
    if arguments[0] in ("-m", "-c"):
        return warm_parent(COMMAND)
    kind = Path(arguments[0]).name.partition("_")[0]
    return warm_parent({"cyclone": CYCLONE, "other": OTHER}.get(kind, PLAIN))


def forked(*arguments: object, modules: Sequence[str] = LIGHT, **options: Any) -> ForkedProcess:
    """Start ``-m app.cli ...`` or ``-c program ...``, forked from a parent with ``modules``."""
    return warm_parent(modules).start(arguments, **options)


def run_forked(*arguments: object, **options: Any) -> "subprocess.CompletedProcess[str]":
    """Run a process of `forked` to its end."""
    with forked(*arguments, **options) as process:
        out, err = process.communicate()
        return subprocess.CompletedProcess(arguments, process.wait(), out, err)


class _Server:
    """Forks on request, and reports process ids and exit statuses."""

    def __init__(self, listener: socket.socket) -> None:
        self._listener = listener
        self._users: list[socket.socket] = []
        self._children: dict[int, tuple[int, int]] = {}
        """Process id and descriptor for its status, by the descriptor of the process."""

    def serve(self) -> dict[str, Any] | None:
        """Serve until all users have gone; in a forked process, return its request."""
        while True:
            ready, _, _ = select.select([self._listener, *self._users, *self._children], [], [])
            for each in ready:
                if each is self._listener:
                    self._users.append(each.accept()[0])
                elif each in self._children:
                    self._report(each)
                elif (request := self._answer(each)) is not None:
                    return request
            if not self._users:
                return None

    def _answer(self, user: socket.socket) -> dict[str, Any] | None:
        """Fork on a request of ``user``; in the forked process, return it."""
        size, descriptors, _, _ = socket.recv_fds(user, _SIZE.size, 4)
        if size:
            payload = user.recv(_SIZE.unpack(size)[0], socket.MSG_WAITALL)
            return self._fork(json.loads(payload), descriptors)
        self._users.remove(user)
        user.close()
        return None

    def _fork(self, request: dict[str, Any], descriptors: Sequence[int]) -> dict[str, Any] | None:
        parent, status = os.getpid(), descriptors[3]
        if pid := fork():
            os.write(status, _PID_OR_STATUS.pack(pid))
            self._children[os.pidfd_open(pid)] = (pid, status)
            for descriptor in descriptors[:3]:
                os.close(descriptor)
            return None
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(1)
        for target, descriptor in enumerate(descriptors[:3]):
            os.dup2(descriptor, target)
        statuses = [each for _, each in self._children.values()]
        for descriptor in (*descriptors, *self._children, *statuses):
            os.close(descriptor)
        for connection in (self._listener, *self._users):
            connection.close()
        return request

    def _report(self, process: int) -> None:
        pid, status = self._children.pop(process)
        _, ended = os.waitpid(pid, 0)
        with contextlib.suppress(BrokenPipeError):
            os.write(status, _PID_OR_STATUS.pack(os.waitstatus_to_exitcode(ended)))
        os.close(status)
        os.close(process)


def fork() -> int:
    """`os.fork`; the tracing library of ROS, if it is loaded, restarts its threads in the child.

    Without that, the end of the child would cancel threads that it does not have.
    """
    maps = Path("/proc/self/maps").read_text().split()
    found = [path for path in maps if re.search(r"/liblttng-ust-[0-9a-f]+\.so[^/]*$", path)]
    if not found:
        return os.fork()
    tracing, signals = ctypes.CDLL(found[0]), ctypes.create_string_buffer(128)
    tracing.ust_before_fork(signals)
    pid = os.fork()
    (tracing.ust_after_fork_parent if pid else tracing.ust_after_fork_child)(signals)
    return pid


def _run(request: dict[str, Any]) -> None:
    """Run the program of a request in this forked process."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.environ.clear()
    os.environ.update(request["environment"])
    os.chdir(request["folder"])
    first, *arguments = request["arguments"]
    if first == "-c":
        sys.argv = [first, *arguments[1:]]
        exec(arguments[0], {"__name__": "__main__"})
        return
    if first == "-m":
        sys.path[0] = request["folder"]
        sys.argv = arguments
        runpy.run_module(arguments[0], run_name="__main__", alter_sys=True)
        return
    sys.path.insert(0, str(Path(first).parent))
    sys.argv = [first, *arguments]
    # Not `runpy.run_path`: the module has to stay, for threads and for functions that run at exit.
    main = sys.modules["__main__"] = ModuleType("__main__")
    main.__file__ = first
    with io.open_code(first) as file:
        exec(compile(file.read(), first, "exec"), main.__dict__)


def main() -> None:
    """Import the modules and serve; in a forked process, run its program."""
    descriptor, *modules = sys.argv[1:]
    sys.path[0] = str(Path(__file__).parents[1])
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of a terminal; the tests end this process
    with socket.socket(fileno=int(descriptor)) as listener:
        for module in modules:
            importlib.import_module(module)
        threads = sum(1 for _ in Path("/proc/self/task").iterdir()) - 1
        if threads > _LTTNG_THREADS:
            sys.exit(f"{modules} have started {threads} threads, which a fork would lose")
        # rclpy finds the caller of a log message by a function that looks at all modules once.
        inspect.getmodule(inspect.currentframe())
        gc.collect()
        gc.freeze()  # no collection of a forked process scans what it shares with this one
        request = _Server(listener).serve()
    if request is not None:
        _run(request)


if __name__ == "__main__":
    main()
