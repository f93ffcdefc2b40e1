"""The attempts themselves, by what they are after; see `escapes`."""

from __future__ import annotations

import ctypes
import fcntl
import mmap
import os
import platform
import socket
import struct
import subprocess
from collections.abc import Callable
from pathlib import Path

from tests.escapes import Ground, attempt, call, raw_call, tries

__all__: list[str] = []

_HERE = -100  # AT_FDCWD
_X32 = 0x40000000


def _reading(path: Path | str) -> int:
    return os.open(path, os.O_RDONLY | os.O_NOCTTY)


# -- files: contents -----------------------------------------------------------------------------

tries("write a file", lambda g: g.precious.write_text("gone"))
tries("append to a file", lambda g: os.open(g.precious, os.O_WRONLY | os.O_APPEND))
tries("open a file to read and write", lambda g: os.open(g.precious, os.O_RDWR))
tries("empty a file as it is opened to read", lambda g: os.open(g.precious, os.O_RDONLY | os.O_TRUNC))
tries("truncate a file", lambda g: os.truncate(g.precious, 0))
tries("openat2 to write", lambda g: call("openat2", _HERE, g.precious, struct.pack("QQQ", os.O_WRONLY, 0, 0), 24))
tries("write by a folder's descriptor", lambda g: os.open("precious", os.O_WRONLY, dir_fd=_reading(g.home)))
tries("write by a path with ..", lambda g: (g.own / ".." / "home" / "precious").write_text("gone"))
tries("write what is open to read", lambda g: os.open(f"/proc/self/fd/{_reading(g.precious)}", os.O_WRONLY))
tries("write through /proc/self/root", lambda g: Path(f"/proc/self/root{g.precious}").write_text("gone"))
tries("write to a terminal", lambda g: os.open(g.terminal, os.O_WRONLY | os.O_NOCTTY))
tries("write the limits of one's own use", lambda g: Path("/proc/self/oom_score_adj").write_text("0"))


@attempt("write through a symbolic link")
def _through_link(ground: Ground) -> None:
    (ground.own / "link").symlink_to(ground.precious)
    (ground.own / "link").write_text("gone")


@attempt("handle of a file, opened to write")
def _by_handle(ground: Ground) -> None:
    handle = ctypes.create_string_buffer(struct.pack("Ii", 128, 0) + bytes(128))
    call("name_to_handle_at", _HERE, ground.precious, handle, ctypes.byref(ctypes.c_int()), 0)
    call("open_by_handle_at", _reading(ground.home), handle, os.O_WRONLY)


@attempt("from another thread")
def _by_thread(ground: Ground) -> None:
    found: list[OSError] = []

    def work() -> None:
        try:
            ground.precious.write_text("gone")
        except OSError as error:
            found.append(error)

    import threading

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    if found:
        raise found[0]


@attempt("from another program")
def _by_program(ground: Ground) -> None:
    if subprocess.run(
        ["/bin/sh", "-c", 'exec 2>/dev/null; echo gone > "$1"', "sh", ground.precious], check=False
    ).returncode:
        raise PermissionError(1, "the shell was refused")


# -- files: names --------------------------------------------------------------------------------

tries("make a file", lambda g: (g.home / "new").touch())
tries("make a file without a name", lambda g: os.open(g.home, os.O_TMPFILE | os.O_RDWR))
tries("remove a file", lambda g: g.precious.unlink())
tries("make a folder", lambda g: (g.home / "folder").mkdir())
tries("remove a folder", lambda g: (g.home / "empty").rmdir())
tries("rename a file", lambda g: g.precious.rename(g.home / "other"))
tries("move a file into one's own folder", lambda g: g.precious.rename(g.own / "taken"))
tries("link a file into one's own folder", lambda g: os.link(g.precious, g.own / "linked"))
tries("make a symbolic link", lambda g: (g.home / "link").symlink_to("/nowhere"))
tries("make a pipe with a name", lambda g: os.mkfifo(g.home / "fifo"))
tries("make a device", lambda g: os.mknod(g.own / "null", 0o020666, os.makedev(1, 3)))
tries("make a socket", lambda g: os.mknod(g.home / "socket", 0o140666))


