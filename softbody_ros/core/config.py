# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Settings of a simulation as frozen dataclasses, validated on construction.

Each field declares its default, range, unit and description once, in `setting(...)`; validation,
the ROS parameters, their descriptors and the reference pages are all derived from it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
import dataclasses
from dataclasses import dataclass
import difflib
from functools import cache, cached_property
import math
import numbers
import re
from typing import Any, Self

import numpy as np

from softbody_ros.core.geometry.mesh import ORIGINS, PRIMITIVES, UPS, MeshFrame
from softbody_ros.core.geometry.mesh_files import FILE_TYPES
from softbody_ros.core.geometry.simplification import FEWEST
from softbody_ros.core.geometry.surface import LARGEST_MESH, Surface

MODES = ('rigid', 'linear', 'quadratic')
FRICTION_MODELS = ('viscous', 'coulomb')
MASS_DISTRIBUTIONS = ('surface', 'volume')
OBSTACLE_TYPES = ('plane', 'box', 'sphere', 'capsule', 'cylinder', 'mesh')
NAME_PATTERN = re.compile(r'[A-Za-z][A-Za-z0-9_]*')
LONGEST_NAME = 100
"""Characters of a name: with it topics have at most 247, of which a namespace is to have some."""
LEAST = {'density': 1e-6, 'young_modulus': 1e-3}
"""Least values of settings that are off at 0, kg/m³ and Pa: frequencies follow from them."""
LARGEST = 1e6
"""Largest magnitude of a vector component: beyond it float64 loses the micrometre."""
FASTEST = 1e4
"""Largest magnitude of a component of a velocity, m/s or rad/s."""
MOST_CHARACTERS, MOST_ITEMS = 80, 12
"""Of a value, or of a list, that are shown in a sentence."""


class ConfigError(ValueError):
    """An invalid setting: the message is one sentence with value, range and remedy."""


@dataclass(frozen=True)
class Setting:
    """
    Metadata of one field; `minimum` and `maximum` hold for each element of a vector.

    `items` is the type of the elements of a list of any length.
    """

    default: Any
    description: str
    unit: str = ''
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] = ()
    group: str = ''
    read_only: bool = False
    items: type | None = None

    @cached_property
    def length(self) -> int | None:
        """Number of elements of a numeric vector, None for anything else."""
        is_vector = isinstance(self.default, tuple) and self.items is None
        return len(self.default) if is_vector else None

    @property
    def range_text(self) -> str:
        """The allowed values, for tables and error messages."""
        if self.choices:
            return ' | '.join(self.choices)
        if self.minimum is None or self.maximum is None:
            return ''
        if self.minimum == -self.maximum:
            return f'±{self.maximum:g}'
        return f'{self.minimum:g} … {self.maximum:g}'


def setting(default: Any, description: str, **facts: Any) -> Any:
    """Return a dataclass field that carries a `Setting`."""
    metadata = {'setting': Setting(default, description, **facts)}
    return dataclasses.field(default=default, metadata=metadata)


def settings(config_class: type | object) -> Sequence[tuple[str, str, Setting]]:
    """
    Return (field name, dotted name, Setting) of each field made by `setting`.

    The dotted name is the ROS parameter's: field `gravity_magnitude` of group `gravity` is
    `gravity.magnitude`, `pins_velocity_linear` of group `pins.velocity` is `pins.velocity.linear`.
    """
    return _settings(config_class if isinstance(config_class, type) else type(config_class))


@cache
def _settings(config_class: type) -> tuple[tuple[str, str, Setting], ...]:
    return tuple(_each_setting(config_class))


@cache
def _settings_by_field(config_class: type) -> dict[str, tuple[str, str, Setting]]:
    return {each[0]: each for each in _settings(config_class)}


def _each_setting(config_class: type) -> Iterator[tuple[str, str, Setting]]:
    for field in dataclasses.fields(config_class):
        facts = field.metadata.get('setting')
        if facts is None:
            continue
        dotted = field.name
        if facts.group:
            start = facts.group.replace('.', '_') + '_'
            dotted = facts.group + '.' + field.name.removeprefix(start)
        yield field.name, dotted, facts


