"""Rights of a worker process: read the program, write its own folders, compute. Nothing else, where Linux can say so.

Landlock (Linux 5.13 and later) limits the files that a process may open, and from 6.7 and 6.12 on TCP and signals;
seccomp refuses all system calls but those that tasks need. Both hold for native code too, and cannot be taken back.
They are set with plain system calls: the libraries for them (py-landlock, pyseccomp) wrap the same few calls, and one
needs a C library that few machines have.

Sources: Linux, Documentation/userspace-api/landlock.rst and seccomp_filter.rst; the numbers of the calls are those of
arch/x86/entry/syscalls/syscall_64.tbl and include/uapi/asm-generic/unistd.h.
"""

import contextlib
import ctypes
import errno
import os
import platform
import struct
import sys
import threading
import tomllib
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import msgspec

from twolink.errors import TwolinkError

_NO_NEW_PRIVS, _SET_SECCOMP, _FILTER = 38, 22, 2  # of prctl
_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446  # system calls, on all processors
_ASK_VERSION, _PATH_BENEATH = 1, 1
# Rights of files: which bits the versions of Landlock know, and those that readers and writers get.
_RIGHTS = {1: 2**13 - 1, 2: 2**14 - 1, 3: 2**15 - 1, 4: 2**15 - 1, 5: 2**16 - 1}
_OF_FILES = 0b1100_0000_0000_0111  # execute, write, read a file, truncate, ioctl
_READ = 0b1100  # a file, a folder
_WRITE = _READ | 0b0110_0001_1011_0010  # write, remove and make files and folders, rename between folders, truncate
_OF_NETWORK = ("/etc", Path.home() / ".config" / "dask", "/proc/stat", "/proc/net")
_TCP, _SIGNALS_AND_SOCKETS = 0b11, 0b11  # what is refused from version 4 on, and from 6 on

_X86_64, _AARCH64 = 0xC000003E, 0xC00000B7  # AUDIT_ARCH_...
_Instruction = tuple[int, int, int, int]
_Asked = tuple[int, int, int, bool]
_CALLS: dict[str, dict[str, list[int]]] = tomllib.loads(
    Path(__file__).with_name("system_calls.toml").read_text("utf-8")
)
_CLONE3, _UNKNOWN = 435, 452  # from which on calls are newer than the table
_ALLOW, _KILL, _REFUSE = 0x7FFF0000, 0x80000000, 0x00050000  # SECCOMP_RET_ALLOW, KILL_PROCESS, ERRNO | number
_LOAD, _EQUAL, _NOT_LESS, _ANY_BIT, _JUMP, _RETURN = 0x20, 0x15, 0x35, 0x45, 0x05, 0x06  # instructions of the filter
_ARGUED = {"clone": (56, 220), "fcntl": (72, 25), "prctl": (157, 167), "prlimit64": (302, 261), "tgkill": (234, 131)}
_FIRST, _SECOND, _THIRD, _THIRD_HIGH = 16, 24, 32, 36  # where the words of arguments are
_ASKED: list[tuple[str, list[_Asked]]] = [
    ("clone", [(_FIRST, _ANY_BIT, 0x10000, True)]),  # a thread
    ("fcntl", [(_SECOND, _NOT_LESS, 8, False)]),  # neither F_SETOWN nor F_SETSIG: they send signals
    ("fcntl", [(_SECOND, _NOT_LESS, 36, True)]),
    *(("prctl", [(_FIRST, _EQUAL, option, True)]) for option in (2, 15, 16, 0x53564D41)),  # names; PR_GET_PDEATHSIG
    ("prlimit64", [(word, _EQUAL, 0, True) for word in (_FIRST, _THIRD, _THIRD_HIGH)]),  # read its own limits
    ("tgkill", [(_FIRST, _EQUAL, os.getpid(), True)]),
]