def _made(ground: Ground) -> Path:
    (ground.own / "mine").write_text("mine")
    return ground.own / "mine"


tries("move a file of one's own out", lambda g: _made(g).rename(g.home / "moved"))
tries("put a file of one's own in its place", lambda g: _made(g).replace(g.precious))
tries("link a file of one's own out", lambda g: os.link(_made(g), g.home / "linked"))
tries("exchange it for one of one's own", lambda g: call("renameat2", _HERE, g.precious, _HERE, _made(g), 2))

# -- files: what else they have ------------------------------------------------------------------

tries("chmod", lambda g: g.precious.chmod(0o777))
tries("fchmod of what is open to read", lambda g: os.fchmod(_reading(g.precious), 0o777))
tries("fchmodat", lambda g: call("fchmodat", _HERE, g.precious, 0o777))
tries("fchmodat2", lambda g: call("fchmodat2", _HERE, g.precious, 0o777, 0))
tries("chown", lambda g: os.chown(g.precious, os.getuid(), -1))
tries("lchown", lambda g: os.lchown(g.precious, os.getuid(), -1))
tries("fchown of what is open to read", lambda g: os.fchown(_reading(g.precious), os.getuid(), -1))
tries("utime", lambda g: os.utime(g.precious, (1, 1)))
tries("utimes", lambda g: call("utimes", g.precious, struct.pack("4q", 1, 0, 1, 0)))
tries("futimens of what is open to read", lambda g: os.utime(_reading(g.precious), (1, 1)))
tries("setxattr", lambda g: os.setxattr(g.precious, "user.a", b"b"))
tries("lsetxattr", lambda g: os.setxattr(g.precious, "user.a", b"b", follow_symlinks=False))
tries("fsetxattr of what is open to read", lambda g: os.setxattr(_reading(g.precious), "user.a", b"b"))
tries("setxattrat", lambda g: call("setxattrat", _HERE, g.precious, 0, b"user.a", bytes(16), 16))
tries("removexattr", lambda g: os.removexattr(g.precious, "user.none"))
tries("file_setattr", lambda g: call("file_setattr", _HERE, g.precious, bytes(24), 24, 0))
tries("its flags, as chattr does", lambda g: fcntl.ioctl(_reading(g.precious), 0x40086602, struct.pack("l", 0x40)))
tries("lock it for others", lambda g: fcntl.flock(_reading(g.precious), fcntl.LOCK_EX | fcntl.LOCK_NB))
tries("lock it against writers", lambda g: fcntl.lockf(_reading(g.precious), fcntl.LOCK_SH | fcntl.LOCK_NB))
tries(
    "lock it by its description", lambda g: fcntl.fcntl(_reading(g.precious), 37, struct.pack("hhqqi", 0, 0, 0, 0, 0))
)
tries("lease it", lambda g: fcntl.fcntl(_reading(g.precious), fcntl.F_SETLEASE, fcntl.F_RDLCK))

# -- networks and other programs -----------------------------------------------------------------


def _socket(family: int, kind: int, protocol: int = 0) -> socket.socket:
    return socket.socket(family, kind, protocol)


def _connected(kind: int, path: str) -> Callable[[Ground], object]:
    return lambda g: _socket(socket.AF_UNIX, kind).connect(str(g.home / path))


