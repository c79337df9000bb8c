# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Which particles touch which obstacles: compared with one look at each, and followed paths."""

import dataclasses

from core_helpers import many_points, thin_bin
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
import trimesh

from softbody_ros.core import ObstacleConfig, Surface
from softbody_ros.core.body import BODY
from softbody_ros.core.collision import obstacle_contacts
from softbody_ros.core.collision.obstacle_contacts import CONTACT
from softbody_ros.core.collision.obstacles import ObstacleTable, made, moved
from softbody_ros.core.compiled import kernel
from softbody_ros.core.config import OBSTACLE_TYPES
from softbody_ros.core.geometry.bounding_boxes import box_around

pytestmark = pytest.mark.plain

SOLIDS = tuple(kind for kind in OBSTACLE_TYPES if kind != 'plane')
THIN = 0.01
"""Half the thickness of the plate."""


def plate(**values):
    return ObstacleConfig(name='plate', type='box', size=(1.0, 1.0, THIN), **values)


def drawn(seed, kind, speed=50.0, turn=20.0):
    """Return an obstacle that has moved for a tick, somewhere about the origin."""
    random = np.random.default_rng(seed)
    mesh = {'mesh': 'torus', 'subdivisions': 1} if kind == 'mesh' else {}
    config = ObstacleConfig(
        name='it',
        type=kind,
        size=(0.6, 0.9, 0.7),
        position=random.uniform(-1, 1, 3),
        orientation=Rotation.random(random_state=seed).as_quat(),
        velocity_linear=random.normal(size=3) * speed,
        velocity_angular=random.normal(size=3) * turn,
        **mesh,
    )
    return moved(made(config), 1 / 60)


def bodies_at(x):
    """Return bodies at positions (B, 3, n)."""
    bodies = np.zeros(len(x), BODY)
    bodies['count'] = bodies['surface'] = x.shape[2]
    bodies['first'] = np.arange(len(x)) * x.shape[2]
    return bodies


@kernel
def contacts_of(bodies, chosen, reach, x, other, sweep, records, trees, contacts):
    """
    Write the contacts of chosen bodies, sorted by body, then obstacle; return their number.

    `other` is whether that of the halves x (2, 3, N) is meant that is being computed, `sweep`
    whether paths from the state to there are followed.
    """
    found = 0
    for k in range(len(chosen)):
        body = bodies[chosen[k]]
        first, count, now = body['first'], body['surface'], body['now']
        start = x[now]
        present = x[1 - now] if other else start
        low, high = box_around(present, first, count)
        low_before, high_before = low, high
        if sweep:
            low_before, high_before = box_around(start, first, count)
        for j in range(len(records)):
            if not obstacle_contacts.may_touch(
                records[j], low, high, low_before, high_before, reach[k]
            ):
                continue
            begin = found
            found = obstacle_contacts.find_contacts(
                records[j], trees, present, start, first, count, reach[k], sweep, contacts, found
            )
            for index in range(begin, min(found, len(contacts))):
                contacts[index]['body'], contacts[index]['obstacle'] = chosen[k], j
    return found


def find(x, obstacles, thickness, start=None, chosen=None):
    """Return the contacts of bodies at x (B, 3, n), before at `start`."""
    bodies, sweep = bodies_at(x), start is not None
    halves = np.stack([each.swapaxes(0, 1).reshape(3, -1) for each in (start if sweep else x, x)])
    chosen = np.arange(len(x)) if chosen is None else np.array(chosen)
    reach = np.broadcast_to(np.asarray(thickness, dtype=float), len(x))[chosen]
    records, trees = ObstacleTable().refresh(obstacles)
    # in the way of kernels, what was there before must not matter
    contacts = np.full(len(obstacles) * x[0, 0].size * len(x), -7, dtype=CONTACT)
    found = contacts_of(bodies, chosen, reach, halves, True, sweep, records, trees, contacts)
    return contacts[:found]