class Protection(msgspec.Struct, frozen=True):
    """Confinement of worker processes, as was tried on this machine. landlock: its version; 0: none."""

    landlock: int
    seccomp: bool

    @property
    def complete(self) -> bool:
        """True if files and system calls are limited."""
        return bool(self.landlock and self.seccomp)

    def __str__(self) -> str:
        files = (
            f"limited by Landlock {self.landlock}" if self.landlock else "NOT limited (this system refuses Landlock)"
        )
        calls = "limited by seccomp" if self.seccomp else "NOT limited (this system refuses seccomp)"
        return f"worker processes: files {files}; network, programs and other processes {calls}"


def protection() -> Protection:
    """The protection that this machine offers: a thread tries it, as limits of a thread end with it."""
    if sys.platform != "linux":
        return Protection(0, False)
    found: list[int] = []

    def attempt() -> None:
        version = max(0, _libc().syscall(_CREATE_RULESET, None, ctypes.c_size_t(0), _ASK_VERSION))
        with contextlib.suppress(TwolinkError):
            _check(_libc().prctl(_NO_NEW_PRIVS, *map(ctypes.c_ulong, (1, 0, 0, 0))))
            files = version and _holds(lambda: _limit_files(version, (), False), lambda: os.listdir("/"))
            found.append(version if files else 0)
            calls = _processor() and _holds(lambda: _limit_calls(False), lambda: os.kill(os.getpid(), 0))
            found.append(bool(calls))

    thread = threading.Thread(target=attempt)
    thread.start()
    thread.join()
    landlock, seccomp = (*found, 0, 0)[:2]
    return Protection(landlock, bool(seccomp))


def _holds(limit: Callable[[], object], forbidden: Callable[[], object]) -> bool:
    """True if a limit can be set, and what it forbids is refused then."""
    try:
        limit()
        forbidden()
    except PermissionError:
        return True
    except TwolinkError:
        pass
    return False


def restrict(writable: Sequence[Path], *, network: bool = False) -> None:
    """Limit this process, which must have one thread, for ever: to the program's files, and to writing some folders.

    What the machine cannot do is left out.

    Parameters
    ----------
    writable : sequence of Path
        The folders that may be written.
    network : bool
        Whether it may use the network, and read what that takes: /etc, and the settings of Dask.

    Raises
    ------
    TwolinkError
        Code "no-sandbox": the system refuses what it says it can do.
    """
    can = protection()
    if not can.landlock and not can.seccomp:
        return
    _check(_libc().prctl(_NO_NEW_PRIVS, *map(ctypes.c_ulong, (1, 0, 0, 0))))
    if can.landlock:
        _limit_files(can.landlock, writable, network)
    if can.seccomp:
        _limit_calls(network)


def _program() -> Iterable[str | Path]:
    """Files and folders that the interpreter, its libraries and the package read."""
    import twolink
    from twolink.robots.catalogue import our_urdfs

    yield from twolink.__path__
    yield our_urdfs()
    yield from (sys.prefix, sys.base_prefix)
    yield from (place for place in sys.path if {"site-packages", "dist-packages"} & set(Path(place).parts))
    yield from filter(None, os.environ.get("LD_LIBRARY_PATH", "").split(":"))
    yield from ("/usr", "/lib", "/lib64", "/nix/store", "/etc/ld.so.cache", "/etc/localtime", "/etc/fonts")
    yield from ("/proc/self", "/proc/cpuinfo", "/proc/meminfo", "/sys/devices/system/cpu", "/sys/fs/cgroup")
    yield from ("/dev/urandom", "/dev/random", "/dev/zero")