def checked(name: str, value: Any, facts: Setting) -> Any:
    """
    Return `value` as the type of the setting's default: integers become floats, lists tuples.

    Raises
    ------
    ConfigError
        if the type, the number of elements or the range is wrong, or a number is not finite.

    """
    default = facts.default
    if isinstance(default, bool):
        if not isinstance(value, (bool, np.bool_)):
            raise ConfigError(f'{name} is {shown(value)}: it must be true or false')
        return bool(value)
    if isinstance(default, str):
        if not isinstance(value, str):
            raise ConfigError(f'{name} is {shown(value)}: it must be a text')
        if facts.choices and value not in facts.choices:
            raise ConfigError(
                f'{name} is {shown(value)}: choose one of {", ".join(facts.choices)}'
            )
        return value
    if isinstance(default, tuple):
        is_list = isinstance(value, (tuple, list))  # asked first: it is much faster
        is_list = is_list or (isinstance(value, Sequence) and not isinstance(value, str))
        is_list = is_list or (isinstance(value, np.ndarray) and value.ndim > 0)
        if facts.items is str:
            if not is_list or not all(isinstance(item, str) for item in value):
                raise ConfigError(f'{name} is {shown(value)}: it must be a list of names')
            return tuple(value)
        if facts.items is int:
            if not is_list:
                raise ConfigError(f'{name} is {shown(value)}: it must be a list of whole numbers')
            items = value.tolist() if isinstance(value, np.ndarray) else value
            if _are_allowed_integers(items, facts):  # asked first: it is much faster
                return tuple(items)
            return tuple(_number(name, value, item, facts, int) for item in value)
        if not is_list or len(value) != facts.length:
            raise ConfigError(f'{name} is {shown(value)}: it must be {facts.length} numbers')
        if _are_allowed_floats(value, facts):  # asked first: it is much faster
            return tuple(map(float, value))
        return tuple(_number(name, value, item, facts, float) for item in value)
    return _number(name, value, value, facts, type(default))


def _bounds(facts: Setting) -> tuple[float, float]:
    """Return the ends of the range of a setting; infinite ones where it has none."""
    low = -math.inf if facts.minimum is None else facts.minimum
    return low, math.inf if facts.maximum is None else facts.maximum


def _are_floats(value: Iterable[Any]) -> bool:
    return {*map(type, value)} == {float}


def _are_allowed_integers(value: Sequence[Any], facts: Setting) -> bool:
    low, high = _bounds(facts)
    if not {*map(type, value)} <= {int}:
        return False
    return not value or (low <= min(value) and max(value) <= high)


def _are_allowed_floats(value: Iterable[Any], facts: Setting) -> bool:
    low, high = _bounds(facts)
    for item in value:
        if not (isinstance(item, float) and low <= item <= high and math.isfinite(item)):
            return False
    return True


def _number(name: str, value: Any, item: Any, facts: Setting, kind: type) -> Any:
    wanted = numbers.Integral if kind is int else numbers.Real
    is_plain = kind is float and isinstance(item, float)  # asked first: it is much faster
    if not is_plain and (isinstance(item, (bool, np.bool_)) or not isinstance(item, wanted)):
        what = 'a whole number' if kind is int else 'a number'
        raise ConfigError(f'{name} is {shown(value)}: it must be {what}')
    try:
        number = kind(item)
    except OverflowError:
        number = math.inf
    low, high = _bounds(facts)
    if not low <= number <= high or (kind is float and not math.isfinite(number)):
        allowed = f'from {low:g} to {high:g}' if low > -math.inf or high < math.inf else 'finite'
        unit = f' {facts.unit}' if facts.unit else ''
        each = 'each element must be' if item is not value else 'it must be'
        raise ConfigError(f'{name} is {shown(value)}: {each} {allowed}{unit}')
    return number


def shown(value: Any) -> str:
    """Return a value for a sentence; of a long one its beginning."""
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    if isinstance(value, str):
        return repr(value if len(value) <= MOST_CHARACTERS else value[:MOST_CHARACTERS] + '…')
    if isinstance(value, Sequence):
        items = [shown(item) for item in value[:MOST_ITEMS]]
        if len(value) > MOST_ITEMS:
            items.append(f'… ({len(value)} in all)')
        return '[' + ', '.join(items) + ']'
    text = repr(value)
    return text if len(text) <= MOST_CHARACTERS else text[:MOST_CHARACTERS] + '…'


def in_brackets(values: Iterable[float]) -> str:
    """Return numbers for a sentence."""
    return '[' + ', '.join(f'{value:g}' for value in values) + ']'


