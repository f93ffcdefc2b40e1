"""Attempts on other processes and on the system; see `escapes`."""

from __future__ import annotations

import ctypes
import errno
import fcntl
import os
import resource
import signal
import struct
from pathlib import Path

from tests.escapes import Ground, attempt, call, tries

__all__: list[str] = []

_WORD = 8  # [byte]

# -- signals -------------------------------------------------------------------------------------

_INFORMATION = struct.pack("iii", signal.SIGTERM, 0, -1) + bytes(116)  # SI_QUEUE

tries("kill", lambda g: os.kill(g.victim, signal.SIGTERM))
tries("kill a group", lambda g: os.killpg(g.victim, signal.SIGTERM))
tries("tkill", lambda g: call("tkill", g.victim, signal.SIGTERM))
tries("tgkill", lambda g: call("tgkill", g.victim, g.victim, signal.SIGTERM))
tries("rt_sigqueueinfo", lambda g: call("rt_sigqueueinfo", g.victim, signal.SIGTERM, _INFORMATION))
tries("rt_tgsigqueueinfo", lambda g: call("rt_tgsigqueueinfo", g.victim, g.victim, signal.SIGTERM, _INFORMATION))
tries(
    "a signal by descriptor",
    lambda g: call("pidfd_send_signal", call("pidfd_open", g.victim, 0), signal.SIGTERM, None, 0),
)


@attempt("a signal when something arrives")
def _when_ready(ground: Ground) -> None:
    reads, writes = os.pipe()
    fcntl.fcntl(reads, 10, signal.SIGTERM)  # F_SETSIG
    fcntl.fcntl(reads, fcntl.F_SETOWN, ground.victim)
    fcntl.fcntl(reads, fcntl.F_SETFL, os.O_ASYNC)
    os.write(writes, b"a")


# -- limits, priority, place ---------------------------------------------------------------------

tries("its processor time, ended", lambda g: resource.prlimit(g.victim, resource.RLIMIT_CPU, (1, 1)))
tries("its files, few", lambda g: resource.prlimit(g.victim, resource.RLIMIT_NOFILE, (3, 3)))
tries("its limits, read", lambda g: resource.prlimit(g.victim, resource.RLIMIT_NOFILE))
tries("its processors", lambda g: os.sched_setaffinity(g.victim, {0}))
tries("its scheduler", lambda g: os.sched_setscheduler(g.victim, os.SCHED_IDLE, os.sched_param(0)))
tries("its scheduler's parameters", lambda g: os.sched_setparam(g.victim, os.sched_param(0)))
tries(
    "its scheduler's attributes",
    lambda g: call("sched_setattr", g.victim, struct.pack("IIQiIQQQ", 48, 0, 0, 5, 0, 0, 0, 0), 0),
)
tries("its priority", lambda g: os.setpriority(os.PRIO_PROCESS, g.victim, 5))
tries("its group's priority", lambda g: os.setpriority(os.PRIO_PGRP, g.victim, 5))
tries("its turn at disks", lambda g: call("ioprio_set", 1, g.victim, 3 << 13))
tries("its group's turn at disks", lambda g: call("ioprio_set", 2, g.victim, 3 << 13))
tries("where its memory lies", lambda g: call("migrate_pages", g.victim, 64, b"\1" + bytes(7), b"\1" + bytes(7)))
tries("move its memory", lambda g: call("move_pages", g.victim, 0, None, None, None, 0))
tries("its cookie of the scheduler", lambda g: call("prctl", 62, 1, g.victim, 0, 0))

# -- looking in ----------------------------------------------------------------------------------

_PLACE = ctypes.create_string_buffer(_WORD)
_PIECE = struct.pack("QQ", ctypes.addressof(_PLACE), _WORD)  # where it is here is where it is in a copy
_TRACE_ATTACH, _TRACE_SEIZE = 16, 0x4206

tries("trace it", lambda g: call("ptrace", _TRACE_ATTACH, g.victim, 0, 0))
tries("trace it without a stop", lambda g: call("ptrace", _TRACE_SEIZE, g.victim, 0, 0))
tries("read its memory", lambda g: call("process_vm_readv", g.victim, _PIECE, 1, _PIECE, 1, 0))
tries("write its memory", lambda g: call("process_vm_writev", g.victim, _PIECE, 1, _PIECE, 1, 0))
tries("read its memory as a file", lambda g: os.open(f"/proc/{g.victim}/mem", os.O_RDONLY))
tries("write its memory as a file", lambda g: os.open(f"/proc/{g.victim}/mem", os.O_RDWR))
tries("its environment", lambda g: Path(f"/proc/{g.victim}/environ").read_bytes())
tries("where its libraries lie", lambda g: Path(f"/proc/{g.victim}/maps").read_bytes())
tries("its files", lambda g: Path(f"/proc/{g.victim}/fd/1").readlink())
tries("into its folder", lambda g: os.open(f"/proc/{g.victim}/cwd/escapes-none", os.O_WRONLY | os.O_CREAT))
tries("let it be ended first", lambda g: Path(f"/proc/{g.victim}/oom_score_adj").write_text("1000"))
tries("its name", lambda g: Path(f"/proc/{g.victim}/comm").write_text("a"))
tries("one of its files", lambda g: call("pidfd_getfd", call("pidfd_open", g.victim, 0), 1, 0))
tries("compare with it", lambda g: call("kcmp", os.getpid(), g.victim, 0, 0, 0))
tries("its list of locks", lambda g: call("get_robust_list", g.victim, bytes(8), bytes(8)))
tries("advise on its memory", lambda g: call("process_madvise", call("pidfd_open", g.victim, 0), _PIECE, 1, 20, 0))
tries(
    "count what it does",
    lambda g: call("perf_event_open", struct.pack("IIQ", 1, 128, 0) + bytes(112), g.victim, -1, -1, 0),
)
tries("into its namespaces", lambda g: call("setns", call("pidfd_open", g.victim, 0), 0x04000000))

