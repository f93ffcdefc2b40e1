"""Messages between this process and a worker, over a socket of their own.

A message is a frame: a mark that is not met by chance, the length, a check sum, its number, and the packed object. What
an FMU writes to a descriptor that is not its own is skipped where it lies between frames; in the middle of a
frame, that message is lost and an error is raised. That guards against mistakes: an FMU can find the mark in its
process's memory.

Large arrays are sent from where they lie, and arrive in the memory that they keep: PEP 574.
"""

from __future__ import annotations

import pickle
import socket
import struct
import zlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from workbench.core.machine.cycles import undisturbed

__all__ = ["HUNG_UP", "LONGEST", "MARK_BYTES", "Channel", "pickled", "unpickled"]

MARK_BYTES = 16

_HEAD = struct.Struct("!QIII")  # length and CRC-32 of what follows, number of the frame, and the CRC-32 of these three
_SIZES = struct.Struct("!QII")
_NUMBERS = 1 << 32  # after so many frames they begin again
_CHUNK = 1 << 20  # [byte]
_PIECES = 16  # are read at a time: whoever writes without end must not keep the reader from all else
LONGEST = 1 << 34  # [byte]: no frame is longer
_APART = 1 << 14  # [byte]: smaller arrays are pickled with the object, and smaller parts sent together
_ALIGNED = 16  # [byte]: at multiples of it arrays begin
_WORD = struct.Struct("!Q")
_DAMAGED = "something was written into the middle of it, by the FMU into a file that is not its own"

# Name of the file that a worker leaves in its folder when its end of the connection was closed.
HUNG_UP = "hung-up"


def pickled(item: object) -> list[bytes | memoryview]:
    """Return a pickled object: the number of its parts, how long each is, and the parts, arrays where they lie."""
    arrays = list[memoryview]()

    def inside(buffer: pickle.PickleBuffer) -> bool:
        content = buffer.raw()
        if content.nbytes >= _APART:
            arrays.append(content)
        return content.nbytes < _APART

    text = pickle.dumps(item, pickle.HIGHEST_PROTOCOL, buffer_callback=inside)
    parts: list[bytes | memoryview] = [text, *arrays]
    sent: list[bytes | memoryview] = [b"".join(map(_WORD.pack, (len(parts), *map(len, parts))))]
    end = len(sent[0])
    for part in parts:
        sent.extend((bytes(-end % _ALIGNED), part))
        end += -end % _ALIGNED + len(part)
    return sent


def unpickled(packed: bytearray) -> Any:  # noqa: ANN401 - anything that can be pickled
    """Return the object that was `pickled`; its large arrays keep the memory of the message."""
    whole, parts = memoryview(packed), list[memoryview]()
    (count,) = _WORD.unpack_from(packed)
    end = (1 + count) * _WORD.size
    for k in range(count):
        begin = end + -end % _ALIGNED
        end = begin + _WORD.unpack_from(packed, (1 + k) * _WORD.size)[0]
        parts.append(whole[begin:end])
    return pickle.loads(parts[0], buffers=parts[1:])  # noqa: S301 - SECURITY.md says whom that trusts


@dataclass
class _Incoming:
    """A message that is arriving.

    Attributes:
        head: mark and sizes, as they came.
        length: of the message [byte].
        message: what is there, and room behind it, in proportion: a head alone takes no memory.
        check: its CRC-32.
        number: of the frame.
        filled: how much of it is there [byte].
    """

    head: bytes
    length: int
    message: bytearray
    check: int
    number: int
    filled: int = 0

    def filled_from(self, arrived: bytearray) -> bool:
        """Take what belongs to the message; return whether all of it is there."""
        more = min(len(arrived), self.length - self.filled)
        self.message[self.filled : self.filled + more] = arrived[:more]
        del arrived[:more]
        self.filled += more
        return self.filled == self.length

    def make_room(self) -> None:
        """Let the message grow where it is full."""
        if self.filled == len(self.message):
            self.message.extend(bytes(min(self.length - self.filled, max(self.filled, _CHUNK))))


