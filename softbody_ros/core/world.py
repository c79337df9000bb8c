# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The world: bodies and obstacles under gravity, stepped, saved, restored and reconfigured."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
import dataclasses
from dataclasses import dataclass
import math
from operator import is_not
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from softbody_ros.core import poke, sleeping
from softbody_ros.core.attachments import Holders, attach
from softbody_ros.core.body_shape import (
    BYTES_OF_PARTICLE,
    BodyShape,
    ShapeCache,
    body_of,
    bytes_of,
    make_body_shape,
    placed_at_start,
    require_possible,
    shape_of,
    start_positions,
    start_surface,
)
from softbody_ros.core.collision import obstacles
from softbody_ros.core.collision.collision_surface import CollisionSurface, CollisionSurfaces
from softbody_ros.core.collision.fixed_points import FixedPoints
from softbody_ros.core.collision.obstacles import Obstacle, ObstacleTable
from softbody_ros.core.collision.point_filter import steadied
from softbody_ros.core.collision.point_obstacles import PointObstacles
from softbody_ros.core.config import (
    BodyConfig,
    ConfigError,
    ObstacleConfig,
    WorldConfig,
    shown,
    unknown_name,
)
from softbody_ros.core.contact import exchange
from softbody_ros.core.contact.rows import NO_MEMORY, without
from softbody_ros.core.contact_forces import ContactImpulse, Departure, ObstacleKey
from softbody_ros.core.embedding import Embedding
from softbody_ros.core.external_inputs import (
    EVERY_BODY,
    MOST_DYNAMIC_OBSTACLES,
    DynamicObstacle,
    ExternalInputs,
    Key,
    ObstacleChange,
    Wrench,
    ticks_of,
)
from softbody_ros.core.finite import (
    finite_array,
    finite_number,
    finite_rows,
    finite_vector,
)
from softbody_ros.core.geometry.bounding_boxes import overlapping
from softbody_ros.core.geometry.bvh import make_tree
from softbody_ros.core.geometry.surface import Surface
from softbody_ros.core.prepared_config import BYTES, PreparedConfig, list_bytes
from softbody_ros.core.rigid_fit import RigidFit, fit_rigid_motion, rigid_field
from softbody_ros.core.shape_matching.gains import put_gains
from softbody_ros.core.shape_matching.material import (
    KAPPA,
    Material,
    make_material,
)
from softbody_ros.core.shape_matching.pins import Pins, make_pins
from softbody_ros.core.shape_matching.plasticity import (
    largest_permanent_strain,
    permanent_strains,
)
from softbody_ros.core.shape_matching.regions import Regions
from softbody_ros.core.shape_matching.rest_shape import (
    RestShape,
    weighted_mean,
)
from softbody_ros.core.state import Body, BodyState, ObstacleTotals, State
from softbody_ros.core.step import Environment, Integrator, SimulationError, SolverWork
from softbody_ros.core.structure import (
    in_order,
    moves_alike,
    require_same_settings,
    require_same_structure,
    shape_key,
    shared,
    structure_of,
    with_structure,
)

FILTERED = 3.0
"""Distance from bodies up to which the noise of points is filtered, in their radii."""


@dataclass(frozen=True)
class Snapshot:
    """
    A copy of the state: simulation from it is reproduced bit by bit.

    It includes the bodies and obstacles at that time: restoring it undoes later additions and
    removals. It includes the contact forces of its tick and their integrals over time, too.
    """

    tick: int
    bodies: tuple[Body, ...]
    states: tuple[BodyState, ...]
    contact_memory: np.ndarray
    obstacles: tuple[Obstacle, ...]
    inputs: ExternalInputs
    obstacle_totals: ObstacleTotals
    gravity: np.ndarray

    @property
    def nbytes(self) -> int:
        """Bytes of memory."""
        states = sum(state.nbytes for state in self.states)
        contacts = self.contact_memory.nbytes + self.obstacle_totals.nbytes
        return states + contacts + self.inputs.nbytes

    @property
    def settings_nbytes(self) -> dict[int, int]:
        """
        Bytes of what only other settings replace, by `id`: lists of indices, and pins.

        Snapshots between such changes share them.
        """
        sizes = {id(body.config): list_bytes(body.config) for body in self.bodies}
        for body in self.bodies:
            if body.pins is not None:
                sizes[id(body.pins.rest)] = BYTES_OF_PARTICLE * body.pins.rest.particle_count
        return {key: size for key, size in sizes.items() if size}


