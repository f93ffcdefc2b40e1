"""Messages between this process and a worker, over a socket of their own.

A message is a frame: a mark that is not met by chance, the length, a check sum, its number, and the packed object. What
an FMU writes to a descriptor that is not its own is skipped where it lies between frames; in the middle of a
frame, that message is lost and an error is raised. That guards against mistakes: an FMU can find the mark in its
process's memory.
"""

from __future__ import annotations

import pickle
import socket
import struct
import zlib
from collections.abc import Callable, Iterator
from typing import Any

from workbench.core.machine.cycles import undisturbed

__all__ = ["HUNG_UP", "LONGEST", "MARK_BYTES", "Channel"]

MARK_BYTES = 16

_HEAD = struct.Struct("!QIII")  # length and CRC-32 of what follows, number of the frame, and the CRC-32 of these three
_SIZES = struct.Struct("!QII")
_NUMBERS = 1 << 32  # after so many frames they begin again
_CHUNK = 1 << 20  # [byte]
_PIECES = 16  # are read at a time: whoever writes without end must not keep the reader from all else
LONGEST = 1 << 34  # [byte]: no frame is longer
_DAMAGED = "something was written into the middle of it, by the FMU into a file that is not its own"

# Name of the file that a worker leaves in its folder when its end of the connection was closed.
HUNG_UP = "hung-up"


class Channel:
    """One end of it.

    Obligations:
      1. `receive` and `flush` never wait; a frame that arrives in pieces waits in here until it is whole.
      2. An object arrives as it was sent, or `receive` raises an exception in its place.

    Args:
        link: connected stream socket; it belongs to the channel from now on.
        mark: begins each frame, random, the same at both ends.
        dumps: makes bytes of an object that is sent.
        loads: makes an object of such bytes.
        longest: that is taken [byte].

    Attributes:
        ended: whether the other end hung up.
        dry: whether the last `receive` took all that was there.
        stray: number of bytes that belong to no message [byte].
    """

    def __init__(
        self,
        link: socket.socket,
        mark: bytes,
        *,
        dumps: Callable[[Any], bytes] = pickle.dumps,
        loads: Callable[[bytes], Any] = pickle.loads,
        longest: int = LONGEST,
    ) -> None:
        link.setblocking(False)
        self._dumps, self._loads, self._longest = dumps, loads, longest
        self._link, self._mark = link, mark
        self._arrived, self._leaving = bytearray(), bytearray()
        self._sent = self._heard = 0  # frames
        self.ended = self.dry = False
        self.stray = 0

    def fileno(self) -> int:
        """Return the descriptor, for `select`."""
        return self._link.fileno()

    @property
    def leaving(self) -> bool:
        """Whether something waits to be sent."""
        return bool(self._leaving)

    def put(self, packed: bytes) -> None:
        """Let a pickled object be sent, as far as it can be without waiting; `flush` sends the rest."""
        if len(packed) > LONGEST:
            raise ValueError(f"a message of {len(packed)} bytes is too long")
        sizes = len(packed), zlib.crc32(packed), self._sent % _NUMBERS
        self._sent += 1
        self._leaving += self._mark + _HEAD.pack(*sizes, zlib.crc32(_SIZES.pack(*sizes))) + packed
        self.flush()

    def send(self, item: Any) -> None:  # noqa: ANN401 - anything that can be pickled
        """Send an object; wait until it is on its way.

        Raises:
            OSError: the other end hung up.
        """
        self._link.setblocking(True)
        try:
            self.put(self._dumps(item))
            if self.ended:
                raise BrokenPipeError
        finally:
            self._link.setblocking(False)

    def flush(self) -> None:
        """Send what waits, as far as it can be without waiting."""
        try:
            while self._leaving:
                with memoryview(self._leaving) as waiting:
                    sent = self._link.send(waiting[:_CHUNK])
                del self._leaving[:sent]
        except BlockingIOError:
            return
        except OSError:
            self._leaving.clear()
            self.ended = True

    @property
    def hung_up(self) -> bool:
        """Whether the other end is gone and all that it sent was received."""
        try:
            return self.ended or not self._link.recv(1, socket.MSG_PEEK)
        except BlockingIOError:
            return False
        except OSError:
            return True

    def receive(self) -> Iterator[Any]:
        """Yield the objects that have arrived.

        Raises:
            pickle.UnpicklingError, AttributeError, ImportError, …: an object that arrived damaged, or cannot be made
                here; it is skipped.
        """
        for _ in range(_PIECES):
            self.dry = not self._read()
            while (packed := self._next()) is not None:
                yield self._made(packed)
            if self.dry:
                return

    def _made(self, packed: bytes) -> Any:  # noqa: ANN401 - anything that can be pickled
        with undisturbed():
            return self._loads(packed)

    def _read(self) -> bool:
        """Take what is there, or a piece of it; return whether there was something."""
        if self.ended:
            return False
        try:
            piece = self._link.recv(_CHUNK)
        except BlockingIOError:
            return False
        except OSError:
            piece = b""
        self._arrived += piece
        self.ended = not piece
        return bool(piece)

    def _next(self) -> bytes | None:
        """Return the next whole message; None: there is none yet."""
        while True:
            at = self._arrived.find(self._mark)
            if at < 0:
                # The last bytes may be the beginning of a mark.
                self._skip(max(0, len(self._arrived) - len(self._mark) + 1))
                return None
            self._skip(at)
            begin = len(self._mark) + _HEAD.size
            if len(self._arrived) < begin:
                return None
            length, check, number, sound = _HEAD.unpack_from(self._arrived, len(self._mark))
            if zlib.crc32(_SIZES.pack(length, check, number)) != sound or length > self._longest:
                self._skip(len(self._mark))  # something was written in the middle of it; the next one's number tells
                continue
            if len(self._arrived) < begin + length:
                return None
            packed = bytes(self._arrived[begin : begin + length])
            missing, self._heard = number != self._heard % _NUMBERS, number + 1
            if zlib.crc32(packed) != check:
                self._skip(len(self._mark))
                raise pickle.UnpicklingError(_DAMAGED)
            del self._arrived[: begin + length]
            if missing:
                raise pickle.UnpicklingError(_DAMAGED)
            return packed

    def _skip(self, count: int) -> None:
        del self._arrived[:count]
        self.stray += count

    def close(self) -> None:
        """Hang up."""
        self.ended = True
        self._link.close()
