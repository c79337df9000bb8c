# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bodies that are inside each other at the start come apart at a bounded speed, at any step."""

from core_helpers import assert_goes_on_bit_by_bit, centre, floating, momentum, random_rotation
import numpy as np
import pytest

from softbody_ros.core import BodyConfig

RECOVERY = 2.0
"""RMS radii a second, as said in docs/explanation/contact.md."""
PAIRS = [
    ('rigid', 'rigid'), ('linear', 'linear'), ('quadratic', 'quadratic'), ('rigid', 'linear'),
    ('rigid', 'quadratic'), ('linear', 'quadratic'),
]  # fmt: skip
SIZE = 0.5


def two_inside(modes, mesh, subdivisions, overlap, h, seed=0, **values):
    """Return a world of two equal bodies that overlap by a share of their size, turned anyhow."""
    random = np.random.default_rng(seed)
    way = random.normal(size=3)
    way *= 2.0 * SIZE * (1.0 - overlap) / np.linalg.norm(way)
    bodies = []
    for name, mode, position in zip('ab', modes, (np.zeros(3), way), strict=True):
        rotation = random_rotation(int(random.integers(1 << 30)))
        bodies.append(
            BodyConfig(
                name=name, mode=mode, mesh=mesh, subdivisions=subdivisions, size=SIZE,
                position=tuple(position), orientation=as_quaternion(rotation), **values,
            )
        )  # fmt: skip
    return floating(*bodies, h=h)


def as_quaternion(rotation):
    """Return the quaternion x, y, z, w of a rotation about an axis that is not 0."""
    w = 0.5 * np.sqrt(max(1.0 + np.trace(rotation), 1e-12))
    axis = np.array([rotation[2, 1], rotation[0, 2], rotation[1, 0]])
    axis -= (rotation[1, 2], rotation[2, 0], rotation[0, 1])
    quaternion = np.append(axis / (4.0 * w), w)
    return tuple(quaternion / np.linalg.norm(quaternion))


def radius(world, name):
    """Return the RMS radius of the rest shape, m."""
    rest = world.rest_shape(name)
    square = ((rest.surface.vertices - rest.centre) ** 2).sum(axis=1)
    return np.sqrt(rest.weights @ square)


def fastest(world):
    """Return the largest speed of a particle, in RMS radii a second."""
    return max(
        np.linalg.norm(world.velocities(name), axis=1).max() / radius(world, name)
        for name in world.names
    )


def energy(world):
    """Return the kinetic energy over that of all bodies at RECOVERY."""
    squares = [
        (world.rest_shape(name).weights @ (world.velocities(name) ** 2).sum(axis=1))
        / (RECOVERY * radius(world, name)) ** 2
        for name in world.names
    ]
    return np.mean(squares)


def watched(world, seconds, h):
    """Return the largest speed and kinetic energy within a time, and those in its last third."""
    speeds, energies = [], []
    for _ in range(round(seconds / h)):
        world.step()
        speeds.append(fastest(world))
        energies.append(energy(world))
    late = 2 * len(speeds) // 3
    return max(speeds), max(energies), max(speeds[late:]), max(energies[late:])


@pytest.mark.parametrize('overlap', [0.2, 0.5])
@pytest.mark.parametrize(('mesh', 'subdivisions'), [('box', 0), ('icosphere', 2)])
@pytest.mark.parametrize('modes', PAIRS)
def test_bodies_inside_each_other_part_at_two_sizes_a_second_at_any_step(
    modes, mesh, subdivisions, overlap
):
    speeds = []
    for h in (1 / 30, 1 / 60, 1 / 240, 1 / 1000):
        world = two_inside(modes, mesh, subdivisions, overlap, h)
        before = np.linalg.norm(centre(world, 'b') - centre(world, 'a'))
        speed, most, _, later = watched(world, 1.5, h)
        speeds.append(speed)
        assert speed < 1.25 * RECOVERY
        # never more than both have at that speed, and none is gained once they are apart
        assert most < 1.0
        assert later < max(0.5, 1.02 * most)
        assert np.linalg.norm(centre(world, 'b') - centre(world, 'a')) > before
        assert momentum(world, 'a') == pytest.approx(-momentum(world, 'b'), abs=1e-12)
    if modes != ('rigid', 'rigid'):
        # rigid bodies are next to still: there is no deformation that could push them
        assert max(speeds[1:]) < 2.0 * min(speeds[1:])


@pytest.mark.parametrize('h', [1 / 30, 1 / 10])
@pytest.mark.parametrize('model', ['viscous', 'coulomb'])
@pytest.mark.parametrize('modes', PAIRS)
def test_friction_throws_no_bodies_that_are_inside_each_other(modes, model, h):
    for seed in range(5):
        world = two_inside(
            modes, 'box', seed % 2, 0.5, h, seed, friction_model=model, friction=1.0
        )
        assert watched(world, 1.5, h)[0] < 1.5 * RECOVERY


def test_a_body_that_is_placed_in_another_one_comes_out_slowly():
    h = 1 / 480
    world = two_inside(('linear', 'rigid'), 'icosphere', 2, -0.5, h)
    world.step(10)
    world.place('b', world.centre_of_mass('a') + (0.4, 0.1, 0.0), np.eye(3))
    assert watched(world, 1.0, h)[0] < 1.25 * RECOVERY
    assert np.linalg.norm(centre(world, 'b') - centre(world, 'a')) > 1.9 * SIZE


def test_bodies_that_are_inside_each_other_go_on_from_a_snapshot_to_the_bit():
    world = two_inside(('linear', 'quadratic'), 'icosphere', 1, 0.5, 1 / 120)
    # less deep than where that begins, so that it is so only as that is remembered
    world.step(50)
    assert_goes_on_bit_by_bit(world, 40)


def test_five_bodies_inside_each_other_stay_slow():
    for seed in range(6):
        random = np.random.default_rng(seed)
        bodies = [
            BodyConfig(
                name=f'b{i}', mode=('linear', 'rigid', 'quadratic')[i % 3], size=SIZE,
                mesh=('box', 'icosphere')[i % 2], subdivisions=1,
                position=tuple(0.3 * random.normal(size=3)),
            )
            for i in range(5)
        ]  # fmt: skip
        assert watched(floating(*bodies, h=1 / 120), 1.5, 1 / 120)[0] < 4.0 * RECOVERY