class World:
    """
    Bodies, obstacles and gravity at one tick.

    Attributes
    ----------
    config : WorldConfig
    tick : int
    time_jumps : int
        number of calls of `reset` and `restore`
    rebuilds : int
        number of times that bodies were added or removed
    departures : int
        number of obstacles that went after they had touched something

    Parameters
    ----------
    config : WorldConfig

    Raises
    ------
    ConfigError, MeshError
        with one sentence that says what to change.

    Examples
    --------
    >>> world = World(WorldConfig())
    >>> world.step(240)
    >>> world.positions('ball').shape
    (642, 3)

    """

    def __init__(self, config: WorldConfig) -> None:
        self.config = config
        self.tick = 0
        self.time_jumps = 0
        self.rebuilds = -1
        self.departures = 0
        self._last_departures: deque[Departure] = deque(maxlen=MOST_DYNAMIC_OBSTACLES)
        self._inputs = ExternalInputs()
        self._shapes: dict[tuple, BodyShape] = {}
        self._known_shapes = ShapeCache()
        self._surfaces: dict[tuple[int, int], CollisionSurface] = {}
        self._obstacle_table, self._fixed_points = ObstacleTable(), FixedPoints()
        self._bodies = [self._make_body(body) for body in config.bodies]
        self._holders: Holders
        self._obstacles = tuple(obstacles.made(item) for item in config.obstacles)
        # of the config, received, and both
        self._present = self._obstacles, self._inputs.obstacles, self._obstacles
        self._awake: np.ndarray | None = None
        self._environment: Environment
        self._build()
        if len(self._bodies) > 1:
            _ = self._environment.surfaces.arrays  # now, not in the tick of the first contact
        self.reset()
        for index, body in enumerate(self._bodies):
            self._check_attachment(index, body.config)

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
            if a number is not finite; the state remains that of the last good tick.

        """
        for _ in range(ticks):
            self._step()

    def load_kernels(self) -> None:
        """
        Take a tick and undo it: what it compiles, or loads, does not delay the first one.

        Nor those in which bodies meet for the first time, or may fall asleep.
        """
        saved = self.snapshot()
        with suppress(SimulationError):
            self._step()
        self._update_sleep()
        boxes = self._boxes()
        sleeping.islands(len(self._bodies), *overlapping(*boxes))
        self._inputs.points.touched(*boxes)
        self._integrator.load_kernels(self._environment_of(self.obstacles, self._inputs))
        if self._bodies:
            self.rigid_fit(self.names[0])
        self.restore(saved)

    def _step(self) -> None:
        h = self.config.time_step
        inputs, moved = self._inputs.moved(h), self._obstacles
        if self._obstacles_move:
            moved = tuple(obstacles.moved(obstacle, h) for obstacle in moved)
        environment = self._environment_of(self._joined(moved, inputs.obstacles), inputs)
        if inputs.wrenches or self._any_wrench:
            self._apply_wrenches()
        if self._awake is None or len(self._awake) < len(self._bodies):
            self._wake_touching()
        assert self._awake is not None
        try:
            self._integrator.take_tick(self._awake, environment, h)
        except SimulationError as error:
            why, name = error.args
            raise SimulationError(
                f'tick {self.tick + 1} of {name} cannot be computed ({why}): the state stays at '
                f'tick {self.tick}, reset it or lower the velocities'
            ) from error
        if moved is not self._obstacles:
            self._put_obstacles(moved)
        self._inputs = inputs
        self._follow_holders(placed=False)
        self.tick += 1
        after = inputs.at(self.tick)
        if after is not inputs:
            self._set_inputs(after)
        if self.tick % self._sleep_interval == 0:
            self._update_sleep()

    def _joined(
        self, standing: tuple[Obstacle, ...], received: tuple[Obstacle, ...]
    ) -> tuple[Obstacle, ...]:
        """Return both together, the same object as long as they are the same ones."""
        if standing is not self._present[0] or received is not self._present[1]:
            self._present = standing, received, standing + received
        return self._present[2]

    def _environment_of(
        self, present: tuple[Obstacle, ...], inputs: ExternalInputs
    ) -> Environment:
        """Return the environment of a tick, the same object as long as nothing changes."""
        environment, gravity = self._environment, self._config_gravity
        if inputs.gravity is not None:
            gravity = inputs.gravity
        if (
            present is environment.obstacles
            and gravity is environment.gravity
            and inputs.points is environment.cloud
        ):
            return environment
        self._environment = self._make_environment(
            gravity, present, inputs.points, environment.surfaces
        )
        return self._environment

    def _make_environment(
        self,
        gravity: np.ndarray,
        present: tuple[Obstacle, ...],
        cloud: PointObstacles,
        surfaces: CollisionSurfaces,
    ) -> Environment:
        keys = self._state.obstacle_keys[:-1]  # the last one is that of points
        records, trees = self._obstacle_table.refresh(present, keys)
        points, sets = self._fixed_points.refresh(cloud, present, records)
        return Environment(gravity, present, records, trees, cloud, points, sets, surfaces)

    def _apply_wrenches(self) -> None:
        """Accumulate applied wrenches per body and wake those bodies."""
        wrenches, records = self._inputs.wrenches, self._state.bodies
        records['wrench'] = 0.0
        common = wrenches.get(EVERY_BODY)
        for index, body in enumerate(self._bodies):
            name = body.config.name
            applied = [wrench for wrench in (common, wrenches.get(name)) if wrench is not None]
            records['has_wrench'][index] = bool(applied)
            for wrench in applied:
                wrench_per_mass = np.stack([wrench.force, wrench.torque]) / records['mass'][index]
                records['wrench'][index, int(wrench.in_body_axes)] += wrench_per_mass
                self._wake(index)
        self._any_wrench = bool(wrenches)

    # --------------------------------------------------------------------------------- sleeping
    def _wake(self, indices: int | np.ndarray | slice) -> None:
        self._state.still_samples[indices] = 0
        self._body_boxes.forget(indices)
        self._awake = None

    def _find_awake(self) -> None:
        self._awake = np.flatnonzero(sleeping.is_awake(self._state))
        self._body_boxes.forget(self._awake)

    def _update_sleep(self) -> None:
        """Sample the displacements of bodies; those that fall asleep get zero velocities."""
        if self._awake is None:
            self._find_awake()
        assert self._awake is not None
        if not len(self._awake):
            return
        environment, before = self._environment_of(self.obstacles, self._inputs), self._awake
        gravity = environment.gravity
        fall = 0.5 * float(np.linalg.norm(gravity)) * self.config.time_step**2
        sleeping.update_sleep(
            self._state,
            environment.obstacles,
            environment.records,
            environment.trees,
            environment.cloud,
            self._holders.fixed_and_driven(),
            fall,
            self._body_boxes,
        )
        self._find_awake()
        if len(self._awake) == len(self._bodies):
            return
        self._balance(np.setdiff1d(before, self._awake), gravity)
        weight = np.stack([gravity, np.zeros(3)])
        for index in np.flatnonzero(~sleeping.is_awake(self._state)).tolist():
            self._state.velocities(index)[:] = 0.0
            if self._bodies[index].pins is None:
                self._state.reaction[index] = -weight
            else:
                self._state.holding[index] = -weight - self._state.reaction[index]
                self._holders.load(index, self.config.time_step)

    def _balance(self, indices: np.ndarray, gravity: np.ndarray) -> None:
        """Let bodies that fall asleep weigh on obstacles as they go on to carry their weight."""
        if not len(indices):
            return
        state, h = self._state, self.config.time_step
        low, high = (corners[indices] for corners in self._boxes())
        island = sleeping.islands(len(indices), *overlapping(low, high))
        origins = np.array([*(obstacle.position for obstacle in self.obstacles), np.zeros(3)])
        for number in np.unique(island):
            members = indices[island == number]
            if any(self._bodies[index].pins is not None for index in members):
                continue  # how much pins carry is not known
            centres = np.array(
                [
                    weighted_mean(state.positions(index).T, self._bodies[index].rest.weights)
                    for index in members
                ]
            )
            weight = h * state.bodies['mass'][members, None] * gravity
            given = [state.obstacle_impulses(index) for index in members]
            for row, balanced in zip(
                given, exchange.balanced(np.array(given), origins, weight, centres), strict=True
            ):
                row[:] = balanced

    def _wake_touching(self) -> None:
        """Wake bodies asleep that awake bodies or moving obstacles touch."""
        if self._awake is None:
            self._find_awake()
        assert self._awake is not None
        if len(self._awake) == len(self._bodies):
            return
        present = self.obstacles
        if len(self._awake) or any(obstacle.drives for obstacle in present):
            sleeping.wake_touching(self._state, self._boxes(), present)
            self._find_awake()

    def _boxes(self) -> sleeping.Boxes:
        return self._body_boxes.measured()

    def _touching(self, index: int) -> np.ndarray:
        """Return which bodies (B,) bool touch one: those asleep on top of it must fall."""
        return sleeping.touching(self._boxes(), index)

    def _wake_near(self, changed: Iterable[Obstacle]) -> None:
        """Wake the bodies near obstacles, given at their old and new poses."""
        if not np.count_nonzero(self._state.still_samples):  # much faster than `any`
            return  # all are wide awake
        boxes = None
        reach = sleeping.NEAR * self._state.scales
        for obstacle in changed:
            boxes = self._boxes() if boxes is None else boxes
            self._wake(sleeping.near_obstacle(boxes, obstacle, reach))

    # ------------------------------------------------------------------------------------ state
    def reset(self) -> None:
        """
        Return to tick 0: undeformed bodies at their start poses with initial velocities.

        Obstacles and points received at run time stay; wrenches and a gravity override end.
        """
        self._inputs = self._inputs.reset(self.tick)
        self.tick = 0
        self.time_jumps += 1
        self._set_obstacles(
            tuple(
                obstacles.placed(config, current.tree)
                for config, current in zip(self.config.obstacles, self._obstacles, strict=True)
            )
        )
        self._state.contact_memory = NO_MEMORY
        self._state.forget_obstacle_contacts()
        for index in range(len(self._bodies)):
            self._reset_body(index)
        self._attach(range(len(self._bodies)))

    def _reset_body(self, index: int) -> None:
        """Put a body into its initial state."""
        state, body = self._state, self._bodies[index]
        state.positions(index)[:] = start_positions(body.config, body.rest)
        state.set_plastic_state(index, None)
        state.forget_contacts(index, self.tick)
        sleeping.begin_watching(state, [index])
        self._apply_initial_velocity(index)

    def apply_initial_velocity(self) -> None:
        """Set the velocities of each body to its initial velocity; positions stay."""
        for index in range(len(self._bodies)):
            self._apply_initial_velocity(index)

    def _apply_initial_velocity(self, index: int) -> None:
        body, x = self._bodies[index], self._state.positions(index)
        centre = weighted_mean(x.T, body.rest.weights)
        linear = np.array(body.config.initial_velocity_linear)
        angular = np.array(body.config.initial_velocity_angular)
        self._state.velocities(index)[:] = rigid_field(linear, angular, x - centre[:, None])
        self._wake(index)

    def place(self, name: str, position: np.ndarray, rotation: np.ndarray) -> None:
        """
        Move a body with its present shape to a pose of its own frame; its twist stays.

        Parameters
        ----------
        name : str
        position : (3,) float
            m
        rotation : (3, 3) float

        Raises
        ------
        ConfigError
            if there is no such body, or a number is not finite; nothing has changed then.

        """
        index, fit = self._index_of(name), self.rigid_fit(name)
        position = finite_vector(position, 'position')
        rotation = finite_array(rotation, (3, 3), 'rotation', 'a matrix')
        self._wake(self._touching(index))
        x, v = self._state.positions(index), self._state.velocities(index)
        rotation_change = rotation @ fit.rotation.T
        arms = x - fit.position[:, None]
        deformation_velocity = v - rigid_field(fit.linear_velocity, fit.angular_velocity, arms)
        arms = rotation_change @ arms
        x[:] = arms + position[:, None]
        v[:] = rotation_change @ deformation_velocity + rigid_field(
            fit.linear_velocity, fit.angular_velocity, arms
        )
        self._wake(index)

    def set_twist(self, name: str, linear: np.ndarray, angular: np.ndarray) -> None:
        """
        Set the velocities of a body to a rigid motion; positions stay.

        Parameters
        ----------
        name : str
        linear : (3,) float
            velocity of the origin of its own frame, m/s
        angular : (3,) float
            rad/s, world axes

        Raises
        ------
        ConfigError
            if there is no such body, or a number is not finite; nothing has changed then.

        """
        index = self._index_of(name)
        linear, angular = finite_vector(linear, 'linear'), finite_vector(angular, 'angular')
        arms = self._state.positions(index) - self.rigid_fit(name).position[:, None]
        self._state.velocities(index)[:] = rigid_field(linear, angular, arms)
        self._wake(index)

    def set_state(
        self, name: str, positions: ArrayLike | None = None, velocities: ArrayLike | None = None
    ) -> None:
        """
        Set positions (n, 3), m, or velocities (n, 3), m/s, of a body, and wake it.

        Inner particles follow the surface by its best affine fit to the rest shape. Where the
        surface is given as it is, they stay as they are; a snapshot keeps them at other times.

        Raises
        ------
        ConfigError
            if the shape of an array is wrong, or a number is not finite; nothing has changed then.

        """
        index = self._index_of(name)
        rest = self._bodies[index].rest
        count = rest.surface_count
        x = None if positions is None else finite_rows(positions, count, f'positions of {name}')
        v = None if velocities is None else finite_rows(velocities, count, f'velocities of {name}')
        if x is not None:
            self._wake(self._touching(index))
        for given, current in (
            (x, self._state.positions(index)),
            (v, self._state.velocities(index)),
        ):
            if given is None:
                continue
            if len(rest.inner) and not np.array_equal(given.T, current[:, :count]):
                current[:, count:] = rest.inner_following(given.T)
            current[:, :count] = given.T
        self._wake(index)

    def snapshot(self) -> Snapshot:
        """Return a copy of the state."""
        states = tuple(self._state.save(index) for index in range(len(self._bodies)))
        bodies = tuple(dataclasses.replace(body) for body in self._bodies)
        memory = self._state.contact_memory
        totals = self._state.save_obstacles()
        return Snapshot(
            self.tick, bodies, states, memory, self._obstacles, self._inputs, totals, self.gravity
        )

    def restore(self, snapshot: Snapshot) -> None:
        """
        Return to the state of a snapshot of this world, including its bodies and obstacles.

        Those that are present, or present again, keep the parameters that they have now. Bodies
        that were asleep with others are awake.
        """
        self._restore_structure(snapshot)
        self.tick = snapshot.tick
        self.time_jumps += 1
        self._inputs = snapshot.inputs
        self._holders = Holders((), self._state)  # of this state none is followed
        self._set_obstacles(
            tuple(
                _with_config(saved, config)
                for config, saved in zip(self.config.obstacles, snapshot.obstacles, strict=True)
            )
        )
        self._state.restore_obstacles(snapshot.obstacle_totals)
        for index, saved in enumerate(snapshot.states):
            self._state.restore(index, saved)
        self._body_boxes.forget(slice(None))
        self._restore_attachments(snapshot)
        self._state.contact_memory = snapshot.contact_memory
        self._awake = None
        self._wake_changed_since(snapshot)

    def _wake_changed_since(self, snapshot: Snapshot) -> None:
        """Wake what was asleep in a snapshot with other parameters."""
        if (snapshot.gravity != self.gravity).any():
            self._wake(slice(None))
        for index, (body, saved) in enumerate(zip(self._bodies, snapshot.bodies, strict=True)):
            if not moves_alike(saved.config, body.config):
                self._wake(index)
        for obstacle, before in zip(self._obstacles, snapshot.obstacles, strict=True):
            if obstacle.config != before.config:
                self._wake_near([before, obstacle])

    # -------------------------------------------------------------------------------- structure
    def add(self, config: BodyConfig | ObstacleConfig) -> None:
        """
        Add a body at its start pose, or an obstacle.

        Raises
        ------
        ConfigError, MeshError
            with one sentence that says what to change; nothing has changed then.

        """
        if isinstance(config, ObstacleConfig):
            new = dataclasses.replace(self.config, obstacles=(*self.config.obstacles, config))
            made = obstacles.made(config)
            self.config = new
            self._set_obstacles((*self._obstacles, made))
            self._wake_near([made])
            return
        new = dataclasses.replace(self.config, bodies=(*self.config.bodies, config))
        body = self._make_body(config)
        self.config = new
        before = self._bodies
        self._replace_bodies([*before, body])
        self._reset_body(len(before))
        try:
            self._check_attachment(len(before), config)
        except ConfigError:
            self.config = dataclasses.replace(self.config, bodies=self.config.bodies[:-1])
            self._replace_bodies(before)
            raise
        self._attach([len(before)])

    def remove(self, name: str) -> None:
        """
        Remove a body or an obstacle.

        Raises
        ------
        ConfigError
            if there is none of that name.

        """
        for index, obstacle in enumerate(self._obstacles):
            if obstacle.config.name == name:
                self._let_go_of([], [index])
                kept = self._obstacles[:index] + self._obstacles[index + 1 :]
                configs = tuple(each.config for each in kept)
                self.config = dataclasses.replace(self.config, obstacles=configs)
                self._set_obstacles(kept)
                return
        if name not in self._index:
            names = (*self.names, *(config.name for config in self.config.obstacles))
            raise ConfigError(
                f'there is no body or obstacle {shown(name)}: {unknown_name(name, names)}'
            )
        index = self._index[name]
        self._let_go_of([index], [])
        others = self._bodies[:index] + self._bodies[index + 1 :]
        bodies = tuple(body.config for body in others)
        self.config = dataclasses.replace(self.config, bodies=bodies)
        self._replace_bodies(others)

    def _let_go_of(self, indices: list[int], rows: list[int]) -> None:
        """Wake what touches bodies and obstacles that are removed; forget what acts on these."""
        self._wake_near(self._obstacles[row] for row in rows)
        for index in indices:
            self._wake(self._touching(index))
            name, still = self._bodies[index].config.name, np.zeros(3)
            self._inputs = self._inputs.with_wrench(name, Wrench(still, still, False, 0))
        records = self._environment_of(self.obstacles, self._inputs).records
        self._state.contact_memory = without(
            self._state.contact_memory, self._state.bodies['id'][indices], records['id'][rows]
        )

    def prepare(
        self, config: WorldConfig, base: WorldConfig | None = None, lenient: bool = False
    ) -> PreparedConfig:
        """
        Load what `adopt` needs to use a config; the world stays as it is.

        Parameters
        ----------
        config : WorldConfig
            those of its bodies and obstacles that are new come last, whatever their order
        base : WorldConfig, optional
            the config that it is to replace, by default the present one
        lenient : bool
            see `configure`

        Raises
        ------
        ConfigError, MeshError
            with one sentence that says what to change.

        """
        base = self.config if base is None else base
        require_same_settings(base, config)
        config = dataclasses.replace(
            config,
            bodies=shared(in_order(config.bodies, base.bodies), base.bodies),
            obstacles=shared(in_order(config.obstacles, base.obstacles), base.obstacles),
        )
        known = {structure_of(item): item for item in base.items}
        changed = [item for item in config.items if known.get(structure_of(item)) is not item]
        nbytes = BYTES * (1 + len(changed)) + sum(map(list_bytes, changed))
        shapes: dict[str, BodyShape] = {}
        for body in config.bodies:
            if known.get(structure_of(body)) is body:
                continue
            is_new = structure_of(body) not in known
            shape = None if is_new else self._present_shape(body)
            shape = shape or self._known_shapes.get(body)
            if shape is None and is_new:
                shape = self._loaded_shape(body)
                nbytes += bytes_of(shape)
            if shape is not None:
                require_possible(body, shape.rest)
                if is_new:
                    shapes[body.name] = shape
        made = {
            item.name: obstacles.made(item)
            for item in config.obstacles
            if structure_of(item) not in known
        }
        prepared = PreparedConfig(config, shapes, made, nbytes)
        if not lenient:
            self._check_attachments(prepared)
        return prepared

    def _check_attachments(self, prepared: PreparedConfig) -> None:
        """Raise ConfigError if a body could not be attached to what a config says."""
        here = {obstacle.config.name: obstacle for obstacle in self._obstacles}
        names = [item.name for item in prepared.config.obstacles]
        standing = here | dict(prepared.obstacles)
        names = [name for name in names if name in standing]
        present = [*(standing[name] for name in names), *self._inputs.obstacles]
        keys: list[ObstacleKey] = [*names, *self._inputs.dynamic_obstacles]
        for config in prepared.config.bodies:
            index = self._index.get(config.name)
            if not config.attach_to:
                continue
            if config.name in prepared.shapes or index is None:
                shape = prepared.shapes.get(config.name) or self._body_shape(config)
                x, rest = start_surface(config, shape.rest), shape.rest
            elif config.attachment != self._bodies[index].config.attachment:
                x, rest = self._state.surface_positions(index).T, self._bodies[index].rest
            else:
                continue
            attach(config, rest, x, present, keys)

    def adopt(self, prepared: PreparedConfig) -> None:
        """
        Use a config from the next tick on: add and remove bodies and obstacles, then `configure`.

        New bodies begin at their start poses. Those that stay keep their order and their state.
        """
        wanted = {structure_of(item): item for item in prepared.config.items}
        present = {structure_of(item) for item in self.config.items}
        if wanted.keys() != present:
            self._replace_structure(prepared, wanted, present)
        self.configure(
            dataclasses.replace(
                prepared.config,
                bodies=in_order(prepared.config.bodies, self.config.bodies),
                obstacles=in_order(prepared.config.obstacles, self.config.obstacles),
            ),
            lenient=True,
        )

    def _replace_structure(
        self, prepared: PreparedConfig, wanted: Mapping[tuple, Any], present: set[tuple]
    ) -> None:
        """Remove bodies and obstacles that are not wanted, and add those that are not present."""
        bodies = [body for body in self._bodies if structure_of(body.config) in wanted]
        standing = [item for item in self._obstacles if structure_of(item.config) in wanted]
        new_bodies = []
        for config in prepared.config.bodies:
            if structure_of(config) not in present:
                shape = prepared.shapes.get(config.name) or self._body_shape(config)
                new_bodies.append(body_of(config, shape))
        new_obstacles = [
            prepared.obstacles.get(config.name) or obstacles.made(config)
            for config in prepared.config.obstacles
            if structure_of(config) not in present
        ]
        gone = [
            index
            for index, body in enumerate(self._bodies)
            if structure_of(body.config) not in wanted
        ]
        removed = [
            row
            for row, item in enumerate(self._obstacles)
            if structure_of(item.config) not in wanted
        ]
        self._let_go_of(gone, removed)
        bodies, standing = bodies + new_bodies, standing + new_obstacles
        self.config = dataclasses.replace(
            self.config,
            bodies=tuple(body.config for body in bodies),
            obstacles=tuple(item.config for item in standing),
        )
        self._set_obstacles(tuple(standing))
        if gone or new_bodies:
            self._replace_bodies(bodies)
        added = range(len(bodies) - len(new_bodies), len(bodies))
        for index in added:
            self._reset_body(index)
        self._attach(added)
        self._wake_near(new_obstacles)

    def _make_body(self, config: BodyConfig) -> Body:
        """Return a body, which shares its rest shape with others of the same mesh."""
        shape = self._body_shape(config)
        require_possible(config, shape.rest)
        return body_of(config, shape)

    def _body_shape(self, config: BodyConfig) -> BodyShape:
        key = shape_key(config)
        if key not in self._shapes:
            self._shapes[key] = self._loaded_shape(config)
        return self._shapes[key]

    def _present_shape(self, config: BodyConfig) -> BodyShape | None:
        """Return the shape of a body of this structure, if it is there."""
        index = self._index.get(config.name)
        if index is None or structure_of(self._bodies[index].config) != structure_of(config):
            return None
        return shape_of(self._bodies[index])

    def _loaded_shape(self, config: BodyConfig) -> BodyShape:
        shape = make_body_shape(config)
        self._known_shapes.put(config, shape)
        return shape

    def _build(self) -> None:
        """Build the arrays for the present bodies."""
        self.rebuilds += 1
        self._index = {body.config.name: index for index, body in enumerate(self._bodies)}
        self._shapes = {shape_key(body.config): shape_of(body) for body in self._bodies}
        self._state = State(self._bodies)
        self._state.use_obstacles(self.obstacle_keys, self.tick)
        self._body_boxes = sleeping.BodyBoxes(self._state)
        self._awake = None
        self._any_wrench = False
        for record, body in zip(self._state.bodies, self._bodies, strict=True):
            self._put_gains(record, body)
        self._integrator = Integrator(self._state, self._bodies)
        self._apply_config()
        self._watch_holders()
        self._set_obstacles(self._obstacles)

    def _put_gains(self, record: np.void, body: Body) -> None:
        step = self.config.reference_step
        has_goals = body.pins is not None or body.regions is not None
        body.material = make_material(body.config, body.rest, step, has_goals, body.regions)
        put_gains(record, body.config, body.material, self.config.time_step, step)

    def _apply_config(self) -> None:
        """Update what depends on the config and on the rest shapes."""
        self._config_gravity = self.config.gravity
        self._sleep_interval = max(round(sleeping.SAMPLE_INTERVAL / self.config.time_step), 1)
        # only surfaces in use are kept; their keys are unique while the shapes exist
        table = zip(self._state.rests, self._state.regions_of, strict=True)
        before, self._surfaces = self._surfaces, {}
        for rest, regions in table:
            key = id(rest), id(regions)
            self._surfaces[key] = before.get(key) or self._make_surface(rest, regions)
        surfaces = CollisionSurfaces(list(self._surfaces.values()))
        self._environment = self._make_environment(
            self.gravity, self.obstacles, self._inputs.points, surfaces
        )

    def _make_surface(self, rest: RestShape, regions: Regions | None) -> CollisionSurface:
        has_body = any(body.rest is rest for body in self._bodies)
        return CollisionSurface(rest, regions, collidable=has_body)

    def _replace_bodies(self, bodies: Sequence[Body]) -> None:
        """Replace the set of bodies; those that stay keep their state."""
        saved = {id(body): self._state.save(index) for index, body in enumerate(self._bodies)}
        memory, totals = self._state.contact_memory, self._state.save_obstacles()
        self._bodies = list(bodies)
        self._build()
        self._state.contact_memory = memory
        self._state.restore_obstacles(totals)
        for index, body in enumerate(self._bodies):
            if id(body) in saved:
                self._state.restore(index, saved[id(body)])

    def _restore_structure(self, snapshot: Snapshot) -> None:
        """Restore the bodies and obstacles of a snapshot; present ones keep their config."""
        now = {structure_of(body.config): body for body in self._bodies}
        configs = {structure_of(config): config for config in self.config.obstacles}
        bodies = {structure_of(body.config): body for body in snapshot.bodies}
        present = {structure_of(saved.config): saved.config for saved in snapshot.obstacles}
        chosen = []
        for key, body in bodies.items():
            same = now.get(key)
            if same is None:
                same = dataclasses.replace(body)
            elif any(map(is_not, shape_of(same), shape_of(body))):
                # it has been removed and added again since, perhaps with another mesh file
                same = dataclasses.replace(body, config=same.config)
            chosen.append(same)
        others = [id(body) for body in chosen] != [id(body) for body in self._bodies]
        if not others and list(present) == list(configs):
            return
        self.config = dataclasses.replace(
            self.config,
            bodies=tuple(body.config for body in chosen),
            obstacles=tuple(configs.get(key, config) for key, config in present.items()),
        )
        if others:
            self._replace_bodies(chosen)

    def _put_obstacles(self, present: tuple[Obstacle, ...]) -> None:
        self._obstacles = present
        self._obstacles_move = not all(obstacle.is_still for obstacle in present)

    def _replace_obstacle(self, index: int, new: Obstacle) -> None:
        """Put an obstacle of the same name in the place of another one."""
        before = self._obstacles[index]
        self._put_obstacles((*self._obstacles[:index], new, *self._obstacles[index + 1 :]))
        self._follow_holders(placed=True)
        self._wake_near([before, new])

    def _set_obstacles(self, present: tuple[Obstacle, ...]) -> None:
        before = self._obstacles
        self._put_obstacles(present)
        self._sum_up(before, self._inputs.dynamic_obstacles)
        self._follow_holders(placed=True)

    def _sum_up(
        self, standing: Iterable[Obstacle], received: Mapping[Key, DynamicObstacle]
    ) -> None:
        """Sum up what the present obstacles feel; note it of those before that have gone."""
        keys = self.obstacle_keys
        if keys == self._state.obstacle_keys:
            return
        before: dict[ObstacleKey, Obstacle] = {each.config.name: each for each in standing}
        before |= {key: item.obstacle for key, item in received.items()}
        gone = before.keys() - set(keys)
        for key in (each for each in self._state.obstacle_keys if each in gone):
            felt = self.obstacle_impulse(key)
            if felt.impulse.any() or felt.angular_impulse.any():
                self._last_departures.append(Departure(key, before[key], felt))
                self.departures += 1
        self._state.use_obstacles(keys, self.tick)

    # ------------------------------------------------------------------------------ attachments
    def _check_attachment(self, index: int, config: BodyConfig) -> None:
        """Raise ConfigError if a body cannot be attached to what a config says."""
        if config.attach_to:
            self._attached(index, config)

    def _attached(self, index: int, config: BodyConfig) -> Pins:
        x = self._state.surface_positions(index).T
        return attach(config, self._bodies[index].rest, x, self.obstacles, self.obstacle_keys)

    def _pins_by(self, index: int, config: BodyConfig) -> Pins | None:
        """Return the pins of a body for a config; none if nothing is in reach of its obstacle."""
        if not config.attach_to:
            return make_pins(config, self._bodies[index].rest, self._bodies[index].pins)
        with suppress(ConfigError):
            return self._attached(index, config)
        return None

    def _attach(self, indices: Iterable[int]) -> None:
        """Let obstacles take hold of bodies where they are now."""
        changed = False
        for index in indices:
            body = self._bodies[index]
            if body.config.attach_to:
                body.pins, changed = self._pins_by(index, body.config), True
        if changed:
            self._use_pins()

    def _restore_attachments(self, snapshot: Snapshot) -> None:
        """Let obstacles hold what they held, of bodies that are attached as they were then."""
        changed = False
        for index, (body, saved) in enumerate(zip(self._bodies, snapshot.bodies, strict=True)):
            before, pins = body.pins, body.pins
            if body.config.attachment != saved.config.attachment:
                pins = self._pins_by(index, body.config)
            elif body.config.attach_to:
                pins = saved.pins
            body.pins = pins
            changed |= pins is not before
        if changed:
            self._use_pins()
        else:
            self._watch_holders()

    def _use_pins(self) -> None:
        """Update what depends on the pins of bodies."""
        for record, body in zip(self._state.bodies, self._bodies, strict=True):
            self._put_gains(record, body)
        self._state.use_shapes(self._bodies)
        self._apply_config()
        self._integrator.update()
        self._watch_holders()

    def _watch_holders(self) -> None:
        """Look anew for the obstacles that hold bodies."""
        self._holders = Holders(self._bodies, self._state)
        self._follow_holders(placed=False)

    def _follow_holders(self, placed: bool) -> None:
        """Let bodies follow obstacles that hold them, see `Holders.follow`."""
        if not self._holders:
            return
        # before they are placed elsewhere with their obstacle, if anybody may sleep
        boxes = self._boxes() if placed and self._state.still_samples.any() else None
        moved, lost = self._holders.follow(self.obstacles, self.obstacle_keys, placed)
        for index in moved + lost:
            self._wake(index if boxes is None else sleeping.touching(boxes, index))
        if lost:
            self._use_pins()

    # -------------------------------------------------------------------------- external inputs
    def change_obstacles(
        self, changes: Iterable[ObstacleChange], longest_gap: float = 0.5
    ) -> None:
        """
        Add, move or remove obstacles at run time, in addition to those of the config.

        An obstacle moves on with the velocity between successive poses; see
        `ExternalInputs.changed`.

        Parameters
        ----------
        changes : iterable of ObstacleUpdate, ObstaclePlacement and ObstacleRemoval
        longest_gap : float
            largest time between two poses for a velocity, and duration of that motion, s

        """
        h = self.config.time_step
        self._set_inputs(self._inputs.changed(changes, self.tick, longest_gap, h))

    def set_points(
        self, points: PointObstacles, self_filter: float = 0.0, noise: float = 0.0
    ) -> None:
        """
        Replace the point obstacles; wake bodies near points that have changed.

        Parameters
        ----------
        points : PointObstacles
        self_filter : float
            points up to this distance from the present surface of a body are left out, m: a camera
            sees the bodies, too
        noise : float
            standard deviation of the points along each axis, m: what merely trembles stays where
            it is, see `point_filter`; 0 takes them as they are

        """
        boxes = self._boxes()
        if self_filter > 0.0:
            own = self._near_surfaces(points.points, self_filter, boxes)
            points = PointObstacles(points.points[~own], points.radius, int(own.sum()))
        before = self._inputs.points
        if noise > 0.0:
            reach = FILTERED * points.radius
            points = steadied(points, before, noise, boxes[0] - reach, boxes[1] + reach)
        self._inputs = self._inputs.with_points(points)
        for index, (low, high) in enumerate(zip(*boxes, strict=True)):
            if not np.array_equal(points.within(low, high), before.within(low, high)):
                self._wake(index)

    def _near_surfaces(
        self, points: np.ndarray, reach: float, boxes: sleeping.Boxes
    ) -> np.ndarray:
        """Return which points (k, 3) are within a distance, m, of the surface of a body."""
        result = np.zeros(len(points), dtype=bool)
        for name, low, high in zip(self.names, *boxes, strict=True):
            near = ((points >= low - reach) & (points <= high + reach)).all(axis=1)
            faces = self.rest_shape(name).surface.faces
            if near.any() and len(faces):
                tree = make_tree(Surface(self.positions(name), faces))
                result[near] |= np.abs(tree.distance(points[near])[0]) <= reach
        return result

    def apply_wrench(
        self,
        name: str | None,
        force: ArrayLike,
        torque: ArrayLike,
        seconds: float,
        in_body_axes: bool = False,
    ) -> None:
        """
        Apply a wrench to a body at its centre of mass for some time, replacing the previous one.

        It accelerates all particles by a rigid field, like gravity: it moves and rotates the body
        without deforming it. Changes of momentum and angular momentum are exact. A zero wrench
        ends it at once.

        Parameters
        ----------
        name : str or None
            of the body; None: on every body, in addition to its own wrench
        force, torque : (3,) float
            N, N m
        seconds : float
        in_body_axes : bool
            whether both rotate with the body, or are in world axes

        Raises
        ------
        ConfigError
            if there is no such body, or a number is not finite; nothing has changed then.

        """
        if name is not None:
            self._index_of(name)
        force, torque = finite_vector(force, 'force'), finite_vector(torque, 'torque')
        ends_at = self._after(seconds)
        wrench = Wrench(force, torque, in_body_axes, ends_at)
        self._set_inputs(self._inputs.with_wrench(EVERY_BODY if name is None else name, wrench))

    def override_gravity(self, gravity: ArrayLike, seconds: float) -> None:
        """
        Override the config's gravity, m/s², for some seconds.

        Raises
        ------
        ConfigError
            if a number is not finite; nothing has changed then.

        """
        gravity = finite_vector(gravity, 'gravity')
        self._set_inputs(self._inputs.with_gravity(gravity, self._after(seconds)))

    def _after(self, seconds: float) -> int:
        """Return the first tick after some time."""
        return self.tick + ticks_of(finite_number(seconds, 'seconds'), self.config.time_step)

    def poke(self, point: ArrayLike, impulse: float, radius: float) -> str:
        """
        Apply an inward impulse to the surface nearest to a point; see `poke.velocity_change`.

        Parameters
        ----------
        point : (3,) float
            m
        impulse : float
            N s
        radius : float
            of the area, m

        Returns
        -------
        str
            the name of the body, '' if none is within the radius

        Raises
        ------
        ConfigError
            if a number is not finite; nothing has changed then.

        """
        point = finite_vector(point, 'point')
        impulse, radius = finite_number(impulse, 'impulse'), finite_number(radius, 'radius')
        name, distance = self.nearest(point)
        if distance >= radius or radius * radius == 0.0:
            return ''
        index = self._index_of(name)
        body = self._bodies[index]
        frequency = 0.0
        if body.config.mode != 'rigid':
            frequency = body.material.frequency
            if not body.material.has_goals:
                # particles by themselves are stiffer than the body
                frequency *= KAPPA
        self._state.velocities(index)[:] += poke.velocity_change(
            self._state.positions(index),
            body.rest,
            point,
            radius,
            impulse / self._state.bodies['mass'][index],
            frequency,
        )
        self._wake(index)
        return name

    def nearest(self, point: ArrayLike) -> tuple[str, float]:
        """
        Return the body that has a particle nearest to a point, and its distance, m.

        Without bodies: '' and infinity.
        """
        place = np.array(point, dtype=float)[:, None]
        distances = {
            name: float(np.linalg.norm(self._state.surface_positions(index) - place, axis=0).min())
            for name, index in self._index.items()
        }
        name = min(distances, key=lambda name: distances[name], default='')
        return name, distances.get(name, math.inf)

    def _set_inputs(self, inputs: ExternalInputs) -> None:
        """Replace the external inputs; wake the bodies that they affect."""
        before, gravity, self._inputs = self._inputs, self.gravity, inputs
        if (gravity != self.gravity).any():
            self._wake(slice(None))
        self._wake_near(inputs.obstacles_changed_since(before))
        self._sum_up(self._obstacles, before.dynamic_obstacles)
        self._follow_holders(placed=True)

    # ----------------------------------------------------------------------------------- config
    def configure(self, config: WorldConfig, lenient: bool = False) -> None:
        """
        Use other parameters from the next tick on; positions and velocities stay.

        An obstacle is moved if its pose in the config changes; start poses and initial velocities
        of bodies take effect on `reset` and `apply_initial_velocity`.

        Parameters
        ----------
        config : WorldConfig
        lenient : bool
            whether an attachment that finds nothing in its reach is left out, as at `reset`, and
            not refused

        Raises
        ------
        ConfigError
            if a read-only setting differs, a pinned vertex does not exist, or a body cannot be
            attached; nothing has changed then.

        """
        self.check(config, lenient)
        gravity, old, self.config = self.gravity, self.config, config
        self._config_gravity = config.gravity
        if (gravity != self.gravity).any():
            self._wake(slice(None))
        for index, (before, after) in enumerate(zip(old.obstacles, config.obstacles, strict=True)):
            if before != after:
                self._replace_obstacle(index, _reconfigured(self._obstacles[index], after))
        repinned = False
        for index, body in enumerate(self._bodies):
            if body.config != config.bodies[index]:
                repinned |= self._reconfigure_body(index, config.bodies[index])
        if repinned:
            self._use_pins()
        self._integrator.update()

    def _reconfigure_body(self, index: int, config: BodyConfig) -> bool:
        """Use another config for a body; return whether its pins have changed."""
        body, old = self._bodies[index], self._bodies[index].config
        before = body.pins
        if not (config.attach_to and config.attachment == old.attachment):
            body.pins = self._pins_by(index, config)
        body.config = config
        self._put_gains(self._state.bodies[index], body)
        if not moves_alike(old, config):
            self._wake(index)
        same = before is body.pins or (
            before is not None and body.pins is not None and before.rest is body.pins.rest
        )
        return not same or (old.mode == 'rigid') != (config.mode == 'rigid')

    def move_obstacle(
        self,
        name: str,
        position: ArrayLike,
        orientation: ArrayLike | None = None,
        linear: ArrayLike = (0.0, 0.0, 0.0),
        angular: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        """
        Set the pose of an obstacle of the config, and its velocity from then on.

        Parameters
        ----------
        name : str
        position : (3,) float
            m
        orientation : (4,) float, optional
            quaternion x y z w; by default that of its config
        linear, angular : (3,) float
            velocity of its origin, m/s, and angular velocity, rad/s, world axes

        Raises
        ------
        ConfigError
            if there is no such obstacle, or a value is invalid; nothing has changed then.

        """
        names = [obstacle.config.name for obstacle in self._obstacles]
        if name not in names:
            raise ConfigError(f'there is no obstacle {shown(name)}: {unknown_name(name, names)}')
        index = names.index(name)
        current = self._obstacles[index]
        values: dict[str, Any] = {
            'position': position, 'velocity_linear': linear, 'velocity_angular': angular,
        }  # fmt: skip
        if orientation is not None:
            values['orientation'] = orientation
        config = current.config.moved(**values)
        if config is current.config and obstacles.is_as_configured(current):
            return  # said again, as for each tick: much faster than what follows
        new = obstacles.placed_shape(config, current.shape)
        if obstacles.is_same(current, new):
            return
        self.config = self.config.with_obstacle(index, config)
        self._replace_obstacle(index, obstacles.continued(new, current))

    def move_pins(
        self, name: str, linear: ArrayLike, angular: ArrayLike = (0.0, 0.0, 0.0)
    ) -> None:
        """Set the velocity of pinned vertices, m/s, and rad/s about their centre."""
        index, bodies = self._index_of(name), list(self.config.bodies)
        values: dict[str, Any] = {
            'pins_velocity_linear': linear,
            'pins_velocity_angular': angular,
        }
        bodies[index] = dataclasses.replace(bodies[index], **values)
        self.configure(dataclasses.replace(self.config, bodies=tuple(bodies)))

    def check(self, config: WorldConfig, lenient: bool = False) -> None:
        """Raise ConfigError if `configure` cannot use a config."""
        require_same_structure(self.config, config)
        for index, (body, new) in enumerate(zip(self._bodies, config.bodies, strict=True)):
            if new is not body.config:
                require_possible(new, body.rest)
                if new.attachment != body.config.attachment and not lenient:
                    self._check_attachment(index, new)

    def adapted(self, config: WorldConfig) -> WorldConfig:
        """
        Return a config for `configure` with the present bodies and obstacles.

        Those that the given config, of another time, contains as well get its parameters.
        """
        return with_structure(config, self.config)

    def material(self, name: str) -> Material:
        """Return mass and stiffness of a body, from whichever settings say them."""
        return self._bodies[self._index_of(name)].material

    def body_config(self, name: str) -> BodyConfig:
        """Return the config of a body."""
        return self.config.bodies[self._index_of(name)]

    # ---------------------------------------------------------------------------------- queries
    def contact_wrench(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """
        Return the total force (3,), N, and torque (3,), N m, of all contacts of a body.

        Of the last tick, in world axes, about the centre of mass; zero without contacts. See
        `MeanWrenches` for means over several ticks.
        """
        index = self._index_of(name)
        force, torque = self._state.bodies['mass'][index] * self._state.reaction[index]
        return force, torque

    def obstacle_wrench(self, name: ObstacleKey) -> tuple[np.ndarray, np.ndarray]:
        """
        Return the total force (3,), N, and torque (3,), N m, of bodies on an obstacle.

        Of the last tick, in world axes, about the origin of the obstacle at the end of the tick;
        about that of the world for points.

        Parameters
        ----------
        name : str, (str, int) or None
            see `obstacle_key`

        """
        row = self._obstacle_row(name)
        total = np.zeros((2, 3))
        for index in range(len(self._bodies)):
            total += self._state.obstacle_impulses(index)[row]
            if self._state.bodies['holder'][index] == row:
                total += self._state.holder_impulse[index]
        force, torque = total / self.config.time_step
        return force, torque

    def contact_impulse(self, name: str) -> ContactImpulse:
        """Return the integral over time of `contact_wrench`, see `contact_forces`."""
        index = self._index_of(name)
        return self._impulse(self._state.bodies['total'][index], self._state.since[index])

    def obstacle_impulse(self, name: ObstacleKey) -> ContactImpulse:
        """Return the integral over time of `obstacle_wrench`, see `contact_forces`."""
        row = self._obstacle_row(name)
        return self._impulse(self._state.obstacle_total[row], self._state.obstacle_since[row])

    def departed_since(self, departures: int) -> tuple[Departure, ...]:
        """
        Return what obstacles felt that have gone, after there were that many `departures`.

        Of more than `MOST_DYNAMIC_OBSTACLES` the last ones. It is no part of the state: after a
        reset or a return to a snapshot it means nothing.
        """
        last = min(self.departures - departures, len(self._last_departures))
        return tuple(self._last_departures)[len(self._last_departures) - last :]

    def pin_wrench(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """
        Return the total force (3,), N, and torque (3,), N m, by which pins hold a body.

        Pins, or the obstacle that it is attached to. It is given like `contact_wrench`, of which
        it is no part: the change of the body's momentum in the last tick less all else that has
        acted on it.
        """
        index = self._index_of(name)
        force, torque = self._state.bodies['mass'][index] * self._state.holding[index]
        return force, torque

    def pin_impulse(self, name: str) -> ContactImpulse:
        """Return the integral over time of `pin_wrench`."""
        index = self._index_of(name)
        total = self._state.bodies['holding_total'][index]
        return self._impulse(total, self._state.since[index])

    def _impulse(self, total: np.ndarray, since: int) -> ContactImpulse:
        impulse, angular_impulse = total.copy()
        start = int(since) * self.config.time_step
        return ContactImpulse(impulse, angular_impulse, start, self.time)

    def normal_forces(self, name: str) -> np.ndarray:
        """
        Return (n,) float: the normal force at each particle of the surface in the last tick, N.

        The sum over its contacts with obstacles, points and faces of bodies, and over contacts of
        faces that it is a corner of, by its share. Of a body asleep, that before it fell asleep.
        """
        impulses = self._state.normal_impulses(self._index_of(name))
        impulses = impulses[: self.rest_shape(name).surface_count]
        return np.asarray(impulses / self.config.time_step)

    def pressure(self, name: str) -> np.ndarray:
        """
        Return (n,) float: the pressure at each particle in the last tick, Pa.

        That is `normal_forces` by the area at rest that belongs to the particle, a third of its
        triangles; 0 without area.
        """
        forces, areas = self.normal_forces(name), self.rest_shape(name).areas
        return np.divide(forces, areas, out=np.zeros(len(forces)), where=areas > 0.0)

    @property
    def obstacle_keys(self) -> tuple[ObstacleKey, ...]:
        """Keys of the `obstacles`, and None for all point obstacles together."""
        names = (obstacle.config.name for obstacle in self._obstacles)
        return (*names, *self._inputs.dynamic_obstacles, None)

    def obstacle_key(self, name: ObstacleKey) -> ObstacleKey:
        """
        Return the key of an obstacle: of the config its name, else that of its `ObstacleUpdate`.

        Parameters
        ----------
        name : str, (str, int) or None
            the key, or a name: the first one in `obstacles` that has it; None for all point
            obstacles together

        Raises
        ------
        ConfigError
            if there is none.

        """
        return self.obstacle_keys[self._obstacle_row(name)]

    def _obstacle_row(self, name: ObstacleKey) -> int:
        keys = self._state.obstacle_keys
        if name in keys:
            return keys.index(name)
        names = [obstacle.config.name for obstacle in self.obstacles]
        if name not in names:
            raise ConfigError(
                f'there is no obstacle {shown(name)}: {unknown_name(str(name), names)}'
            )
        return names.index(name)

    @property
    def notes(self) -> tuple[str, ...]:
        """A sentence for each thing to be known about the meshes of bodies and obstacles."""
        result: list[str] = []
        for body in self._bodies:
            surface, prefix = body.rest.surface, body.config.prefix
            result += [prefix + note for note in surface.notes]
            visual = self.visual_surface(body.config.name)
            if visual.source != surface.source:
                result += [f'{prefix}visual_{note}' for note in visual.notes]
            if len(surface.faces) and not surface.closed:
                defects, remedy = surface.openness
                name = f'mesh {surface.source}'.rstrip()
                result.append(
                    f'{prefix}{name} is not closed ({defects}): it has no inside, so that bodies '
                    'and points pass through its surface, only its own vertices touch others, and '
                    f'volume_conservation acts on its overall stretch alone; {remedy}'
                )
        for obstacle in self._obstacles:
            if obstacle.tree is not None:
                prefix = obstacle.config.prefix
                result += [prefix + note for note in obstacle.tree.surface.notes]
        return tuple(result)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the bodies, in the order of the config."""
        return tuple(self._index)

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """The obstacles at their present poses: those of the config, then those received."""
        return self._joined(self._obstacles, self._inputs.obstacles)

    @property
    def gravity(self) -> np.ndarray:
        """(3,) float: the present gravity, m/s²."""
        override = self._inputs.gravity
        return self._config_gravity if override is None else override

    @property
    def point_obstacles(self) -> PointObstacles:
        """The point obstacles."""
        return self._inputs.points

    @property
    def external_inputs(self) -> ExternalInputs:
        """The external inputs in force."""
        return self._inputs

    def rest_shape(self, name: str) -> RestShape:
        """Return the rest shape of a body."""
        return self._bodies[self._index_of(name)].rest

    def start_positions(self, name: str) -> np.ndarray:
        """Return (n, 3) float: the positions to which `reset` takes a body, m."""
        body = self._bodies[self._index_of(name)]
        return start_surface(body.config, body.rest)

    def positions(self, name: str) -> np.ndarray:
        """Return (n, 3) float: a copy of the positions of the surface, m."""
        return self._state.surface_positions(self._index_of(name)).T.copy()

    def velocities(self, name: str) -> np.ndarray:
        """Return (n, 3) float: a copy of the velocities of the surface, m/s."""
        count = self.rest_shape(name).surface_count
        return self._state.velocities(self._index_of(name))[:, :count].T.copy()

    def visual_surface(self, name: str) -> Surface:
        """
        Return the surface that a body is shown by, at rest.

        That of `visual_mesh`, of a mesh that is simplified the mesh itself, else the simulated
        one.
        """
        body = self._bodies[self._index_of(name)]
        return body.rest.surface if body.embedding is None else body.embedding.visual

    def visual_positions(self, name: str, positions: np.ndarray | None = None) -> np.ndarray:
        """
        Return (k, 3) float: the positions of the vertices of `visual_surface`, m.

        Parameters
        ----------
        name : str
        positions : (n, 3) float, optional
            of the simulated surface, for whoever has them, or others than the present ones, m;
            returned as they are where that is the one shown

        """
        embedding = self._bodies[self._index_of(name)].embedding
        x = self.positions(name) if positions is None else positions
        return x if embedding is None else embedding.positions(x)

    def visual_start_positions(self, name: str) -> np.ndarray:
        """Return (k, 3) float: `visual_positions` at the start, to which `reset` returns, m."""
        config = self.body_config(name)
        return placed_at_start(config, self.visual_surface(name).vertices).T

    def embedding(self, name: str) -> Embedding | None:
        """Return how the surface that a body is shown by is carried; None if it is simulated."""
        return self._bodies[self._index_of(name)].embedding

    @property
    def solver_work(self) -> SolverWork:
        """What the solution of contacts has taken since bodies were last added or removed."""
        return SolverWork(*self._integrator.work.tolist())

    def is_asleep(self, name: str) -> bool:
        """Return whether a body is asleep: at rest, and not simulated until it is woken."""
        return not sleeping.is_awake(self._state)[self._index_of(name)]

    def permanent_strain(self, name: str) -> float:
        """Return the largest permanent strain of a body and its regions."""
        stretch = self._state.plastic_state(self._index_of(name))
        return 0.0 if stretch is None else largest_permanent_strain(stretch)

    def permanent_strains(self, name: str) -> np.ndarray:
        """
        Return (n,) float: the permanent strain at each vertex of the surface; read-only.

        With regions it is the mean of that of the whole body and those of the regions that the
        vertex belongs to, with the weights of their goals.
        """
        index = self._index_of(name)
        body, stretch = self._bodies[index], self._state.plastic_state(index)
        if stretch is None:
            return np.broadcast_to(0.0, body.rest.surface_count)
        whole, *local = permanent_strains(stretch)
        if body.regions is None:
            return np.broadcast_to(whole, body.rest.surface_count)
        weight = body.config.regions_whole_body_weight
        mean = body.regions.mean_at_particles(np.array(local))[: body.rest.surface_count]
        return weight * whole + (1.0 - weight) * mean

    def centre_of_mass(self, name: str) -> np.ndarray:
        """Return (3,) float: the centre of mass of a body, m, with what is inside."""
        index = self._index_of(name)
        return weighted_mean(self._state.positions(index).T, self._bodies[index].rest.weights)

    def rigid_fit(self, name: str) -> RigidFit:
        """Return the best rigid fit to a body, and the distance of each vertex from it."""
        index = self._index_of(name)
        x, v = self._state.positions(index), self._state.velocities(index)
        return fit_rigid_motion(x, v, self._bodies[index].rest)

    def _index_of(self, name: str) -> int:
        if name not in self._index:
            raise ConfigError(f'there is no body {shown(name)}: {unknown_name(name, self.names)}')
        return self._index[name]


def _reconfigured(current: Obstacle, config: ObstacleConfig) -> Obstacle:
    target = obstacles.placed(config, current.tree)
    same_pose = (
        current.config.position == target.config.position
        and current.config.orientation == target.config.orientation
    )
    if same_pose:
        return _with_config(current, config)
    return target


def _with_config(obstacle: Obstacle, config: ObstacleConfig) -> Obstacle:
    """Return an obstacle at its present pose, with another size or velocity."""
    if config == obstacle.config:
        return obstacle
    shape = obstacles.placed(config, obstacle.tree).shape
    return dataclasses.replace(obstacle, config=config, shape=shape)
