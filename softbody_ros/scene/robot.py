# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A robot of a URDF: the collision shapes of its links as obstacles that move with its joints.

yourdfpy reads the URDF, and is only imported here; poses and twists come from `kinematic_tree`. No
ROS.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
import dataclasses
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cached_property
import io
import math
import re
from typing import Any
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation
import trimesh

from softbody_ros.core import ConfigError, MeshError, ObstacleConfig, Surface
from softbody_ros.core.collision.obstacles import Obstacle
from softbody_ros.core.collision.shapes import Shape, make_shape
from softbody_ros.core.config import LARGEST, LONGEST_NAME, NAME_PATTERN, unknown_name
from softbody_ros.core.contact_forces import ContactWrench
from softbody_ros.core.external_inputs import (
    ROBOT,
    DynamicObstacle,
    Key,
    ObstacleChange,
    ObstacleRemoval,
    Twist,
    is_link,
)
from softbody_ros.core.geometry.bvh import closed_tree
from softbody_ros.core.geometry.mesh import read_surface
from softbody_ros.core.kinematic_tree import FIXED, FRAME, SLIDES, TURNS, motion_of, motions
from softbody_ros.core.links import LinkShape, placements
from softbody_ros.core.world import World
from softbody_ros.scene.parameters import mesh_path

KINDS = {'fixed': FIXED, 'revolute': TURNS, 'continuous': TURNS, 'prismatic': SLIDES}
"""Types of joints that can be followed."""
STILL = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
HULL_DIGITS = (12, 5, 4, 3)
"""Digits of vertices, by the size of a mesh: hulls of nearly flat faces may have slits."""
BYTES_PER_STATE, BYTES_PER_JOINT = 1000, 16
"""Approximate memory of a state in the history."""


class RobotError(ValueError):
    """A robot that cannot be used: one sentence with the reason and a remedy."""


@dataclass(frozen=True, eq=False)
class RobotState:
    """
    Where the joints of a robot are, and how they move.

    Attributes
    ----------
    positions, velocities : (j,) float
        of `Robot.joints`, rad or m, per simulated second
    root_position, root_orientation : (3,) float, (4,) float
        of its root in the world, m, and a quaternion x y z w
    root_twist : ((3,) float, (3,) float)
        its velocity, m/s, and angular velocity, rad/s, world axes, by simulated time
    approach : float
        see `links.placements`

    """

    positions: np.ndarray
    velocities: np.ndarray
    root_position: tuple[float, ...] = (0.0, 0.0, 0.0)
    root_orientation: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0)
    root_twist: Twist = STILL
    approach: float = 0.0

    @property
    def nbytes(self) -> int:
        """Approximate bytes of memory."""
        return BYTES_PER_STATE + BYTES_PER_JOINT * len(self.positions)


@dataclass(frozen=True, eq=False)
class Link:
    """
    A link with collision shapes.

    Attributes
    ----------
    link, name : str
        its own name, and that of its obstacles
    keys : tuple of (str, int)
        of its shapes
    position, rotation : (3,) float, (3, 3) float
        of the first of its shapes in the link, m

    """

    link: str
    name: str
    keys: tuple[Key, ...]
    position: np.ndarray
    rotation: np.ndarray

    def pose(self, first: Obstacle) -> tuple[np.ndarray, np.ndarray]:
        """Return position (3,), m, and rotation (3, 3) of the link, from its first shape."""
        rotation = first.rotation @ self.rotation.T
        return first.position - rotation @ self.position, rotation

    def wrench(
        self,
        present: Mapping[Key, DynamicObstacle],
        wrench_of: Callable[[Key], ContactWrench],
    ) -> ContactWrench:
        """
        Return force (3,), N, and torque (3,), N m, on the link, about its origin, world axes.

        Of means over several ticks, moments are taken about where the origin is in the end.

        Parameters
        ----------
        present : mapping of key to DynamicObstacle
        wrench_of : callable
            returns the wrench on a shape, such as `World.obstacle_wrench`

        """
        origin, _ = self.pose(present[self.keys[0]].obstacle)
        force, torque = np.zeros(3), np.zeros(3)
        for key in self.keys:
            on_shape, about_shape = wrench_of(key)
            force += on_shape
            torque += about_shape + np.cross(present[key].obstacle.position - origin, on_shape)
        return force, torque