class Channel:
    """One end of it.

    Obligations:
      1. `receive` and `flush` never wait; a frame that arrives in pieces waits in here until it is whole.
      2. An object arrives as it was sent, or `receive` raises an exception in its place.

    Args:
        link: connected stream socket; it belongs to the channel from now on.
        mark: begins each frame, random, the same at both ends.
        dumps: makes parts of a message of an object that is sent.
        loads: makes an object of a message, whose memory it may keep.
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
        dumps: Callable[[Any], Iterable[bytes | memoryview]] = pickled,
        loads: Callable[[bytearray], Any] = unpickled,
        longest: int = LONGEST,
    ) -> None:
        link.setblocking(False)
        self._dumps, self._loads, self._longest = dumps, loads, longest
        self._link, self._mark = link, mark
        self._arrived, self._leaving = bytearray(), deque[memoryview]()
        self._frame: _Incoming | None = None  # whose message is arriving
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

    def put(self, *parts: bytes | memoryview) -> None:
        """Let a message be sent, as far as it can be without waiting; `flush` sends the rest.

        Args:
            parts: of the message; they stay as they are until it is sent.
        """
        length, check = 0, 0
        for part in parts:
            length, check = length + len(part), zlib.crc32(part, check)
        if length > LONGEST:
            raise ValueError(f"a message of {length} bytes is too long")
        sizes = length, check, self._sent % _NUMBERS
        self._sent += 1
        head = self._mark + _HEAD.pack(*sizes, zlib.crc32(_SIZES.pack(*sizes)))
        for small, beside in groupby((head, *parts), lambda part: len(part) < _APART):
            pieces = list(beside)
            self._leaving += map(memoryview, [b"".join(pieces)] if small else pieces)
        self.flush()

    def send(self, item: Any) -> None:  # noqa: ANN401 - anything that can be pickled
        """Send an object; wait until it is on its way.

        Raises:
            OSError: the other end hung up.
        """
        self._link.setblocking(True)
        try:
            self.put(*self._dumps(item))
            if self.ended:
                raise BrokenPipeError
        finally:
            self._link.setblocking(False)

    def flush(self) -> None:
        """Send what waits, as far as it can be without waiting."""
        try:
            while self._leaving:
                sent = self._link.send(self._leaving[0][:_CHUNK])
                rest = self._leaving.popleft()[sent:]
                if rest:
                    self._leaving.appendleft(rest)
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

    def _made(self, packed: bytearray) -> Any:  # noqa: ANN401 - anything that can be pickled
        with undisturbed():
            return self._loads(packed)

    def _read(self) -> bool:
        """Take what is there, or a piece of it; return whether there was something."""
        if self.ended:
            return False
        try:
            if self._frame is None:
                self._arrived += (piece := self._link.recv(_CHUNK))
                count = len(piece)
            else:
                self._frame.make_room()
                with memoryview(self._frame.message) as room:
                    count = self._link.recv_into(room[self._frame.filled :][:_CHUNK])
                self._frame.filled += count
        except BlockingIOError:
            return False
        except OSError:
            count = 0
        self.ended = not count
        return count > 0

    def _next(self) -> bytearray | None:
        """Return the next whole message; None: there is none yet."""
        if self._frame is None:
            self._frame = self._begun()
        if self._frame is None or not self._frame.filled_from(self._arrived):
            return None
        frame, self._frame = self._frame, None
        missing, self._heard = frame.number != self._heard % _NUMBERS, frame.number + 1
        if zlib.crc32(frame.message) != frame.check:
            self._arrived[:0] = frame.head + frame.message  # the next one may have begun in it
            self._skip(len(self._mark))
            raise pickle.UnpicklingError(_DAMAGED)
        if missing:
            raise pickle.UnpicklingError(_DAMAGED)
        return frame.message

    def _begun(self) -> _Incoming | None:
        """Return the next frame, whose head has arrived; None: it has not."""
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
            if zlib.crc32(_SIZES.pack(length, check, number)) == sound and length <= self._longest:
                head = bytes(self._arrived[:begin])
                del self._arrived[:begin]
                return _Incoming(head, length, bytearray(), check, number)
            self._skip(len(self._mark))  # something was written in the middle of it; the next one's number tells

    def _skip(self, count: int) -> None:
        del self._arrived[:count]
        self.stray += count

    def close(self) -> None:
        """Hang up."""
        self.ended = True
        self._link.close()
