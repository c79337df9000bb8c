# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Logic of the services of simulation_interfaces, without its messages.

simulation_interfaces is the standard that Gazebo and Isaac Sim implement. Its package need not be
installed: the functions here take and return plain values, with the constants of its definitions.
Only `simulation_interfaces_node` imports the messages.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
import functools
import math
import re

import numpy as np
from scipy.spatial.transform import Rotation
import trimesh

from softbody_ros.core import RigidFit, World
from softbody_ros.core.config import LARGEST
from softbody_ros.timeline.history import Checkpoint
from softbody_ros.timeline.stepper import Stepper

# Result
FEATURE_UNSUPPORTED, OK, NOT_FOUND, INCORRECT_STATE, OPERATION_FAILED = range(5)
ALREADY_IN_TARGET_STATE, STATE_TRANSITION_ERROR = 101, 102
INVALID_POSE = 101
# SimulationState
STOPPED, PLAYING, PAUSED, QUITTING = range(4)
# ResetSimulation
SCOPE_DEFAULT, SCOPE_STATE, SCOPE_ALL = 0, 2, 255
# Bounds
UNBOUNDED, SPHERE = 0, 3

FEATURES = {
    'get_simulator_features': (),
    'get_entities': (),
    'get_entity_state': (10,),  # ENTITY_STATE_GETTING
    'set_entity_state': (11,),  # ENTITY_STATE_SETTING
    'reset_simulation': (20, 22),  # SIMULATION_RESET, SIMULATION_RESET_STATE
    'get_simulation_state': (24,),  # SIMULATION_STATE_GETTING
    'set_simulation_state': (25, 26),  # SIMULATION_STATE_SETTING, SIMULATION_STATE_PAUSE
    'step_simulation': (31, 32),  # STEP_SIMULATION_SINGLE, STEP_SIMULATION_MULTIPLE
}
"""Features that each registered service lets the simulator advertise (SimulatorFeatures)."""
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


class Simulation:
    """
    A stepper with the states of the standard: stopped, playing or paused.

    Parameters
    ----------
    stepper : Stepper
    pause, reset : callable
        handlers of the node's own services of these names; `pause(on)` returns a reason or ''

    """

    def __init__(
        self, stepper: Stepper, pause: Callable[[bool], str], reset: Callable[[], None]
    ) -> None:
        self._stepper = stepper
        self._pause, self._reset = pause, reset
        self._stopped: Checkpoint | None = None

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
        """Reset the bodies; time is the clock's, and there are no spawned entities."""
        if scope not in (SCOPE_DEFAULT, SCOPE_STATE, SCOPE_ALL):
            return Outcome(
                FEATURE_UNSUPPORTED,
                f'scope {scope} cannot be reset: use SCOPE_STATE (2) or SCOPE_ALL (255)',
            )
        self._reset()
        return Outcome()

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

    def step(self, steps: int) -> Outcome:
        """Request ticks while paused; the stepper takes them in slices."""
        if self.state != PAUSED:
            return Outcome(
                OPERATION_FAILED, 'only a paused simulation can be stepped: set state PAUSED (2)'
            )
        if not 1 <= steps <= MOST_STEPS:
            return Outcome(
                OPERATION_FAILED, f'steps is {steps}: it must be from 1 to {MOST_STEPS}'
            )
        self._stepper.single_step(steps)
        return Outcome()

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
            return self._unknown(name), None
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
        if name not in self.world.names:
            return self._unknown(name)
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

    def _unknown(self, name: str) -> Outcome:
        return Outcome(
            NOT_FOUND, f'there is no entity {name!r}: known are {", ".join(self.world.names)}'
        )


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
