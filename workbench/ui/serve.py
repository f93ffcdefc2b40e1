"""The server of the browser workbench, on this machine only."""

from __future__ import annotations

import os
import secrets
import socket
import sys
import threading
import webbrowser
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import quote

from workbench.errors import InputError
from workbench.ui.root import ServedFolder

__all__ = ["serve"]

_LOOPBACK = "127.0.0.1"
_TOKEN_BYTES = 24


def serve(folder: Path, *, port: int = 0, browser: bool = True, opened: str = "") -> None:
    """Serve until the process is told to end; the address is the first line of standard output.

    Args:
        folder: from which models are opened.
        port: 0: a free one.
        browser: whether to open the page in the browser.
        opened: what the page shows first, as the browser names it.

    Raises:
        InputError: the port is taken, or starlette and uvicorn are not installed.
    """
    try:
        import uvicorn  # noqa: PLC0415 - optional

        from workbench.ui.app import app_of  # noqa: PLC0415
        from workbench.ui.guard import Guard  # noqa: PLC0415
    except ModuleNotFoundError as error:
        raise InputError(f"ui: {error.name} is not installed; pip install 'fmi-workbench[ui]'") from None
    from workbench.ui.jobs import Desk  # noqa: PLC0415

    with socket.socket() as listening:
        if sys.platform != "win32":
            listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind((_LOOPBACK, port))
        except (OSError, OverflowError) as error:
            why = getattr(error, "strerror", None) or error
            raise InputError(
                f"ui: port {port} cannot be used: {why}; --port names another, 0 takes a free one"
            ) from None
        listening.listen()  # so that whoever reads the address finds somebody there
        port = listening.getsockname()[1]
        token = secrets.token_urlsafe(_TOKEN_BYTES)
        os.chdir(folder)  # so that what is shown as a command line holds in this folder
        desk = Desk(ServedFolder(folder))
        settings: Any = {"log_level": "warning", "timeout_graceful_shutdown": 1, "lifespan": "off", "ws": "none"}
        server = uvicorn.Server(uvicorn.Config(Guard(app_of(desk), token, port), **settings))
        address = f"http://{_LOOPBACK}:{port}/?token={token}" + (f"#/open/{quote(opened, safe='')}" if opened else "")
        sys.stdout.write(f"{address}\n")
        sys.stdout.flush()
        if browser:
            threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()
        try:
            with suppress(KeyboardInterrupt):  # that is how it ends
                server.run(sockets=[listening])
        finally:
            desk.close()
