"""Messages between processes: whole and in order, or an error; whatever else is written there."""

from __future__ import annotations

import pickle
import socket
import struct
import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from workbench.jobs.channel import LONGEST, MARK_BYTES, Channel, pickled

MARK = bytes(range(MARK_BYTES))


class Pair:
    """Both ends, and the descriptor to which a program writes by mistake."""

    def __init__(self) -> None:
        here, self.there = socket.socketpair()
        self.here, self.sender = Channel(here, MARK), Channel(self.there, MARK)

    def frames(self, *items: object) -> list[bytes]:
        """Return what is written for messages, which are not sent."""
        found = []
        for item in items:
            self.sender._leaving.clear()
            self.sender.flush = lambda: None  # type: ignore[method-assign]
            self.sender.put(*pickled(item))
            found.append(b"".join(self.sender._leaving))
        return found


@pytest.fixture
def pair() -> Iterator[Pair]:
    made = Pair()
    yield made
    made.here.close()
    made.sender.close()


def test_what_is_written_between_messages_is_skipped(pair: Pair) -> None:
    one, two = pair.frames("one", "two")
    for noise in (b"noise", MARK, MARK + b"\0" * 40, MARK[:7], b""):
        pair.here._heard = 0
        pair.there.sendall(noise + one + noise + two)
        assert list(pair.here.receive()) == ["one", "two"]


@pytest.mark.parametrize("place", [3, MARK_BYTES + 4, MARK_BYTES + 25])
def test_what_is_written_into_a_message_is_an_error(pair: Pair, place: int) -> None:
    """Where its begin is spoilt, it is missed when the next one comes."""
    one, two, three = pair.frames("one", "two", "three")
    pair.there.sendall(one[:place] + b"noise" + one[place:] + two + three)
    with pytest.raises(pickle.UnpicklingError, match="by the FMU into a file that is not its own"):
        list(pair.here.receive())
    assert list(pair.here.receive()) in (["two", "three"], ["three"])


def test_a_length_that_nobody_can_have_is_not_waited_for(pair: Pair) -> None:
    sizes = struct.pack("!QII", 1 << 62, 0, 0)
    (one,) = pair.frames("one")
    pair.there.sendall(MARK + sizes + struct.pack("!I", zlib.crc32(sizes)) + one)
    assert list(pair.here.receive()) == ["one"]
    assert len(pair.here._arrived) < 100


def test_a_message_in_pieces_waits_until_it_is_whole(pair: Pair) -> None:
    (one,) = pair.frames(list(range(1000)))
    for k in range(0, len(one), 700):
        assert list(pair.here.receive()) == []
        pair.there.sendall(one[k : k + 700])
    assert list(pair.here.receive()) == [list(range(1000))]
    pair.there.sendall(one[:100])
    pair.sender.close()
    assert list(pair.here.receive()) == []
    assert pair.here.ended


def test_who_writes_without_end_does_not_keep_the_reader(pair: Pair, monkeypatch: pytest.MonkeyPatch) -> None:
    class Endless:
        def recv(self, _: int) -> bytes:
            return b"x" * 1000

        def close(self) -> None:
            real.close()

    real = pair.here._link
    monkeypatch.setattr(pair.here, "_link", Endless())
    assert list(pair.here.receive()) == []
    assert not pair.here.dry
    assert len(pair.here._arrived) < MARK_BYTES  # and it fills no memory


@pytest.mark.parametrize("piece", [100_000, 4096, 1000])
def test_large_arrays_arrive_in_the_memory_of_their_message(pair: Pair, piece: int) -> None:
    """Aligned, so that compiled code can take them, and to be written to, as others are."""
    columns = np.arange(120_000.0).reshape(3, -1)
    small = np.arange(7)
    sent = {"a": columns[0], "b": columns[1:].T, "small": small, "flags": columns[0] > 7, "z": columns[0] * 1j}
    stream = b"".join(pair.frames(sent, "next"))
    arrived, whole = list[Any](), 0
    for k in range(0, len(stream), piece):
        pair.there.sendall(stream[k : k + piece])
        for item in pair.here.receive():
            arrived.append(item)
            whole = whole or k + piece
    assert arrived[1:] == ["next"]
    assert whole < len(stream) + piece
    for name, values in sent.items():
        result = arrived[0][name]
        assert result.dtype == values.dtype
        np.testing.assert_array_equal(result, values)
        assert result.flags.aligned
        assert result.flags.writeable
    message = _memory(arrived[0]["a"])
    assert message is _memory(arrived[0]["z"])
    assert len(message) < 1.01 * sum(values.nbytes for values in sent.values())


def _memory(array: Any) -> Any:  # noqa: ANN401 - what numpy calls a base
    while isinstance(array, np.ndarray):
        array = array.base
    return array.obj


def test_a_message_that_is_only_announced_takes_no_memory(pair: Pair) -> None:
    sizes = struct.pack("!QII", LONGEST, 0, 0)
    pair.there.sendall(MARK + sizes + struct.pack("!I", zlib.crc32(sizes)) + bytes(1000))
    assert list(pair.here.receive()) == []
    assert pair.here._frame is not None
    assert len(pair.here._frame.message) < 1 << 22


@pytest.mark.parametrize("place", [5000, 900_000])
def test_what_is_written_into_a_large_array_costs_that_message_only(pair: Pair, place: int) -> None:
    one, two, three = pair.frames(np.arange(120_000.0), "two", "three")
    message = one[:place] + b"noise" + one[place:] + two + three
    errors, arrived = 0, list[Any]()
    for k in range(0, len(message), 100_000):
        pair.there.sendall(message[k : k + 100_000])
        try:
            arrived += pair.here.receive()
        except pickle.UnpicklingError:
            errors += 1
    arrived += pair.here.receive()
    assert errors == 1
    assert arrived == ["two", "three"]


def test_hung_up(pair: Pair) -> None:
    assert not pair.here.hung_up
    pair.there.sendall(b"x")
    pair.sender.close()
    assert not pair.here.hung_up  # something was not received yet
    list(pair.here.receive())
    assert pair.here.hung_up