@dataclass(frozen=True, eq=False)
class Robot:
    """
    The chosen links of a robot with what they are fixed to, as far as the root.

    Attributes
    ----------
    root : str
        name of the root link
    joints : tuple of str
        those that move chosen links, without those that mimic one
    names : mapping of str to str
        of links with shapes to the names of their obstacles
    shapes : tuple of LinkShape
    rows : mapping of str to int
        the frame of each link
    frames : (k,) FRAME
        of links, then of shapes
    variable : (k,) int
        the joint that moves each frame against its parent, −1 for none
    multiplier, offset : (k,) float
        the position of that joint is multiplier · position + offset

    """

    root: str
    joints: tuple[str, ...]
    names: Mapping[str, str]
    shapes: tuple[LinkShape, ...]
    rows: Mapping[str, int]
    frames: np.ndarray
    variable: np.ndarray
    multiplier: np.ndarray
    offset: np.ndarray

    def motions(self, state: RobotState) -> np.ndarray:
        """Return the motions (k,) MOTION of its frames in a state."""
        moves = self.variable >= 0
        joints = np.zeros((len(self.frames), 2))
        for column, values in enumerate((state.positions, state.velocities)):
            joints[moves, column] = self.multiplier[moves] * values[self.variable[moves]]
        joints[moves, 0] += self.offset[moves]
        turns = self.frames['kind'] == TURNS
        joints[turns, 0] = np.fmod(joints[turns, 0], math.tau)
        rotation = Rotation.from_quat(state.root_orientation).as_matrix()
        root = motion_of(state.root_position, rotation, *state.root_twist)
        return motions(self.frames, joints, root)

    def part(self, link: str) -> Robot:
        """Return one link with its shapes, which is its own root."""
        shapes = [shape for shape in self.shapes if shape.link == link]
        frames = self.frames[[shape.row for shape in shapes]]
        frames['parent'] = -1
        return Robot(
            link,
            (),
            {link: self.names[link]},
            tuple(dataclasses.replace(shape, row=row) for row, shape in enumerate(shapes)),
            {},
            frames,
            np.full(len(shapes), -1),
            np.zeros(len(shapes)),
            np.zeros(len(shapes)),
        )

    def with_friction(self, friction: float) -> Robot:
        """Return the robot with links of another friction."""
        shapes = [
            dataclasses.replace(shape, config=dataclasses.replace(shape.config, friction=friction))
            for shape in self.shapes
        ]
        return dataclasses.replace(self, shapes=tuple(shapes))

    @cached_property
    def links(self) -> tuple[Link, ...]:
        """The links with shapes."""
        result = []
        for link, name in self.names.items():
            own = [shape for shape in self.shapes if shape.link == link]
            frame = self.frames[own[0].row]
            keys = tuple(shape.key for shape in own)
            result.append(Link(link, name, keys, frame['position'], frame['rotation']))
        return tuple(result)

    @property
    def keys(self) -> frozenset:
        """Keys of its shapes."""
        return frozenset(shape.key for shape in self.shapes)


def move_robot(
    world: World,
    robot: Robot | None,
    states: Mapping[str, RobotState],
    seconds: float,
) -> None:
    """
    Move the links of a robot in a world, instead of those of another robot or no robot.

    Parameters
    ----------
    world : World
    robot : Robot or None
    states : mapping of str to RobotState
        that of the robot by the name of its root; or of each of its links, see `Robot.part`
    seconds : float
        for which it moves on at these velocities without another state

    """
    keys = robot.keys if robot is not None else frozenset()
    present = world.external_inputs.dynamic_obstacles
    changes: list[ObstacleChange] = [
        ObstacleRemoval(*key) for key in present if is_link(key) and key not in keys
    ]
    for name, state in states.items():
        part = robot if robot is None or name == robot.root else robot.part(name)
        if part is not None and part.shapes:
            moving = part.motions(state)[len(part.frames) - len(part.shapes) :]
            time = world.tick, world.config.time_step
            changes += placements(part.shapes, moving, present, *time, state.approach, seconds)
    if changes:
        world.change_obstacles(changes)


