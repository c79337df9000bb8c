# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The state of all bodies as arrays, which a tick reads and writes.

The particles of all bodies are columns of common arrays, body after body; so are the distinct rest
shapes. So one kernel call processes all bodies. Of each body, those at the surface come first;
inner ones (see shape_matching/solid.py) follow.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from softbody_ros.core.body import BODY, identities
from softbody_ros.core.config import BodyConfig
from softbody_ros.core.contact.exchange import rearranged
from softbody_ros.core.contact.rows import NO_MEMORY
from softbody_ros.core.contact_forces import ObstacleKey
from softbody_ros.core.embedding import Embedding
from softbody_ros.core.shape_matching.material import Material
from softbody_ros.core.shape_matching.pins import Pins
from softbody_ros.core.shape_matching.regions import REGION, Regions
from softbody_ros.core.shape_matching.rest_shape import SHAPE, RestShape

SAMPLES_TO_SLEEP = 5
"""Consecutive samples at rest after which a body falls asleep, see `sleeping`."""


@dataclass
class Body:
    """
    One body: its settings and all that is computed once; its particles are in `State`.

    The material is that of its settings, once they are in use.
    """

    config: BodyConfig
    rest: RestShape
    regions: Regions | None = None
    pins: Pins | None = None
    embedding: Embedding | None = None
    material: Material = field(init=False)


@dataclass(frozen=True, eq=False)
class BodyState:
    """
    A copy of the state of one body of n particles, inner ones too, with K regions.

    Attributes
    ----------
    x, v : (3, n) float
        m, m/s
    stretch : (1 + K, 3, 3) float or None
        plastic state of the whole body and its regions, None without permanent deformation
    reaction : (2, 3) float
        force, m/s², and torque about the centre of mass, m²/s², of all contacts, per mass
    anchor : (3, n) float
        positions at the last sample of its displacement, m
    still_samples : int
        consecutive samples at rest, see `sleeping`
    moved : (SAMPLES_TO_SLEEP - 1,) float
        displacements between the last samples, RMS radii
    since : int
        tick from which on `total` is summed up
    total : (2, 3) float
        integral over time of the wrench of all contacts, N s and N m s
    touched, normal_impulse : (k,) int, (k,) float
        particles with a normal force, and that of the last tick times its length, N s
    obstacle_impulse : (O, 2, 3) float or None
        see `State`; None without contacts
    flattened : float
        volume, of that at rest, by which that of the fit is to be less while it is in contact
    holding, holding_total, holder_impulse : (2, 3) float
        of pins, see `State`; the second is an integral over time, N s and N m s

    """

    x: np.ndarray
    v: np.ndarray
    stretch: np.ndarray | None
    reaction: np.ndarray
    anchor: np.ndarray
    still_samples: int
    moved: np.ndarray
    since: int
    total: np.ndarray
    touched: np.ndarray
    normal_impulse: np.ndarray
    obstacle_impulse: np.ndarray | None
    flattened: float
    holding: np.ndarray
    holding_total: np.ndarray
    holder_impulse: np.ndarray

    @property
    def nbytes(self) -> int:
        """Bytes of memory."""
        arrays = (
            self.x, self.v, self.anchor, self.stretch, self.touched, self.normal_impulse,
            self.obstacle_impulse,
        )  # fmt: skip
        return sum(array.nbytes for array in arrays if array is not None)


@dataclass(frozen=True, eq=False)
class ObstacleTotals:
    """
    Integrals over time of the wrenches on O obstacles.

    Attributes
    ----------
    keys : (O,) tuple
        names of those of the config, keys of those received, and None for all points together
    since : (O,) int
        ticks from which on they are summed up
    total : (O, 2, 3) float
        N s, N m s, the moments about the moving origins

    """

    keys: tuple[ObstacleKey, ...]
    since: np.ndarray
    total: np.ndarray

    @property
    def nbytes(self) -> int:
        """Bytes of memory."""
        return self.since.nbytes + self.total.nbytes


