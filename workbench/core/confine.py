"""Confine this process: the system refuses it networks, and files to write but in one folder (Linux).

Landlock [1] takes the right to change files; a filter of system calls, seccomp [2], takes sockets and what Landlock
does not know: owners, permissions, times and attributes of files, input to terminals, rings of requests that pass it.
Both hold for every thread and process that begins here later, and nothing takes them back.

Sources: [1] Linux, Documentation/userspace-api/landlock.rst; [2] Documentation/userspace-api/seccomp_filter.rst.
"""

from __future__ import annotations

import ctypes
import os
import platform
import struct
import sys
from collections.abc import Iterator

__all__ = ["confine", "confined", "why_not"]


class _State:
    """Of this process.

    Attributes:
        confined: whether `confine` was called.
    """

    confined = False


def confined() -> bool:
    """Return whether this process confined itself."""
    return _State.confined


def why_not() -> str:
    """Return why a process cannot be confined here; empty: it can."""
    if sys.platform != "linux":
        return f"it needs Linux, not {platform.system()}"
    machine = platform.machine()
    if machine not in _CALLS or sys.maxsize < 1 << 32:
        return f"it is not known for the processor {machine}, only for {' and '.join(_CALLS)}"
    abi = _syscall(_LANDLOCK_CREATE, None, 0, _VERSION)
    if abi < _LEAST_ABI:
        there = "has no Landlock, or it is switched off" if abi < 1 else f"has only version {abi} of Landlock"
        return f"it needs Linux 6.2 with Landlock, and this kernel {there}"
    if _libc().prctl(_GET_SECCOMP, 0, 0, 0, 0) < 0:
        return "this kernel filters no system calls (seccomp)"
    return ""


def confine(folder: str) -> None:
    """Confine this process, which must not have begun a second thread.

    Args:
        folder: the only one in which it may write from now on.

    Raises:
        OSError: it is not possible; the process must not go on then.
    """
    if why := why_not():
        raise OSError(why)
    if len(os.listdir("/proc/self/task")) != 1:  # noqa: PTH208 - they would go on as they are
        raise OSError("a process with several threads cannot be confined")
    _call("prctl", _libc().prctl(_NO_NEW_PRIVILEGES, 1, 0, 0, 0))
    _drop_capabilities()
    _restrict_files(folder)
    _restrict_calls(_CALLS[platform.machine()])
    _State.confined = True


def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def _syscall(number: int, *arguments: object) -> int:
    call = _libc().syscall
    call.restype = ctypes.c_long
    return int(call(ctypes.c_long(number), *(ctypes.c_long(a) if isinstance(a, int) else a for a in arguments)))


def _call(what: str, result: int) -> int:
    if result < 0:
        error = ctypes.get_errno()
        raise OSError(error, f"{what}: {os.strerror(error)}")
    return result


_GET_SECCOMP, _SET_SECCOMP, _NO_NEW_PRIVILEGES = 21, 22, 38  # of prctl

# -- capabilities: what root may besides --------------------------------------------------------

_CAPABILITY_VERSION = 0x20080522
_READS = 1 << 1 | 1 << 2  # CAP_DAC_OVERRIDE and CAP_DAC_READ_SEARCH: to read what root could read


def _drop_capabilities() -> None:
    head = struct.pack("Ii", _CAPABILITY_VERSION, 0)
    data = ctypes.create_string_buffer(24)
    _call("capget", _libc().capget(head, data))
    effective, permitted, *_ = struct.unpack("6I", data.raw)
    left = struct.pack("6I", effective & _READS, permitted & _READS, 0, 0, 0, 0)
    _call("capset", _libc().capset(head, left))


# -- files --------------------------------------------------------------------------------------

_LANDLOCK_CREATE, _LANDLOCK_ADD, _LANDLOCK_RESTRICT = 444, 445, 446  # system calls, the same on all processors
_VERSION = 1  # flag: which version there is
_LEAST_ABI = 3  # before, a file could be emptied
_BENEATH = 1  # kind of rule

# Rights by the version of Landlock that brought them, linux/landlock.h; reading and executing are not among them.
_WRITE = 1 << 1
_CHANGES = (
    _WRITE | sum(1 << bit for bit in range(4, 13)) | 1 << 13 | 1 << 14
)  # write, remove, make anything, link and move to another folder, truncate
_DEVICES = 1 << 6 | 1 << 11  # make a character or a block device
_DEVICE_COMMANDS, _DEVICE_COMMANDS_ABI = 1 << 15, 5
_NETWORK, _NETWORK_ABI = 0b11, 4  # bind and connect, TCP
_SCOPES, _SCOPES_ABI = 0b11, 6  # abstract sockets, signals to processes outside