def unknown_name(name: str, known: Sequence[str]) -> str:
    """Return the clause of an error message that helps with a misspelt name."""
    if not known:
        return 'there are none'
    close = difflib.get_close_matches(name[:MOST_CHARACTERS], known, n=1)
    if close:
        return f'did you mean {close[0]}?'
    more = f' and {len(known) - MOST_ITEMS} more' if len(known) > MOST_ITEMS else ''
    return f'known are {", ".join(known[:MOST_ITEMS])}{more}'


def require_usable_name(name: Any) -> None:
    """Raise ConfigError if something is no name for a body or an obstacle."""
    if not (isinstance(name, str) and NAME_PATTERN.fullmatch(name)):
        raise ConfigError(
            f'the name {shown(name)} is not usable: begin with a letter and go on with letters, '
            'digits and underscores (a-z, A-Z, 0-9, _)'
        )
    if len(name) > LONGEST_NAME:
        raise ConfigError(
            f'the name {shown(name)} has {len(name)} characters: at most {LONGEST_NAME} are '
            'possible, shorten it'
        )


def require_distinct(names: Sequence[str]) -> None:
    """Raise ConfigError if a name occurs twice."""
    if len(set(names)) < len(names):
        name = next(name for name in names if names.count(name) > 1)
        raise ConfigError(f'the name {name} is used twice: give each thing its own')


class Checked:
    """Base of the config dataclasses: checks every setting when an object is made."""

    @property
    def prefix(self) -> str:
        """What stands before a setting's name in messages and ROS parameters."""
        name = getattr(self, 'name', '')
        return f'{name}.' if name else ''

    def __post_init__(self) -> None:
        require_usable_name(getattr(self, 'name', 'unnamed'))
        self._check(settings(self))

    def with_values(self, **values: Any) -> Self:
        """Return a config with other values, of the right types and in range: unchecked."""
        result = object.__new__(type(self))
        result.__dict__.update(self.__dict__)
        result.__dict__.update(values)
        return result

    def _check(self, chosen: Sequence[tuple[str, str, Setting]]) -> None:
        """Check the values of some settings, and make them of the right type."""
        prefix = self.prefix
        for field, dotted, facts in chosen:
            value = getattr(self, field)
            if isinstance(value, Surface):
                continue
            object.__setattr__(self, field, checked(prefix + dotted, value, facts))
        for field, dotted, facts in chosen:
            if field.endswith(('direction', 'orientation')):
                length = math.hypot(*getattr(self, field))
                if length < 1e-6:
                    raise ConfigError(
                        f'{self.prefix + dotted} is {shown(getattr(self, field))}: '
                        f'its length must not be zero, {shown(facts.default)} is the default'
                    )


def _vector(default: tuple[float, ...], description: str, **facts: Any) -> Any:
    facts = {'minimum': -LARGEST, 'maximum': LARGEST} | facts
    return setting(default, description, **facts)


MESH_SOURCE = (
    f'a primitive ({", ".join(PRIMITIVES)}) or a mesh file '
    f'({", ".join(FILE_TYPES).upper()}) by path, file:// or package:// URI'
)
RESOLUTION = 'each level has four times as many triangles'


def _mesh_scale() -> Any:
    return setting(
        0.0,
        'Length in m of one unit of the mesh file, such as 0.001 for millimetres; 0 scales the '
        'file to size; without effect on primitives',
        minimum=0.0, maximum=LARGEST, read_only=True,
    )  # fmt: skip


def _mesh_origin() -> Any:
    return setting(
        'box_centre',
        'Point of the mesh file that becomes the origin of the body or obstacle: centre of the '
        'bounding box, origin of the file or centre of mass; without effect on primitives',
        choices=ORIGINS, read_only=True,
    )  # fmt: skip


def _mesh_up() -> Any:
    return setting(
        'auto',
        'Axis of the mesh file that points up; auto takes y for GLB, the axis that a COLLADA '
        'file states, and z for other formats; without effect on primitives',
        choices=UPS, read_only=True,
    )  # fmt: skip