# --------------------------------------------------------------------------------------- the URDF
def read_robot(
    text: str, links: Sequence[str], friction: float = -1.0, taken: Iterable[str] = ()
) -> tuple[Robot, list[str]]:
    """
    Return the chosen links of a robot, and a sentence for each thing that is not as it says.

    Parameters
    ----------
    text : str
        the URDF
    links : sequence of str
        names of links, or patterns with * ? and […]
    friction : float
        of the links, negative: the bodies' alone
    taken : iterable of str
        names that no obstacle may have

    Raises
    ------
    RobotError
        if it is no URDF that can be used; with one sentence.

    """
    model = _model(text)
    problems: list[str] = []
    above = {joint.child: joint for joint in model.joints}
    known = [link.name for link in model.links]
    root = _root_of(model, known, above)
    chosen = _chosen(links, known, problems)
    order, needed = _needed(chosen, above)
    rows = {name: row for row, name in enumerate(order)}
    frames = [_frame_of(above.get(name), rows, problems) for name in order]
    driven = _driven(model, [above.get(name) for name in order], problems)
    joints = tuple(dict.fromkeys(name for name, _, _ in driven if name))
    names: dict[str, str] = {}
    shapes: list[LinkShape] = []
    shape_frames: list[np.ndarray] = []
    names_in_use = set(taken)
    for link in model.links:
        if link.name not in needed:
            continue
        name = _obstacle_name(link.name, names_in_use)
        own = list(_shapes_of(link, name, friction, problems))
        if not own:
            if not link.collisions and link.name in links:
                problems.append(f'link {link.name} has no collision shape: it is not in the way')
            continue
        names_in_use.add(name)
        names[link.name] = name
        for number, (config, shape, position, rotation) in enumerate(own):
            row = len(order) + len(shapes)
            shapes.append(LinkShape((ROBOT + name, number), link.name, config, shape, row))
            shape_frames.append(_fixed(rows[link.name], position, rotation))
    still = [('', 0.0, 0.0)] * len(shapes)
    variable, multiplier, offset = zip(*(driven + still), strict=True) if order else ((),) * 3
    index = {name: number for number, name in enumerate(joints)}
    robot = Robot(
        root,
        joints,
        names,
        tuple(shapes),
        rows,
        np.concatenate([np.zeros(0, FRAME), *frames, *shape_frames]),
        np.array([index.get(name, -1) for name in variable], dtype=np.int64),
        np.array(multiplier, dtype=float),
        np.array(offset, dtype=float),
    )
    return robot, problems


def _model(text: str) -> Any:
    """Return what yourdfpy reads: robot.links and robot.joints."""
    try:
        import yourdfpy
    except ImportError as error:
        raise RobotError(
            f"robot.links needs yourdfpy ({error}): pip install '.[robot]', or yourdfpy"
        ) from None
    text = re.sub(r'^\s*<\?xml.*?\?>', '', text, count=1, flags=re.DOTALL)
    data = text.encode('utf-8', errors='replace')
    try:
        root = ElementTree.fromstring(data)
    except (ElementTree.ParseError, ValueError) as error:
        raise RobotError(f'it is no XML ({error}): it must be a URDF') from None
    if root.tag != 'robot':
        raise RobotError(f'it is a <{root.tag[:60]}>, not a <robot>: it must be a URDF')
    if any('wiki/xacro' in str(element.tag) for element in root.iter()):
        raise RobotError('it has xacro in it: let xacro make a URDF of it')
    root.attrib.setdefault('name', 'robot')
    for element in root.findall('gazebo') + root.findall('transmission'):
        root.remove(element)
    try:
        stream = io.BytesIO(ElementTree.tostring(root))
        model = yourdfpy.URDF.load(stream, build_scene_graph=False, load_meshes=False)
    except RecursionError:
        raise RobotError('it is nested too deeply: run check_urdf on it') from None
    except Exception as error:  # it raises all kinds of exceptions
        reason = f'{type(error).__name__}: {" ".join(str(error).split())}'
        raise RobotError(f'it cannot be read as URDF ({reason}): run check_urdf on it') from None
    return model.robot


