# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What can be fitted: a number of the scene within bounds, as a coordinate from 0 to 1."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math
from typing import Any

import numpy as np

from softbody_ros.core.config import ConfigError, Setting, checked, shown
from softbody_ros.scene.parameters import (
    BODY_TABLE,
    OBSTACLE_TABLE,
    SceneLists,
    normal,
    scene_lists,
    table,
    unknown_parameter,
)
from softbody_ros.scene.scene_file import scene_of

OFFSET = 'time_offset'
"""Name of the time, s, that is added to those of the observation."""
GRAVITY = ('gravity.magnitude', 'gravity.direction')
"""What can be fitted of what belongs to no body and no obstacle."""
LOGARITHMIC = 30.0
"""Bounds with at least this ratio are searched by the logarithm."""
AXES = 'xyz'

RANGES: dict[str, tuple[float, float]] = {
    'density': (1.0, 2e4),
    'elasticity': (0.0, 1.0),
    'friction': (0.0, 2.0),
    'gravity.magnitude': (0.0, 20.0),
    'natural_frequency': (0.3, 300.0),
    'plasticity.creep': (0.01, 1e3),
    'plasticity.yield': (1e-3, 1.0),
    'thickness': (0.0, 0.05),
    'young_modulus': (1e2, 1e8),
}
"""Default bounds where the range of the parameter is wider than what objects have."""
FACTORS = {'mass': 30.0, 'size': 2.0}
"""Default bounds about the value of the scene: it divided and multiplied by this."""
REACHES = {
    'position': 0.2,
    'initial_velocity.linear': 1.0,
    'initial_velocity.angular': 5.0,
    'velocity.linear': 1.0,
    'velocity.angular': 5.0,
    'surface_velocity': 1.0,
}
"""Default bounds of a component of a vector: its value in the scene less and plus this."""
WIDEST = 1.0
"""Other ranges that are wider need bounds from the user."""


@dataclass(frozen=True)
class Unknown:
    """
    A number that is fitted.

    Attributes
    ----------
    name : str
        of the parameter, with .x, .y or .z for a component of a vector; or `OFFSET`
    low, high : float
        bounds
    start : float
        value in the scene
    unit : str
    component : int, optional
        of a vector

    """

    name: str
    low: float
    high: float
    start: float
    unit: str = ''
    component: int | None = None

    @property
    def parameter(self) -> str:
        """Name of the parameter of the scene."""
        return self.name if self.component is None else self.name[:-2]

    @property
    def logarithmic(self) -> bool:
        """Whether its coordinate is that of the logarithm."""
        return 0.0 < LOGARITHMIC * self.low <= self.high

    def value(self, coordinate: float) -> float:
        """Return the value at a coordinate, which is 0 at the lower and 1 at the upper bound."""
        if self.logarithmic:
            value = self.low * (self.high / self.low) ** coordinate
        else:
            value = self.low + (self.high - self.low) * coordinate
        # ten digits: the value of the scene comes back as it was written
        return min(max(float(f'{value:.10g}'), self.low), self.high)

    def coordinate(self, value: float) -> float:
        """Return the coordinate of a value."""
        if self.logarithmic:
            return math.log(max(value, 1e-300) / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)

    def slope(self, coordinate: float) -> float:
        """Return the derivative of the value by the coordinate."""
        if self.logarithmic:
            return self.value(coordinate) * math.log(self.high / self.low)
        return self.high - self.low


def fitted_values(
    scene: Mapping[str, Any], unknowns: Sequence[Unknown], coordinates: np.ndarray
) -> dict[str, Any]:
    """Return the values of a scene with those of the unknowns at coordinates (p,)."""
    values = dict(scene)
    known = table(scene_lists(scene))
    for unknown, coordinate in zip(unknowns, coordinates, strict=True):
        name, value = unknown.parameter, unknown.value(coordinate)
        if name == OFFSET:
            continue
        if unknown.component is None:
            values[name] = value
        else:
            vector = list(values.get(name, known[name].default))
            vector[unknown.component] = value
            values[name] = vector
    return values


def offset_of(unknowns: Sequence[Unknown], coordinates: np.ndarray) -> float:
    """Return the time offset among the unknowns at coordinates (p,), s; 0 without one."""
    for unknown, coordinate in zip(unknowns, coordinates, strict=True):
        if unknown.name == OFFSET:
            return unknown.value(coordinate)
    return 0.0


def separate(arguments: Sequence[str]) -> tuple[dict[str, Any], dict[str, Any]]:
    """
    Separate the arguments `-p`: what is fitted from what is set.

    Returns
    -------
    fitted : dict
        names to bounds [low, high], or None for default ones
    assigned : dict
        names to values, which are those of the scene then

    Raises
    ------
    ConfigError
        if one is no NAME, NAME:=[LOW, HIGH] or NAME:=VALUE, or a name is given twice.

    """
    fitted: dict[str, Any] = {}
    assigned: dict[str, Any] = {}
    for argument in arguments:
        if ':=' not in argument:
            new: dict[str, Any] = {argument: None}
        else:
            new = scene_of('', '', [argument])
        name, value = next(iter(new.items()))
        if name in fitted or name in assigned:
            raise ConfigError(f'-p {name} is given twice: give it once')
        is_bounds = ':=' not in argument or (
            isinstance(value, list) and len(value) == 2 and _is_number(name)
        )
        (fitted if is_bounds else assigned)[name] = value
    return fitted, assigned