@dataclass(frozen=True)
class BodyConfig(Checked):
    """
    One deformable object.

    `mesh` is the name of a primitive, the path of a mesh file, or a `Surface` made by the caller
    (whose vertices are taken as they are, without `size`). So is `visual_mesh`, if there is one.
    """

    name: str = 'body'
    mesh: str | Surface = setting(
        'icosphere', f'Surface to simulate: {MESH_SOURCE}', read_only=True
    )
    size: float = setting(
        0.5,
        'Radius or half extent of a primitive; half of the longest side of a mesh file, unless '
        'mesh_scale is set',
        unit='m', minimum=1e-4, maximum=1e4, read_only=True,
    )  # fmt: skip
    mesh_scale: float = _mesh_scale()
    mesh_origin: str = _mesh_origin()
    mesh_up: str = _mesh_up()
    subdivisions: int = setting(
        3, f'Resolution of a primitive: {RESOLUTION}', minimum=0, maximum=8, read_only=True
    )
    mass_distribution: str = setting(
        'surface', 'Distribution of the mass: surface spreads it over the surface by area, as in '
        'a hollow ball; volume over the enclosed volume, as in a solid ball',
        choices=MASS_DISTRIBUTIONS, read_only=True,
    )  # fmt: skip
    visual_mesh: str | Surface = setting(
        '', 'Fine surface that follows the simulated one and is displayed in its place: a '
        'primitive or a mesh file, given as in mesh; empty for none', read_only=True,
    )  # fmt: skip
    simplify_to: int = setting(
        0, 'Approximate number of vertices to which the mesh is simplified for the simulation, '
        'while the original mesh is displayed; 0 is off; requires fast-simplification',
        minimum=0, maximum=LARGEST_MESH, read_only=True,
    )  # fmt: skip
    position: tuple[float, ...] = _vector(
        (0.0, 0.0, 1.5), 'Initial position of the body, to which a reset returns it', unit='m'
    )
    orientation: tuple[float, ...] = _vector(
        (0.0, 0.0, 0.0, 1.0),
        'Initial orientation of the body, to which a reset returns it: quaternion x y z w',
        minimum=-1.0, maximum=1.0,
    )  # fmt: skip
    initial_velocity_linear: tuple[float, ...] = _vector(
        (0.0, 0.0, 0.0),
        'Initial velocity of the centre of mass, set at the start, by ~/reset and by '
        '~/apply_initial_velocity',
        unit='m/s', minimum=-FASTEST, maximum=FASTEST, group='initial_velocity',
    )  # fmt: skip
    initial_velocity_angular: tuple[float, ...] = _vector(
        (0.0, 0.0, 0.0),
        'Initial angular velocity about the centre of mass in world axes, set at the start, by '
        '~/reset and by ~/apply_initial_velocity',
        unit='rad/s', minimum=-FASTEST, maximum=FASTEST, group='initial_velocity',
    )  # fmt: skip
    mass: float = setting(
        1.0, 'Total mass of the body, in effect if density is 0', unit='kg', minimum=1e-6,
        maximum=1e6,
    )  # fmt: skip
    density: float = setting(
        0.0, 'Density of the material, which sets the mass by the enclosed volume; 0 uses mass',
        unit='kg/m³', minimum=0.0, maximum=1e5,
    )  # fmt: skip
    mode: str = setting(
        'quadratic', 'Deformations that the goal shape can have: rigid has none; linear '
        'stretches and shears; quadratic also bends, twists and bulges', choices=MODES,
    )  # fmt: skip
    stiffness: float = setting(
        0.5, 'Stiffness of the pull towards the goal shape, in effect if natural_frequency and '
        'young_modulus are 0; its angular frequency ω follows from cos(ω·reference_step) = 1 − '
        'stiffness/2', minimum=0.0, maximum=1.0,
    )  # fmt: skip
    natural_frequency: float = setting(
        0.0, 'Natural frequency of the pull towards the goal shape, in place of stiffness; 0 '
        'uses stiffness', unit='Hz', minimum=0.0, maximum=1e6,
    )  # fmt: skip
    young_modulus: float = setting(
        0.0, "Young's modulus of the material, which sets the natural frequency by size, mass "
        'and shape; 0 uses natural_frequency or stiffness', unit='Pa', minimum=0.0, maximum=1e12,
    )  # fmt: skip
    bounciness: float = setting(
        0.5, 'Ratio of the amplitudes of successive half swings of a deformation: 0 is '
        'critically damped, 1 is undamped', minimum=0.0, maximum=1.0,
    )  # fmt: skip
    deformation: float = setting(
        0.5, 'Fraction β of the deformation that the goal shape follows: larger values yield '
        'more, and at 1 the deformation remains', minimum=0.0, maximum=1.0,
    )  # fmt: skip
    elasticity: float = setting(
        0.3, 'Coefficient of restitution ε of contacts: exact for rigid bodies; of deformable '
        'bodies, the fraction of the rebound that is kept', minimum=0.0, maximum=1.0,
    )  # fmt: skip
    friction: float = setting(
        0.5, 'Friction of the surface: the coefficient μ with friction_model coulomb; the '
        'fraction of the sliding velocity removed per reference_step with viscous',
        minimum=0.0, maximum=10.0,
    )  # fmt: skip
    friction_model: str = setting(
        'coulomb', 'Law of sliding friction: coulomb limits the force to μ times the normal '
        'force; viscous removes a fraction of the sliding velocity', choices=FRICTION_MODELS,
    )  # fmt: skip
    volume_conservation: float = setting(
        1.0, 'Degree to which the rest volume is conserved: 1 is incompressible, 0 lets the '
        'volume change', minimum=0.0, maximum=1.0,
    )  # fmt: skip
    damping: float = setting(
        0.0, 'Fraction of the velocity of deformation removed per reference_step; rigid motion '
        'is not damped', minimum=0.0, maximum=1.0,
    )  # fmt: skip
    thickness: float = setting(
        0.0, 'Distance that the vertices of the body keep from obstacles', unit='m', minimum=0.0,
        maximum=1e3,
    )  # fmt: skip
    regions_count: int = setting(
        0, 'Number of overlapping regions that are matched separately, so that the body bends '
        'locally; 0 matches the body as a whole only', minimum=0, maximum=4096, group='regions',
        read_only=True,
    )  # fmt: skip
    regions_overlap: int = setting(
        3, 'Number of regions to which each particle belongs', minimum=1, maximum=16,
        group='regions', read_only=True,
    )  # fmt: skip
    regions_whole_body_weight: float = setting(
        0.3, 'Weight of the match of the whole body in the goal shape; the regions share the '
        'rest', minimum=0.0, maximum=1.0, group='regions',
    )  # fmt: skip
    plasticity_yield: float = setting(
        0.1, 'Strain beyond which deformation becomes permanent', minimum=0.0, maximum=10.0,
        group='plasticity',
    )  # fmt: skip
    plasticity_creep: float = setting(
        0.0, 'Rate of plastic flow beyond the yield strain; 0 is elastic', unit='1/s',
        minimum=0.0, maximum=1e4, group='plasticity',
    )  # fmt: skip
    plasticity_max: float = setting(
        0.3, 'Largest permanent strain', minimum=0.0, maximum=0.9, group='plasticity'
    )
    pins_indices: tuple[int, ...] = setting(
        (), 'Indices of pinned vertices, which are held in place or moved by pins.velocity; empty '
        'for none', minimum=-1, maximum=LARGEST_MESH, items=int, group='pins',
    )  # fmt: skip
    pins_box: tuple[float, ...] = _vector(
        (0.0,) * 6, 'Box whose vertices are pinned: x y z of two opposite corners in the axes of '
        'the mesh; all 0 for none', unit='m', group='pins',
    )  # fmt: skip
    pins_velocity_linear: tuple[float, ...] = _vector(
        (0.0, 0.0, 0.0), 'Velocity of the pinned vertices in world axes', unit='m/s',
        minimum=-FASTEST, maximum=FASTEST, group='pins.velocity',
    )  # fmt: skip
    pins_velocity_angular: tuple[float, ...] = _vector(
        (0.0, 0.0, 0.0), 'Angular velocity of the pinned vertices about their centre in world '
        'axes', unit='rad/s', minimum=-FASTEST, maximum=FASTEST, group='pins.velocity',
    )  # fmt: skip
    attach_to: str = setting(
        '', 'Name of the obstacle or robot link to which the vertices of attach.indices, '
        'attach.box and attach.radius are attached; empty detaches them', group='attach',
    )  # fmt: skip
    attach_indices: tuple[int, ...] = setting(
        (), 'Indices of vertices that attach.to attaches; empty for none', minimum=-1,
        maximum=LARGEST_MESH, items=int, group='attach',
    )  # fmt: skip
    attach_box: tuple[float, ...] = _vector(
        (0.0,) * 6, 'Box whose vertices attach.to attaches: x y z of two opposite corners in the '
        'axes of the mesh; all 0 for none', unit='m', group='attach',
    )  # fmt: skip
    attach_radius: float = setting(
        0.0, 'Distance from the surface of the obstacle within which attach.to attaches '
        'vertices; 0 for none', unit='m', minimum=0.0, maximum=1e4, group='attach',
    )  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        # −1: rclpy cannot tell the type of an empty list; each once: histories keep what is sent
        for field in ('pins_indices', 'attach_indices'):
            indices = dict.fromkeys(getattr(self, field))
            indices.pop(-1, None)
            object.__setattr__(self, field, tuple(indices))
        self._check_attachment()
        for field, least in LEAST.items():
            if 0.0 < getattr(self, field) < least:
                raise ConfigError(
                    f'{self.prefix}{field} is {getattr(self, field):g}: it must be at least '
                    f'{least:g}, or 0, which is off'
                )
        if self.young_modulus > 0.0:
            self._check_modulus()
        if 0 < self.simplify_to < FEWEST:
            raise ConfigError(
                f'{self.prefix}simplify_to is {self.simplify_to}: it must be at least {FEWEST} '
                'vertices, or 0, which is off'
            )
        if self.friction_model == 'viscous' and self.friction > 1.0:
            raise ConfigError(
                f'{self.prefix}friction is {self.friction:g}: with friction_model viscous it is '
                'a fraction from 0 to 1; larger coefficients need friction_model coulomb'
            )

    def _check_modulus(self) -> None:
        if self.deformation == 1.0:
            raise ConfigError(
                f'{self.prefix}young_modulus is {self.young_modulus:g}, but with '
                f'{self.prefix}deformation 1 goals follow any deformation, '
                'which nothing resists then: lower it'
            )

    @property
    def mesh_frame(self) -> MeshFrame:
        """How the coordinates of its mesh file become its own."""
        return MeshFrame(self.mesh_scale, self.mesh_origin, self.mesh_up)

    @property
    def has_visual(self) -> bool:
        """Whether it may be shown by another surface than the simulated one."""
        return self.visual_mesh != '' or self.simplify_to > 0

    @property
    def has_pins(self) -> bool:
        """Whether pins hold some of its vertices."""
        return bool(self.pins_indices) or any(self.pins_box)

    @property
    def attachment(self) -> tuple:
        """All that says what it is attached to, and where."""
        return self.attach_to, self.attach_indices, self.attach_box, self.attach_radius

    def _check_attachment(self) -> None:
        if not self.attach_to:
            return
        if not (self.attach_indices or any(self.attach_box) or self.attach_radius):
            raise ConfigError(
                f'{self.prefix}attach.to is {shown(self.attach_to)}, but no vertex is named: set '
                'attach.radius, attach.indices or attach.box first'
            )
        if self.has_pins:
            raise ConfigError(
                f'{self.prefix}attach.to is {shown(self.attach_to)}, but pins hold this body: '
                'clear pins.indices and pins.box first'
            )