def expected_contacts(x, obstacles, thickness):
    """Return rows (body, obstacle, particle), and depths and normals, one look at each."""
    rows, depths, normals = [], [], []
    for body, positions in enumerate(x):
        for index, obstacle in enumerate(obstacles):
            distance, normal = obstacle.closest(positions.T)
            for particle in np.flatnonzero(distance < thickness):
                rows.append((body, index, particle))
                depths.append(thickness - distance[particle])
                normals.append(normal[particle])
    return rows, np.array(depths), np.array(normals)


@kernel
def boxes_touch(records, low, high, low_before, high_before, thickness):
    corners = ((low[0], low[1], low[2]), (high[0], high[1], high[2]))
    before = (low_before[0], low_before[1], low_before[2])
    after = (high_before[0], high_before[1], high_before[2])
    return obstacle_contacts.may_touch(
        records[0], corners[0], corners[1], before, after, thickness
    )


# --------------------------------------------------------------------------------- closest points
@pytest.mark.parametrize('thickness', [0.0, 0.05])
def test_what_is_nearer_than_its_thickness_touches(thickness):
    random = np.random.default_rng(2)
    touching = 0
    for seed in range(4):
        obstacles = [drawn(10 * seed + i, kind) for i, kind in enumerate(OBSTACLE_TYPES)]
        x = random.normal(size=(3, 3, 30)) * 0.3 + random.uniform(-1, 1, (3, 3, 1))
        contacts = find(x, obstacles, thickness)
        rows, depths, normals = expected_contacts(x, obstacles, thickness)
        touching += len(rows)
        found = np.stack([contacts[name] for name in ('body', 'obstacle', 'particle')], axis=1)
        assert found.tolist() == [list(row) for row in rows]
        assert contacts['depth'] == pytest.approx(depths, abs=1e-12)
        assert contacts['normal'] == pytest.approx(normals, abs=1e-9)
        assert not contacts['swept'].any()
        for contact in contacts:
            place = x[contact['body'], :, contact['particle']]
            assert np.array_equal(contact['point'], place)
    assert touching > 50


def test_bodies_of_more_than_a_tile_are_looked_at_whole():
    random = np.random.default_rng(0)
    x = random.uniform(-1.0, 1.0, (2, 3, 2 * obstacle_contacts.TILE + 7))
    x[:, 2] += 0.999 + 1e-3  # few are below the plane, in whichever tile
    x[1, 2, [0, obstacle_contacts.TILE, -1]] = -0.1
    obstacles = (made(ObstacleConfig()), made(ObstacleConfig(type='sphere', size=(0.4, 1, 1))))
    contacts = find(x, obstacles, 0.0)
    rows, _, _ = expected_contacts(x, obstacles, 0.0)
    found = np.stack([contacts[name] for name in ('body', 'obstacle', 'particle')], axis=1)
    assert found.tolist() == [list(row) for row in rows]


def test_what_finds_no_space_is_counted_and_not_written():
    x = np.random.default_rng(0).uniform(-1.0, 0.5, (2, 3, 20))
    obstacles = (made(ObstacleConfig()), made(plate()))
    every = find(x, obstacles, 0.0)
    bodies, halves = bodies_at(x), np.stack([x.swapaxes(0, 1).reshape(3, -1)] * 2)
    records, trees = ObstacleTable().refresh(obstacles)
    contacts = np.full(12, -7, dtype=CONTACT)
    count = contacts_of(
        bodies, np.arange(2), np.zeros(2), halves, False, False, records, trees, contacts[:10]
    )
    assert count == len(every) > 12
    assert np.array_equal(contacts[:10], every[:10])
    assert (contacts['particle'][10:] == -7).all()


