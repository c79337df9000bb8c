# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Logic of the services of simulation_interfaces, without its messages.

simulation_interfaces is the standard that Gazebo and Isaac Sim implement. Its package need not be
installed: the functions here take and return plain values, with the constants of its definitions.
Only `simulation_interfaces_node` imports the messages.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
import functools
import math
import re
from typing import Any, Protocol

import numpy as np
from scipy.spatial.transform import Rotation
import trimesh

from softbody_ros.core import ConfigError, MeshError, RigidFit, World
from softbody_ros.core.config import LARGEST, shown, unknown_name
from softbody_ros.scene import resources
from softbody_ros.scene.resources import Pose, Problem, ResourceError
from softbody_ros.timeline.history import Checkpoint
from softbody_ros.timeline.stepper import Stepper

# Result
FEATURE_UNSUPPORTED, OK, NOT_FOUND, INCORRECT_STATE, OPERATION_FAILED = range(5)
ALREADY_IN_TARGET_STATE, STATE_TRANSITION_ERROR = 101, 102
INVALID_POSE = 101
# SpawnEntity, SpawnEntities
(
    NAME_NOT_UNIQUE, NAME_INVALID, UNSUPPORTED_FORMAT, NO_RESOURCE, NAMESPACE_INVALID,
    RESOURCE_PARSE_ERROR, MISSING_ASSETS, UNSUPPORTED_ASSETS, INVALID_SPAWN_POSE,
) = range(101, 110)  # fmt: skip
ENTITIES_SPAWN_FAILED = 150
# SimulationState
STOPPED, PLAYING, PAUSED, QUITTING = range(4)
# ResetSimulation
SCOPE_DEFAULT, SCOPE_TIME, SCOPE_STATE, SCOPE_SPAWNED, SCOPE_ALL = 0, 1, 2, 4, 255
# Bounds
UNBOUNDED, SPHERE = 0, 3

FEATURES = {
    'get_simulator_features': (),
    'get_entities': (),
    'get_entity_state': (10,),  # ENTITY_STATE_GETTING
    'set_entity_state': (11,),  # ENTITY_STATE_SETTING
    'spawn_entity': (0, 9),  # SPAWNING, SPAWNING_RESOURCE_STRING
    'delete_entity': (1,),  # DELETING
    'reset_simulation': (20, 22, 23),  # SIMULATION_RESET, …_STATE, …_SPAWNED
    'get_simulation_state': (24,),  # SIMULATION_STATE_GETTING
    'set_simulation_state': (25, 26),  # SIMULATION_STATE_SETTING, SIMULATION_STATE_PAUSE
    'step_simulation': (31, 32),  # STEP_SIMULATION_SINGLE, STEP_SIMULATION_MULTIPLE
    'spawn_entities': (50,),  # SPAWNING_ENTITIES
}
"""Features that each registered service lets the simulator advertise (SimulatorFeatures)."""
OF_LATER_VERSIONS = ('spawn_entities',)
"""Services that versions of the package before 1.6 and 2.1 do not have."""
PROBLEMS = {
    Problem.NOTHING_GIVEN: NO_RESOURCE,
    Problem.FORMAT: UNSUPPORTED_FORMAT,
    Problem.CONTENT: RESOURCE_PARSE_ERROR,
    Problem.MISSING_MESH: MISSING_ASSETS,
    Problem.MESH: UNSUPPORTED_ASSETS,
    Problem.NAME: NAME_INVALID,
    Problem.NAME_TAKEN: NAME_NOT_UNIQUE,
    Problem.POSE: INVALID_SPAWN_POSE,
}
POSIX_CLASSES = {
    'alpha': 'a-zA-Z', 'digit': '0-9', 'alnum': 'a-zA-Z0-9', 'upper': 'A-Z', 'lower': 'a-z',
    'space': r'\s', 'blank': r' \t', 'punct': '_', 'xdigit': '0-9A-Fa-f', 'word': r'\w',
}  # fmt: skip
MOST_STEPS = 1_000_000
FASTEST = 1e4


@dataclass(frozen=True)
class Outcome:
    """The `result` and `error_message` of a Result."""

    code: int = OK
    message: str = ''


def features(registered: Iterable[str]) -> list[int]:
    """Return the features of the registered services, sorted."""
    return sorted(feature for name in registered for feature in FEATURES[name])