@dataclass(frozen=True)
class ObstacleConfig(Checked):
    """
    One thing that bodies bump into.

    Its own +z axis is a plane's normal, the axis of a capsule or cylinder. `mesh` is given like
    that of a body, its surface must be closed.
    """

    name: str = 'ground'
    type: str = setting(
        'plane', 'Shape of the obstacle; its +z axis is the normal of a plane and the axis of a '
        'capsule or cylinder', choices=OBSTACLE_TYPES, read_only=True,
    )  # fmt: skip
    mesh: str | Surface = setting(
        '', f'Closed surface of an obstacle of type mesh: {MESH_SOURCE}', read_only=True
    )
    mesh_scale: float = _mesh_scale()
    mesh_origin: str = _mesh_origin()
    mesh_up: str = _mesh_up()
    subdivisions: int = setting(
        3, f'Resolution of the primitive of an obstacle of type mesh: {RESOLUTION}', minimum=0,
        maximum=8, read_only=True,
    )  # fmt: skip
    position: tuple[float, ...] = _vector(
        (0.0, 0.0, 0.0), 'Position of the origin of the obstacle', unit='m'
    )
    orientation: tuple[float, ...] = _vector(
        (0.0, 0.0, 0.0, 1.0), 'Orientation of the obstacle: quaternion x y z w', minimum=-1.0,
        maximum=1.0,
    )  # fmt: skip
    size: tuple[float, ...] = setting(
        (1.0, 1.0, 1.0),
        'Half extents x y z of a box; radius, unused, half length of a sphere, capsule or '
        'cylinder; half of the longest side, unused, unused of a mesh, unless mesh_scale is set; '
        'without effect on a plane',
        unit='m', minimum=1e-4, maximum=1e4,
    )  # fmt: skip
    velocity_linear: tuple[float, ...] = _vector(
        (0.0, 0.0, 0.0), 'Velocity of the origin of the obstacle in world axes', unit='m/s',
        minimum=-FASTEST, maximum=FASTEST, group='velocity',
    )  # fmt: skip
    velocity_angular: tuple[float, ...] = _vector(
        (0.0, 0.0, 0.0), 'Angular velocity of the obstacle about its origin in world axes',
        unit='rad/s', minimum=-FASTEST, maximum=FASTEST, group='velocity',
    )  # fmt: skip
    surface_velocity: tuple[float, ...] = _vector(
        (0.0, 0.0, 0.0),
        'Velocity of the surface along itself in the axes of the obstacle, as of a conveyor '
        'belt, while the obstacle stays in place', unit='m/s', minimum=-FASTEST, maximum=FASTEST,
    )  # fmt: skip
    friction: float = setting(
        -1.0, 'Friction coefficient of the obstacle, combined with that of a body by the '
        'geometric mean; negative uses that of the body alone', minimum=-1.0, maximum=10.0,
    )  # fmt: skip
    elasticity: float = setting(
        -1.0, 'Coefficient of restitution of the obstacle, combined with that of a rigid body by '
        'the geometric mean; negative uses that of the body alone, as deformable bodies do',
        minimum=-1.0, maximum=1.0,
    )  # fmt: skip

    @property
    def mesh_frame(self) -> MeshFrame:
        """How the coordinates of its mesh file become its own."""
        return MeshFrame(self.mesh_scale, self.mesh_origin, self.mesh_up)

    @property
    def has_own_scale(self) -> bool:
        """Whether its mesh is as large as it is, whatever `size` says."""
        if isinstance(self.mesh, Surface):
            return True
        return self.mesh_scale > 0.0 and self.mesh not in PRIMITIVES

    def moved(self, **motion: Any) -> ObstacleConfig:
        """
        Return a config with another pose or velocity: only these are checked.

        That is for obstacles that are moved at each tick.
        """
        present, known = self.__dict__, _settings_by_field(ObstacleConfig)
        changed = {
            field: value
            for field, value in motion.items()
            # what is as it was has been checked; 1 and True equal 1.0 but are no floats
            if not (type(value) is tuple and value == present[field] and _are_floats(value))
        }
        if not changed:
            return self
        result = self.with_values(**changed)
        result._check([known[field] for field in changed])
        return result


