# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Widgets for parameters, derived from their descriptors: pure functions."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
import math
import re
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, ParameterType

from softbody_ros.viewer.decoding import round_up

ORIGINAL = ('mass', 'stiffness', 'bounciness', 'friction', 'deformation', 'elasticity', 'mode')
"""The sliders of the original Maya plugin, in its order."""
VELOCITY = ('initial_velocity.linear', 'initial_velocity.angular')
WIDEST_SLIDER = 5.0
"""Range above which a slider shows only the lower end: it would be too coarse there."""
LISTS = {
    ParameterType.PARAMETER_DOUBLE_ARRAY: float,
    ParameterType.PARAMETER_INTEGER_ARRAY: int,
    ParameterType.PARAMETER_STRING_ARRAY: str,
}
TYPES = {
    ParameterType.PARAMETER_BOOL,
    ParameterType.PARAMETER_INTEGER,
    ParameterType.PARAMETER_DOUBLE,
    ParameterType.PARAMETER_STRING,
    *LISTS,
}
"""Types of parameters that can be shown."""
_UNIT = re.compile(r' \[([^\]]+)\]$')


class FieldError(ValueError):
    """A text that is not a value of the parameter; with the reason in one sentence."""


@dataclass(frozen=True)
class Field:
    """
    One parameter as displayed in the panel.

    `kind` is slider, number, switch, choice, vector, color or text; `type` its `ParameterType`.
    """

    name: str
    kind: str
    type: int
    hint: str
    unit: str = ''
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] = ()

    @property
    def whole(self) -> bool:
        """Whether it is an integer."""
        return self.type == ParameterType.PARAMETER_INTEGER


def field(descriptor: ParameterDescriptor, value: Any) -> Field:
    """Return the field of a parameter with this descriptor and value."""
    found = _UNIT.search(descriptor.description)
    unit = found.group(1) if found else ''
    hint = _UNIT.sub('', descriptor.description)
    if descriptor.additional_constraints:
        hint += f' ({descriptor.additional_constraints}{" " + unit if unit else ""})'
    ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
    low, high = (ranges[0].from_value, ranges[0].to_value) if ranges else (None, None)
    choices: tuple[str, ...] = ()
    kind = 'text'
    if descriptor.type == ParameterType.PARAMETER_DOUBLE:
        kind = 'slider' if ranges else 'number'
    elif descriptor.type == ParameterType.PARAMETER_INTEGER:
        kind = 'number'
    elif descriptor.type == ParameterType.PARAMETER_BOOL:
        kind = 'switch'
    elif descriptor.type == ParameterType.PARAMETER_STRING:
        choices = tuple(filter(None, descriptor.additional_constraints.split(' | ')))
        kind = 'choice' if choices else 'text'
    elif descriptor.type == ParameterType.PARAMETER_DOUBLE_ARRAY:
        if descriptor.name.split('.')[-1] == 'color' and len(value) == 4:
            kind = 'color'
        elif len(value) == 3:
            kind = 'vector'
    return Field(descriptor.name, kind, descriptor.type, hint, unit, low, high, choices)


def slider_range(field: Field, value: float) -> tuple[float, float, float]:
    """
    Return minimum, maximum and step of a slider that shows a value.

    Of a wide range it shows up to about twice the value; it grows when dragged to its end.
    """
    low, high = field.minimum or 0.0, field.maximum or 0.0
    if high - low > WIDEST_SLIDER:
        high = min(high, round_up(max(1.5 * value, 1e-3 if low > 0.0 else 1.0, 2.0 * low)))
    step = round_up((high - max(low, 0.0)) / 1000.0)
    if 0.0 < low < step:
        low = min(step, value)
    return low, high, step


def to_widget(field: Field, value: Any) -> Any:
    """Return the value of a widget for the value of a parameter."""
    if field.kind == 'color':
        return tuple(round(255.0 * item) for item in value)
    if field.kind == 'vector':
        return tuple(float(item) for item in value)
    if field.kind == 'text' and field.type in LISTS:
        kind = LISTS[field.type]
        return ', '.join(f'{item:g}' if kind is float else str(item) for item in value)
    return value


def can_show(field: Field, value: Any) -> bool:
    """Whether the widget of a field can display a value of the field's type."""
    if field.kind in ('slider', 'number'):
        return math.isfinite(value)
    if field.kind in ('vector', 'color'):
        count = 3 if field.kind == 'vector' else 4
        return len(value) == count and all(map(math.isfinite, value))
    return field.kind != 'choice' or value in field.choices


def from_widget(field: Field, value: Any) -> Any:
    """
    Return the value of a parameter for the value of its widget.

    Raises
    ------
    FieldError
        if a text is not a list of the parameter's type.

    """
    if field.kind == 'color':
        return [item / 255.0 for item in value]
    if field.kind == 'vector':
        return [float(item) for item in value]
    if field.kind == 'text' and field.type in LISTS:
        items = [item for item in re.split(r'[\s,]+', value.strip('[]() ')) if item]
        try:
            if LISTS[field.type] is str:
                return items or ['']  # an empty list has no type
            return [LISTS[field.type](item) for item in items]
        except ValueError:
            what = 'whole numbers' if LISTS[field.type] is int else 'numbers'
            raise FieldError(
                f'{field.name}: {value!r} is no list of {what}: separate them by commas'
            ) from None
    if field.type == ParameterType.PARAMETER_DOUBLE:
        return float(value)
    return int(value) if field.whole else value


@dataclass(frozen=True)
class Section:
    """A folder of the panel: the names of its parameters, and their common prefix."""

    title: str
    names: tuple[str, ...]
    prefix: str = ''
    is_open: bool = True


def sections(
    names: Iterable[str], bodies: Sequence[str], obstacles: Sequence[str]
) -> tuple[list[Section], dict[str, list[Section]], dict[str, list[Section]]]:
    """Return the sections of the scene, of each body and of each obstacle, in order."""
    left = list(names)

    def take(wanted: Iterable[str]) -> tuple[str, ...]:
        taken = tuple(name for name in wanted if name in left)
        left[:] = [name for name in left if name not in taken]
        return taken

    def of(owner: str) -> list[str]:
        return [name for name in left if name.startswith(owner + '.')]

    gravity = Section('gravity', take(of('gravity')), 'gravity.')
    body_sections = {}
    for body in bodies:
        own = take(f'{body}.{name}' for name in ORIGINAL)
        velocity = take(f'{body}.{name}' for name in VELOCITY)
        body_sections[body] = [
            Section(body, own, f'{body}.'),
            Section('initial velocity', velocity, f'{body}.initial_velocity.'),
            Section(f'more of {body}', take(of(body)), f'{body}.', is_open=False),
        ]
    obstacle_sections = {
        name: [Section(f'obstacle {name}', take(of(name)), f'{name}.', is_open=False)]
        for name in obstacles
    }
    rest = Section('simulation', take(list(left)), is_open=False)
    return [gravity, rest], body_sections, obstacle_sections


def label(field: Field, section: Section) -> str:
    """Return the label of a widget, without the prefix of its section."""
    word = field.name.removeprefix(section.prefix).replace('.', ' ').replace('_', ' ')
    # a division slash: after another one browsers break lines
    return f'{word} [{field.unit.replace("/", "∕")}]' if field.unit else word


def decimals(step: float) -> int:
    """Return the number of decimals that resolves the steps of a slider."""
    return max(0, -math.floor(math.log10(step) + 1e-9))