class Scene(Protocol):
    """The parameters of the scene: now, and at the start of the node."""

    values: Mapping[str, Any]
    start: Mapping[str, Any]

    @property
    def taken(self) -> Collection[str]:
        """Names that nothing else can have."""

    def request(self, values: Mapping[str, Any]) -> None:
        """Set parameters in one request, or raise ConfigError or MeshError without effect."""


class Simulation:
    """
    A stepper with the states of the standard: stopped, playing or paused.

    Parameters
    ----------
    stepper : Stepper
    scene : Scene
    pause, reset, step : callable
        handlers of the node's own services of these names; `pause(on)` returns a reason or '',
        `step(ticks)` one to be awaited

    """

    def __init__(
        self,
        stepper: Stepper,
        scene: Scene,
        pause: Callable[[bool], str],
        reset: Callable[[], None],
        step: Callable[[int], Awaitable[str]],
    ) -> None:
        self._stepper, self._scene = stepper, scene
        self._pause, self._reset, self._step = pause, reset, step
        self._stopped: Checkpoint | None = None
        # what has been added as one entity, by its name
        self._members: dict[str, tuple[str, ...]] = {}

    @property
    def world(self) -> World:
        """The world that is simulated."""
        return self._stepper.world

    # ---------------------------------------------------------------------------------- the whole
    @property
    def state(self) -> int:
        """STOPPED, PLAYING or PAUSED."""
        if not self._stepper.paused:
            return PLAYING
        begins = self._stopped is self._stepper.history.beginning and self.world.tick == 0
        return STOPPED if begins else PAUSED

    def reset(self, scope: int) -> Outcome:
        """
        Reset the bodies, or what bodies and obstacles there are, or both; time is the clock's.

        Parameters
        ----------
        scope : int
            SCOPE_SPAWNED removes what has been added since the start of the node; SCOPE_ALL also
            adds what has been removed since

        """
        everything = scope in (SCOPE_DEFAULT, SCOPE_ALL)
        if not everything and scope not in (
            SCOPE_STATE,
            SCOPE_SPAWNED,
            SCOPE_STATE | SCOPE_SPAWNED,
        ):
            return Outcome(
                FEATURE_UNSUPPORTED,
                f'scope {scope} cannot be reset: use SCOPE_STATE (2), SCOPE_SPAWNED (4), both (6) '
                'or SCOPE_ALL (255)',
            )
        if everything or scope & SCOPE_SPAWNED:
            try:
                self._scene.request(self._start_scene(with_removed=everything))
            except (ConfigError, MeshError) as error:
                return Outcome(OPERATION_FAILED, str(error))
            self._members.clear()
        if everything or scope & SCOPE_STATE:
            self._reset()
        return Outcome()

    def _start_scene(self, with_removed: bool) -> dict[str, Any]:
        """Return a request for the bodies and obstacles that there were at the start."""
        start, now, request = self._scene.start, self._scene.values, {}
        for kind in ('bodies', 'obstacles'):
            kept = [name for name in start[kind] if with_removed or name in now[kind]]
            request[kind] = kept
            back = [f'{name}.' for name in kept if name not in now[kind] and name]
            request |= {
                name: value for name, value in start.items() if name.startswith(tuple(back))
            }
        return request

    def set_state(self, state: int) -> Outcome:
        """Play, pause, or stop, i.e. pause at the initial state."""
        names = {STOPPED: 'stopped', PLAYING: 'playing', PAUSED: 'paused'}
        if state not in names:
            return Outcome(
                FEATURE_UNSUPPORTED,
                f'state {state} cannot be set: use STOPPED (0), PLAYING (1) or PAUSED (2)',
            )
        if state == self.state:
            return Outcome(ALREADY_IN_TARGET_STATE, f'the simulation is {names[state]} already')
        if state == STOPPED:
            self._reset()
        failure = self._pause(state != PLAYING)
        if failure:
            return Outcome(STATE_TRANSITION_ERROR, failure)
        self._stopped = self._stepper.history.beginning if state == STOPPED else None
        return Outcome()

    async def step(self, steps: int) -> Outcome:
        """Take ticks while paused."""
        if self.state != PAUSED:
            return Outcome(
                OPERATION_FAILED, 'only a paused simulation can be stepped: set state PAUSED (2)'
            )
        if not 1 <= steps <= MOST_STEPS:
            return Outcome(
                OPERATION_FAILED, f'steps is {steps}: it must be from 1 to {MOST_STEPS}'
            )
        failure = await self._step(steps)
        return Outcome(OPERATION_FAILED, failure) if failure else Outcome()

    # --------------------------------------------------------------------------------- the bodies
    def entities(
        self,
        name_filter: str = '',
        categories: int = 0,
        tags: int = 0,
        bounds: int = UNBOUNDED,
        points: Iterable[tuple[float, float, float]] = (),
    ) -> tuple[Outcome, list[str]]:
        """
        Return the names of the bodies that match.

        Parameters
        ----------
        name_filter : str
            regular expression for the whole name, as in Gazebo; empty for all
        categories, tags : int
            number of categories and tags to filter by: not supported
        bounds : int
            UNBOUNDED or SPHERE
        points : iterable of three floats each
            of a sphere: its centre, and its radius as the second point's first number

        """
        if categories or tags:
            return Outcome(FEATURE_UNSUPPORTED, 'bodies have no categories and no tags'), []
        try:
            pattern = re.compile(_without_classes(name_filter))
            names = [
                name for name in self.world.names if not name_filter or pattern.fullmatch(name)
            ]
        except (re.error, OverflowError, RecursionError) as error:
            shown = name_filter[:40]
            return Outcome(OPERATION_FAILED, f'filter {shown!r} is no pattern: {error}'), []
        if bounds == UNBOUNDED:
            return Outcome(), names
        if bounds != SPHERE:
            return Outcome(
                FEATURE_UNSUPPORTED, f'bounds of type {bounds}: use TYPE_SPHERE (3)'
            ), []
        corners = list(points)
        if len(corners) != 2 or not np.isfinite([*corners[0], corners[1][0]]).all():
            reason = 'a sphere has two points: its centre, and its radius as x, both finite'
            return Outcome(OPERATION_FAILED, reason), []
        centre, radius = np.array(corners[0]), corners[1][0]
        return Outcome(), [name for name in names if self._distance(name, centre) <= radius]

    def _distance(self, name: str, point: np.ndarray) -> float:
        """Return the distance of a point from a body, m; 0 inside."""
        vertices = self.world.positions(name)
        faces = self.world.rest_shape(name).surface.faces
        if not len(faces):
            return float(np.linalg.norm(vertices - point, axis=1).min())
        triangles = vertices[faces] - point
        if _winding_number(triangles) > 0.5:
            return 0.0
        nearest = trimesh.triangles.closest_point(triangles, np.zeros((len(triangles), 3)))
        return float(np.linalg.norm(nearest, axis=1).min())

    def entity_state(self, name: str) -> tuple[Outcome, RigidFit | None]:
        """Return the best-fit pose and twist of a body."""
        if name not in self.world.names:
            return _unknown(name, self._names), None
        return Outcome(), self.world.rigid_fit(name)

    def set_entity_state(
        self,
        name: str,
        pose: tuple[Sequence[float], Sequence[float]] | None = None,
        twist: tuple[Sequence[float], Sequence[float]] | None = None,
    ) -> Outcome:
        """
        Move a body with its present shape to a pose, or set its rigid velocity.

        Parameters
        ----------
        name : str
        pose : (3,) and (4,) float, optional
            position, m, and orientation x y z w of the body's own frame
        twist : (3,) and (3,) float, optional
            velocity of that frame's origin, m/s, and angular velocity, rad/s, world axes

        """
        if name not in self._names:
            return _unknown(name, self._names)
        if pose is not None:
            position, quaternion = (np.asarray(item, dtype=float) for item in pose)
            length = float(np.linalg.norm(quaternion))
            if not (np.abs(position) <= LARGEST).all():
                return Outcome(INVALID_POSE, f'position {position} is not within {LARGEST:g} m')
            if not math.isfinite(length) or length < 1e-6:
                return Outcome(INVALID_POSE, f'orientation {quaternion} has no direction')
            rotation = Rotation.from_quat(quaternion / length).as_matrix()
        if twist is not None and not (np.abs(np.array(twist)) <= FASTEST).all():
            return Outcome(OPERATION_FAILED, f'the twist is not within {FASTEST:g} m/s and rad/s')
        if pose is not None:
            self._stepper.act(
                functools.partial(World.place, name=name, position=position, rotation=rotation)
            )
        if twist is not None:
            linear, angular = (np.asarray(item, dtype=float) for item in twist)
            self._stepper.act(
                functools.partial(World.set_twist, name=name, linear=linear, angular=angular)
            )
        self._stepper.publish_now()
        return Outcome()

    # ------------------------------------------------------------------------ they come and go
    def spawn(
        self,
        name: str,
        may_rename: bool = False,
        uri: str = '',
        text: str = '',
        namespace: str = '',
        pose: Pose = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)),
    ) -> tuple[Outcome, str]:
        """
        Add a mesh as a body, or the bodies and obstacles of a scene file, see `resources`.

        Returns
        -------
        Outcome
        str
            the name of the entity, '' if there is none

        """
        if namespace:
            reason = (
                f'entity_namespace is {shown(namespace)}: entities have no namespaces, leave it '
                'empty'
            )
            return Outcome(NAMESPACE_INVALID, reason), ''
        if not (np.abs(pose[0]) <= LARGEST).all():
            reason = f'position {list(pose[0])} is not within {LARGEST:g} m'
            return Outcome(INVALID_SPAWN_POSE, reason), ''
        values = self._scene.values
        self._forget_gone_members()
        taken = {*self._scene.taken, *self._members}
        try:
            resource = resources.read_resource(uri, text)
            entity = resources.make_entity(resource, name, may_rename, pose, taken)
            lists = {
                'bodies': [*values['bodies'], *entity.bodies],
                'obstacles': [*values['obstacles'], *entity.obstacles],
            }
            self._scene.request(entity.values | lists)
        except ResourceError as error:
            return Outcome(PROBLEMS[error.problem], str(error)), ''
        except MeshError as error:
            code = RESOURCE_PARSE_ERROR if resource.is_mesh else UNSUPPORTED_ASSETS
            return Outcome(code, str(error)), ''
        except ConfigError as error:
            return Outcome(RESOURCE_PARSE_ERROR, str(error)), ''
        self._members[entity.name] = (*entity.bodies, *entity.obstacles)
        return Outcome(), entity.name

    def delete(self, name: str) -> Outcome:
        """Remove an entity: a body or an obstacle, with all that was added with it."""
        self._forget_gone_members()
        members = {name, *self._members.get(name, ())}
        values = self._scene.values
        lists = {
            kind: [each for each in values[kind] if each not in members]
            for kind in ('bodies', 'obstacles')
        }
        if all(len(lists[kind]) == len(values[kind]) for kind in lists):
            return _unknown(name, [*values['bodies'], *values['obstacles'], *self._members])
        try:
            self._scene.request(lists)
        except (ConfigError, MeshError) as error:
            return Outcome(OPERATION_FAILED, str(error))
        self._members.pop(name, None)
        return Outcome()

    def _forget_gone_members(self) -> None:
        """Forget what has been removed by parameters, or because time went back before it."""
        values = self._scene.values
        present = {*values['bodies'], *values['obstacles']}
        kept = {
            name: tuple(each for each in members if each in present)
            for name, members in self._members.items()
        }
        self._members = {name: members for name, members in kept.items() if members}

    @property
    def _names(self) -> tuple[str, ...]:
        """Names of the bodies; during a replay those at its end."""
        return tuple(body.name for body in self._stepper.config.bodies)


def _unknown(name: str, known: Iterable[str]) -> Outcome:
    hint = unknown_name(name, list(dict.fromkeys(known)))
    return Outcome(NOT_FOUND, f'there is no entity {shown(name)}: {hint}')


def _without_classes(pattern: str) -> str:
    """Return a POSIX pattern in Python's syntax: they differ in the names of classes."""
    for name, members in POSIX_CLASSES.items():
        pattern = pattern.replace(f'[:{name}:]', members)
    return pattern


def _winding_number(triangles: np.ndarray) -> float:
    """
    Return the winding number of triangles (m, 3, 3) about the origin: 1 inside a closed surface.

    A. van Oosterom, J. Strackee: The Solid Angle of a Plane Triangle, IEEE Trans. BME 1983.
    """
    a, b, c = triangles.transpose(1, 0, 2)
    lengths = np.linalg.norm(triangles, axis=2)
    volume = np.einsum('ij,ij->i', a, np.cross(b, c))
    flat = lengths.prod(axis=1)
    for first, second, other in ((a, b, 2), (b, c, 0), (c, a, 1)):
        flat = flat + np.einsum('ij,ij->i', first, second) * lengths[:, other]
    return float(np.arctan2(volume, flat).sum() / (2.0 * np.pi))
