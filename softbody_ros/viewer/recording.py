# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The folder `film` of the panel: the present scene is baked by a process of its own."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Sequence
from functools import partial
import importlib.util
import os
import pathlib
import re
import signal
import subprocess
import sys
import tempfile
import termios
import threading
from typing import Any

import viser
from viser import Icon

from softbody_ros.bake.__main__ import FORMATS

OFFERED = ('.glb', '.usdc', '.npz')
MOST_SECONDS = 60.0
RATES = ('24', '25', '30', '60')
LARGEST_FILM = 256e6
"""Bytes of a film, about, that goes to a page."""
PATIENCE = 2.0
"""Seconds in which a bake ends when it is asked to."""
SPEAKER = 'bake: '
FRAMES = re.compile(rb'(\d+)/(\d+) \[')


class Baking:
    """
    A bake as a process.

    Parameters
    ----------
    arguments : sequence of str
        of the command `bake`
    progress : callable
        is called with the part that is done, 0 … 1
    ended : callable
        is called with the exit status and why there is no film, '' if there is one

    """

    def __init__(
        self,
        arguments: Sequence[str],
        progress: Callable[[float], None],
        ended: Callable[[int, str], None],
    ) -> None:
        self._progress, self._ended = progress, ended
        # on a terminal, which has room for it, bake says how far it is
        leader, follower = os.openpty()
        termios.tcsetwinsize(leader, (24, 100))
        with os.fdopen(follower) as terminal:
            self._process = subprocess.Popen(
                [sys.executable, '-m', 'softbody_ros.bake', *arguments],
                stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=terminal,
            )  # fmt: skip
        threading.Thread(target=self._follow, args=(leader,), daemon=True).start()

    def _follow(self, leader: int) -> None:
        text, last = b'', b''
        with os.fdopen(leader, 'rb', buffering=0) as terminal:
            while chunk := _read(terminal):
                *lines, text = re.split(rb'[\r\n]+', text + chunk)
                last = next(filter(_is_said, reversed(lines)), last)
                for done, total in FRAMES.findall(b' '.join([*lines, text])):
                    self._progress(int(done) / max(int(total), 1))
        status = self._process.wait()
        self._ended(status, _reason(status, last.decode(errors='replace')) if status else '')

    def cancel(self) -> None:
        """Ask it to end; not by SIGINT, which an import at its start could swallow."""
        if self._process.poll() is None:
            self._process.terminate()

    def close(self) -> None:
        """End it."""
        self.cancel()
        try:
            self._process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def _read(terminal: Any) -> bytes:
    try:
        return terminal.read(4096) or b''
    except OSError:  # the process has closed its end
        return b''


def _is_said(line: bytes) -> bool:
    """Return whether a line is one of a sentence, not of the progress bar."""
    return bool(line.strip()) and not FRAMES.search(line)


def _reason(status: int, last: str) -> str:
    """Return why a bake has failed, from its exit status and the last line that it has said."""
    if status < 0:
        return (
            f'bake was ended ({signal.strsignal(-status)}), perhaps for lack of memory: take '
            'fewer seconds or frames, or a coarser mesh'
        )
    if last.startswith(SPEAKER):
        return last.removeprefix(SPEAKER)
    return f'bake has failed ({last[:200]}): save the scene file and use the command bake'