class ShapeTable:
    """
    Constants of the R distinct rest shapes of bodies, as arrays for kernels.

    Parameters
    ----------
    bodies : iterable of Body

    Attributes
    ----------
    rests : list of RestShape
    regions_of : list of Regions or None
        the regions of each of them
    shapes : (R,) SHAPE
    weights, q : (M,), (3, M) float
        mass shares and rest positions of their particles
    regions : (Q,) REGION
    member, features, weighted_features : (m,) int, (4, m), (4, m) float
        members of all regions, see `Regions`
    faces : (f, 3) int
        corners of all faces

    """

    def __init__(self, bodies: Iterable[Body]) -> None:
        self.rests: list[RestShape] = []
        self.regions_of: list[Regions | None] = []
        self._row: dict[tuple[int, int], int] = {}
        for body in bodies:
            self._add(body.rest, body.regions)
            if body.pins is not None:
                self._add(body.pins.rest, body.pins.regions)
        self.shapes = np.zeros(len(self.rests), SHAPE)
        first = first_region = first_member = first_face = 0
        records = [np.zeros(0, REGION)]
        for row, (rest, regions) in enumerate(zip(self.rests, self.regions_of, strict=True)):
            self.shapes[row] = rest.record()
            shape = self.shapes[row]
            shape['first'], first = first, first + rest.particle_count
            shape['first_region'] = first_region
            shape['first_face'], shape['faces'] = first_face, len(rest.surface.faces)
            first_face += len(rest.surface.faces)
            if regions is not None:
                shape['regions'] = regions.count
                first_region += regions.count
                records.append(regions.records())
                records[-1]['first'] += first_member
                first_member += len(regions.particle)
        divided = [regions for regions in self.regions_of if regions is not None]
        self.regions = np.concatenate(records, dtype=REGION)  # just this one, see `bvh.pack`
        self.weights = np.concatenate([np.zeros(0), *(rest.weights for rest in self.rests)])
        self.q = _side_by_side(3, [rest.q for rest in self.rests])
        faces = [rest.surface.faces.astype(np.int32) for rest in self.rests]
        self.faces = np.concatenate([np.zeros((0, 3), np.int32), *faces])
        self.member = np.concatenate(
            [np.zeros(0, np.int64), *(regions.particle for regions in divided)]
        )
        self.features = _side_by_side(4, [regions.features for regions in divided])
        self.weighted_features = _side_by_side(
            4, [regions.weighted_features for regions in divided]
        )

    def _add(self, rest: RestShape, regions: Regions | None) -> None:
        key = (id(rest), id(regions))
        if key not in self._row:
            self._row[key] = len(self.rests)
            self.rests.append(rest)
            self.regions_of.append(regions)

    def row(self, rest: RestShape, regions: Regions | None) -> int:
        """Return the row of a rest shape."""
        return self._row[id(rest), id(regions)]


