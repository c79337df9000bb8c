# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Obstacles: poses, and records for kernels."""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from dataclasses import dataclass
from functools import cached_property, lru_cache
import math
import operator
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from softbody_ros.core.body import identities
from softbody_ros.core.collision.shapes import (
    BOX,
    CAPSULE,
    CYLINDER,
    MESH,
    PLANE,
    SPHERE,
    Shape,
    box_distance,
    capsule_distance,
    cylinder_distance,
    make_shape,
    plane_distance,
    sphere_distance,
)
from softbody_ros.core.compiled import helper, kernel
from softbody_ros.core.config import ConfigError, ObstacleConfig
from softbody_ros.core.contact_forces import ObstacleKey, name_of_obstacle
from softbody_ros.core.geometry.bvh import (
    SurfaceTree,
    Trees,
    closed_tree,
    pack,
    signed_distance_from_mesh,
)
from softbody_ros.core.geometry.mesh import PRIMITIVES, make_surface
from softbody_ros.core.geometry.surface import MeshError, Surface
from softbody_ros.core.geometry.vectors import (
    Vector,
    along,
    applied,
    applied_transposed,
    cross,
    matrix_of,
    minus,
    plus,
    product,
    put_matrix,
    put_vector,
    scaled,
    vector_of,
)
from softbody_ros.core.kinematic_tree import MOTION
from softbody_ros.core.shape_matching.free_rotation import rotation_by

SAME = 1e-6
"""Distance, m, and difference of rotations, up to which an obstacle is where it was."""
SETTLED = 2
"""Ticks after it was put somewhere from which on that is no matter of the tick before."""
ROUNDING = 1e-9
"""Relative enlargement of the bounding box of an obstacle."""

OBSTACLE = np.dtype(
    [
        ('id', np.int64),  # see `body.identities`
        ('kind', np.int64),  # Shape.kind
        ('size', np.float64, (3,)),  # m
        ('tree', np.int64),  # index of the tree of a mesh
        ('half_extents', np.float64, (3,)),  # of its bounding box in its own frame, m
        ('bounding_radius', np.float64),  # of a ball about its origin, m
        ('ccd_threshold', np.float64),  # displacement in a tick above which CCD is needed, m
        ('position', np.float64, (3,)),  # m
        ('rotation', np.float64, (3, 3)),  # its axes in world coordinates, as columns
        ('half_box', np.float64, (3,)),  # half extents of its bounding box in the world, m
        ('moved', np.bool_),  # whether its pose has changed since the tick before
        ('position_before', np.float64, (3,)),  # at the tick before, m
        ('rotation_before', np.float64, (3, 3)),
        ('rotation_change', np.float64),  # norm of the difference of the rotations
        ('moves', np.bool_),  # whether it has a velocity
        ('is_placed', np.bool_),  # whether it was put elsewhere after the tick before
        ('linear', np.float64, (3,)),  # of its origin, m/s
        ('angular', np.float64, (3,)),  # rad/s
        ('surface_velocity', np.float64, (3,)),  # of its surface, in its own axes, m/s
        ('friction', np.float64),  # negative: that of the body
        ('elasticity', np.float64),
    ],
    align=True,
)
"""One obstacle, for kernels."""