class FilmMenu:
    """
    Widgets for one film at a time.

    Parameters
    ----------
    gui : viser.GuiApi
    later : callable
        queues a task, which may be a coroutine function, in the thread of the viewer
    notify : callable
        shows title, text and colour of a notice
    scene : callable
        is awaited for the text of a scene file
    vertices : callable
        returns how many vertices are shown

    """

    def __init__(
        self,
        gui: viser.GuiApi,
        later: Callable[[Callable[[], Any]], None],
        notify: Callable[[str, str, Any], None],
        scene: Callable[[], Awaitable[str]],
        vertices: Callable[[], int],
    ) -> None:
        self._later, self._notify = later, notify
        self._scene, self._vertices = scene, vertices
        self._directory = tempfile.TemporaryDirectory(prefix='softbody_film_')
        self._baking: Baking | None = None
        self._job: object | None = None
        self._film: pathlib.Path | None = None
        formats = tuple(
            suffix for suffix in OFFERED if importlib.util.find_spec(FORMATS[suffix][2])
        )
        with gui.add_folder('film', expand_by_default=False):
            self._seconds = gui.add_number(
                'seconds', 5.0, min=0.1, max=MOST_SECONDS, step=0.5,
                hint='simulated time, from the start of the scene',
            )  # fmt: skip
            self._fps = gui.add_dropdown(
                'fps', RATES, initial_value='30', hint='frames in a second of simulated time'
            )
            self._format = gui.add_dropdown(
                'format', formats,
                hint='.glb for the web, .usdc for Blender, Houdini, Maya, .npz for NumPy',
            )  # fmt: skip
            self._record = gui.add_button(
                'Record', icon=Icon.MOVIE,
                hint='simulate the scene from its start with the present values, offline; what '
                'other nodes send is not in it',
            )  # fmt: skip
            self._bar: Any = gui.add_progress_bar(0.0, visible=False, animated=True)
            self._cancel = gui.add_button('Cancel', icon=Icon.X, visible=False)
            self._download = gui.add_button('Download', icon=Icon.DOWNLOAD, visible=False)
        self._record.on_click(lambda _: later(self._start))
        self._cancel.on_click(lambda _: later(self._stop))
        self._download.on_click(
            lambda event: self._send(event.client)
        )  # in a thread of the server

    def steerable(self, is_there: bool) -> None:
        """Enable or disable the button."""
        self._record.disabled = not is_there

    def close(self) -> None:
        """End what is recorded, and remove its files."""
        if self._baking is not None:
            self._baking.close()
        self._directory.cleanup()

    async def _start(self) -> None:
        if self._job is not None or self._baking is not None:
            return
        seconds, fps, suffix = self._seconds.value, int(self._fps.value), self._format.value
        size = film_size(self._vertices(), round(seconds * fps) + 1, suffix)
        if size > LARGEST_FILM:
            self._notify(
                'no film',
                f'it would have about {size / 1e6:.0f} MB, of at most {LARGEST_FILM / 1e6:.0f}: '
                'take fewer seconds or frames, or save the scene file and use the command bake',
                'red',
            )
            return
        job = self._job = object()
        self._show(is_recorded=True)
        scene = pathlib.Path(self._directory.name) / 'scene.yaml'
        self._film = scene.with_name('film' + suffix)
        text = await self._scene()
        if self._job is not job:  # cancelled while the node was asked
            return
        scene.write_text(text, 'utf-8')
        self._baking = Baking(
            [str(scene), f'--seconds={seconds}', f'--fps={fps}', f'--output={self._film}'],
            lambda part: self._later(partial(self._tell, part)),
            lambda status, sentence: self._later(partial(self._finish, status, sentence)),
        )

    def _show(self, is_recorded: bool) -> None:
        self._bar.value = 0.0
        self._bar.visible = self._cancel.visible = is_recorded
        self._record.visible = not is_recorded
        self._download.visible = False

    def _stop(self) -> None:
        self._job = None  # what is ready at this moment is cancelled, too
        if self._baking is None:
            self._show(is_recorded=False)
        else:
            self._baking.cancel()

    def _tell(self, part: float) -> None:
        self._bar.value = 100.0 * part

    def _finish(self, status: int, sentence: str) -> None:
        is_cancelled = self._job is None
        self._baking = self._job = None
        self._show(is_recorded=False)
        if is_cancelled:
            return
        if status == 0:
            assert self._film is not None
            megabytes = self._film.stat().st_size / 1e6
            self._download.label = f'Download {self._film.name} ({megabytes:.1f} MB)'
            self._download.visible = True
            self._notify('the film is ready', 'download it in the folder film', 'green')
        else:
            self._notify('no film', sentence, 'red')

    def _send(self, client: viser.ClientHandle | None) -> None:
        if client is not None and self._film is not None:
            client.send_file_download(
                self._film.name, self._film.read_bytes(), save_immediately=True
            )


def film_size(vertices: int, frames: int, suffix: str) -> float:
    """Return about how many bytes a film has."""
    weights = frames if suffix == '.glb' else 0
    return frames * (24.0 * vertices + 4.0 * weights)
