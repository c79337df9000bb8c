# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Any state comes back: inverted, collapsed, random and huge bodies find their rest shapes."""

import math

from core_helpers import (
    random_rotation,
    rank_deficient_shapes,
    rms_displacement,
    sheared_box,
)
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np

from softbody_ros.core import BodyConfig, Surface, World, WorldConfig, make_surface
from softbody_ros.core.shape_matching.gains import damping_ratio
from softbody_ros.core.shape_matching.material import natural_frequency

MODES = ('rigid', 'linear', 'quadratic')
REFERENCE = 1 / 120
GRAVITY = 9.81


def flattened(q, random, dimensions):
    """Return points projected on a random plane, line or point through the centre."""
    basis = random_rotation(int(random.integers(1 << 30)))[:, :dimensions]
    return q @ basis @ basis.T


STATES = {
    'inverted': lambda q, random: -q,
    'mirrored': lambda q, random: q * (-1.0, 1.0, 1.0),
    'a plane': lambda q, random: flattened(q, random, 2),
    'its own plane': lambda q, random: q * (1.0, 1.0, 0.0),
    'a line': lambda q, random: flattened(q, random, 1),
    'a point': lambda q, random: flattened(q, random, 0),
    'random': lambda q, random: np.sqrt(np.mean(q**2)) * random.normal(size=q.shape),
    'shuffled': lambda q, random: random.permutation(q),
    'scaled 100 times': lambda q, random: 100.0 * q,
    'scaled to 1 %': lambda q, random: 0.01 * q,
    'mirrored and scaled 100 times': lambda q, random: q * (100.0, 100.0, -100.0),
    'stretched 100 times': lambda q, random: q * (100.0, 1.0, 1.0),
}
FULL_SHAPES = {
    'icosphere': make_surface('icosphere', 1.0, 1),
    'sheared box': sheared_box(),
    'torus': make_surface('torus', 1.0, 0),
    'open bowl': Surface(
        make_surface('icosphere', 1.0, 1).vertices, make_surface('icosphere', 1.0, 1).faces[:50]
    ),
}


RANK_DEFICIENT = rank_deficient_shapes()


sizes = st.floats(-3.0, 2.0).map(lambda exponent: 10.0**exponent)
seeds = st.integers(0, 1 << 30)
directions = seeds.map(lambda seed: random_rotation(seed)[0])
places = st.tuples(st.floats(0.0, 1000.0), directions).map(lambda place: place[0] * place[1])
materials = st.fixed_dictionaries(
    {
        'stiffness': st.sampled_from([0.05, 0.2, 0.5, 1.0]),
        'bounciness': st.sampled_from([0.0, 0.5, 0.9]),
        'deformation': st.sampled_from([0.0, 0.3, 0.7, 0.9]),
        'volume_conservation': st.sampled_from([0.0, 0.5, 1.0]),
        'damping': st.sampled_from([0.0, 0.0, 0.05]),
        'mass': st.sampled_from([1e-3, 1.0, 1e4]),
    }
)
more = st.sampled_from(
    [
        {'regions_count': 6},
        {'regions_count': 12, 'regions_whole_body_weight': 0.1},
        {'plasticity_creep': 50.0, 'plasticity_yield': 0.05, 'plasticity_max': 0.2},
        {'plasticity_creep': 5.0, 'regions_count': 4},
    ]
)


def time_to_come_back(material):
    """
    Return the time in which a body surely finds its shape again, s.

    The softest deformations are those that the goal follows: frequency ω of the stiffness
    (1 − β) α_s, damping ζ from the bounciness. They decay as (1 + ω t) exp(−ζ ω t) or faster, and
    from 100 times the size to 1 % is exp(−9.2). ζ ω t = 15 leaves (1 + 15) exp(−15) = exp(−12.2)
    at critical damping, where the polynomial counts most, for the way back from states that no
    goal can follow.
    """
    softest = (1.0 - material['deformation']) * material['stiffness']
    rate = damping_ratio(material['bounciness']) * natural_frequency(softest, REFERENCE)
    return 15.0 / rate


def worlds_in_every_state(surface, size, material, time_step, **more):
    """Return a world with a body for each mode and state, their names and the mesh's scale."""
    scaled = Surface(size * surface.vertices, surface.faces)
    cases = [(mode, state) for mode in MODES for state in STATES]
    bodies = tuple(
        BodyConfig(name=f'b{i}', mesh=scaled, mode=mode, **material)
        for i, (mode, _) in enumerate(cases)
    )
    config = WorldConfig(time_step=time_step, reference_step=REFERENCE, bodies=bodies, **more)
    return World(config), cases


def put_in_every_state(world, cases, pose, places, velocity, seed):
    """Deform the bodies in their own frames, turn them, put them somewhere and let them drift."""
    random = np.random.default_rng(seed)
    rest = world.rest_shape(world.names[0])
    for name, (_, state), place in zip(world.names, cases, places, strict=True):
        q = rest.surface.vertices - rest.centre
        x = STATES[state](q, random) @ pose.T + place
        world.set_state(name, x, np.broadcast_to(np.reshape(velocity, (-1, 3)), x.shape))