def _restrict_files(folder: str) -> None:
    abi = _syscall(_LANDLOCK_CREATE, None, 0, _VERSION)
    files = _CHANGES | (_DEVICE_COMMANDS if abi >= _DEVICE_COMMANDS_ABI else 0)
    handled = [files]
    handled += [_NETWORK] if abi >= _NETWORK_ABI else []
    handled += [_SCOPES] if abi >= _SCOPES_ABI else []
    packed = struct.pack(f"{len(handled)}Q", *handled)
    rules = _call("Landlock", _syscall(_LANDLOCK_CREATE, packed, len(packed), 0))
    _allow(rules, folder, _CHANGES & ~_DEVICES)
    _allow(rules, os.devnull, _WRITE)
    _call("Landlock", _syscall(_LANDLOCK_RESTRICT, rules, 0))
    os.close(rules)


def _allow(rules: int, path: str, rights: int) -> None:
    place = os.open(path, os.O_PATH | os.O_CLOEXEC)
    try:
        _call("Landlock", _syscall(_LANDLOCK_ADD, rules, _BENEATH, struct.pack("=Qi", rights, place), 0))
    finally:
        os.close(place)


# -- system calls -------------------------------------------------------------------------------

_SAME = {"io_uring_setup": 425, "fchmodat2": 452, "setxattrat": 463, "removexattrat": 466, "file_setattr": 469}

# Numbers of the calls that are refused: asm/unistd_64.h, asm-generic/unistd.h.
_CALLS: dict[str, dict[str, int]] = {
    "x86_64": {
        "audit": 0xC000003E, "ioctl": 16, "socket": 41, "socketpair": 53, "chmod": 90, "fchmod": 91, "chown": 92,
        "fchown": 93, "lchown": 94, "fchmodat": 268, "fchownat": 260, "setxattr": 188, "lsetxattr": 189,
        "fsetxattr": 190, "removexattr": 197, "lremovexattr": 198, "fremovexattr": 199, "utime": 132, "utimes": 235,
        "futimesat": 261, "utimensat": 280, **_SAME,
    },
    "aarch64": {
        "audit": 0xC00000B7, "ioctl": 29, "socket": 198, "socketpair": 199, "fchmod": 52, "fchmodat": 53,
        "fchownat": 54, "fchown": 55, "setxattr": 5, "lsetxattr": 6, "fsetxattr": 7, "removexattr": 14,
        "lremovexattr": 15, "fremovexattr": 16, "utimensat": 88, **_SAME,
    },
}  # fmt: skip

_TERMINAL_INPUT = (0x5412, 0x541C)  # TIOCSTI, TIOCLINUX: a line that the terminal takes for typed
_STREAM, _TYPE = 1, 0xF  # a pair of stream sockets cannot be connected to another one
_X32 = 0x40000000  # calls of another numbering

# Instructions of the filter, linux/bpf_common.h, and the places of what it sees, linux/seccomp.h.
_LOAD, _JUMP_EQUAL, _JUMP_ATLEAST, _AND, _RETURN = 0x20, 0x15, 0x35, 0x54, 0x06
_NUMBER, _ARCHITECTURE, _SECOND_ARGUMENT = 0, 4, 24
_ALLOWED, _REFUSED = 0x7FFF0000, 0x00050000 | 1  # SECCOMP_RET_ALLOW, SECCOMP_RET_ERRNO with EPERM


def _restrict_calls(calls: dict[str, int]) -> None:
    program = b"".join(struct.pack("HBBI", *line) for line in _filter(calls))
    kept = ctypes.create_string_buffer(program)
    whole = struct.pack("HxxxxxxP", len(program) // 8, ctypes.addressof(kept))
    _call("seccomp", _libc().prctl(_SET_SECCOMP, ctypes.c_ulong(2), whole, ctypes.c_ulong(0), ctypes.c_ulong(0)))


def _filter(calls: dict[str, int]) -> Iterator[tuple[int, int, int, int]]:
    """Yield instructions: code, lines to leave out if it is so, if it is not, and the constant."""
    refused = (_RETURN, 0, 0, _REFUSED)
    yield _LOAD, 0, 0, _ARCHITECTURE
    yield _JUMP_EQUAL, 1, 0, calls["audit"]
    yield refused
    yield _LOAD, 0, 0, _NUMBER
    yield _JUMP_ATLEAST, 0, 1, _X32
    yield refused
    for name, number in calls.items():
        if name not in ("audit", "ioctl", "socketpair"):
            yield _JUMP_EQUAL, 0, 1, number
            yield refused
    yield _JUMP_EQUAL, 0, 5, calls["socketpair"]
    yield _LOAD, 0, 0, _SECOND_ARGUMENT
    yield _AND, 0, 0, _TYPE
    yield _JUMP_EQUAL, 1, 0, _STREAM
    yield refused
    yield _RETURN, 0, 0, _ALLOWED
    yield _JUMP_EQUAL, 0, 1 + 2 * len(_TERMINAL_INPUT), calls["ioctl"]
    yield _LOAD, 0, 0, _SECOND_ARGUMENT
    for command in _TERMINAL_INPUT:
        yield _JUMP_EQUAL, 0, 1, command
        yield refused
    yield _RETURN, 0, 0, _ALLOWED