@dataclass(frozen=True)
class Obstacle:
    """
    An obstacle at its present pose.

    Attributes
    ----------
    config : ObstacleConfig
    position : (3,) float
        m
    rotation : (3, 3) float
        its axes in world coordinates, as columns
    shape : Shape
    before : (position, rotation) or None
        at the tick before, if it has moved since
    age : int
        ticks since it was put where it is, or moves from, `SETTLED` at most

    """

    config: ObstacleConfig
    position: np.ndarray
    rotation: np.ndarray
    shape: Shape
    before: tuple[np.ndarray, np.ndarray] | None = None
    age: int = 0

    @property
    def tree(self) -> SurfaceTree | None:
        """Tree of a mesh, of half extent 1 unless the config has a `Surface`."""
        return self.shape.tree

    @property
    def half_extents(self) -> np.ndarray:
        """(3,) float: of a bounding box in its own frame, centred at its origin, m."""
        return np.array(self.shape.half_extents)

    @property
    def radius(self) -> float:
        """Radius of a bounding sphere about its origin, m; infinite for a plane."""
        return self.shape.bounding_radius

    @cached_property
    def moves(self) -> bool:
        """Whether it has a velocity."""
        return any(self.config.velocity_linear) or any(self.config.velocity_angular)

    @property
    def is_still(self) -> bool:
        """Whether a tick leaves it as it is."""
        return self.age == SETTLED and not self.moves and self.before is None

    @property
    def drives(self) -> bool:
        """Whether it moves, or its surface does: then what touches it does not fall asleep."""
        return self.moves or any(self.config.surface_velocity)

    def velocity_at(self, points: np.ndarray) -> np.ndarray:
        """Return its velocity (k, 3) at points (k, 3), m/s."""
        if not self.moves:
            return np.zeros((len(points), 3))
        turning = np.cross(self.config.velocity_angular, points - self.position)
        return turning + self.config.velocity_linear

    def closest(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return signed distances (k,), m, and outward normals (k, 3) of world points (k, 3)."""
        distance, normals = self.distance((points - self.position) @ self.rotation)
        return distance, normals @ self.rotation.T

    def distance(self, local: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return signed distances (k,) and outward normals (k, 3) of points in its frame."""
        records, trees = ObstacleTable().refresh((self,))
        points = np.ascontiguousarray(local, dtype=np.float64)
        distance, normal = np.empty(len(points)), np.empty((len(points), 3))
        _distances(records, trees, points, distance, normal)
        return distance, normal

    @property
    def triangles(self) -> np.ndarray:
        """(3 m, 3) float: corners of the triangles of its tessellation, in its own frame, m."""
        surface = self.shape.surface
        return surface.vertices[surface.faces.reshape(-1)]


def made(config: ObstacleConfig) -> Obstacle:
    """
    Return an obstacle at the pose of its config.

    Raises
    ------
    ConfigError, MeshError
        if its mesh is missing, unreadable or not closed.

    """
    if config.type != 'mesh':
        return placed(config)
    if config.mesh == '':
        raise ConfigError(
            f"{config.prefix}mesh is '': type mesh needs a primitive "
            f'({", ".join(PRIMITIVES)}) or a file'
        )
    try:
        surface = config.mesh
        if not isinstance(surface, Surface):
            surface = make_surface(surface, 1.0, config.subdivisions, config.mesh_frame)
        return placed(config, closed_tree(surface))
    except MeshError as error:
        raise MeshError(f'{config.prefix}{error}') from None


def placed(config: ObstacleConfig, tree: SurfaceTree | None = None) -> Obstacle:
    """Return an obstacle at the pose of its config, with the tree of its mesh."""
    return placed_shape(config, make_shape(config, tree))


def placed_shape(config: ObstacleConfig, shape: Shape) -> Obstacle:
    """Return an obstacle of a shape at the pose of its config."""
    rotation = np.array(_rotation_by(config.orientation))
    return Obstacle(config, np.array(config.position), rotation, shape)


def continued(obstacle: Obstacle, before: Obstacle) -> Obstacle:
    """Return an obstacle, not as one that was put anywhere if it is where it was before."""
    is_there = (
        obstacle.shape is before.shape
        and _are_near(obstacle.position, before.position)
        and _are_near(obstacle.rotation, before.rotation)
    )
    if obstacle.age == before.age or not is_there:
        return obstacle
    return Obstacle(
        obstacle.config, obstacle.position, obstacle.rotation, obstacle.shape, obstacle.before,
        before.age,
    )  # fmt: skip


def _are_near(one: np.ndarray, other: np.ndarray) -> bool:
    # lists are faster than small arrays; and most rotations are the same
    return one.tobytes() == other.tobytes() or (
        math.dist(one.ravel().tolist(), other.ravel().tolist()) <= SAME
    )


@lru_cache(maxsize=1024)
def _rotation_by(orientation: tuple[float, ...]) -> np.ndarray:
    return Rotation.from_quat(orientation).as_matrix()


def is_as_configured(obstacle: Obstacle) -> bool:
    """Return whether an obstacle is still where its config says."""
    config = obstacle.config
    return (
        obstacle.position.tolist() == [*config.position]
        and obstacle.rotation.tobytes() == _rotation_by(config.orientation).tobytes()
    )


def is_same(one: Obstacle, other: Obstacle) -> bool:
    """Return whether shape, pose and velocity of two obstacles are equal."""
    # bit by bit, as that is much faster; asked first is what mostly differs
    return (
        one.position.tobytes() == other.position.tobytes()
        and one.rotation.tobytes() == other.rotation.tobytes()
        and one.config == other.config
    )


def moved(obstacle: Obstacle, h: float) -> Obstacle:
    """Return an obstacle after h seconds at its own velocity."""
    config = obstacle.config
    position, rotation = obstacle.position, obstacle.rotation
    if not obstacle.moves:
        if obstacle.is_still:
            return obstacle
        return _after(obstacle, position, rotation)
    if any(config.velocity_angular):
        rotation_change = Rotation.from_rotvec(h * np.array(config.velocity_angular)).as_matrix()
        rotation = rotation_change @ rotation
    # component by component is faster than with arrays
    (x, y, z), (vx, vy, vz) = position.tolist(), config.velocity_linear
    position = np.array((x + h * vx, y + h * vy, z + h * vz))
    return _after(obstacle, position, rotation)


def _after(obstacle: Obstacle, position: np.ndarray, rotation: np.ndarray) -> Obstacle:
    """Return an obstacle after a tick, at its pose then."""
    before = (obstacle.position, obstacle.rotation) if obstacle.moves else None
    age = min(obstacle.age + 1, SETTLED)
    return Obstacle(obstacle.config, position, rotation, obstacle.shape, before, age)


def with_twist(
    obstacle: Obstacle, linear: tuple[float, ...], angular: tuple[float, ...], **pose: Any
) -> Obstacle:
    """
    Return an obstacle where it is with another velocity, m/s, and angular velocity, rad/s.

    Not checked. `pose` is what its config says to be its last received one.
    """
    config = obstacle.config.with_values(velocity_linear=linear, velocity_angular=angular, **pose)
    return dataclasses.replace(obstacle, config=config, before=None)


def moved_together(moving: Sequence[Obstacle], h: float) -> list[Obstacle]:
    """Return obstacles after h seconds at their own velocities, many at a time."""
    motions = np.zeros(len(moving), MOTION)
    motions['position'] = [each.position for each in moving]
    motions['rotation'] = [each.rotation for each in moving]
    motions['linear'] = [each.config.velocity_linear for each in moving]
    motions['angular'] = [each.config.velocity_angular for each in moving]
    _move(motions, h)
    return [
        _after(each, position, rotation)
        for each, position, rotation in zip(
            moving, motions['position'].copy(), motions['rotation'].copy(), strict=True
        )
    ]


@kernel
def _move(motions: np.ndarray, h: float) -> None:
    """Move poses (s,) MOTION by h seconds of their velocities."""
    for row in range(len(motions)):
        record = motions[row]
        place, turn = vector_of(record['position']), matrix_of(record['rotation'])
        put_vector(record['position'], along(place, h, vector_of(record['linear'])))
        turned = product(rotation_by(scaled(h, vector_of(record['angular']))), turn)
        put_matrix(record['rotation'], turned)


# ----------------------------------------------------------------------------------------- records
class ObstacleTable:
    """Records of the obstacles of a world, updated incrementally from tick to tick."""

    def __init__(self) -> None:
        self._obstacles: tuple[Obstacle, ...] = ()
        self._keys: tuple[ObstacleKey, ...] = ()
        self._trees: tuple[SurfaceTree, ...] = ()
        self._records = np.zeros(0, OBSTACLE)
        self._packed = pack(())

    def refresh(
        self, obstacles: Sequence[Obstacle], keys: Sequence[ObstacleKey] = ()
    ) -> tuple[np.ndarray, Trees]:
        """
        Return the records (o,) OBSTACLE, valid until the next call, and the trees.

        Parameters
        ----------
        obstacles : sequence of Obstacle
        keys : sequence
            of these, see `World.obstacle_keys`, by which contacts are known again

        """
        obstacles, keys = tuple(obstacles), tuple(keys)
        known: tuple[Obstacle | None, ...] = self._obstacles
        if len(known) != len(obstacles):
            self._records = np.zeros(len(obstacles), OBSTACLE)
            known, self._keys = (None,) * len(obstacles), ()
        elif keys == self._keys and all(map(operator.is_, obstacles, known)):
            return self._records, self._packed
        if keys != self._keys:
            self._keys = keys
            self._records['id'] = identities([name_of_obstacle(key) for key in keys])
        self._obstacles = obstacles
        trees = tuple(dict.fromkeys(each.tree for each in obstacles if each.tree))
        repacked = trees != self._trees
        if repacked:
            self._trees, self._packed = trees, pack(trees)
        for index, (obstacle, before) in enumerate(zip(obstacles, known, strict=True)):
            if obstacle is before and not repacked:
                continue
            record = self._records[index]
            record['tree'] = trees.index(obstacle.tree) if obstacle.tree else -1
            if before is None or before.shape is not obstacle.shape:
                _put_shape(record, obstacle.shape)
            if before is None or _surface_of(before) != _surface_of(obstacle):
                _put_surface(record, obstacle)
            record['moved'] = obstacle.before is not None
            record['is_placed'] = obstacle.age < SETTLED
            pose = (obstacle.position, obstacle.rotation)
            _put_pose(self._records, index, *pose, *(obstacle.before or pose))
        return self._records, self._packed


def _put_shape(record: np.void, shape: Shape) -> None:
    record['kind'] = shape.kind
    record['size'] = shape.size
    record['half_extents'] = shape.half_extents
    record['bounding_radius'] = shape.bounding_radius
    record['ccd_threshold'] = shape.ccd_threshold


def _surface_of(obstacle: Obstacle) -> tuple[object, ...]:
    """Return all that `_put_surface` depends on."""
    config = obstacle.config
    return (
        config.velocity_linear, config.velocity_angular, config.surface_velocity,
        config.friction, config.elasticity,
    )  # fmt: skip


def _put_surface(record: np.void, obstacle: Obstacle) -> None:
    config = obstacle.config
    record['moves'] = obstacle.moves
    record['linear'], record['angular'] = config.velocity_linear, config.velocity_angular
    record['surface_velocity'] = config.surface_velocity
    record['friction'], record['elasticity'] = config.friction, config.elasticity


@kernel
def _put_pose(
    records: np.ndarray,
    index: int,
    position: np.ndarray,
    rotation: np.ndarray,
    position_before: np.ndarray,
    rotation_before: np.ndarray,
) -> None:
    """Write present and previous pose, (3,) and (3, 3), and values that depend on them."""
    record = records[index]
    put_vector(record['position'], vector_of(position))
    put_matrix(record['rotation'], matrix_of(rotation))
    put_vector(record['position_before'], vector_of(position_before))
    put_matrix(record['rotation_before'], matrix_of(rotation_before))
    change = 0.0
    for row in range(3):
        extent = 0.0
        for axis in range(3):
            change += (rotation[row, axis] - rotation_before[row, axis]) ** 2
            if rotation[row, axis] != 0.0:  # planes are infinite
                extent += abs(rotation[row, axis]) * record['half_extents'][axis]
        record['half_box'][row] = (1.0 + ROUNDING) * extent
    record['rotation_change'] = math.sqrt(change)


# ----------------------------------------------------------------------------------------- kernels
@helper
def in_frame(obstacle: np.void, point: Vector) -> Vector:
    """Return a point in the frame of an OBSTACLE, m."""
    offset = minus(point, vector_of(obstacle['position']))
    return applied_transposed(matrix_of(obstacle['rotation']), offset)


@helper
def in_frame_before(obstacle: np.void, point: Vector) -> Vector:
    """Return a point in the frame of an OBSTACLE at the tick before, m."""
    offset = minus(point, vector_of(obstacle['position_before']))
    return applied_transposed(matrix_of(obstacle['rotation_before']), offset)


@helper
def to_world(obstacle: np.void, vector: Vector) -> Vector:
    """Return a vector in the frame of an OBSTACLE in world coordinates."""
    return applied(matrix_of(obstacle['rotation']), vector)


@helper
def distance_in_frame(obstacle: np.void, trees: Trees, local: Vector) -> tuple[float, Vector]:
    """
    Return the distance of a point from an OBSTACLE, m, negative inside, and the outward normal.

    NaN for an unknown shape.

    Parameters
    ----------
    obstacle : OBSTACLE
    trees : Trees
        of the meshes of obstacles
    local : Vector
        in the frame of the obstacle, m

    """
    kind, size = obstacle['kind'], vector_of(obstacle['size'])
    if kind == MESH:
        # the first `size` is the scale of the mesh
        scale = size[0]
        point = scaled(1.0 / scale, local)
        distance, normal = signed_distance_from_mesh(trees, obstacle['tree'], point)
        return scale * distance, normal
    if kind == BOX:
        return box_distance(size, local)
    if kind == CYLINDER:
        return cylinder_distance(size, local)
    if kind == CAPSULE:
        return capsule_distance(size, local)
    if kind == SPHERE:
        return sphere_distance(size, local)
    if kind == PLANE:
        return plane_distance(size, local)
    return np.nan, (np.nan, np.nan, np.nan)


@helper
def distance_from(obstacle: np.void, trees: Trees, point: Vector) -> tuple[float, Vector]:
    """Return the signed distance of a point in world coordinates, m, and the normal there."""
    distance, normal = distance_in_frame(obstacle, trees, in_frame(obstacle, point))
    return distance, to_world(obstacle, normal)


@helper
def velocity_at(obstacle: np.void, point: Vector) -> Vector:
    """Return the velocity of an OBSTACLE at a point, m/s."""
    if not obstacle['moves']:
        return (0.0, 0.0, 0.0)
    arm = minus(point, vector_of(obstacle['position']))
    return plus(vector_of(obstacle['linear']), cross(vector_of(obstacle['angular']), arm))


@kernel
def _distances(
    obstacles: np.ndarray,
    trees: Trees,
    points: np.ndarray,
    distance: np.ndarray,
    normal: np.ndarray,
) -> None:
    """Write what `distance_in_frame` returns for the first obstacle and points (k, 3)."""
    for i in range(len(points)):
        distance[i], direction = distance_in_frame(obstacles[0], trees, vector_of(points[i]))
        put_vector(normal[i], direction)