def side_by_side(cases, place, size):
    """Return a place for each case, so far apart that bodies of 100 times their size are alone."""
    return [np.add(place, (1000.0 * size * i, 0.0, 0.0)) for i in range(len(cases))]


def orientation(world, name):
    """Return det A of the linear map that takes the rest shape nearest to the body."""
    rest = world.rest_shape(name)
    q = rest.surface.vertices - rest.centre
    p = world.positions(name) - rest.weights @ world.positions(name)
    root = np.sqrt(rest.weights)[:, None]
    return np.linalg.det(np.linalg.lstsq(root * q, root * p, rcond=None)[0].T)


def assert_all_come_back(surface, size, material, pose, place, velocity, seed):
    seconds = time_to_come_back(material)
    time_step = min(max(seconds / 3000, 1 / 480), 1 / 120)
    world, cases = worlds_in_every_state(
        surface, size, material, time_step, gravity_magnitude=0.0, obstacles=()
    )
    put_in_every_state(world, cases, pose, side_by_side(cases, place, size), velocity, seed)
    world.step(math.ceil(seconds / time_step))
    for name in world.names:
        assert np.isfinite(world.positions(name)).all()
        assert np.isfinite(world.velocities(name)).all()
    rms = [rms_displacement(world, name) for name in world.names]
    lost = [(*case, far) for case, far in zip(cases, rms, strict=True) if not far <= 0.01]
    assert not lost
    if world.rest_shape(world.names[0]).has_volume:  # a sheet that is mirrored is one turned over
        assert min(orientation(world, name) for name in world.names) > 0.9


@settings(max_examples=12)
@given(
    st.sampled_from(sorted(RANK_DEFICIENT)), sizes, materials, seeds.map(random_rotation), places,
    directions, seeds,
)  # fmt: skip
def test_a_sheet_a_rod_or_a_box_left_alone_finds_its_shape_from_any_state(
    shape, size, material, pose, place, velocity, seed
):
    surface = RANK_DEFICIENT[shape]
    assert_all_come_back(surface, size, material, pose, place, size * velocity, seed)


@settings(max_examples=4)
@given(
    st.sampled_from(sorted(FULL_SHAPES)), sizes, materials, more, seeds.map(random_rotation), seeds
)
def test_regions_and_dents_keep_any_state_finite_and_the_right_way_round(
    shape, size, material, extra, pose, seed
):
    world, cases = worlds_in_every_state(
        FULL_SHAPES[shape], size, material | extra, 1 / 240, gravity_magnitude=0.0, obstacles=()
    )
    places = side_by_side(cases, (1.0, 2.0, 3.0), size)
    put_in_every_state(world, cases, pose, places, size * np.ones(3), seed)
    world.step(math.ceil(min(time_to_come_back(material), 10.0) * 240))
    for name, case in zip(world.names, cases, strict=True):
        assert np.isfinite(world.positions(name)).all(), case
        assert orientation(world, name) > 0.0, case
        assert world.permanent_strain(name) <= extra.get('plasticity_max', 0.3) + 1e-9, case


@settings(max_examples=16)
@given(
    st.sampled_from(sorted(FULL_SHAPES)), sizes, materials, seeds.map(random_rotation), places,
    directions, seeds,
)  # fmt: skip
def test_a_body_left_alone_finds_its_shape_from_any_state(
    shape, size, material, pose, place, velocity, seed
):
    assert_all_come_back(FULL_SHAPES[shape], size, material, pose, place, size * velocity, seed)


@settings(max_examples=3)
@given(sizes, materials, seeds.map(random_rotation), seeds)
def test_no_state_dropped_on_the_ground_leaves_the_finite_numbers(size, material, pose, seed):
    """Gravity is scaled with the body, so that what falls is as heavy for its size at any size."""
    world, cases = worlds_in_every_state(
        FULL_SHAPES['sheared box'], size, material, 1 / 120, gravity_magnitude=GRAVITY * size
    )
    places = side_by_side(cases, (0.0, 0.0, 300.0 * size), size)
    put_in_every_state(world, cases, pose, places, np.zeros(3), seed)

    def positions():
        """Return where the bodies are, as seen from below the places from which they fall."""
        return [
            world.positions(name) - place * (1.0, 1.0, 0.0)
            for name, place in zip(world.names, places, strict=True)
        ]

    start = [np.abs(x).max() for x in positions()]
    for _ in range(16):
        world.step(60)
        for name, x, case, extent in zip(world.names, positions(), cases, start, strict=True):
            assert np.isfinite(x).all() and np.isfinite(world.velocities(name)).all(), case
            assert np.abs(x).max() < 10.0 * extent + 10.0 * size, case
