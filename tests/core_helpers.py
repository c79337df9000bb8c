# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Shapes, worlds and measurements that several core tests use."""

import dataclasses
from importlib.resources import files

import numpy as np
import pytest
import trimesh

from softbody_ros.core import BodyConfig, Surface, World, WorldConfig, make_surface
from softbody_ros.core.compiled import is_compiled

many_points = pytest.mark.skipif(not is_compiled(), reason='too many points for plain Python')


def cad_mesh(name):
    """Return the path of a real part's STL: it has not been made for these tests."""
    return str(files('cookie_description') / 'meshes' / f'{name}.stl')


def sheared_box():
    """Return a closed surface without any symmetry, its centre of mass off its origin."""
    surface = make_surface('box', 0.5, 2)
    shear = np.array([[1.0, 0.4, -0.2], [0.0, 0.7, 0.3], [0.1, 0.0, 1.3]])
    vertices = surface.vertices @ shear.T
    return Surface(vertices + 0.1 * vertices**2 + (0.2, -0.1, 0.3), surface.faces)


def sheet():
    """Return a flat square of 25 particles in the plane z = 0."""
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, 5), np.linspace(-0.5, 0.5, 5))
    vertices = np.stack([x.ravel(), y.ravel(), np.zeros(25)], axis=1)
    corner = np.array([row * 5 + column for row in range(4) for column in range(4)])
    lower = np.stack([corner, corner + 1, corner + 6], axis=1)
    upper = np.stack([corner, corner + 6, corner + 5], axis=1)
    return Surface(vertices, np.vstack([lower, upper]))


def thin_bin(wall=0.02, sections=4):
    """Return an open-top bin of radius and height 1 about the z axis: a closed surface."""
    inner = 1.0 - wall
    profile = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (inner, 1.0), (inner, wall), (0.0, wall)]
    mesh = trimesh.creation.revolve(profile, sections=sections)
    mesh.merge_vertices()
    return Surface(mesh.vertices, mesh.faces)


def cloud(points):
    """Return particles without faces."""
    return Surface(np.array(points, dtype=float), np.empty((0, 3), dtype=int))


