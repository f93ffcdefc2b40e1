"""Messages between processes: whole and in order, or an error; whatever else is written there."""

from __future__ import annotations

import pickle
import socket
import struct
import zlib
from collections.abc import Iterator

import pytest

from workbench.jobs.channel import MARK_BYTES, Channel

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
            self.sender.put(pickle.dumps(item))
            found.append(bytes(self.sender._leaving))
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


def test_a_stop_that_comes_while_something_is_sent_waits_for_it(pair: Pair) -> None:
    """As a signal handler's would: nothing is sent there."""
    with memoryview(pair.here._leaving), pytest.raises(BufferError):
        pair.here._leaving += b"x"  # why `Pool.end_soon` only notes it


def test_hung_up(pair: Pair) -> None:
    assert not pair.here.hung_up
    pair.there.sendall(b"x")
    pair.sender.close()
    assert not pair.here.hung_up  # something was not received yet
    list(pair.here.receive())
    assert pair.here.hung_up
