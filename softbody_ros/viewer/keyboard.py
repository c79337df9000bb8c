# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Keys of the page, and the folder `help` that lists them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import viser
from viser import Icon

KEYS: tuple[tuple[Any, str, str, str], ...] = (
    ('space', 'space', 'pause', 'pause, or go on'),
    ('R', 'R', 'reset', 'back to the start'),
    ('.', '.', 'step', 'step, while paused'),
)
"""Key in viser, name, action, and what it does."""
HELP = """
| | |
|---|---|
{keys}
| drag | turn the view |
| wheel, pinch | zoom |
| right button | move the view |
| WASDQE, arrows | fly, turn |
| click a body | poke it |
| drop a file | mesh or scene |
| Ctrl K | all commands |
"""


class Keyboard:
    """
    Commands with keys, and their help; viser ignores keys while a text is typed.

    Parameters
    ----------
    gui : viser.GuiApi
    later : callable
        queues a task in the thread of the viewer
    act : callable
        does an action, as the buttons do
    toggle_dark : callable
        makes a page dark or light

    """

    def __init__(
        self,
        gui: viser.GuiApi,
        later: Callable[[Callable[[], Any]], None],
        act: Callable[[str], None],
        toggle_dark: Callable[[viser.ClientHandle | None], None],
    ) -> None:
        self._commands = []
        for key, _, action, hint in KEYS:
            command = gui.add_command(action.capitalize(), description=hint, hotkey=key)
            command.on_trigger(partial(self._pressed, later, partial(act, action)))
            self._commands.append(command)
        keys = '\n'.join(f'| {name} | {hint} |' for _, name, _, hint in KEYS)
        with gui.add_folder('help', expand_by_default=False):
            dark = gui.add_button('Dark or light', icon=Icon.SUN_MOON, hint='of this page')
            gui.add_markdown(HELP.format(keys=keys))
        dark.on_click(lambda event: toggle_dark(event.client))
        self.steerable(False)

    @staticmethod
    def _pressed(later: Callable[[Any], None], task: Callable[[], Any], _: Any) -> None:
        later(task)

    def steerable(self, is_there: bool) -> None:
        """Enable or disable the keys."""
        for command in self._commands:
            command.disabled = not is_there