def _limit_files(version: int, writable: Sequence[Path], network: bool) -> None:
    rights = _RIGHTS[min(version, max(_RIGHTS))]
    kinds = [rights, *[0 if network else _TCP] * (version >= 4), *[_SIGNALS_AND_SOCKETS] * (version >= 6)]
    content = struct.pack(f"{len(kinds)}Q", *kinds)
    rules = _check(_libc().syscall(_CREATE_RULESET, content, ctypes.c_size_t(len(content)), 0))
    try:
        for path in (*_program(), *(_OF_NETWORK if network else ())):
            _allow(rules, path, _READ & rights)
        for path in (*writable, Path("/dev/null")):
            _allow(rules, path, _WRITE & rights)
        _check(_libc().syscall(_RESTRICT_SELF, rules, 0))
    finally:
        os.close(rules)


def _allow(rules: int, path: str | Path, rights: int) -> None:
    """Allow `rights` at a path and below it, if it exists."""
    try:
        place = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return
    try:
        if not os.path.isdir(path):
            rights &= _OF_FILES
        _check(_libc().syscall(_ADD_RULE, rules, _PATH_BENEATH, struct.pack("=Qi", rights, place), 0))
    finally:
        os.close(place)


def _limit_calls(network: bool) -> None:
    """Refuse all system calls but those of the table, new processes included; threads are allowed."""
    code = _filter(_processor() or 0, network)
    content = ctypes.create_string_buffer(b"".join(struct.pack("=HBBI", *instruction) for instruction in code))
    program = struct.pack("HxxxxxxP", len(code), ctypes.addressof(content))
    _check(_libc().prctl(_SET_SECCOMP, _FILTER, program, 0, 0))


def _filter(processor: int, network: bool) -> list[_Instruction]:
    """The instructions (code, steps to jump if true, if false, value) that judge a system call."""
    column = 0 if processor == _X86_64 else 1
    calls = _CALLS["all"] | (_CALLS["network"] if network else {})
    numbers = [pair[column] for pair in calls.values() if len(pair) > column]
    return [
        (_LOAD, 0, 0, 4),  # the processor's kind: 32-bit calls have other numbers
        (_EQUAL, 1, 0, processor),
        (_RETURN, 0, 0, _KILL),
        (_LOAD, 0, 0, 0),  # the number of the call
        *((_EQUAL, len(numbers) - k, 0, number) for k, number in enumerate(numbers)),
        (_JUMP, 0, 0, 1),
        (_RETURN, 0, 0, _ALLOW),
        *(each for call, asked in _ASKED for each in _if(_ARGUED[call][column], asked)),
        (_LOAD, 0, 0, 0),
        (_NOT_LESS, 2, 0, 0x40000000),  # x32 has numbers of its own
        (_NOT_LESS, 2, 0, _UNKNOWN),  # libc takes another where there is no such call
        (_EQUAL, 1, 0, _CLONE3),  # its flags are in memory
        (_RETURN, 0, 0, _REFUSE | errno.EPERM),
        (_RETURN, 0, 0, _REFUSE | errno.ENOSYS),
    ]


def _if(number: int, asked: Sequence[_Asked]) -> list[_Instruction]:
    """Allow a call where its arguments are as asked: (offset of a word, instruction, value, answer)."""
    left = 2 * len(asked)
    code: list[_Instruction] = [(_LOAD, 0, 0, 0), (_EQUAL, 0, left + 1, number)]
    for offset, instruction, value, answer in asked:
        left -= 2
        code += [(_LOAD, 0, 0, offset), (instruction, 0 if answer else left + 1, left + 1 if answer else 0, value)]
    return [*code, (_RETURN, 0, 0, _ALLOW)]


def _processor() -> int | None:
    """The number of this kind of processor in the kernel, or None for those without a table here."""
    known = {"x86_64": _X86_64, "aarch64": _AARCH64}
    return known.get(platform.machine()) if sys.maxsize > 2**32 else None


def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def _check(result: int) -> int:
    if result < 0:
        what = f"the system refuses to limit a worker process: {os.strerror(ctypes.get_errno())}"
        raise TwolinkError(what, code="no-sandbox", remedy="report it, with the version of Linux")
    return result