def test_only_the_chosen_bodies_and_the_chosen_half_are_looked_at():
    below = np.full((3, 3, 4), -1.0)
    assert set(find(below, (made(ObstacleConfig()),), 0.0, chosen=[0, 2])['body']) == {0, 2}
    above = -below
    halves = np.stack([each.swapaxes(0, 1).reshape(3, -1) for each in (below, above)])
    bodies, (records, trees) = bodies_at(below), ObstacleTable().refresh((made(ObstacleConfig()),))
    bodies['now'] = [0, 0, 1]
    contacts = np.zeros(99, CONTACT)
    for other, expected in ((False, [0, 1]), (True, [2])):
        found = contacts_of(
            bodies, np.arange(3), np.zeros(3), halves, other, False, records, trees, contacts
        )
        assert np.unique(contacts['body'][:found]).tolist() == expected


# ------------------------------------------------------------------------------------- broad phase
@pytest.mark.parametrize('kind', OBSTACLE_TYPES)
def test_what_touches_is_nearby_and_what_is_far_away_is_not(kind):
    random = np.random.default_rng(0)
    touching = passed_over = 0
    for seed in range(12):
        start = random.normal(size=(4, 3, 20)) * 0.3 + random.uniform(-3, 3, (4, 3, 1))
        x = start + random.uniform(-2, 2, (4, 3, 1)) * random.choice([0.01, 1.0])
        obstacle = drawn(seed, kind, turn=20.0 * (seed % 2))
        records, _ = ObstacleTable().refresh((obstacle,))
        away = records.copy()
        away['position'] += 100.0
        away['position_before'] += 100.0
        touched = {*find(x, (obstacle,), 0.05, start)['body'].tolist()}
        for body in range(4):
            corners = [extreme(axis=1) for extreme in (x[body].min, x[body].max)]
            corners += [extreme(axis=1) for extreme in (start[body].min, start[body].max)]
            near = boxes_touch(records, *corners, 0.05)
            assert near or body not in touched
            touching += body in touched
            passed_over += not near
            if kind != 'plane' and not seed % 2:
                assert not boxes_touch(away, *corners, 0.05)
    assert touching > 3
    assert (passed_over > 0) == (kind != 'plane')


# ------------------------------------------------------------------------------------ swept paths
@pytest.mark.parametrize('kind', OBSTACLE_TYPES)
def test_slow_contacts_are_those_of_the_closest_point_bit_by_bit(kind):
    random = np.random.default_rng(3)
    obstacle = drawn(3, kind, speed=0.0, turn=0.0)
    x = random.uniform(-1, 1, (2, 3, 60)) + obstacle.position[:, None]
    start = x + random.uniform(-0.01, 0.01, x.shape)
    without, swept = (find(x, (obstacle,), 0.02, before) for before in (None, start))
    assert len(without) > 10
    assert np.array_equal(without, swept)


def test_a_particle_stays_on_its_side_whether_it_touches_or_passes():
    obstacle = made(plate())
    for begin, end, side in (
        (0.5, -0.4, 1.0),
        (THIN, -0.4, 1.0),
        (THIN, -0.006, 1.0),
        (-THIN, 0.006, -1.0),
        (-0.5, 0.0, -1.0),
        (0.004, -0.5, 1.0),
    ):
        start = np.array([0.1, 0.2, begin]).reshape(1, 3, 1)
        x = np.array([0.3, 0.1, end]).reshape(1, 3, 1)
        contacts = find(x, (obstacle,), 0.0, start)
        assert contacts['normal'] == pytest.approx(np.array([(0.0, 0.0, side)]))
        assert contacts['depth'] == pytest.approx(THIN - side * end)
    # beside it, and away from it
    for begin, end in (((1.5, 0.0, 0.5), (1.5, 0.0, -0.5)), ((0.0, 0.0, THIN), (0.1, 0.0, 0.8))):
        start, x = (np.array(place).reshape(1, 3, 1) for place in (begin, end))
        assert not len(find(x, (obstacle,), 0.0, start))