def rank_deficient_shapes():
    """Return named shapes that do not span all features."""
    random = np.random.default_rng(5)
    return {
        'sheet': sheet(),
        'rod': cloud(np.linspace((-0.5, 0.0, 0.2), (0.5, 0.3, 0.4), 9)),
        'two points': cloud([(0.0, 0.0, 0.0), (1.0, 0.5, 0.0)]),
        'triangle': Surface(np.eye(3), np.array([(0, 1, 2)])),
        'tetrahedron': Surface(
            np.vstack([np.zeros(3), np.eye(3)]),
            np.array([(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]),
        ),
        'box of 8 vertices': make_surface('box', 0.5, 0),
        'icosphere of 12 vertices': make_surface('icosphere', 0.5, 0),
        'cloud': cloud(random.normal(size=(40, 3))),
    }


def floating(*bodies, h=1 / 120, reference_step=1 / 120, gravity=0.0):
    """Return a world of bodies without obstacles."""
    config = WorldConfig(
        time_step=h,
        reference_step=reference_step,
        gravity_magnitude=gravity,
        bodies=bodies,
        obstacles=(),
    )
    return World(config)


def body(mesh='icosphere', **values):
    """Return a body at the origin, by default of 42 vertices: enough for the physics."""
    return BodyConfig(**{'mesh': mesh, 'subdivisions': 1, 'position': (0.0, 0.0, 0.0)} | values)


def apart(bodies, distance=20.0):
    """Return bodies with their positions shifted along x, far enough to never meet, as a list."""
    return [
        dataclasses.replace(each, position=np.add(each.position, (i * distance, 0.0, 0.0)))
        for i, each in enumerate(bodies)
    ]


def bytes_of(world):
    """Return the whole state of the bodies as bytes."""
    return b''.join(
        world.positions(name).tobytes() + world.velocities(name).tobytes() for name in world.names
    )


def assert_goes_on_bit_by_bit(world, ticks, meanwhile=lambda world: None, state=bytes_of):
    """
    Step a world, and from a snapshot of where it was again: bit by bit it must be the same.

    Parameters
    ----------
    world : World
        is left as it is after the steps
    ticks : int
        the steps
    meanwhile : callable
        what happens to the world between the steps and its restoration
    state : callable
        returns of a world what is compared

    """
    saved, then = world.snapshot(), state(world)
    world.step(ticks)
    later = state(world)
    another = World(world.config)
    meanwhile(world)
    for each in (world, another):
        each.restore(saved)
        assert state(each) == then
        each.step(ticks)
        assert state(each) == later


def centre(world, name='body'):
    """Return the centre of mass, (3,)."""
    return world.rest_shape(name).weights @ world.positions(name)


def momentum(world, name='body'):
    """Return the mean velocity, (3,)."""
    return world.rest_shape(name).weights @ world.velocities(name)


def angular_momentum(world, name='body'):
    """Return Σ w (x − centre) × v, (3,)."""
    arms = world.positions(name) - centre(world, name)
    return world.rest_shape(name).weights @ np.cross(arms, world.velocities(name))


def rms_displacement(world, name='body'):
    """Return the weighted RMS distance from the best rigid pose, relative to the RMS radius."""
    rest = world.rest_shape(name)
    displacement = world.rigid_fit(name).displacement
    return np.sqrt(rest.weights @ displacement**2) / rest.scale


def enclosed_volume(vertices, faces):
    """Return the volume by the divergence theorem, m³."""
    return float(trimesh.Trimesh(vertices, faces, process=False).volume)


def random_rotation(seed):
    """Return a (3, 3) rotation matrix."""
    return trimesh.transformations.random_rotation_matrix(
        np.random.default_rng(seed).uniform(size=3)
    )[:3, :3]


def disturbed(world, name='body', seed=0, shape=0.1, speed=0.5):
    """Move and deform a body in ways that its mode knows and does not know; kick its particles."""
    random = np.random.default_rng(seed)
    rest = world.rest_shape(name)
    transform = random_rotation(seed) @ (np.eye(3) + shape * random.normal(size=(3, 3)))
    bend = shape * random.normal(size=(3, 6))
    x = rest.scale * (transform @ rest.features[1:4] + bend @ rest.features[4:]).T
    x = x[: rest.surface_count]
    x += 0.3 * shape * rest.scale * random.normal(size=x.shape)
    v = speed * rest.scale * random.normal(size=x.shape)
    v += np.cross(speed * random.normal(size=3), x) + random.normal(size=3)
    place = random.normal(size=3) + world.body_config(name).position
    world.set_state(name, x + place, v)


def frequency_and_decay(amplitudes, h):
    """Return ω√(1−ζ²) and ζω, 1/s, of the best damped sinusoid through the samples."""
    table = np.stack([amplitudes[1:-1], amplitudes[:-2]], axis=1)
    trace, minus_square = np.linalg.lstsq(table, amplitudes[2:], rcond=None)[0]
    eigenvalue = (trace + np.sqrt(complex(trace**2 + 4 * minus_square))) / 2
    rate = np.log(eigenvalue) / h
    return abs(rate.imag), -rate.real


def assert_as_if_alone(bodies, ticks):
    """Step bodies together, and each by itself: they must move alike."""
    together = World(WorldConfig(bodies=tuple(bodies)))
    together.step(ticks)
    for config in bodies:
        alone = World(WorldConfig(bodies=(config,)))
        alone.step(ticks)
        assert together.positions(config.name) == pytest.approx(
            alone.positions(config.name), abs=1e-12
        )


def stretch(q, weights):
    """Return a deviation from rest positions (n, 3) that keeps the volume: longer and thinner."""
    return q * (1.0, -0.5, -0.5)


def breathing(q, weights):
    """Return a deviation from rest positions (n, 3) that changes the volume."""
    return q


def wrinkle(q, weights):
    """Return the part of a fine pattern that no quadratic goal follows."""
    x, y, z = (q / np.abs(q).max()).T
    pattern = np.stack([x * y * z, x**3 * y, y**2 * z**2 * x], axis=1)
    ones = np.ones_like(x)
    known = np.stack([ones, x, y, z, x * x, y * y, z * z, x * y, y * z, z * x], axis=1)
    root = np.sqrt(weights)[:, None]
    return pattern - known @ np.linalg.lstsq(root * known, root * pattern, rcond=None)[0]


def totals(world):
    """Return momentum (3,), angular momentum about the origin (3,) and kinetic energy of all."""
    linear, angular, energy = np.zeros(3), np.zeros(3), 0.0
    for config in world.config.bodies:
        weights = config.mass * world.rest_shape(config.name).weights.astype(float)
        x, v = (f(config.name).astype(float) for f in (world.positions, world.velocities))
        linear += weights @ v
        angular += weights @ np.cross(x, v)
        energy += 0.5 * weights @ np.sum(v**2, axis=1)
    return linear, angular, energy


def sizes(world):
    """Return what momentum and angular momentum could at most be: to compare changes with."""
    linear = angular = 0.0
    for config in world.config.bodies:
        weights = config.mass * world.rest_shape(config.name).weights.astype(float)
        speed = np.linalg.norm(world.velocities(config.name), axis=1)
        linear += weights @ speed
        angular += weights @ (speed * np.linalg.norm(world.positions(config.name), axis=1))
    return linear, angular


def assert_kept(world, before, scale, tolerance=1e-9):
    """Assert that momentum and angular momentum are those before."""
    after = totals(world)
    # bodies at rest that are put into each other have no momentum before to compare with, but
    # forces: up to half a meganewton, of which the rounding remains
    assert np.linalg.norm(after[0] - before[0]) <= tolerance * scale[0] + 1e-11
    assert np.linalg.norm(after[1] - before[1]) <= tolerance * scale[1] + 1e-11
