# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""viser's server, restricted to its own page."""

from __future__ import annotations

from collections.abc import Mapping
import contextlib
import errno
import io
import ipaddress
import json
import logging
import os
import socket
from typing import Any
from urllib.parse import urlsplit

import viser
from viser._messages import RunJavascriptMessage

FOREIGN = 1008
"""Close code of a websocket that violates the policy (RFC 6455)."""


class PageServer(viser.ViserServer):
    """
    viser's server, without log output, which accepts websockets of its own page only.

    Any page in a browser may open a websocket to any address, also to the machine that the browser
    runs on. Sharing through a public tunnel is disabled, too.
    """

    def __init__(self, host: str, port: int) -> None:
        # browsers open connections in advance and drop them, which would log tracebacks
        logging.getLogger('websockets.server').setLevel(logging.CRITICAL)
        self._is_local = ipaddress.ip_address(host).is_loopback
        with contextlib.redirect_stdout(io.StringIO()):
            super().__init__(host, port, verbose=False)
        # viser has no public hook that runs before messages of a page are handled
        self._websock_server.on_client_connect(self._close_foreign)

    async def _close_foreign(self, client: Any) -> None:
        connection = self._websock_server._live_connections[client.client_id]
        assert connection.request is not None
        if not is_own_page(connection.request.headers, self._is_local):
            await connection.close(FOREIGN, 'only the page of this server may steer')

    def name_pages(self, title: str) -> None:
        """Let the tabs of browsers have a title."""
        # viser has no public way to set it; this is sent to each page that connects
        self.gui._websock_interface.queue_message(
            RunJavascriptMessage(source=f'document.title = {json.dumps(title)};')
        )

    def request_share_url(self, verbose: bool = True) -> None:
        """Refuse to open a tunnel to a public address."""

    def stop(self) -> None:
        """Close the pages."""
        with contextlib.redirect_stdout(io.StringIO()):
            super().stop()


def is_own_page(headers: Mapping[str, str], is_local: bool) -> bool:
    """
    Return whether the page that opens a websocket with these headers is the server's own.

    Without an `Origin` it is not a browser. At a local server a host name other than localhost
    means DNS rebinding: a page that resolves its own name to this machine.
    """
    origin, host = headers.get('Origin'), headers.get('Host', '')
    if origin is None:
        return True
    if urlsplit(origin).netloc != host:
        return False
    name = urlsplit('//' + host).hostname or ''
    return not is_local or name == 'localhost' or _is_address(name)


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def free_port(host: str, port: int) -> int:
    """
    Return the first usable port, from this one on.

    viser retries for ever, whatever the error.

    Raises
    ------
    OSError
        if there is no such address, or none of its ports is free.

    """
    family = socket.AF_INET6 if ':' in host else socket.AF_INET
    for candidate in range(port, 65536):
        with socket.socket(family) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as the server does
            try:
                probe.bind((host, candidate))
                return candidate
            except OSError as error:
                if error.errno != errno.EADDRINUSE:
                    raise
    raise OSError(errno.EADDRINUSE, os.strerror(errno.EADDRINUSE))


def page_address(host: str, port: int) -> str:
    """Return the address to open in a browser, as a text."""
    if host == '0.0.0.0':  # all addresses of this machine: none that a browser can open
        return f'http://127.0.0.1:{port} in a browser, elsewhere with the address of this machine'
    return f'http://{f"[{host}]" if ":" in host else host}:{port} in a browser'