# -- leaving the worker's group, and rights ------------------------------------------------------

_NEW_USER, _NEW_MOUNT, _OF_PARENT = 0x10000000, 0x20000, 0x8000
_ALL_RIGHTS = struct.pack("6I", *(0xFFFFFFFF,) * 2, 0, *(0xFFFFFFFF,) * 2, 0)


def _clone(flags: int) -> None:
    if call("clone", flags | signal.SIGCHLD, 0, 0, 0, 0) == 0:
        os._exit(0)


@attempt("a session of one's own")
def _session(_: Ground) -> None:
    if (child := os.fork()) == 0:
        try:
            os.setsid()
        except OSError as error:
            os._exit(error.errno or 1)
        os._exit(0)
    if code := os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]):
        raise OSError(code, os.strerror(code))


tries("a group of one's own", lambda g: os.setpgid(0, 0))
tries("a child of the parent", lambda g: _clone(_OF_PARENT))
tries("a namespace of users", lambda g: call("unshare", _NEW_USER))
tries("a namespace of mounts", lambda g: call("unshare", _NEW_MOUNT))
tries("a process in a namespace", lambda g: _clone(_NEW_USER))
tries(
    "clone3 into a namespace",
    lambda g: call("clone3", struct.pack("11Q", 1 << 28, *[0] * 3, 17, *[0] * 6), 88) or os._exit(0),
)
tries("root's rights again", lambda g: call("capset", struct.pack("Ii", 0x20080522, 0), _ALL_RIGHTS))
tries("be another user", lambda g: os.setresuid(os.getuid(), os.getuid(), 12345))
tries("be of other groups", lambda g: os.setgroups([]))
tries("another root", lambda g: os.chroot(g.own))
tries("another personality", lambda g: call("personality", 0x0040000))

# -- the system: to whoever may, these are wrong arguments, and nothing more -----------------------

_BAD = 1  # an address at which nothing is

tries("mount", lambda g: call("mount", None, g.home / "none", b"tmpfs", 0, None))
tries("unmount", lambda g: call("umount2", g.home / "none", 0))
tries("turn the root", lambda g: call("pivot_root", g.home / "none", g.home / "none"))
tries("copy a mount", lambda g: call("open_tree", -100, g.home, 1))
tries("open a file system", lambda g: call("fsopen", b"none-such", 0))
tries("move a mount", lambda g: call("move_mount", -1, b"", -1, b"", 0))
tries("change a mount", lambda g: call("mount_setattr", -1, b"", 0, bytes(32), 32))
tries("add a key", lambda g: call("add_key", b"user", b"escapes", b"a", 1, -2))
tries("ask for a key", lambda g: call("request_key", b"user", b"escapes-none", None, 0))
tries("keyrings", lambda g: call("keyctl", 0, -3, 0, 0, 0))
tries("programs in the kernel", lambda g: call("bpf", 0, bytes(48), 48))
tries("faults of memory, handled", lambda g: call("userfaultfd", 1))
tries("secret memory", lambda g: call("memfd_secret", 0))
tries("another kernel", lambda g: call("kexec_load", 0, 1000000, _BAD, 0))
tries("a module", lambda g: call("init_module", _BAD, 0, _BAD))
tries("a module from a file", lambda g: call("finit_module", -1, b"", 0))
tries("swap to a file", lambda g: call("swapon", g.home / "none", 0))
tries("swap no more", lambda g: call("swapoff", g.home / "none"))
tries("restart", lambda g: call("reboot", 0, 0, 0, 0))
tries("the host's name", lambda g: call("sethostname", _BAD, -1))
tries("the domain's name", lambda g: call("setdomainname", _BAD, -1))
tries("the clock", lambda g: call("clock_settime", 0, struct.pack("qq", -1, -1)))
tries("the clock, the older way", lambda g: call("settimeofday", struct.pack("qq", -1, -1), None))
tries("the clock's rate", lambda g: call("clock_adjtime", 0, _BAD))
tries("keep accounts", lambda g: call("acct", g.home / "none"))
tries("the kernel's log", lambda g: call("syslog", 10, 0, 0))
tries("quotas", lambda g: call("quotactl", 0x80000100, g.home / "none", 0, 0))
tries("watch all files", lambda g: call("fanotify_init", 0, 0))
tries("write all to disk", lambda g: call("syncfs", os.open(g.home, os.O_RDONLY)))


@attempt("be told of a folder by signals")
def _told(ground: Ground) -> None:
    folder = os.open(ground.home, os.O_RDONLY)
    fcntl.fcntl(folder, fcntl.F_NOTIFY, fcntl.DN_CREATE)
    if folder < 0:
        raise OSError(errno.EBADF, "no folder")