def _is_number(name: str) -> bool:
    facts = _setting(name.partition('.')[2]) or table(SceneLists()).get(name)
    return facts is None or not isinstance(facts.default, tuple)


def _setting(own: str) -> Setting | None:
    """Return the setting of a parameter of bodies or obstacles."""
    return BODY_TABLE.get(own) or OBSTACLE_TABLE.get(own)


def make_unknown(scene: Mapping[str, Any], name: str, bounds: Any) -> Unknown:
    """
    Return what is fitted by its name.

    Parameters
    ----------
    scene : mapping
        values of the scene
    name : str
    bounds : [low, high] or None
        None: those of `RANGES`, … or of the parameter

    Raises
    ------
    ConfigError
        if there is no such parameter, it is no real number, nothing that moves a body, or bounds
        are missing or wrong.

    """
    if name == OFFSET:
        low, high = (-0.1, 0.1) if bounds is None else _pair(name, bounds)
        return Unknown(name, low, high, min(max(0.0, low), high), 's')
    known = table(scene_lists(scene))
    parameter, component = name, None
    if name not in known and name[-2:] in ('.x', '.y', '.z'):
        parameter, component = name[:-2], AXES.index(name[-1])
    if parameter not in known:
        hint = unknown_parameter(name, known)
        if '=' in name:
            hint = 'write NAME, NAME:=[LOW,HIGH] or NAME:=VALUE'
        raise ConfigError(f'unknown parameter {name}: {hint}')
    facts = known[parameter]
    _require_real(parameter, facts, scene_lists(scene))
    if (facts.length is not None) != (component is not None):
        if component is None:
            raise ConfigError(
                f'{name} is a vector: fit its components, such as -p {name}.x -p {name}.z'
            )
        raise ConfigError(f'{parameter} has no component {name[-1]}: fit {parameter} itself')
    whole = normal(scene.get(parameter, facts.default), facts)
    whole = checked(parameter, whole, facts)
    start = whole if component is None else whole[component]
    own = parameter if parameter in GRAVITY else parameter.partition('.')[2]
    low, high = _default(name, own, start, facts) if bounds is None else _pair(name, bounds)
    for end in (low, high):
        checked(f'bound of {name}', [end] * facts.length if facts.length else end, facts)
    return Unknown(name, low, high, start, facts.unit, component)


def _require_real(name: str, facts: Setting, lists: SceneLists) -> None:
    owner, _, own = name.partition('.')
    if isinstance(facts.default, bool) or facts.items is not None:
        kind = 'a switch' if isinstance(facts.default, bool) else 'a list'
    elif isinstance(facts.default, str):
        kind = 'a choice' if facts.choices else 'a text'
    elif isinstance(facts.default, int):
        kind = 'a whole number'
    elif facts.length not in (None, 3):
        kind = f'{facts.length} numbers'
    elif name in GRAVITY or (owner in (*lists.bodies, *lists.obstacles) and own != 'color'):
        return
    else:
        raise ConfigError(f'{name} cannot be fitted: it is no property of a body or an obstacle')
    raise ConfigError(
        f'{name} cannot be fitted: it is {kind}; fit real numbers, and set this with '
        f'-p {name}:=VALUE'
    )


def _default(name: str, own: str, start: float, facts: Setting) -> tuple[float, float]:
    if own in RANGES:
        return RANGES[own]
    if own in FACTORS:
        return start / FACTORS[own], start * FACTORS[own]
    if own in REACHES:
        return start - REACHES[own], start + REACHES[own]
    if facts.minimum is None or facts.maximum is None or facts.maximum - facts.minimum > WIDEST:
        raise ConfigError(
            f'{name} has a wide range, {facts.range_text}: give bounds, -p {name}:=[LOW,HIGH]'
        )
    return facts.minimum, facts.maximum


def _pair(name: str, bounds: Any) -> tuple[float, float]:
    is_pair = isinstance(bounds, Sequence) and not isinstance(bounds, str) and len(bounds) == 2
    if not is_pair or not all(
        isinstance(each, (int, float)) and not isinstance(each, bool) and math.isfinite(each)
        for each in bounds
    ):
        raise ConfigError(f'the bounds of {name} are {shown(bounds)}: give two numbers')
    low, high = map(float, bounds)
    if not low < high:
        raise ConfigError(
            f'the bounds of {name} are {shown(bounds)}: the first must be less than the second'
        )
    return low, high
