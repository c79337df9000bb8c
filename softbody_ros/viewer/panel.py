# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The panel: status, buttons, and a widget for each parameter that the node describes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
import itertools
import time
from typing import Any

import viser
from viser import Icon

from softbody_ros.viewer import widgets
from softbody_ros.viewer.decoding import COLORS
from softbody_ros.viewer.widgets import Field, Section

BY_BODY, BY_DISPLACEMENT, BY_PRESSURE = 'body', 'displacement', 'pressure'
BY_STRAIN = 'permanent strain'
UNITS = {
    BY_DISPLACEMENT: ((1.0, 'm'), (1e-2, 'cm'), (1e-3, 'mm')),
    BY_PRESSURE: ((1e6, 'MPa'), (1e3, 'kPa'), (1.0, 'Pa')),
    BY_STRAIN: ((1e-2, '%'),),
}
"""Units of the legend."""
SETTLED = 1.0
"""Seconds after its last change at which a slider counts as released."""
LEGEND = """
<div style="font-size:0.8em;padding:0 0.9em 0.6em">
  <div style="height:0.8em;border-radius:0.3em;background:linear-gradient(90deg,{colors})"></div>
  <div style="display:flex;justify-content:space-between"><span>0</span><span>{most}</span></div>
</div>
"""

POKING = """
<div style="font-size:0.8em;padding:0 0.9em 0.6em;opacity:0.7">Click a body to poke it.</div>
"""


