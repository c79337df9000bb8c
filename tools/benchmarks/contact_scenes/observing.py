# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Shapes, motions of obstacles and measurements that several scenes use."""

from __future__ import annotations

from collections import deque
import math

import numpy as np
import trimesh

from softbody_ros.core import MeanWrenches, ObstacleConfig, Surface, make_surface

GROUND = ObstacleConfig(name='ground')


# ----------------------------------------------------------------------------------------- shapes
def cuboid(half_extents, subdivisions=3):
    """Return the surface of a box."""
    cube = make_surface('box', 1.0, subdivisions)
    return Surface(cube.vertices * half_extents, cube.faces)


def about_y(degrees):
    """Return a rotation as a quaternion x y z w: a positive one tilts the z axis towards x."""
    half = math.radians(degrees) / 2
    return 0.0, math.sin(half), 0.0, math.cos(half)


def about_z(degrees):
    """Return a rotation as a quaternion x y z w: a positive one turns the x axis towards y."""
    half = math.radians(degrees) / 2
    return 0.0, 0.0, math.sin(half), math.cos(half)


# ------------------------------------------------------------------------------------------- time
def stepped(world, seconds, every=1):
    """Step a world for some time and yield the time since the start, s, `every` ticks."""
    h = world.config.time_step
    for number in range(1, max(round(seconds / h / every), 1) + 1):
        world.step(every)
        yield number * every * h


def driven(world, paths, seconds):
    """
    Step a world while obstacles follow paths, and yield the time since the start, s, each tick.

    Parameters
    ----------
    world : World
    paths : dict
        by the name of an obstacle, a function of the time, s, that returns its position, (3,), m
    seconds : float

    """
    h, end = world.config.time_step, 0.0
    for number in range(max(math.ceil(seconds / h - 1e-9), 1)):
        start, end = number * h, (number + 1) * h
        for name, path in paths.items():
            world.move_obstacle(name, path(start), linear=(path(end) - path(start)) / h)
        world.step()
        yield end
    for name, path in paths.items():
        world.move_obstacle(name, path(end))


def run(ticks):
    """Take all ticks of `stepped` or `driven`."""
    deque(ticks, maxlen=0)


# ----------------------------------------------------------------------------------------- forces
def mean_forces(world, names, ticks):
    """Return the mean force (3,) on each of some obstacles while ticks are taken, N."""
    means = MeanWrenches(world)
    run(ticks)
    return [means.obstacle_wrench(name)[0] for name in names]


def mean_contact_force(world, name, seconds):
    """Return the mean force (3,) of all contacts of a body, N."""
    means = MeanWrenches(world)
    run(stepped(world, seconds))
    return means.contact_wrench(name)[0]


def carried_by_ground(world, seconds):
    """Return the mean force with which bodies press on the obstacle `ground`, N."""
    return -float(mean_forces(world, ['ground'], stepped(world, seconds))[0][2])


# ----------------------------------------------------------------------------------------- motion
def weights(world, name):
    """Return the share of its mass that each particle of a body has, (n,)."""
    return world.rest_shape(name).weights


def centre(world, name='body'):
    """Return the centre of mass, (3,), m."""
    return weights(world, name) @ world.positions(name)


def velocity(world, name='body'):
    """Return the velocity of the centre of mass, (3,), m/s."""
    return weights(world, name) @ world.velocities(name)


def fastest(world, name='body'):
    """Return the speed of the fastest particle, m/s."""
    return float(np.linalg.norm(world.velocities(name), axis=1).max())


def momentum(world):
    """Return the momentum (3,), kg m/s, and the angular momentum about the origin (3,), N m s."""
    linear, angular = np.zeros(3), np.zeros(3)
    for name in world.names:
        masses = world.body_config(name).mass * weights(world, name)
        x, v = world.positions(name), world.velocities(name)
        linear += masses @ v
        angular += masses @ np.cross(x, v)
    return linear, angular


def kinetic_energy(world):
    """Return the kinetic energy of all bodies, J."""
    return sum(
        0.5 * world.body_config(name).mass * weights(world, name)
        @ np.sum(world.velocities(name) ** 2, axis=1)
        for name in world.names
    )  # fmt: skip


# ------------------------------------------------------------------------------------------ shape
def tilt(world, name='body', normal=(0.0, 0.0, 1.0)):
    """Return the angle between the body's own z axis and a normal, in degrees."""
    cosine = world.rigid_fit(name).rotation[:, 2] @ normal
    return math.degrees(math.acos(np.clip(cosine, -1.0, 1.0)))


def rms_deformation(world, name='body'):
    """Return the RMS distance from the rest shape at its best pose, over the body's size, %."""
    squares = world.rigid_fit(name).displacement ** 2
    return 100 * math.sqrt(weights(world, name) @ squares) / world.body_config(name).size


def volume(world, name='body'):
    """Return the enclosed volume relative to that of the rest shape."""
    surface = world.rest_shape(name).surface
    return _volume(world.positions(name), surface.faces) / _volume(surface.vertices, surface.faces)


def _volume(vertices, faces):
    a, b, c = vertices[faces.T]
    return float(np.einsum('ij,ij->', np.cross(a, b), c)) / 6


def overlap(world, name, other):
    """Return how deep the deepest vertex of each of two bodies is inside the other, m."""
    return max(_depth(world, name, other), _depth(world, other, name))


def _depth(world, name, other):
    """Return how deep the deepest vertex of a body is inside another, m."""
    points, vertices = world.positions(name), world.positions(other)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    points = points[((points > low) & (points < high)).all(axis=1)]
    mesh = trimesh.Trimesh(vertices, world.rest_shape(other).surface.faces, process=False)
    points = points[[_is_inside(point, mesh.triangles) for point in points]]
    if not len(points):
        return 0.0
    return float(trimesh.proximity.closest_point_naive(mesh, points)[1].max())


def _is_inside(point, triangles):
    """
    Return whether triangles (m, 3, 3) wind about a point, by the sum of their solid angles.

    Van Oosterom and Strackee (1983), The solid angle of a plane triangle, eq. 8.
    """
    a, b, c = np.moveaxis(triangles - point, 1, 0)
    la, lb, lc = (np.linalg.norm(each, axis=1) for each in (a, b, c))
    determinant = np.einsum('ij,ij->i', a, np.cross(b, c))
    products = [np.einsum('ij,ij->i', *pair) for pair in ((a, b), (b, c), (c, a))]
    denominator = la * lb * lc + products[0] * lc + products[1] * la + products[2] * lb
    return np.arctan2(determinant, denominator).sum() > np.pi