class State:
    """
    State of B bodies with N particles in all; S matches: of the bodies, and of their regions.

    Parameters
    ----------
    bodies : sequence of Body

    Attributes
    ----------
    bodies : (B,) BODY
    table : ShapeTable
        and its arrays: shapes, weights, regions, member, features, weighted_features, faces
    q : (3, M + G) float
        that of the table, then, from `first_goal` of a body with regions or pins on, the goals of
        its particles, and the velocities of these: in the map of its flight they take the place
        of the features
    x, v : (2, 3, N) float
        positions, m, and velocities, m/s, double-buffered: `now` of a body is the present half
    stretch : (2, S, 3, 3) float
        plastic states, halves as in `x`
    match_centre, match_posture : (S, 3), (S, 3, 3) float
        centres, m, and linear maps of offsets, of the matched shapes at the last tick
    pinned, is_pinned : (m,) int, (N,) bool
        pinned particles of all bodies, as columns of `x`
    pin_offset : (3, m) float
        where they are in the frame of the obstacle that holds them, m, if one does
    holding : (B, 2, 3) float
        wrench of the pins of a body in the last tick, about its centre of mass, per mass: m/s²,
        m²/s²
    holder_impulse : (B, 2, 3) float
        of a body on the obstacle that holds it, in the last tick, as of `obstacle_impulse`
    reaction : (B, 2, 3) float
        force, m/s², and torque about the centre of mass, m²/s², of all contacts, per mass
    anchor : (3, N) float
    still_samples, moved : (B,) int, (B, SAMPLES_TO_SLEEP - 1) float
        see `BodyState`
    contact_memory : (r,) MEMORY
        forces of contacts at the last tick, in order of their keys
    scales : (B,) float
        RMS radii of the rest shapes, m
    since : (B,) int
        see `BodyState`
    normal_impulse : (2, N) float
        at each particle in the last tick, the sum of all contacts, N s; halves as in `x`
    obstacle_impulse : (B, 2, O, 2, 3) float
        of each body on each obstacle in the last tick, see contact/exchange.py
    obstacle_keys, obstacle_since, obstacle_total : (O,) tuple, (O,) int, (O, 2, 3) float
        see `ObstacleTotals`

    """

    def __init__(self, bodies: Sequence[Body]) -> None:
        self.bodies = np.zeros(len(bodies), BODY)
        self.bodies['id'] = identities([body.config.name for body in bodies])
        first = first_match = 0
        for record, body in zip(self.bodies, bodies, strict=True):
            count, regions = body.rest.particle_count, body.regions
            record['first'], record['count'] = first, count
            record['surface'] = body.rest.surface_count
            record['first_match'] = first_match
            record['regions'] = regions.count if regions else 0
            first, first_match = first + count, first_match + 1 + int(record['regions'])
        self.x, self.v = np.zeros((2, 3, first)), np.zeros((2, 3, first))
        self.stretch = np.empty((2, first_match, 3, 3))
        self.stretch[:] = np.eye(3)
        self.match_centre = np.zeros((first_match, 3))
        self.match_posture = np.zeros((first_match, 3, 3))
        self.reaction = np.zeros((len(bodies), 2, 3))
        self.holding, self.holder_impulse = np.zeros((2, len(bodies), 2, 3))
        self.anchor = np.zeros((3, first))
        self.contact_memory = NO_MEMORY
        self.still_samples = np.zeros(len(bodies), np.int64)
        self.moved = np.zeros((len(bodies), SAMPLES_TO_SLEEP - 1))
        self.scales = np.array([body.rest.scale for body in bodies])
        self.since = np.zeros(len(bodies), np.int64)
        self.normal_impulse = np.zeros((2, first))
        self.obstacle_impulse = np.zeros((len(bodies), 2, 0, 2, 3))
        self.obstacle_keys: tuple[ObstacleKey, ...] = ()
        self.obstacle_since, self.obstacle_total = np.zeros(0, np.int64), np.zeros((0, 2, 3))
        self.use_shapes(bodies)

    def use_shapes(self, bodies: Sequence[Body]) -> None:
        """Rebuild the tables of rest shapes and pins after changes of the bodies."""
        self.table = table = ShapeTable(bodies)
        self.rests, self.regions_of = table.rests, table.regions_of
        self.shapes, self.weights, columns = table.shapes, table.weights, table.q.shape[1]
        self.regions, self.member = table.regions, table.member
        self.features, self.weighted_features = table.features, table.weighted_features
        self.faces = table.faces
        pinned, offset = [np.zeros(0, np.int64)], [np.zeros((3, 0))]
        first_pin = 0
        for index, (record, body) in enumerate(zip(self.bodies, bodies, strict=True)):
            record['holder'] = -1
            if body.pins is None:
                self.holding[index] = self.holder_impulse[index] = 0.0
            record['shape'] = record['matched'] = table.row(body.rest, body.regions)
            record['first_pin'], record['pins'], record['first_goal'] = first_pin, 0, -1
            if body.pins is not None:
                if body.config.mode != 'rigid':
                    record['matched'] = table.row(body.pins.rest, body.pins.regions)
                record['pins'] = len(body.pins.particle)
                pinned.append(record['first'] + body.pins.particle)
                offset.append(
                    np.zeros((3, len(body.pins.particle)))
                    if body.pins.offset is None
                    else body.pins.offset.T
                )
                first_pin += len(body.pins.particle)
            if body.pins is not None or body.regions is not None:
                record['first_goal'] = columns
                columns += 2 * record['count']
        self.pinned = np.concatenate(pinned)
        self.pin_offset = np.ascontiguousarray(np.concatenate(offset, axis=1))
        self.is_pinned = np.zeros(self.x.shape[2], np.bool_)
        self.is_pinned[self.pinned] = True
        self.q = np.zeros((3, columns))
        self.q[:, : table.q.shape[1]] = table.q

    # -------------------------------------------------------------------------------- obstacles
    def use_obstacles(self, keys: tuple[ObstacleKey, ...], tick: int) -> None:
        """Use other obstacles, see `ObstacleTotals`; new ones are summed up from a tick on."""
        if keys == self.obstacle_keys:
            return
        row = {key: index for index, key in enumerate(self.obstacle_keys)}
        source = [row.get(key, -1) for key in keys]
        is_new = np.array(source) < 0
        self.obstacle_keys = keys
        self.obstacle_since = rearranged(self.obstacle_since, source) + is_new * tick
        self.obstacle_total = rearranged(self.obstacle_total, source)
        impulse = rearranged(np.moveaxis(self.obstacle_impulse, 2, 0), source)
        self.obstacle_impulse = np.ascontiguousarray(np.moveaxis(impulse, 0, 2))

    def save_obstacles(self) -> ObstacleTotals:
        """Return a copy of the integrals for obstacles."""
        return ObstacleTotals(
            self.obstacle_keys, self.obstacle_since.copy(), self.obstacle_total.copy()
        )

    def restore_obstacles(self, saved: ObstacleTotals) -> None:
        """Restore the integrals for obstacles; `restore` follows for each body."""
        self.use_obstacles(saved.keys, 0)
        self.obstacle_since[:], self.obstacle_total[:] = saved.since, saved.total

    def forget_obstacle_contacts(self) -> None:
        """Begin the integrals for obstacles anew, at tick 0."""
        self.obstacle_since[:], self.obstacle_total[:] = 0, 0.0

    # --------------------------------------------------------------------------------- one body
    def columns(self, index: int) -> slice:
        """Return the columns of the particles of a body."""
        first = int(self.bodies['first'][index])
        return slice(first, first + int(self.bodies['count'][index]))

    def surface_positions(self, index: int) -> np.ndarray:
        """Return a view of the positions (3, n) of the particles at the surface of a body, m."""
        record = self.bodies[index]
        return self.positions(index)[:, : int(record['surface'])]

    def positions(self, index: int) -> np.ndarray:
        """Return a view of the positions (3, n) of a body, m."""
        return self.x[self.bodies['now'][index], :, self.columns(index)]

    def velocities(self, index: int) -> np.ndarray:
        """Return a view of the velocities (3, n) of a body, m/s."""
        return self.v[self.bodies['now'][index], :, self.columns(index)]

    def _matches(self, index: int) -> slice:
        first = int(self.bodies['first_match'][index])
        return slice(first, first + 1 + int(self.bodies['regions'][index]))

    def plastic_state(self, index: int) -> np.ndarray | None:
        """Return the stretches (1 + K, 3, 3) of a body, None without permanent deformation."""
        if not self.bodies['is_plastic'][index]:
            return None
        return self.stretch[self.bodies['now'][index], self._matches(index)]

    def set_plastic_state(self, index: int, stretch: np.ndarray | None) -> None:
        """Set the stretches of a body, see `plastic_state`."""
        self.bodies['is_plastic'][index] = stretch is not None
        self.stretch[:, self._matches(index)] = np.eye(3) if stretch is None else stretch

    def forget_contacts(self, index: int, tick: int) -> None:
        """Sum up the contacts of a body anew, from a tick on."""
        self._put_exchange(index, None, np.zeros(0, np.int64), np.zeros(0))
        self.reaction[index] = self.bodies['total'][index] = 0.0
        self.bodies['flattened'][index] = 0.0
        self.bodies['holding_total'][index] = 0.0
        self.holding[index] = self.holder_impulse[index] = 0.0
        self.since[index] = tick

    def normal_impulses(self, index: int) -> np.ndarray:
        """Return a view of the normal impulses (n,) at the particles of a body, N s."""
        return self.normal_impulse[self.bodies['now'][index], self.columns(index)]

    def obstacle_impulses(self, index: int) -> np.ndarray:
        """Return a view of the impulses (O, 2, 3) of a body on obstacles, N s, N m s."""
        return self.obstacle_impulse[index, self.bodies['now'][index]]

    def _put_exchange(
        self,
        index: int,
        obstacle_impulse: np.ndarray | None,
        touched: np.ndarray,
        normal_impulse: np.ndarray,
    ) -> None:
        """Set what a body has exchanged in the last tick, see `BodyState`."""
        self.bodies['touches'][index] = 0
        self.obstacle_impulse[index] = self.normal_impulse[:, self.columns(index)] = 0.0
        if obstacle_impulse is not None:
            self.bodies['touches'][index, self.bodies['now'][index]] = 1
            self.obstacle_impulses(index)[:] = obstacle_impulse
            self.normal_impulses(index)[touched] = normal_impulse

    def save(self, index: int) -> BodyState:
        """Return a copy of the state of a body."""
        stretch = self.plastic_state(index)
        touches = self.bodies['touches'][index, self.bodies['now'][index]]
        normal_impulse = self.normal_impulses(index)
        touched = np.flatnonzero(normal_impulse)
        return BodyState(
            self.positions(index).copy(),
            self.velocities(index).copy(),
            None if stretch is None else stretch.copy(),
            self.reaction[index].copy(),
            self.anchor[:, self.columns(index)].copy(),
            int(self.still_samples[index]),
            self.moved[index].copy(),
            int(self.since[index]),
            self.bodies['total'][index].copy(),
            touched,
            normal_impulse[touched],
            self.obstacle_impulses(index).copy() if touches else None,
            float(self.bodies['flattened'][index, self.bodies['now'][index]]),
            self.holding[index].copy(),
            self.bodies['holding_total'][index].copy(),
            self.holder_impulse[index].copy(),
        )

    def restore(self, index: int, saved: BodyState) -> None:
        """Restore a saved state of a body."""
        self.positions(index)[:], self.velocities(index)[:] = saved.x, saved.v
        self.set_plastic_state(index, saved.stretch)
        self.reaction[index] = saved.reaction
        self.anchor[:, self.columns(index)] = saved.anchor
        self.still_samples[index], self.moved[index] = saved.still_samples, saved.moved
        self.since[index], self.bodies['total'][index] = saved.since, saved.total
        self.bodies['flattened'][index] = saved.flattened
        self.holding[index], self.holder_impulse[index] = saved.holding, saved.holder_impulse
        self.bodies['holding_total'][index] = saved.holding_total
        self._put_exchange(index, saved.obstacle_impulse, saved.touched, saved.normal_impulse)


def _side_by_side(rows: int, fields: Sequence[np.ndarray]) -> np.ndarray:
    """Return fields (rows, n) concatenated along n, contiguous."""
    return np.ascontiguousarray(np.concatenate([np.zeros((rows, 0)), *fields], axis=1))
