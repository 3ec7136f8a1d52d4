"""What a worker process may do: read the program, write its own folders, compute. Nothing else, where Linux can say so.

Landlock (Linux 5.13 and later) limits the files that a process may open, and from 6.7 and 6.12 on TCP and signals;
seccomp refuses system calls: those that no task needs, by name, since a list of what numerical libraries do need would
break with each of their versions. Both hold for native code too, and cannot be taken back. They are set with plain
system calls: the libraries for them (py-landlock, pyseccomp) wrap the same few calls, and one needs a C library that
few machines have.

Sources: Linux, Documentation/userspace-api/landlock.rst and seccomp_filter.rst; the numbers of the calls are those of
arch/x86/entry/syscalls/syscall_64.tbl and include/uapi/asm-generic/unistd.h.
"""

import ctypes
import errno
import os
import platform
import struct
import sys
import tomllib
from collections.abc import Iterable, Sequence
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
_Calls = dict[str, list[int]]
_CALLS: dict[str, _Calls] = tomllib.loads(Path(__file__).with_name("system_calls.toml").read_text("utf-8"))
_REFUSED = _CALLS["network"] | _CALLS["others"]
_CLONE, _CLONE3, _NEW_THREAD = (56, 220), 435, 0x10000
_ALLOW, _KILL, _REFUSE = 0x7FFF0000, 0x80000000, 0x00050000  # SECCOMP_RET_ALLOW, KILL_PROCESS, ERRNO | number
_LOAD, _EQUAL, _NOT_LESS, _ANY_BIT, _RETURN = 0x20, 0x15, 0x35, 0x45, 0x06  # instructions of the filter


class Protection(msgspec.Struct, frozen=True):
    """How worker processes are kept in on this machine. landlock: the version of it; 0: files are not limited."""

    landlock: int
    seccomp: bool

    @property
    def complete(self) -> bool:
        """Whether files and system calls are limited."""
        return bool(self.landlock and self.seccomp)

    def __str__(self) -> str:
        files = f"limited by Landlock {self.landlock}" if self.landlock else "NOT limited (this system has no Landlock)"
        calls = "limited by seccomp" if self.seccomp else "NOT limited (no seccomp on this system)"
        return f"worker processes: files {files}; network, programs and other processes {calls}"


def protection() -> Protection:
    """What this machine can do. Nothing is changed."""
    if sys.platform != "linux":
        return Protection(0, False)
    version = _libc().syscall(_CREATE_RULESET, None, ctypes.c_size_t(0), _ASK_VERSION)
    return Protection(max(0, version), _processor() is not None and Path("/proc/sys/kernel/seccomp").is_dir())


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
        _limit_calls(_CALLS["others"] if network else _REFUSED)


def _program() -> Iterable[str | Path]:
    """What the interpreter, its libraries and the package read."""
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


def _limit_calls(calls: _Calls) -> None:
    """Refuse these system calls with EPERM, new processes included; threads are allowed."""
    code = _filter(_processor() or 0, calls)
    content = ctypes.create_string_buffer(b"".join(struct.pack("=HBBI", *instruction) for instruction in code))
    program = struct.pack("HxxxxxxP", len(code), ctypes.addressof(content))
    _check(_libc().prctl(_SET_SECCOMP, _FILTER, program, 0, 0))


def _filter(processor: int, calls: _Calls) -> list[tuple[int, int, int, int]]:
    """The instructions (code, steps to jump if true, if false, value) that judge a system call."""
    column = 0 if processor == _X86_64 else 1
    numbers = [pair[column] for pair in calls.values() if len(pair) > column]
    refused = [(_EQUAL, len(numbers) - k + 2, 0, number) for k, number in enumerate(numbers)]
    return [
        (_LOAD, 0, 0, 4),  # the processor's kind: 32-bit calls have other numbers
        (_EQUAL, 1, 0, processor),
        (_RETURN, 0, 0, _KILL),
        (_LOAD, 0, 0, 0),  # the number of the call
        (_NOT_LESS, len(refused) + 5, 0, 0x40000000),  # x32 has numbers of its own
        (_EQUAL, 0, 1, _CLONE3),  # its flags are in memory: libc takes clone where there is no clone3
        (_RETURN, 0, 0, _REFUSE | errno.ENOSYS),
        *refused,
        (_EQUAL, 0, 3, _CLONE[column]),
        (_LOAD, 0, 0, 16),  # its flags
        (_ANY_BIT, 1, 0, _NEW_THREAD),
        (_RETURN, 0, 0, _REFUSE | errno.EPERM),
        (_RETURN, 0, 0, _ALLOW),
    ]


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