class Panel:
    """
    The widgets, whose events become calls of `act(button)` or `change(field, value)`.

    The server calls back in its own threads: `later(function)` queues a call in the thread of the
    viewer.
    """

    def __init__(
        self,
        gui: viser.GuiApi,
        later: Callable[[Callable[[], None]], None],
        act: Callable[[str], None],
        change: Callable[[Field, Any], None],
    ) -> None:
        self._gui, self._later, self._act, self._change = gui, later, act, change
        self._fields: dict[str, Field] = {}
        self._values: dict[str, Any] = {}
        self._widgets: dict[str, Any] = {}
        self._dragged: dict[str, float] = {}
        self._folders: list[Any] = []
        self._chosen: dict[str, str] = {}
        gui.set_panel_label('softbody_ros')
        self._status = gui.add_markdown('')
        self.is_paused = False
        self._buttons = {
            'reset': self._button(
                'Reset', 'reset', 'the bodies back to their start', Icon.REFRESH
            ),
            'pause': self._button('Pause', 'pause', 'stop the time, or go on', Icon.PLAYER_PAUSE),
            'step': self._button(
                'Step', 'step', 'while paused: step_count ticks', Icon.PLAYER_TRACK_NEXT
            ),
        }
        self._coloring = gui.add_dropdown(
            'colour by', (BY_BODY, BY_DISPLACEMENT, BY_PRESSURE, BY_STRAIN),
            hint='displacement: the distance from the rest shape, moved and turned to fit best; '
            'pressure: of what touches, like a tactile skin; '
            'permanent strain: of the dents that stay (plasticity.creep)',
        )  # fmt: skip
        self._legend = gui.add_html('', visible=False)
        self._forces = gui.add_checkbox(
            'contact forces', False,
            hint='arrows: red on bodies, where they are pressed; blue on obstacles, unless they '
            'are the mirror image',
        )  # fmt: skip
        self._poking = gui.add_html(POKING, visible=False)
        self.steerable(False)

    def _button(self, label: str, action: str, hint: str, icon: Any) -> Any:
        button = self._gui.add_button(label, hint=hint, icon=icon)
        button.on_click(lambda _: self._later(partial(self._act, action)))
        return button

    # ------------------------------------------------------------------------------------- status
    @property
    def coloring(self) -> str:
        """By what to colour: BY_BODY, BY_DISPLACEMENT, BY_PRESSURE or BY_STRAIN."""
        return self._coloring.value

    @property
    def shows_forces(self) -> bool:
        """Whether forces of contacts are to be drawn."""
        return self._forces.value

    def status(self, text: str) -> None:
        """Set the status text, in Markdown."""
        self._status.content = text

    def legend(self, most: float | None) -> None:
        """Show the colour scale up to `most`, in the unit of what it is of, or hide it."""
        self._legend.visible = most is not None
        if most is not None:
            colors = ','.join('rgb({:.0f},{:.0f},{:.0f})'.format(*color) for color in COLORS)
            end = with_unit(most, UNITS[self.coloring])
            self._legend.content = LEGEND.format(colors=colors, most=end)

    def paused(self, is_paused: bool) -> None:
        """Show whether the simulation is paused."""
        if is_paused != self.is_paused:
            self.is_paused = is_paused
            self._buttons['pause'].label = 'Go on' if is_paused else 'Pause'
            self._buttons['step'].disabled = not is_paused

    def steerable(self, is_there: bool) -> None:
        """Enable or disable all controls."""
        for name, button in self._buttons.items():
            button.disabled = not is_there or (name == 'step' and not self.is_paused)
        for widget in self._widgets.values():
            widget.disabled = not is_there
        self._poking.visible = is_there

    # --------------------------------------------------------------------------- the parameters
    def describe(
        self,
        described: Iterable[Field],
        values: Mapping[str, Any],
        bodies: Sequence[str],
        obstacles: Sequence[str],
    ) -> None:
        """Build widgets for these parameters, or update the present ones if they are the same."""
        wanted = {field.name: field for field in described}
        if wanted == self._fields:
            for name in wanted:
                self.show(name, values[name])
            return
        self._fields, self._values = wanted, dict(values)
        self._widgets.clear()
        for folder in self._folders:
            folder.remove()
        (gravity, rest), of_bodies, of_obstacles = widgets.sections(
            self._fields, bodies, obstacles
        )
        self._folders = [self._folder(gravity)]
        self._folders += self._chooser('body', of_bodies)
        self._folders += self._chooser('obstacle', of_obstacles)
        self._folders.append(self._folder(rest))

    def _chooser(self, what: str, choices: dict[str, list[Section]]) -> list[Any]:
        """Show the sections of one of several bodies or obstacles, with a menu to choose it."""
        if not choices:
            return []
        holder = self._gui.add_folder(None)
        shown: list[Any] = []

        def show(name: str) -> None:
            self._chosen[what] = name
            for folder in shown:
                folder.remove()
            for section in itertools.chain(*choices.values()):
                for parameter in section.names:
                    self._widgets.pop(parameter, None)
            with holder:
                shown[:] = [self._folder(section) for section in choices[name] if section.names]

        first = self._chosen.get(what)
        first = first if first in choices else next(iter(choices))
        if len(choices) > 1:
            with holder:
                chosen = self._gui.add_dropdown(what, tuple(choices), initial_value=first)
            chosen.on_update(lambda event: self._later(partial(show, event.target.value)))
        show(first)
        return [holder]

    def _folder(self, section: Section) -> Any:
        folder = self._gui.add_folder(section.title, expand_by_default=section.is_open)
        with folder:
            for name in section.names:
                field = self._fields[name]
                words = widgets.label(field, section)
                self._widgets[name] = self._widget(words, field, self._values[name])
                self._widgets[name].on_update(partial(self._updated, field))
            if any(name.endswith(widgets.VELOCITY) for name in section.names):
                self._button(
                    'Apply velocity', 'apply_initial_velocity',
                    'set the velocities of all bodies, without moving them', Icon.ARROW_UP_RIGHT,
                )  # fmt: skip
        return folder

    def _widget(self, label: str, field: Field, value: Any) -> Any:
        shown = widgets.to_widget(field, value)
        match field.kind:
            case 'slider':
                low, high, step = widgets.slider_range(field, value)
                return self._gui.add_slider(label, low, high, step, shown, hint=field.hint)
            case 'number':
                return self._gui.add_number(
                    label, shown, min=field.minimum, max=field.maximum, hint=field.hint,
                    step=1 if field.whole else None,
                )  # fmt: skip
            case 'switch':
                return self._gui.add_checkbox(label, shown, hint=field.hint)
            case 'choice':
                return self._gui.add_dropdown(
                    label, field.choices, initial_value=shown, hint=field.hint
                )
            case 'vector':
                return self._gui.add_vector3(label, shown, hint=field.hint, step=0.01)
            case 'color':
                return self._gui.add_rgba(label, shown, hint=field.hint)
        return self._gui.add_text(label, shown, hint=field.hint)

    def _updated(self, field: Field, event: Any) -> None:
        if event.client_id is not None:  # by a user, not by this program
            self._later(partial(self._set, field, event.target.value))

    def _set(self, field: Field, value: Any) -> None:
        self._dragged[field.name] = time.monotonic()
        self._change(field, value)

    def show(self, name: str, value: Any) -> None:
        """Display the value of a parameter."""
        self._values[name] = value
        widget, field = self._widgets.get(name), self._fields.get(name)
        if widget is None or field is None or not widgets.can_show(field, value):
            return
        shown = widgets.to_widget(field, value)
        if field.kind == 'slider' and not widget.min <= shown <= widget.max:
            self._fit_slider(field, widget)
        widget.value = shown

    def restore(self, name: str) -> None:
        """Display the last known value of a parameter again."""
        self.show(name, self._values[name])

    def settle(self) -> None:
        """Adapt the range of sliders that have been dragged to their end, or close to 0."""
        now = time.monotonic()
        for name, last in list(self._dragged.items()):
            if now - last < SETTLED:
                continue
            del self._dragged[name]
            widget, field = self._widgets.get(name), self._fields.get(name)
            if widget is not None and field is not None and field.kind == 'slider':
                value = self._values[name]
                if value > 0.999 * widget.max or 0.0 < value < 0.02 * widget.max:
                    self._fit_slider(field, widget)

    def _fit_slider(self, field: Field, widget: Any) -> None:
        low, high, widget.step = widgets.slider_range(field, self._values[field.name])
        widget.min, widget.max = low, high
        widget.precision = widgets.decimals(widget.step)


def with_unit(value: float, units: Sequence[tuple[float, str]]) -> str:
    """Return a value as text in the first of the units, from large to small, that is not more."""
    size, unit = next(((size, unit) for size, unit in units if value >= size), units[-1])
    return f'{value / size:g} {unit}'
