# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The folder `scene` of the panel: scenes are loaded and saved, meshes become bodies."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any

import numpy as np
import viser
from viser import Icon

from softbody_ros.core import ConfigError
from softbody_ros.core.geometry.mesh_files import FILE_TYPES
from softbody_ros.scene.resources import SCENE_TYPES, ResourceError
from softbody_ros.scene.scene_file import scene_of
from softbody_ros.viewer.decoding import PALETTE, Frame
from softbody_ros.viewer.mesh_drop import DroppedMeshes
from softbody_ros.viewer.remote import Remote
from softbody_ros.viewer.scene_requests import (
    NOTHING,
    fitted,
    mesh_request,
    meshes_in,
    scene_request,
    scene_yaml,
    shipped_scenes,
)

LARGEST_SIZE = 1e4
ELSEWHERE = (
    '. If the node runs on another machine or in a container, copy the file there and set mesh to '
    'its path'
)


class SceneMenu:
    """
    Widgets for whole scenes and new bodies.

    Parameters
    ----------
    gui : viser.GuiApi
    later : callable
        queues a task, which may be a coroutine function, in the thread of the viewer
    remote : Remote
        the parameters of the node
    notify : callable
        shows title, text and colour of a notice
    frame : callable
        returns what is shown
    expect : callable
        is called with whether a scene comes; with False again if the node refuses it
    reset : callable
        is awaited to put the bodies at their start

    """

    def __init__(
        self,
        gui: viser.GuiApi,
        later: Callable[[Callable[[], Any]], None],
        remote: Remote,
        notify: Callable[[str, str, Any], None],
        frame: Callable[[], Frame | None],
        expect: Callable[[bool], None],
        reset: Callable[[], Awaitable[None]],
    ) -> None:
        self._later, self._remote, self._notify = later, remote, notify
        self._frame, self._expect, self._reset = frame, expect, reset
        self._meshes = DroppedMeshes()
        self._scenes = shipped_scenes()
        with gui.add_folder('scene', expand_by_default=False):
            self._chosen = gui.add_dropdown(
                'example',
                tuple(self._scenes),
                initial_value='default',
                hint='the scenes that come with softbody_ros',
            )
            load = gui.add_button(
                'Load', icon=Icon.PLAYER_PLAY,
                hint='replace all bodies and obstacles; values that the scene does not give '
                'become defaults',
            )  # fmt: skip
            open_file = gui.add_upload_button(
                'Open scene file', icon=Icon.FOLDER_OPEN,
                mime_type=_endings(SCENE_TYPES),
                hint='a parameter file of sim_node, YAML; it may also be dropped on the page',
            )  # fmt: skip
            save = gui.add_button(
                'Save scene file', icon=Icon.DEVICE_FLOPPY,
                hint='all parameters of the node as YAML, for --params-file and bake',
            )  # fmt: skip
            add = gui.add_upload_button(
                'Add mesh', icon=Icon.CUBE_PLUS,
                mime_type=_endings(FILE_TYPES),
                hint=f'a new body above the others from a file ({", ".join(FILE_TYPES)}); it may '
                'also be dropped on the page',
            )  # fmt: skip
            self._size = gui.add_number(
                'its size [m]', 0.0, min=0.0, max=LARGEST_SIZE, step=0.001,
                hint='half of the longest side of the next mesh; 0: like the other bodies',
            )  # fmt: skip
        load.on_click(lambda _: later(self._load_example))
        open_file.on_upload(partial(self._uploaded, self._open))
        save.on_click(lambda event: later(partial(self._save, event.client)))
        add.on_upload(partial(self._uploaded, self._add))
        self._buttons = (load, open_file, save, add)

    def steerable(self, is_there: bool) -> None:
        """Enable or disable all buttons."""
        for button in self._buttons:
            button.disabled = not is_there

    def _uploaded(self, use: Callable[[str, bytes], Any], event: Any) -> None:
        file = event.target.value
        if self._buttons[0].disabled:  # it was dropped on the page
            self._later(partial(self._notify, file.name, 'there is no node to add it to', 'red'))
        else:
            self._later(partial(use, file.name, file.content))

    def close(self) -> None:
        """Remove the files of dropped meshes."""
        self._meshes.close()

    async def text(self) -> str:
        """Return what the node simulates as a scene file."""
        values = await self._remote.read()
        comments = [
            f'{name} is the file of a mesh that was dropped on the page of the viewer, which '
            'removes it when it ends: keep a copy, and give its path here'
            for name in meshes_in(values, self._meshes.folder)
        ]
        return scene_yaml(values, comments)

    # ------------------------------------------------------------------------------------- scenes
    async def _load_example(self) -> None:
        name = self._chosen.value
        await self._load(f'{name}.yaml', self._scenes[name].read_text('utf-8'))

    async def _open(self, name: str, content: bytes) -> None:
        try:
            text = content.decode()
        except UnicodeError:
            self._notify(f'{name} is not loaded', 'it is not UTF-8 text', 'red')
            return
        await self._load(name, text)

    async def _load(self, name: str, text: str) -> None:
        before = await self._remote.read()
        try:
            request = scene_request(scene_of(text, name), before)
        except ConfigError as error:
            self._notify(f'{name} is not loaded', str(error), 'red')
            return
        reason = ''
        if request.from_nothing:
            reason = await self._remote.set_together(NOTHING)
        self._expect(True)
        reason = reason or await self._remote.set_together(request.values)
        if reason:
            self._expect(False)
            if request.from_nothing:
                await self._restore(before)
            self._notify(f'{name} is not loaded', reason, 'red')
            return
        await self._reset()
        self._notify(f'{name} is loaded', '; '.join(request.notes), 'green')

    async def _restore(self, before: dict[str, Any]) -> None:
        """Add what was there again, at its start."""
        request = scene_request(before, await self._remote.read())
        reason = await self._remote.set_together(request.values)
        if reason:
            self._notify('the bodies that were there are gone', reason, 'red')

    async def _save(self, client: viser.ClientHandle | None) -> None:
        text = await self.text()
        if client is not None:
            client.send_file_download('scene.yaml', text.encode(), save_immediately=True)

    # ------------------------------------------------------------------------------------- meshes
    async def _add(self, file_name: str, content: bytes) -> None:
        frame = self._frame()
        positions = np.zeros((0, 3)) if frame is None else frame.positions
        size, above = fitted(positions, np.zeros(0) if frame is None else frame.body)
        present = await self._remote.read()
        color = PALETTE[len(present.get('bodies', ())) % len(PALETTE)]
        path = file_name
        try:
            path = str(self._meshes.keep(file_name, content))
            name, values = mesh_request(path, self._size.value or size, color, above, present)
            reason = await self._remote.set_together(values)
        except (ResourceError, OSError) as error:
            reason = str(error)
        if not reason:
            self._notify(f'{file_name} is the body {name}', '', 'green')
        elif 'does not exist' in reason:
            self._notify(f'{file_name} is not added', reason + ELSEWHERE, 'red')
        else:
            self._notify(f'{file_name} is not added', reason.replace(path, file_name), 'red')


def _endings(endings: tuple[str, ...]) -> str:
    return ','.join(f'.{ending}' for ending in endings)
