"""Tasks that try to leave a worker process, for tests of the sandbox. Each returns what it got."""

import ctypes
import fcntl
import functools
import importlib
import os
import resource
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import FunctionType

from twolink.errors import TwolinkError


def read(*, at: str) -> str:
    return Path(at).read_text()


def listing(*, at: str) -> list[str]:
    return os.listdir(Path(at).parent)


def write(*, at: str) -> int:
    return Path(at).write_text("written by a worker")


def link(*, at: str) -> str:
    """Reads through a link in a folder of its own."""
    place = Path(os.environ["TMPDIR"]) / "link"
    place.unlink(missing_ok=True)
    place.symlink_to(at)
    return place.read_text()


def remove(*, at: str) -> None:
    Path(at).unlink()


def give_away(*, at: str) -> None:
    os.chown(at, os.getuid(), os.getgid())


def tcp(*, port: int) -> str:
    with socket.create_connection(("127.0.0.1", port), timeout=5) as connection:
        return connection.recv(100).decode()


def udp(*, port: int) -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        return sender.sendto(b"x", ("127.0.0.1", port))


def pair() -> int:
    """An unbound socket of a pair can send to any named one."""
    one, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    one.close()
    other.close()
    return 1


def program() -> str:
    return subprocess.run([sys.executable, "-c", "print(1)"], check=True, capture_output=True, text=True).stdout


def execute() -> None:
    os.execv("/bin/true", ["/bin/true"])


def forked() -> int:
    process = os.fork()
    if process == 0:
        os._exit(0)
    return os.waitpid(process, 0)[0]


def c_library() -> None:
    if ctypes.CDLL(None, use_errno=True).system(b"true") != 0:
        raise PermissionError


def trace() -> int:
    """PTRACE_SEIZE on the parent."""
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.ptrace(0x4206, os.getppid(), None, None) != 0:
        raise PermissionError(ctypes.get_errno(), "ptrace")
    return libc.ptrace(17, os.getppid(), None, None)


def memory_of_the_service() -> int:
    return len(Path(f"/proc/{os.getppid()}/environ").read_bytes())


def signal_the_service() -> None:
    os.kill(os.getppid(), 0)


def owner_of_signals() -> None:
    """A signal of one's own choice, to the parent, when something can be read."""
    end, other = os.pipe()
    fcntl.fcntl(end, fcntl.F_SETOWN, os.getppid())
    os.close(end)
    os.close(other)


def limits_of_the_service() -> None:
    """The limit that ends a process by its processor time."""
    resource.prlimit(os.getppid(), resource.RLIMIT_CPU, resource.getrlimit(resource.RLIMIT_CPU))


def priority_of_the_service() -> None:
    os.setpriority(os.PRIO_PROCESS, os.getppid(), os.getpriority(os.PRIO_PROCESS, os.getppid()))


def processors_of_the_service() -> None:
    os.sched_setaffinity(os.getppid(), os.sched_getaffinity(os.getppid()))


def disk_priority_of_the_service() -> None:
    if ctypes.CDLL(None, use_errno=True).syscall(251, 1, os.getppid(), 0) != 0:  # ioprio_set on x86-64
        raise PermissionError(ctypes.get_errno(), "ioprio_set")


def permissions(*, at: str) -> None:
    os.chmod(at, 0o644)


def times(*, at: str) -> None:
    os.utime(at, (1, 1))


def name_of_the_machine() -> None:
    socket.sethostname(socket.gethostname())


def all_calls(*, some: list[int]) -> dict[int, int]:
    """The error of each of these system calls, with arguments of no use."""
    libc = ctypes.CDLL(None, use_errno=True)

    def error(number: int) -> int:
        ctypes.set_errno(0)
        libc.syscall(number, *[ctypes.c_ulong(2**64 - 1)] * 6)
        return ctypes.get_errno()

    return {number: error(number) for number in some}


def environment() -> dict[str, str]:
    return dict(os.environ)


def status() -> dict[str, str]:
    lines = Path("/proc/self/status").read_text().splitlines()
    return {key: value.strip() for key, _, value in (line.partition(":") for line in lines)}


def death_signal() -> int:
    value = ctypes.c_int()
    ctypes.CDLL(None).prctl(2, ctypes.byref(value), 0, 0, 0)  # PR_GET_PDEATHSIG
    return value.value


def late_import() -> str:
    """Libraries are imported when they are first needed, a user's own ones too."""
    return str(importlib.import_module("installed_for_one_user").WORD)


def compute() -> dict[str, float]:
    """What tasks need: threads, a figure, compiled code on several threads, files of its own."""
    import numpy as np

    import twolink as tl
    from twolink.show.figure import new_figure, save_figure

    thread = threading.Thread(target=sum, args=([1],))
    thread.start()
    thread.join()
    save_figure(new_figure(1, size=(3, 2))[0], Path(os.environ["TMPDIR"]) / "own.svg")
    robot = tl.load_robot("panda")
    batch = robot.forward_dynamics(np.tile(robot.neutral, (5000, 1)), np.zeros((5000, 9)), np.zeros((5000, 9)))
    return {"batch": float(batch.std(axis=0).max())}


def _told(task: Callable[..., object]) -> Callable[..., object]:
    """The task, whose denial has the code "denied"."""

    @functools.wraps(task)
    def run(**arguments: object) -> object:
        try:
            return task(**arguments)
        except PermissionError as error:
            raise TwolinkError(str(error), code="denied") from None

    return run


_TASKS = {name: task for name, task in globals().items() if isinstance(task, FunctionType) and name[0] != "_"}
TASKS = {name: _told(task) for name, task in _TASKS.items()}