@dataclass(frozen=True)
class WorldConfig(Checked):
    """Everything that `World` needs: time steps, gravity, bodies and obstacles."""

    time_step: float = setting(
        1 / 240, 'Length of one tick, the fixed time step of the simulation', unit='s',
        minimum=1e-5, maximum=0.1, read_only=True,
    )  # fmt: skip
    reference_step: float = setting(
        1 / 120, 'Time step to which stiffness, damping and viscous friction refer, so that the '
        'motion does not depend on time_step', unit='s', minimum=1e-5, maximum=1.0,
        read_only=True,
    )  # fmt: skip
    gravity_magnitude: float = setting(
        9.81, 'Magnitude of the gravitational acceleration', unit='m/s²', minimum=0.0,
        maximum=1e4, group='gravity',
    )  # fmt: skip
    gravity_direction: tuple[float, ...] = _vector(
        (0.0, 0.0, -1.0), 'Direction of gravity in world axes, of any length except zero',
        group='gravity',
    )  # fmt: skip
    bodies: tuple[BodyConfig, ...] = (BodyConfig(name='ball'),)
    obstacles: tuple[ObstacleConfig, ...] = (ObstacleConfig(name='ground'),)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_distinct([item.name for item in self.items])

    @property
    def items(self) -> tuple[BodyConfig | ObstacleConfig, ...]:
        """The bodies, then the obstacles."""
        return (*self.bodies, *self.obstacles)

    def with_obstacle(self, index: int, config: ObstacleConfig) -> WorldConfig:
        """Return a config with another config of one obstacle, of the same name."""
        configs = list(self.obstacles)
        configs[index] = config
        return self.with_values(obstacles=tuple(configs))

    @property
    def gravity(self) -> np.ndarray:
        """(3,) float: acceleration, m/s²."""
        direction = np.array(self.gravity_direction)
        return self.gravity_magnitude / np.linalg.norm(direction) * direction