def _root_of(model: Any, known: Sequence[str], above: Mapping[str, Any]) -> str:
    """Return the name of the root; raise RobotError unless the links are one tree."""
    for what, names in (('link', known), ('joint', [joint.name for joint in model.joints])):
        twice = [name for name in names if names.count(name) > 1]
        if twice:
            raise RobotError(f'the {what} {twice[0]} is there twice: give each its own name')
    if not known:
        raise RobotError('it has no links')
    for joint in model.joints:
        for end in (joint.parent, joint.child):
            if end not in known:
                hint = unknown_name(str(end), known)
                raise RobotError(
                    f'joint {joint.name} has a link {end!r} that is not there: {hint}'
                )
    if len(above) < len(model.joints):
        children = [joint.child for joint in model.joints]
        twice = [child for child in children if children.count(child) > 1]
        raise RobotError(f'the link {twice[0]} has two parents: a URDF is a tree')
    roots = [name for name in known if name not in above]
    if len(roots) > 1:
        raise RobotError(f'it has the roots {", ".join(roots[:4])}: a URDF is one tree')
    for name in known:
        at, steps = name, 0
        while at in above:
            at, steps = above[at].parent, steps + 1
            if steps > len(known):
                raise RobotError(f'the link {name} is its own ancestor: a URDF is a tree')
    return roots[0]


def _chosen(links: Sequence[str], known: Sequence[str], problems: list[str]) -> list[str]:
    chosen = [name for name in known if any(fnmatchcase(name, each) for each in links)]
    for each in links:
        if not any(fnmatchcase(name, each) for name in known):
            shown = unknown_name(each, known[:20])
            problems.append(f'robot.links names {each!r}, but the robot has no such link: {shown}')
    return chosen


def _needed(chosen: Sequence[str], above: Mapping[str, Any]) -> tuple[list[str], set[str]]:
    """Return the chosen links and all ancestors, each after its parent, and the chosen ones."""
    order: dict[str, None] = {}
    for name in chosen:
        chain = [name]
        while chain[-1] in above:
            chain.append(above[chain[-1]].parent)
        order |= dict.fromkeys(reversed(chain))
    return list(order), set(chosen)


