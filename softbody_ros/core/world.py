# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The world: bodies and obstacles under gravity, stepped, saved, restored and reconfigured."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
import dataclasses
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from softbody_ros.core import poke, sleeping
from softbody_ros.core.basis import POSITION
from softbody_ros.core.collision import obstacles
from softbody_ros.core.collision.collision_surface import Skin
from softbody_ros.core.collision.obstacles import Obstacle
from softbody_ros.core.collision.point_obstacles import PointObstacles
from softbody_ros.core.config import (
    BodyConfig,
    ConfigError,
    ObstacleConfig,
    WorldConfig,
    settings,
    unknown_name,
)
from softbody_ros.core.contact import body_body
from softbody_ros.core.external_inputs import (
    EVERY_BODY,
    Outside,
    Placement,
    Removal,
    Wrench,
    ticks_of,
)
from softbody_ros.core.geometry import bounding_boxes
from softbody_ros.core.geometry.mesh import MeshError, Surface, make_surface
from softbody_ros.core.shape_matching import dynamics, matching, plasticity, rigid_motion
from softbody_ros.core.shape_matching.dynamics import Batch, Flight
from softbody_ros.core.shape_matching.gains import Gains, make_gains, natural_frequency
from softbody_ros.core.shape_matching.pins import Pins, make_pins, pinned_particles
from softbody_ros.core.shape_matching.polar_decomposition import rotation
from softbody_ros.core.shape_matching.regions import Regions, make_regions
from softbody_ros.core.shape_matching.rest_shape import RestShape, make_rest_shape
from softbody_ros.core.sleeping import Stillness
from softbody_ros.core.sums import weighted
from softbody_ros.core.tick import SimulationError

Result = TypeVar('Result')


@dataclass(frozen=True)
class Snapshot:
    """A copy of the state: restoring it continues bit by bit as before."""

    tick: int
    x: tuple[np.ndarray, ...]
    v: tuple[np.ndarray, ...]
    plastic: tuple[np.ndarray | None, ...]
    reaction: tuple[np.ndarray, ...]
    watched: tuple[Stillness, ...]
    obstacles: tuple[Obstacle, ...]
    outside: Outside

    @property
    def nbytes(self) -> int:
        """Memory that it takes."""
        arrays = [*self.x, *self.v, *(array for array in self.plastic if array is not None)]
        arrays += [watched.anchor for watched in self.watched]
        return sum(array.nbytes for array in arrays) + self.outside.nbytes


@dataclass(frozen=True)
class RigidFit:
    """
    The rigid motion that comes nearest to a deformed body.

    Attributes
    ----------
    position : (3,) float
        of the origin of the body's own frame, m
    rotation : (3, 3) float
        from the body's own frame to the world
    linear_velocity : (3,) float
        of that origin, m/s, world axes
    angular_velocity : (3,) float
        rad/s, world axes
    displacement : (n,) float
        distance of each particle from the rest shape at this pose, m

    """

    position: np.ndarray
    rotation: np.ndarray
    linear_velocity: np.ndarray
    angular_velocity: np.ndarray
    displacement: np.ndarray


