"""Pictures and reports of works, drawn one after the other in a thread of their own: Matplotlib draws one at a time."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from queue import SimpleQueue
from threading import Thread

__all__ = ["Drawings"]

_Asked = tuple[Callable[[], bytes], "Future[bytes]"]


class Drawings:
    """Makes what is asked for in the order asked; a server that ends does not wait for it."""

    def __init__(self) -> None:
        self._asked: SimpleQueue[_Asked] = SimpleQueue()
        Thread(target=self._draw, name="drawings", daemon=True).start()

    def ask(self, make: Callable[[], bytes]) -> Future[bytes]:
        """Return what will hold what a function makes.

        Args:
            make: draws.
        """
        result: Future[bytes] = Future()
        self._asked.put((make, result))
        return result

    def _draw(self) -> None:
        while True:
            make, result = self._asked.get()
            try:
                result.set_result(make())
            except BaseException as error:  # noqa: BLE001 - told to who asked
                result.set_exception(error)