def _fixed(parent: int, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    frame = np.zeros(1, FRAME)
    frame['parent'], frame['position'], frame['rotation'] = parent, position, rotation
    return frame


def _frame_of(joint: Any, rows: Mapping[str, int], problems: list[str]) -> np.ndarray:
    """Return the frame (1,) FRAME of the link below a joint; of the root without a joint."""
    if joint is None:
        return _fixed(-1, np.zeros(3), np.eye(3))
    position, rotation = _pose(joint.origin, f'joint {joint.name}')
    frame = _fixed(rows[joint.parent], position, rotation)
    if joint.type not in KINDS:
        problems.append(
            f'joint {joint.name} is {joint.type}, which is not followed: it stays at its origin'
        )
    frame['kind'] = KINDS.get(joint.type, FIXED)
    if frame['kind'][0] != FIXED:
        axis = np.array(joint.axis, dtype=float)
        length = float(np.linalg.norm(axis))
        if axis.shape != (3,) or not 1e-6 < length < math.inf:
            raise RobotError(f'joint {joint.name} has the axis {joint.axis}: give a direction')
        frame['axis'] = axis / length
    return frame


def _pose(origin: np.ndarray | None, what: str) -> tuple[np.ndarray, np.ndarray]:
    if origin is None:
        return np.zeros(3), np.eye(3)
    if not (np.abs(origin) <= LARGEST).all():
        raise RobotError(f'{what} has an origin that is not within ±{LARGEST:g} m')
    return origin[:3, 3], origin[:3, :3]


def _driven(
    model: Any, joints: Sequence[Any], problems: list[str]
) -> list[tuple[str, float, float]]:
    """Return for each joint what moves it, after all mimics: a joint, a factor and an offset."""
    every = {joint.name: joint for joint in model.joints}
    result = []
    for joint in joints:
        if joint is None or KINDS.get(joint.type, FIXED) == FIXED:
            result.append(('', 0.0, 0.0))
            continue
        name, multiplier, offset = joint.name, 1.0, 0.0
        seen = {name}
        while every[name].mimic is not None:
            mimic = every[name].mimic
            factor, shift = float(mimic.multiplier), float(mimic.offset)
            if mimic.joint in seen:
                raise RobotError(f'joint {name} mimics itself')
            if mimic.joint not in every:
                problems.append(
                    f'joint {name} mimics {mimic.joint}, not there: it has its own state'
                )
                break
            offset, multiplier = offset + multiplier * shift, multiplier * factor
            if not (abs(offset) <= LARGEST and abs(multiplier) <= LARGEST):
                raise RobotError(
                    f'joint {name} mimics {mimic.joint} by a number beyond {LARGEST:g}'
                )
            name = mimic.joint
            seen.add(name)
        if KINDS.get(every[name].type, FIXED) == FIXED:
            problems.append(f'joint {joint.name} mimics {name}, which is {every[name].type}')
            result.append(('', 0.0, 0.0))
            continue
        result.append((name, multiplier, offset))
    return result


# --------------------------------------------------------------------------------------- its links
def _obstacle_name(link: str, taken: set[str]) -> str:
    """Return a name for the obstacles of a link that topics can have, and nothing else has."""
    # something may be added to it
    name = re.sub(r'[^A-Za-z0-9_]', '_', link)[: LONGEST_NAME // 2]
    if not NAME_PATTERN.fullmatch(name):
        name = f'link_{name}'
    if name in taken:
        name = f'robot_{name}'
    base, number = name, 2
    while name in taken:
        name, number = f'{base}_{number}', number + 1
    return name


def _shapes_of(
    link: Any, name: str, friction: float, problems: list[str]
) -> Iterable[tuple[ObstacleConfig, Shape, np.ndarray, np.ndarray]]:
    """Yield config, shape, position and rotation of each collision shape of a link."""
    for number, collision in enumerate(link.collisions):
        what = f'collision shape {number} of link {link.name}'
        try:
            position, rotation = _pose(collision.origin, what)
            geometry = collision.geometry
            facts: dict[str, Any] = {}
            if geometry.mesh is not None:
                surface, middle = _surface_of(geometry.mesh, what, problems)
                position = position + rotation @ middle
                facts = {'type': 'mesh', 'mesh': surface}
            elif geometry.box is not None:
                facts = {'type': 'box', 'size': tuple(0.5 * np.array(geometry.box.size, float))}
            elif geometry.cylinder is not None:
                radius, half = geometry.cylinder.radius, 0.5 * geometry.cylinder.length
                facts = {'type': 'cylinder', 'size': (radius, radius, half)}
            elif geometry.sphere is not None:
                facts = {'type': 'sphere', 'size': (geometry.sphere.radius,) * 3}
            config = ObstacleConfig(name=name, friction=friction, **facts)
            mesh = config.mesh
            tree = closed_tree(mesh) if isinstance(mesh, Surface) else None
            yield config, make_shape(config, tree), position, rotation
        except (ConfigError, MeshError, RobotError) as error:
            problems.append(f'{what} is left out: {error}')


def _surface_of(mesh: Any, what: str, problems: list[str]) -> tuple[Surface, np.ndarray]:
    """Return the closed surface of a mesh about the middle of its box, and where that is, m."""
    scale = np.array(1.0 if mesh.scale is None else mesh.scale, dtype=float)
    fits = scale.shape in ((), (1,), (3,)) and np.isfinite(scale).all() and scale.all()
    if not mesh.filename or not fits:
        raise RobotError(
            f'its mesh is {mesh.filename!r} with the scale {scale.tolist()}: give a file, and one '
            'number or three, none of them 0'
        )
    path = mesh_path(mesh.filename)
    surface = read_surface(path, np.broadcast_to(scale, 3).tolist())
    problems.extend(f'{what}: {note}' for note in surface.notes)
    if not surface.closed:
        defects, _ = surface.openness
        hull = _convex_hull(surface)
        if hull is None:
            raise RobotError(f'mesh {path} is neither closed nor has a convex hull')
        surface = hull
        problems.append(
            f'{what}: mesh {path} is not closed, so its convex hull is used ({defects})'
        )
    low, high = surface.vertices.min(axis=0), surface.vertices.max(axis=0)
    middle = (low + high) / 2
    return Surface(surface.vertices - middle, surface.faces), middle


def _convex_hull(surface: Surface) -> Surface | None:
    """Return the convex hull, None of what is flat; of vertices rounded until it is closed."""
    size = float(np.ptp(surface.vertices, axis=0).max())
    for digits in HULL_DIGITS:
        vertices = size * np.round(surface.vertices / size, digits)
        try:
            found = trimesh.convex.convex_hull(np.unique(vertices, axis=0))
        except Exception:  # Qhull has all kinds of reasons
            continue
        hull = Surface(found.vertices, found.faces)
        if hull.closed:
            return hull
    return None