class World:
    """
    Bodies, obstacles and gravity at one tick.

    >>> world = World(WorldConfig())
    >>> world.step(240)
    >>> world.positions('ball').shape
    (642, 3)

    Parameters
    ----------
    config : WorldConfig
    dtype : numpy float type
        of positions and velocities

    Raises
    ------
    ConfigError, MeshError
        with one sentence that says what to change.

    """

    def __init__(self, config: WorldConfig, dtype: type = np.float64) -> None:
        self.config = config
        self.tick = 0
        self._dtype = dtype
        self._obstacles = tuple(obstacles.made(item) for item in config.obstacles)
        self._outside = Outside()
        self._index = {body.name: index for index, body in enumerate(config.bodies)}
        self._members = _members_by_shape(config.bodies)
        self._place = {
            name: (batch, row)
            for batch, members in enumerate(self._members)
            for row, name in enumerate(members)
        }
        self._rests = [
            _rest_shape_of(self.body_config(names[0]), dtype) for names in self._members
        ]
        self._batches: list[Batch] = []
        self._watched: list[Stillness] = []
        self._regions = [
            _regions_of(self.body_config(names[0]), rest)
            for names, rest in zip(self._members, self._rests, strict=True)
        ]
        self._skins = [
            Skin(rest, parts) for rest, parts in zip(self._rests, self._regions, strict=True)
        ]
        if len(config.bodies) > 1:
            for skin in self._skins:
                skin.prepare()
        self._gains = self._gains_of(config)
        self._pinned: list[dict[int, Pins]] = [{} for _ in self._members]
        self._update_pins()
        self.reset()

    # ------------------------------------------------------------------------------------- time
    @property
    def time(self) -> float:
        """Simulated seconds since the start."""
        return self.tick * self.config.time_step

    def step(self, ticks: int = 1) -> None:
        """
        Advance by whole ticks.

        Raises
        ------
        SimulationError
            if a number would not be finite; the state is that of the last good tick.

        """
        for _ in range(ticks):
            self._step()

    def _step(self) -> None:
        h, outside = self.config.time_step, self._outside.moved(self.config.time_step)
        moved = tuple(obstacles.moved(obstacle, h) for obstacle in self._obstacles)
        there = moved + outside.obstacles
        self._push()
        self._wake_neighbours()
        awake = [np.flatnonzero(watched.awake) for watched in self._watched]
        with np.errstate(over='ignore', invalid='ignore'):
            flights = {
                index: self._computed(self._members[index], self._fly, index, rows)
                for index, rows in enumerate(awake)
                if len(rows)
            }
            skins = [self._skins[index] for index in flights]
            meeting = (list(flights.values()), skins, there, outside.points)
            self._computed(self.names, body_body.meet, *meeting)
            for index, flight in flights.items():
                self._computed(self._members[index], dynamics.land, flight, there)
        for index, flight in flights.items():
            batch = self._batches[index]
            if flight.batch is not batch:
                batch.take(flight.batch, awake[index])
            batch.swap()
        self._obstacles, self._outside = moved, outside
        self.tick += 1
        self._let(self._outside.at(self.tick))
        if self.tick % max(round(sleeping.WATCH / h), 1) == 0:
            self._watch()

    def _fly(self, index: int, awake: np.ndarray) -> Flight:
        """Let those bodies of a batch fly that are awake, given as indices."""
        batch, gains, pinned = self._batches[index], self._gains[index], self._pinned[index]
        gravity, h = self.gravity, self.config.time_step
        if len(awake) == len(batch.x):
            return dynamics.fly(batch, gains, pinned, gravity, h)
        places = {row: place for place, row in enumerate(awake.tolist())}
        part_pinned = {places[row]: pins for row, pins in pinned.items() if row in places}
        return dynamics.fly(batch.part(awake), gains.of(awake), part_pinned, gravity, h)

    def _computed(
        self, names: Sequence[str], stage: Callable[..., Result], *arguments: Any
    ) -> Result:
        """Compute a stage of a tick; what goes wrong with it says which bodies it concerns."""
        try:
            return stage(*arguments)
        except (SimulationError, np.linalg.LinAlgError) as error:
            raise SimulationError(
                f'tick {self.tick + 1} of {", ".join(names)} cannot be computed ({error}): the '
                f'state stays at tick {self.tick}, reset it or lower the velocities'
            ) from error

    def _watch(self) -> None:
        """Look which bodies have come to rest: those get zero velocities."""
        if not any(watched.awake.any() for watched in self._watched):
            return
        there, points = self.obstacles, self._outside.points
        still = [obstacle for obstacle in there if not obstacle.moves]
        fall = 0.5 * float(np.linalg.norm(self.gravity)) * self.config.time_step**2
        way, lies = [], []
        for batch, watched, gains, pinned in zip(
            self._batches, self._watched, self._gains, self._pinned, strict=True
        ):
            way.append(sleeping.look(watched, batch.x, batch.rest))
            lies.append(sleeping.lying(batch.x, batch.rest, gains, still, points, pinned, fall))
        low, high = self._boxes()
        sleeping.fall_asleep(
            self._watched,
            np.concatenate(way),
            np.concatenate(lies),
            sleeping.stirred(low, high, there),
            bounding_boxes.overlapping(low, high),
        )
        for batch, watched, pinned in zip(self._batches, self._watched, self._pinned, strict=True):
            batch.v[~watched.awake] = 0.0
            resting = np.setdiff1d(np.flatnonzero(~watched.awake), list(pinned))
            batch.reaction[resting] = -np.stack([self.gravity, np.zeros(3)])

    def _wake_neighbours(self) -> None:
        """Wake sleepers that something comes near to: those who are awake, moving obstacles."""
        if all(watched.awake.all() for watched in self._watched):
            return
        there = self.obstacles
        moving = any(obstacle.moves for obstacle in there)
        if moving or any(watched.awake.any() for watched in self._watched):
            low, high = self._boxes()
            neighbours = bounding_boxes.overlapping(low, high)
            sleeping.wake_neighbours(self._watched, sleeping.stirred(low, high, there), neighbours)

    def _boxes(self) -> tuple[np.ndarray, np.ndarray]:
        """Return corners (C, 3) of boxes around all bodies, batch by batch, m."""
        corners = [(np.zeros((0, 3)), np.zeros((0, 3)))]
        for batch, gains in zip(self._batches, self._gains, strict=True):
            reach = (gains.thickness + sleeping.QUIET * batch.rest.scale)[:, None]
            low, high = bounding_boxes.bounds(batch.x)
            corners.append((low - reach, high + reach))
        lowest, highest = zip(*corners, strict=True)
        return np.concatenate(lowest), np.concatenate(highest)

    # ------------------------------------------------------------------------------------ state
    def reset(self) -> None:
        """
        Return to tick 0: rest shapes at their start poses, initial velocities, no dents.

        What others have put in the way is theirs and stays there; wrenches and a gravity of their
        own end.
        """
        self._outside = self._outside.begun_anew(self.tick)
        self.tick = 0
        self._obstacles = tuple(
            obstacles.placed(config, current.faces)
            for config, current in zip(self.config.obstacles, self._obstacles, strict=True)
        )
        self._batches = []
        for names, rest, parts in zip(self._members, self._rests, self._regions, strict=True):
            particles: np.ndarray = np.zeros((len(names), 6, rest.particle_count), self._dtype)
            for name, each in zip(names, particles, strict=True):
                each[POSITION] = _start_positions(self.body_config(name), rest)
            self._batches.append(Batch(rest, parts, particles))
        self._watched = [sleeping.stillness(batch.x) for batch in self._batches]
        self.apply_initial_velocity()

    def apply_initial_velocity(self) -> None:
        """Give each body its initial velocity, rigidly about its centre; the shape stays."""
        for name in self._place:
            batch, row = self._state(name)
            config = self.body_config(name)
            centre = weighted(batch.x[row], batch.rest.weights)
            arms = batch.x[row] - centre[:, None]
            linear = np.array(config.initial_velocity_linear)
            batch.v[row] = _twist(linear, np.array(config.initial_velocity_angular), arms)
            self._wake(name)

    def place(self, name: str, position: np.ndarray, rotation: np.ndarray) -> None:
        """
        Move a body as it is, deformed or not, to a pose of its own frame; its twist stays.

        Parameters
        ----------
        name : str
        position : (3,) float
            m
        rotation : (3, 3) float

        """
        batch, row = self._state(name)
        fit = self.rigid_fit(name)
        turn = rotation @ fit.rotation.T
        arms = batch.x[row] - fit.position[:, None]
        deforming = batch.v[row] - _twist(fit.linear_velocity, fit.angular_velocity, arms)
        arms = turn @ arms
        batch.x[row] = arms + position[:, None]
        batch.v[row] = turn @ deforming + _twist(fit.linear_velocity, fit.angular_velocity, arms)
        self._wake(name)

    def set_twist(self, name: str, linear: np.ndarray, angular: np.ndarray) -> None:
        """
        Let a body move as if it were rigid; its shape stays.

        Parameters
        ----------
        name : str
        linear : (3,) float
            velocity of the origin of its own frame, m/s
        angular : (3,) float
            rad/s, world axes

        """
        batch, row = self._state(name)
        arms = batch.x[row] - self.rigid_fit(name).position[:, None]
        batch.v[row] = _twist(linear, angular, arms)
        self._wake(name)

    def snapshot(self) -> Snapshot:
        """Return a copy of the state."""
        return Snapshot(
            self.tick,
            tuple(batch.x.copy() for batch in self._batches),
            tuple(batch.v.copy() for batch in self._batches),
            tuple(batch.plastic for batch in self._batches),
            tuple(batch.reaction.copy() for batch in self._batches),
            tuple(watched.copy() for watched in self._watched),
            self._obstacles,
            self._outside,
        )

    def restore(self, snapshot: Snapshot) -> None:
        """Return to the state of a snapshot of this world."""
        self.tick = snapshot.tick
        self._obstacles = tuple(
            dataclasses.replace(saved, config=config)
            for config, saved in zip(self.config.obstacles, snapshot.obstacles, strict=True)
        )
        self._outside = snapshot.outside
        self._watched = [watched.copy() for watched in snapshot.watched]
        for batch, x, v, plastic, reaction in zip(
            self._batches,
            snapshot.x,
            snapshot.v,
            snapshot.plastic,
            snapshot.reaction,
            strict=True,
        ):
            batch.x[:], batch.v[:], batch.plastic = x, v, plastic
            batch.reaction = reaction.copy()

    # -------------------------------------------------------------------------- from the outside
    def change_obstacles(
        self, changes: Iterable[Placement | Removal], longest_gap: float = 0.5
    ) -> None:
        """
        Let others put obstacles in the way, move them, or take them away.

        Poses that are said one after the other make a velocity, with which an obstacle moves on;
        see `Outside.changed`.

        Parameters
        ----------
        changes : iterable of Placement and Removal
        longest_gap : float
            between two poses that make a velocity, and time for which it is kept up, s

        """
        h = self.config.time_step
        self._let(self._outside.changed(changes, self.tick, longest_gap, h))

    def set_points(self, points: PointObstacles) -> None:
        """Let other points be in the way, instead of those before."""
        before, self._outside = self._outside.points, self._outside.with_points(points)
        # bodies in the same order as their boxes: batch by batch
        for name, low, high in zip(self._place, *self._boxes(), strict=True):
            if not np.array_equal(points.within(low, high), before.within(low, high)):
                self._wake(name)

    def apply_wrench(
        self,
        name: str | None,
        force: ArrayLike,
        torque: ArrayLike,
        seconds: float,
        in_body_axes: bool = False,
    ) -> None:
        """
        Push and turn a body at its centre of mass for some time, instead of the wrench before.

        It acts at every point of the body like gravity, as a rigid field: it moves and turns the
        body and does not deform it. Momentum and angular momentum that it gives are exact. A zero
        wrench ends it at once.

        Parameters
        ----------
        name : str or None
            of the body; None is each of all bodies, besides what acts on them alone
        force, torque : (3,) float
            N, N m
        seconds : float
        in_body_axes : bool
            whether both turn with the body, or are in world axes

        """
        if name is not None:
            self._require_body(name)
        ends_at = self.tick + ticks_of(seconds, self.config.time_step)
        force, torque = np.array(force, dtype=float), np.array(torque, dtype=float)
        wrench = Wrench(force, torque, in_body_axes, ends_at)
        self._let(self._outside.with_wrench(EVERY_BODY if name is None else name, wrench))

    def override_gravity(self, gravity: ArrayLike, seconds: float) -> None:
        """Let another gravity, m/s², act for some time instead of the config's."""
        ends_at = self.tick + ticks_of(seconds, self.config.time_step)
        self._let(self._outside.with_gravity(np.array(gravity, dtype=float), ends_at))

    def poke(self, point: ArrayLike, impulse: float, radius: float) -> str:
        """
        Poke the surface that is nearest to a point, inwards; see `poke.velocity_change`.

        Parameters
        ----------
        point : (3,) float
            m
        impulse : float
            N s
        radius : float
            of the spot, m

        Returns
        -------
        str
            the name of the body, '' if none is within the radius

        """
        name, distance = self.nearest(point)
        if distance >= radius:
            return ''
        batch, row = self._state(name)
        body, x = self.body_config(name), batch.x[row].astype(np.float64)
        frequency = 0.0
        if body.mode != 'rigid':
            frequency = natural_frequency(body.stiffness, self.config.reference_step)
        batch.v[row] += poke.velocity_change(
            x, batch.rest, np.array(point), radius, impulse / body.mass, frequency
        )
        self._wake(name)
        return name

    def nearest(self, point: ArrayLike) -> tuple[str, float]:
        """Return the body that has a particle nearest to a point, and its distance, m."""
        distances = {
            name: float(np.linalg.norm(self.positions(name) - np.array(point), axis=1).min())
            for name in self.names
        }
        name = min(distances, key=lambda name: distances[name])
        return name, distances[name]

    def _let(self, outside: Outside) -> None:
        """Let something act from now on; bodies wake up if they notice it."""
        if outside is self._outside:
            return
        before, gravity, self._outside = self._outside, self.gravity, outside
        if not outside.same_guests(before) or (gravity != self.gravity).any():
            for name in self._place:
                self._wake(name)

    def _push(self) -> None:
        """Give the batches their wrenches; whoever is pushed is awake."""
        wrenches = self._outside.wrenches
        for batch, names in zip(self._batches, self._members, strict=True):
            batch.push = None
            if not wrenches:
                continue
            batch.push = np.zeros((len(names), 2, 2, 3))
            for row, name in enumerate(names):
                for wrench in (wrenches.get(EVERY_BODY), wrenches.get(name)):
                    if wrench is not None:
                        both = np.stack([wrench.force, wrench.torque])
                        batch.push[row, int(wrench.in_body_axes)] += both
                        self._wake(name)
                batch.push[row] /= self.body_config(name).mass

    # ----------------------------------------------------------------------------------- config
    def configure(self, config: WorldConfig) -> None:
        """
        Use other parameters from the next tick on; positions and velocities stay.

        An obstacle whose pose differs from the old config's is put there; start poses and initial
        velocities of bodies wait for `reset` and `apply_initial_velocity`.

        Raises
        ------
        ConfigError
            if a read-only setting differs, or there is no such vertex to pin; nothing has changed
            then.

        """
        self.check(config)
        self._obstacles = tuple(
            _reconfigured(current, new)
            for current, new in zip(self._obstacles, config.obstacles, strict=True)
        )
        self._wake_those_that_notice(self.config, config)
        self.config = config
        self._gains = self._gains_of(config)
        self._update_pins()

    def check(self, config: WorldConfig) -> None:
        """Raise ConfigError if `configure` cannot use a config."""
        _require_same_structure(self.config, config)
        for bodies, rest in zip(self._batched(config), self._rests, strict=True):
            for body in bodies:
                pinned_particles(body, rest)

    def _wake_those_that_notice(self, old: WorldConfig, new: WorldConfig) -> None:
        """Wake bodies by a change that matters to them; those of start states do not."""
        elsewhere = (old.gravity != new.gravity).any() or old.obstacles != new.obstacles
        for before, after in zip(old.bodies, new.bodies, strict=True):
            start = {
                field: getattr(after, field)
                for field in ('position', 'orientation')
                + ('initial_velocity_linear', 'initial_velocity_angular')
            }
            if elsewhere or dataclasses.replace(before, **start) != after:
                self._wake(after.name)

    def _wake(self, name: str) -> None:
        batch, row = self._place[name]
        self._watched[batch].quiet_looks[row] = 0

    def body_config(self, name: str) -> BodyConfig:
        """Return the config of a body."""
        self._require_body(name)
        return self.config.bodies[self._index[name]]

    def _gains_of(self, config: WorldConfig) -> list[Gains]:
        return [
            make_gains(bodies, config.time_step, config.reference_step)
            for bodies in self._batched(config)
        ]

    def _update_pins(self) -> None:
        for batch, bodies in enumerate(self._batched(self.config)):
            made = {
                row: make_pins(body, self._rests[batch], self._pinned[batch].get(row))
                for row, body in enumerate(bodies)
            }
            self._pinned[batch] = {row: pins for row, pins in made.items() if pins is not None}

    def _batched(self, config: WorldConfig) -> list[list[BodyConfig]]:
        return [[config.bodies[self._index[name]] for name in names] for names in self._members]

    # ---------------------------------------------------------------------------------- queries
    def contact_wrench(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """
        Return the total force (3,), N, and torque (3,), N m, of all contacts of a body.

        World axes, at the centre of mass; zero where nothing touches.
        """
        batch, row = self._state(name)
        force, torque = self.body_config(name).mass * batch.reaction[row]
        return force, torque

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the bodies, in the order of the config."""
        return tuple(body.name for body in self.config.bodies)

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """The obstacles where they are now: those of the config, then those of others."""
        return self._obstacles + self._outside.obstacles

    @property
    def gravity(self) -> np.ndarray:
        """(3,) float: the gravity that acts now, m/s²."""
        override = self._outside.gravity
        return self.config.gravity if override is None else override

    @property
    def point_obstacles(self) -> PointObstacles:
        """The points that are in the way."""
        return self._outside.points

    @property
    def outside(self) -> Outside:
        """What others do to this world."""
        return self._outside

    def rest_shape(self, name: str) -> RestShape:
        """Return the rest shape of a body."""
        return self._state(name)[0].rest

    def positions(self, name: str) -> np.ndarray:
        """Return (n, 3) float: a copy of the positions, m."""
        batch, row = self._state(name)
        return batch.x[row].T.copy()

    def velocities(self, name: str) -> np.ndarray:
        """Return (n, 3) float: a copy of the velocities, m/s."""
        batch, row = self._state(name)
        return batch.v[row].T.copy()

    def is_asleep(self, name: str) -> bool:
        """Return whether a body lies still and is not simulated until something wakes it."""
        self._require_body(name)
        batch, row = self._place[name]
        return not self._watched[batch].awake[row]

    def permanent_strain(self, name: str) -> float:
        """Return the largest strain of a body, or of its regions, that has become permanent."""
        batch, row = self._state(name)
        return 0.0 if batch.plastic is None else plasticity.strain(batch.plastic[row])

    def rigid_fit(self, name: str) -> RigidFit:
        """Return the rigid motion nearest to a body, and how far each particle is from it."""
        batch, row = self._state(name)
        rest, x, v = batch.rest, batch.x[row : row + 1], batch.v[row : row + 1]
        centre, moment = matching.moments(x, rest, 3)
        rotations = rotation(moment)
        motion = rigid_motion.rigid_motion(x, v, centre, rest)
        omega = motion.angular_velocity[0]
        to_origin = -rotations[0] @ rest.centre
        return RigidFit(
            position=centre[0] + to_origin,
            rotation=rotations[0],
            linear_velocity=motion.velocity[0] + np.cross(omega, to_origin),
            angular_velocity=omega,
            displacement=matching.distances(x, centre, rotations, rest)[0],
        )

    def _require_body(self, name: str) -> None:
        if name not in self._place:
            raise ConfigError(f'there is no body {name!r}: {unknown_name(name, self.names)}')

    def _state(self, name: str) -> tuple[Batch, int]:
        self._require_body(name)
        batch, row = self._place[name]
        return self._batches[batch], row


def _members_by_shape(bodies: tuple[BodyConfig, ...]) -> list[list[str]]:
    """Return the names of the bodies, grouped by rest shape: each group is stepped as one."""
    groups: dict[tuple, list[str]] = {}
    for body in bodies:
        shape: tuple = (body.mesh, body.size, body.subdivisions)
        if isinstance(body.mesh, Surface):
            shape = (id(body.mesh),)
        parts = (body.regions_count, body.regions_overlap)
        groups.setdefault(shape + parts, []).append(body.name)
    return list(groups.values())


def _rest_shape_of(body: BodyConfig, dtype: type) -> RestShape:
    try:
        surface = body.mesh
        if not isinstance(surface, Surface):
            surface = make_surface(surface, body.size, body.subdivisions)
        return make_rest_shape(surface, dtype)
    except MeshError as error:
        raise MeshError(f'{body.prefix}{error}') from None


def _regions_of(body: BodyConfig, rest: RestShape) -> Regions | None:
    if body.regions_count > rest.particle_count:
        raise ConfigError(
            f'{body.prefix}regions.count is {body.regions_count}: the mesh has only '
            f'{rest.particle_count} vertices'
        )
    if not body.regions_count:
        return None
    return make_regions(rest, body.regions_count, body.regions_overlap)


def _start_positions(body: BodyConfig, rest: RestShape) -> np.ndarray:
    """Return (3, n) float: the rest shape at the start pose, m."""
    rotation = Rotation.from_quat(body.orientation).as_matrix()
    return rotation @ rest.surface.vertices.T + np.array(body.position)[:, None]


def _twist(linear: np.ndarray, angular: np.ndarray, arms: np.ndarray) -> np.ndarray:
    """Return the velocities (3, n) of a rigid motion at arms (3, n) from a point that has it."""
    return linear[:, None] + np.cross(angular, arms, axisb=0, axisc=0)


def _reconfigured(current: Obstacle, config: ObstacleConfig) -> Obstacle:
    target = obstacles.placed(config, current.faces)
    same_pose = (
        current.config.position == target.config.position
        and current.config.orientation == target.config.orientation
    )
    if same_pose:
        return dataclasses.replace(current, config=config)
    return target


def _require_same_structure(old: WorldConfig, new: WorldConfig) -> None:
    def read_only(config: WorldConfig) -> Mapping[str, object]:
        values: dict[str, object] = {}
        for part in (config, *config.bodies, *config.obstacles):
            for field, dotted, facts in settings(part):
                if facts.read_only:
                    values[part.prefix + dotted] = getattr(part, field)
        return values

    before, after = read_only(old), read_only(new)
    if list(before) != list(after):
        raise ConfigError('bodies and obstacles cannot be added or removed: make a new World')
    for name, value in before.items():
        if value is not after[name] and value != after[name]:
            raise ConfigError(f'{name} is {value!r} and cannot change: make a new World')
