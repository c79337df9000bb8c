# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The look of the page, dark or light, and its script `page.js`, which each page runs."""

from __future__ import annotations

from collections.abc import Sequence
import contextlib
from importlib import resources
import string
from typing import Any

import viser
from viser._messages import (
    FileTransferStartUpload,
    RunJavascriptMessage,
    SceneNodeUpdateMessage,
)

LARGEST_FILE = 100_000_000
"""Bytes of a file that is sent by a page."""
REFUSAL = (
    f'the viewer takes up to {LARGEST_FILE / 1e6:.0f} MB. Copy it to the machine of the node and '
    'set the parameter mesh to its path'
)
CHOSEN, SYSTEM_IS_DARK = 'dark', 'system-is-dark'
"""Keys of what a browser keeps: what was chosen on the page, and what the system prefers."""
PATIENCE = 60.0
"""Seconds in which a page says what it keeps."""
THEME: dict[str, Any] = {
    'show_logo': False,
    'show_share_button': False,
    'brand_color': (217, 108, 46),
}

DARK_GRID = {
    'cell_color': (52, 52, 54), 'section_color': (78, 78, 80), 'plane_color': (34, 34, 36),
}  # fmt: skip


def script() -> str:
    """Return the script of the page."""
    text = resources.files('softbody_ros.viewer').joinpath('page.js').read_text('utf-8')
    return string.Template(text).safe_substitute(
        LARGEST_FILE=LARGEST_FILE, REFUSAL=REFUSAL, SYSTEM_IS_DARK=SYSTEM_IS_DARK
    )


class Page:
    """Theme and script of all pages of a server; each is dark or light by itself."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self._dark: dict[int, bool] = {}
        self._grids: Sequence[viser.GridHandle] = ()
        server.gui.configure_theme(**THEME)
        server.gui.main_panel.dock_right()
        # viser has no public way to run a script, nor to bound an upload
        connection = server.gui._websock_interface
        connection.queue_message(RunJavascriptMessage(source=script()))
        connection.register_handler(FileTransferStartUpload, self._bound)
        server.on_client_connect(self._connected)
        server.on_client_disconnect(self._disconnected)

    def _bound(self, _: Any, message: FileTransferStartUpload) -> None:
        """Forget an upload that is too large; the script has told whoever chose the file."""
        if message.size_bytes > LARGEST_FILE:
            self._server.gui._current_file_upload_states.pop(message.transfer_uuid, None)

    def _connected(self, client: viser.ClientHandle) -> None:
        # without storage, or gone already
        with contextlib.suppress(RuntimeError, TimeoutError):
            chosen = client.local_storage.get_item(CHOSEN, PATIENCE)
            chosen = chosen or client.local_storage.get_item(SYSTEM_IS_DARK, PATIENCE)
            if chosen == 'yes':
                self._set(client, True)

    def _disconnected(self, client: viser.ClientHandle) -> None:
        self._dark.pop(client.client_id, None)

    def toggle(self, client: viser.ClientHandle | None) -> None:
        """Make a page dark that is light, or light; its browser remembers it."""
        if client is None:  # it is gone
            return
        is_dark = not self._dark.get(client.client_id, False)
        client.local_storage.set_item(CHOSEN, 'yes' if is_dark else 'no')
        self._set(client, is_dark)

    def _set(self, client: viser.ClientHandle, is_dark: bool) -> None:
        self._dark[client.client_id] = is_dark
        client.gui.configure_theme(dark_mode=is_dark, **THEME)
        self._paint(client)

    def paint(self, grids: Sequence[viser.GridHandle]) -> None:
        """Give these the colours of each page: what is added has those of a light one."""
        self._grids = grids
        for number, client in self._server.get_clients().items():
            if self._dark.get(number):
                self._paint(client)

    def _paint(self, client: viser.ClientHandle) -> None:
        for grid in self._grids:
            light = {name: getattr(grid, name) for name in DARK_GRID}
            colors = DARK_GRID if self._dark.get(client.client_id) else light
            # a property of the handle would be set on all pages
            client._websock_connection.queue_message(SceneNodeUpdateMessage(grid.name, colors))