tries("TCP: connect", lambda g: _socket(socket.AF_INET, socket.SOCK_STREAM).connect(("127.0.0.1", g.port)))
tries("TCP: listen", lambda g: _socket(socket.AF_INET, socket.SOCK_STREAM).bind(("127.0.0.1", 0)))
tries("TCP over IPv6", lambda g: _socket(socket.AF_INET6, socket.SOCK_STREAM))
tries("TCP by several paths", lambda g: _socket(socket.AF_INET, socket.SOCK_STREAM, 262))
tries("UDP", lambda g: _socket(socket.AF_INET, socket.SOCK_DGRAM).sendto(b"a", ("127.0.0.1", g.port)))
tries("ICMP", lambda g: _socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_ICMP))
tries("packets", lambda g: _socket(socket.AF_PACKET, socket.SOCK_RAW))
tries("netlink", lambda g: _socket(socket.AF_NETLINK, socket.SOCK_RAW))
tries("virtual machines' sockets", lambda g: _socket(40, socket.SOCK_STREAM))
tries("the kernel's ciphers", lambda g: _socket(38, socket.SOCK_SEQPACKET))
tries("Unix: connect", _connected(socket.SOCK_STREAM, "stream"))
tries("Unix: datagrams", _connected(socket.SOCK_DGRAM, "datagrams"))
tries("Unix: without a file", lambda g: _socket(socket.AF_UNIX, socket.SOCK_STREAM).bind(f"\0escapes-{g.victim}"))
tries(
    "a pair of sockets for datagrams",
    lambda g: socket.socketpair(type=socket.SOCK_DGRAM)[0].sendto(b"a", str(g.home / "datagrams")),
)
tries("a ring that passes by", lambda g: call("io_uring_setup", 4, ctypes.create_string_buffer(120)))
tries("queues of requests", lambda g: call("io_setup", 1, ctypes.byref(ctypes.c_long())))


def _system_v(make: str, remove: str, *arguments: int) -> Callable[[Ground], object]:
    """Return an attempt that makes something that stays when its process ends, and removes it again."""
    return lambda _: call(remove, call(make, *arguments), 0, 0)  # IPC_RMID is 0


tries("memory of System V", _system_v("shmget", "shmctl", 0, 4096, 0o1600))
tries("semaphores of System V", lambda g: call("semctl", call("semget", 0, 1, 0o1600), 0, 0))
tries("messages of System V", _system_v("msgget", "msgctl", 0, 0o1600))


@attempt("write shared memory")
def _shared_memory(ground: Ground) -> None:
    file = Path(f"/dev/shm/escapes-{ground.victim}")  # noqa: S108 - what shm_open makes
    file.touch()
    file.unlink()


@attempt("a message queue")
def _queue(ground: Ground) -> None:
    name = f"escapes-{ground.victim}".encode()
    call("mq_open", name, os.O_RDWR | os.O_CREAT, 0o600, None)
    call("mq_unlink", name)


@attempt("a call of another numbering, x32")
def _x32(_: Ground) -> None:
    raw_call("socket", _X32 | 41, socket.AF_INET, socket.SOCK_STREAM, 0)


@attempt("a call of another processor, int 0x80")
def _int_80(_: Ground) -> None:
    if platform.machine() != "x86_64":
        raise PermissionError(1, "no such processor")
    # push rbx; mov eax, 359 (socket); mov ebx, 2; mov ecx, 1; xor edx, edx; int 0x80; pop rbx; ret
    code = bytes.fromhex("53 b867010000 bb02000000 b901000000 31d2 cd80 5b c3")
    memory = mmap.mmap(-1, 4096, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC)
    memory.write(code)
    function = ctypes.CFUNCTYPE(ctypes.c_int)(ctypes.addressof(ctypes.c_char.from_buffer(memory)))
    if (result := function()) < 0:
        raise OSError(-result, "int 0x80")


@attempt("type into a terminal")
def _type_in(ground: Ground) -> None:
    fcntl.ioctl(_reading(ground.terminal), 0x5412, b"a")  # TIOCSTI


tries("the manners of a terminal", lambda g: fcntl.ioctl(_reading(g.terminal), 0x5402, bytes(60)))  # TCSETS
tries("the size of a terminal", lambda g: fcntl.ioctl(_reading(g.terminal), 0x5414, bytes(8)))  # TIOCSWINSZ
tries("what a terminal holds", lambda g: fcntl.ioctl(_reading(g.terminal), 0x540B, 0))  # TCFLSH
tries("stop a terminal", lambda g: fcntl.ioctl(_reading(g.terminal), 0x540A, 0))  # TCXONC