@pytest.mark.parametrize('seed', range(3))
@pytest.mark.parametrize('kind', ['box', 'cylinder', 'mesh'])
def test_a_fast_plate_takes_along_all_that_it_comes_upon(kind, seed):
    mesh = trimesh.creation.box((4.0, 4.0, 2 * THIN))
    mesh = {'mesh': Surface(mesh.vertices, mesh.faces)} if kind == 'mesh' else {}
    config = ObstacleConfig(
        name='plate',
        type=kind,
        size=(2.0, 2.0, THIN),
        orientation=Rotation.random(random_state=seed).as_quat(),
        velocity_linear=np.random.default_rng(seed).normal(size=3) * 20.0,
        velocity_angular=(3.0, 1.0, 2.0),
        **mesh,
    )
    obstacle = moved(made(config), 1 / 60)
    x = np.random.default_rng(seed).uniform(-0.5, 0.5, (1, 3, 100))
    position, rotation = obstacle.before
    before = ((x[0].T - position) @ rotation)[:, 2]
    after = ((x[0].T - obstacle.position) @ obstacle.rotation)[:, 2]
    crossed = np.flatnonzero((before * after < 0.0) & (np.abs(before) > THIN))
    contacts = find(x, (obstacle,), 0.0, x)
    contacts = contacts[np.isin(contacts['particle'], crossed)]
    assert contacts['particle'].tolist() == crossed.tolist()
    side = np.sign(before[crossed])
    assert contacts['normal'] == pytest.approx(side[:, None] * obstacle.rotation[:, 2])
    assert contacts['depth'] == pytest.approx(THIN - side * after[crossed])
    assert contacts['swept'].all()


@many_points
@pytest.mark.parametrize('sections', [4, 16])
def test_no_path_leads_through_a_thin_wall(sections):
    random = np.random.default_rng(sections)
    obstacle = made(ObstacleConfig(type='mesh', mesh=thin_bin(sections=sections)))
    angle, height = random.uniform(0.0, 2.0 * np.pi, 40), random.uniform(0.2, 0.8, (2, 40))
    inner = random.uniform(0.0, 0.5, 40) * np.array([np.cos(angle), np.sin(angle)])
    outer = random.uniform(1.1, 2.0, 40) * np.array([np.cos(angle + 0.5), np.sin(angle + 0.5)])
    within, without = (
        np.vstack(place)[None] for place in zip((inner, outer), height, strict=True)
    )
    for start, end, outwards in ((within, without, -1.0), (without, within, 1.0)):
        contacts = find(end, (obstacle,), 0.0, start)
        assert contacts['particle'].tolist() == list(range(40))
        assert contacts['swept'].all()
        # they are led back to the side on which they were
        radial = np.einsum('ij,ij->i', contacts['normal'][:, :2], start[0, :2].T)
        assert (outwards * radial > 0.0).mean() > 0.9


def test_a_path_that_comes_near_to_nothing_touches_nothing():
    random = np.random.default_rng(0)
    obstacle = made(ObstacleConfig(type='mesh', mesh=thin_bin()))
    start = random.uniform(-1.0, 1.0, (1, 3, 60))
    x = start + random.normal(size=start.shape)
    found = set(find(x, (obstacle,), 0.0, start)['particle'].tolist())
    share = np.linspace(0.0, 1.0, 101)
    clear = 0
    for particle in range(60):
        one, path = start[0, :, particle], x[0, :, particle] - start[0, :, particle]
        distance, _ = obstacle.distance(one + share[:, None] * path)
        # within a hundredth of its length a path may count as one that touches
        if distance.min() > 0.016 * np.linalg.norm(path):
            assert particle not in found
            clear += 1
    assert 10 < clear < 55


def test_an_obstacle_that_stops_has_no_motion_left():
    moving = moved(made(plate(velocity_linear=(1, 0, 0))), 0.1)
    assert moving.before is not None
    stopped = dataclasses.replace(moving, config=plate())
    assert moved(stopped, 0.1).before is None
