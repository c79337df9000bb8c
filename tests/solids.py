# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Closed surfaces, and what is known of the solids that they enclose."""

import functools

import numpy as np
import trimesh

from softbody_ros.core import Surface, make_surface
from softbody_ros.core.geometry.mesh import PRIMITIVES


def surface_of(mesh):
    """Return a trimesh as a surface."""
    return Surface(mesh.vertices, mesh.faces)


def box(extents, divisions=0, at=(0.0, 0.0, 0.0)):
    """Return a box with edges, m, each face in 2 · 4^divisions triangles, at a centre."""
    mesh = trimesh.creation.box(extents=extents)
    for _ in range(divisions):
        mesh = mesh.subdivide()
    return surface_of(mesh.apply_translation(at))


def cone(radius=1.0, height=2.0, sections=32, divisions=0):
    """Return a cone on the plane z = 0, a vertex of its base on the x axis."""
    mesh = trimesh.creation.cone(radius=radius, height=height, sections=sections)
    for _ in range(divisions):
        mesh = mesh.subdivide()
    return surface_of(mesh)


def joined(*meshes):
    """Return several closed surfaces as one."""
    return surface_of(trimesh.util.concatenate(meshes))


def hollow_ball(inner, subdivisions=3):
    """Return a ball of radius 1 with a cavity of that radius, whose surface faces inwards."""
    cavity = trimesh.creation.icosphere(subdivisions, radius=inner)
    cavity.invert()
    return joined(trimesh.creation.icosphere(subdivisions), cavity)


def l_shape(divisions=0):
    """Return an L, 3 m by 3 m, 1 m wide and high, on the plane z = 0."""
    outline = np.array([(0, 0), (3, 0), (3, 1), (1, 1), (1, 3), (0, 3)], dtype=float)
    vertices = [np.column_stack([outline, np.full(6, height)]) for height in (0.0, 1.0)]
    cap = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)]
    faces = [(a, c, b) for a, b, c in cap] + [(a + 6, b + 6, c + 6) for a, b, c in cap]
    for i in range(6):
        j = (i + 1) % 6
        faces += [(i, j, j + 6), (i, j + 6, i + 6)]
    mesh = trimesh.Trimesh(np.concatenate(vertices), faces, process=False)
    for _ in range(divisions):
        mesh = mesh.subdivide()
    return surface_of(mesh)


def hull(seed, count=30, extents=(1.0, 2.0, 0.3)):
    """Return the convex hull of random points."""
    points = np.random.default_rng(seed).normal(size=(count, 3)) * extents
    mesh = trimesh.convex.convex_hull(points)
    return surface_of(mesh)


def moved(surface, scale=1.0, offset=(0.0, 0.0, 0.0), turn=None):
    """Return a surface turned, scaled, and displaced by an offset, m."""
    turn = np.eye(3) if turn is None else turn
    return Surface(scale * surface.vertices @ turn.T + offset, surface.faces)


@functools.cache
def closed_surfaces():
    """Return named closed surfaces of all sorts."""
    turn = trimesh.transformations.rotation_matrix(0.7, (1.0, 2.0, 3.0))[:3, :3]
    ball, plate = trimesh.creation.icosphere(3), box((1.0, 0.7, 1e-3), 2)
    fin = trimesh.creation.box(extents=(1.0, 10.0, 0.01)).apply_translation((0.0, 6.0, 0.0))
    leaves = [
        trimesh.creation.box(extents=(0.5, 0.5, 0.001)).apply_translation((0.0, 0.0, 0.02 * k))
        for k in range(-100, 100)
    ]
    ends = [ball.copy().apply_translation((0.0, 0.0, z)) for z in (-5.0, 5.0)]
    shapes = {name: make_surface(name, 0.5, 2) for name in PRIMITIVES}
    return shapes | {
        'box of 8 vertices': box((1.0, 2.0, 3.0)),
        'tetrahedron': hull(3, 4),
        'cone': cone(divisions=2),
        'tall cone': cone(0.1, 3.0),
        'L': l_shape(),
        'fine L': l_shape(3),
        'plate': plate,
        'turned plate': moved(plate, turn=turn),
        'foil': box((1.0, 0.7, 1e-6)),
        'needle': box((1.0, 1e-4, 2e-4), 2),
        'turned needle': moved(box((1.0, 1e-3, 2e-3), 2), turn=turn),
        'thick ring': surface_of(trimesh.creation.torus(1.0, 0.5)),
        'thin ring': surface_of(trimesh.creation.torus(1.0, 0.01)),
        'hollow ball': hollow_ball(0.5),
        'thin-walled ball': hollow_ball(0.999),
        'ball with a fin': joined(ball, fin),
        'mass at the ends, area between': joined(*ends, *leaves),
        'two parts': joined(ball, ball.copy().apply_translation((0.0, 30.0, 0.0))),
        'off centre': moved(cone(), offset=(500.0, -200.0, 100.0), turn=turn),
        'micrometres': moved(l_shape(), 1e-6, turn=turn),
        'kilometres': moved(l_shape(), 1e3, turn=turn),
        **{f'hull {seed}': hull(seed) for seed in range(8)},
        **{f'small hull {seed}': moved(hull(seed, 8), 1e-3) for seed in range(8, 12)},
    }


def of_the_solid(surface):
    """Return volume, centre of mass (3,), and inertia tensor per mass (3, 3), by trimesh."""
    origin = surface.vertices.mean(axis=0)
    size = np.ptp(surface.vertices, axis=0).max()
    vertices = (surface.vertices - origin) / size
    mesh = trimesh.Trimesh(vertices, surface.faces, process=False, validate=False)
    inertia = np.asarray(mesh.moment_inertia) / mesh.volume
    return size**3 * mesh.volume, origin + size * mesh.center_mass, size**2 * inertia
