"""Messages between this process and a worker, over a socket of their own.

A message is a frame: a mark that nobody else knows, the length, a check sum, and the pickled object. What an FMU writes
to a descriptor that is not its own lies between frames, or in the middle of one, and is skipped.
"""

from __future__ import annotations

import pickle
import socket
import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

__all__ = ["MARK_BYTES", "Channel"]

MARK_BYTES = 16

_HEAD = struct.Struct("!QII")  # length and CRC-32 of what follows, and the CRC-32 of these two
_SIZES = struct.Struct("!QI")
_CHUNK = 1 << 20  # [byte]


class Channel:
    """One end of it.

    Obligations:
      1. `receive` and `flush` never wait; a frame that arrives in pieces waits in here until it is whole.
      2. An object arrives as it was sent, or not at all.

    Args:
        link: connected stream socket; it belongs to the channel from now on.
        mark: begins each frame, random, the same at both ends.
        dumps: makes bytes of an object that is sent.
        loads: makes an object of such bytes.

    Attributes:
        ended: whether the other end hung up.
        stray: number of bytes that belong to no message [byte].
    """

    def __init__(
        self,
        link: socket.socket,
        mark: bytes,
        *,
        dumps: Callable[[Any], bytes] = pickle.dumps,
        loads: Callable[[bytes], Any] = pickle.loads,
    ) -> None:
        link.setblocking(False)
        self._dumps, self._loads = dumps, loads
        self._link, self._mark = link, mark
        self._arrived, self._leaving = bytearray(), bytearray()
        self.ended = False
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
        sizes = len(packed), zlib.crc32(packed)
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

    def receive(self) -> Iterator[Any]:
        """Yield the objects that have arrived.

        Raises:
            pickle.UnpicklingError, AttributeError, ImportError, …: an object that cannot be made here; it is skipped.
        """
        self._read()
        while (packed := self._next()) is not None:
            yield self._loads(packed)

    def _read(self) -> None:
        with suppress(BlockingIOError):
            try:
                while not self.ended:
                    piece = self._link.recv(_CHUNK)
                    self._arrived += piece
                    self.ended = not piece
            except BlockingIOError:
                raise
            except OSError:
                self.ended = True

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
            length, check, sound = _HEAD.unpack_from(self._arrived, len(self._mark))
            if zlib.crc32(_SIZES.pack(length, check)) == sound:
                if len(self._arrived) < begin + length:
                    return None
                packed = bytes(self._arrived[begin : begin + length])
                if zlib.crc32(packed) == check:
                    del self._arrived[: begin + length]
                    return packed
            self._skip(len(self._mark))  # something was written in the middle of it

    def _skip(self, count: int) -> None:
        del self._arrived[:count]
        self.stray += count

    def close(self) -> None:
        """Hang up."""
        self._link.close()
