"""Confine this process: the system refuses it networks, and files to write but in one folder (Linux).

Landlock [1] takes the right to change files; a filter of system calls, seccomp [2], lets only those through that are
listed in `system_calls`: no sockets, and of limits, priorities and the like only the process's own.
Both hold for every thread and process that begins here later, and nothing takes them back.

Sources: [1] Linux, Documentation/userspace-api/landlock.rst; [2] Documentation/userspace-api/seccomp_filter.rst.
"""

from __future__ import annotations

import ctypes
import errno
import os
import platform
import struct
import sys
from collections.abc import Iterator

from workbench.jobs.system_calls import AFTER, CONDITIONS, INSTEAD, Condition, numbers

__all__ = ["SIGNALS_SINCE", "confine", "confined", "landlock_version", "why_not"]


class _Confinement:
    """Of this process.

    Attributes:
        confined: whether `confine` was called.
    """

    confined = False


def confined() -> bool:
    """Return whether this process confined itself."""
    return _Confinement.confined


def why_not() -> str:
    """Return why a process cannot be confined here; empty: it can."""
    if sys.platform != "linux":
        return f"it needs Linux, not {platform.system()}"
    machine = platform.machine()
    if machine not in _AUDIT or sys.maxsize < 1 << 32:
        return f"it is not known for the processor {machine}, only for {' and '.join(_AUDIT)}"
    abi = landlock_version()
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
    _restrict_calls(platform.machine())
    _Confinement.confined = True


def landlock_version() -> int:
    """Return which version of Landlock the kernel has; −1: none."""
    return _syscall(_LANDLOCK_CREATE, None, 0, _VERSION)


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
_SCOPES, SIGNALS_SINCE = 0b11, 6  # abstract sockets, signals to processes outside


def _restrict_files(folder: str) -> None:
    abi = landlock_version()
    files = _CHANGES | (_DEVICE_COMMANDS if abi >= _DEVICE_COMMANDS_ABI else 0)
    handled = [files]
    handled += [_NETWORK] if abi >= _NETWORK_ABI else []
    handled += [_SCOPES] if abi >= SIGNALS_SINCE else []
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

_AUDIT = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7}  # linux/audit.h

# Instructions of the filter, linux/bpf_common.h, and the places of what it sees, linux/seccomp.h.
_LOAD, _JUMP_EQUAL, _JUMP_ATLEAST, _AND, _RETURN = 0x20, 0x15, 0x35, 0x54, 0x06
_NUMBER, _ARCHITECTURE, _ARGUMENTS = 0, 4, 16
_ERROR = 0x00050000  # SECCOMP_RET_ERRNO
_ALLOWED, _REFUSED, _UNKNOWN = 0x7FFF0000, _ERROR | errno.EPERM, _ERROR | errno.ENOSYS

_Line = tuple[int, int, int, int]  # code, lines to leave out if it is so, if it is not, and the constant


def _restrict_calls(machine: str) -> None:
    program = b"".join(struct.pack("HBBI", *line) for line in _filter(machine))
    kept = ctypes.create_string_buffer(program)
    whole = struct.pack("HxxxxxxP", len(program) // 8, ctypes.addressof(kept))
    _call("seccomp", _libc().prctl(_SET_SECCOMP, ctypes.c_ulong(2), whole, ctypes.c_ulong(0), ctypes.c_ulong(0)))


def _filter(machine: str) -> Iterator[_Line]:
    yield _LOAD, 0, 0, _ARCHITECTURE
    yield _JUMP_EQUAL, 1, 0, _AUDIT[machine]
    yield _RETURN, 0, 0, _REFUSED
    yield _LOAD, 0, 0, _NUMBER
    for name, number in numbers(machine).items():
        allowed = [*_only(CONDITIONS.get(name, ())), (_RETURN, 0, 0, _ALLOWED)]
        yield _JUMP_EQUAL, 0, len(allowed), number
        yield from allowed
    for number in INSTEAD.values():
        yield _JUMP_EQUAL, 0, 1, number
        yield _RETURN, 0, 0, _UNKNOWN
    yield _JUMP_ATLEAST, 0, 1, AFTER  # on x86_64 also those of another numbering, x32
    yield _RETURN, 0, 0, _UNKNOWN
    yield _RETURN, 0, 0, _REFUSED


def _only(conditions: tuple[Condition, ...]) -> Iterator[_Line]:
    """Yield instructions that refuse the call unless its arguments are as they must be."""
    for argument, bits, values in conditions:
        yield _LOAD, 0, 0, _ARGUMENTS + 8 * argument  # the lower half: both processors have it first
        yield _AND, 0, 0, bits
        for after, value in zip(reversed(range(len(values))), values, strict=True):
            yield _JUMP_EQUAL, after + 1, 0, value
        yield _RETURN, 0, 0, _REFUSED
