# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Make the mesh files of `config`: `python3 tools/make_meshes.py` (needs scikit-image).

Each is the surface where a distance is zero: found by marching cubes, evened out, and put back
onto the surface.
"""

from __future__ import annotations

from collections.abc import Callable
import pathlib

import numpy as np
from skimage.measure import marching_cubes
import trimesh

CONFIG = pathlib.Path(__file__).parent.parent / 'config'
Distance = Callable[[np.ndarray], np.ndarray]


def ball(centre, radii) -> Distance:
    """Return the distance from an ellipsoid, right near it."""
    radii = np.asarray(radii, dtype=float)

    def distance(points):
        scaled = (points - centre) / radii
        length = np.linalg.norm(scaled, axis=-1)
        slope = np.linalg.norm(scaled / radii, axis=-1)
        return length * (length - 1.0) / np.maximum(slope, 1e-9)

    return distance


def united(*parts: Distance, blend: float) -> Distance:
    """Return the distance from parts that flow into each other over a length `blend`."""

    def distance(points):
        result = parts[0](points)
        for part in parts[1:]:
            other = part(points)
            near = np.maximum(blend - abs(result - other), 0.0) / blend
            result = np.minimum(result, other) - blend * near**2 / 4.0
        return result

    return distance


def above(part: Distance, height: float, blend: float) -> Distance:
    """Return the distance from what of a part is above a height; its edge is rounded."""

    def distance(points):
        inside, floor = part(points), height - points[..., 2]
        near = np.maximum(blend - abs(inside - floor), 0.0) / blend
        return np.maximum(inside, floor) + blend * near**2 / 4.0

    return distance


def surface(distance: Distance, low, high, pitch: float) -> trimesh.Trimesh:
    """Return the closed surface of what is between two corners, with edges of about `pitch`."""
    low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    axes = [np.arange(*bounds, pitch) for bounds in zip(low, high + pitch, strict=True)]
    field = distance(np.stack(np.meshgrid(*axes, indexing='ij'), axis=-1))
    vertices, faces, _, _ = marching_cubes(field, 0.0, spacing=(pitch,) * 3)
    mesh = trimesh.Trimesh(vertices + low, faces)
    for _ in range(12):
        trimesh.smoothing.filter_laplacian(mesh, lamb=0.5, iterations=1, volume_constraint=False)
        for _ in range(3):
            mesh.vertices = onto(distance, mesh.vertices)
    return mesh


def onto(distance: Distance, points: np.ndarray, reach: float = 1e-4) -> np.ndarray:
    """Return points moved along the gradient to where the distance is zero."""
    steps = reach * np.eye(3)
    slope = np.stack([distance(points + s) - distance(points - s) for s in steps], axis=-1)
    slope /= 2.0 * reach
    square = np.maximum(np.sum(slope**2, axis=-1), 1e-6)
    return points - (distance(points) / square)[:, None] * slope


def duck() -> Distance:
    """Return a bath duck that looks along x."""
    body = united(
        ball((0.0, 0.0, 0.0), (0.62, 0.46, 0.40)),
        ball((-0.52, 0.0, 0.20), (0.26, 0.20, 0.17)),  # tail
        ball((-0.72, 0.0, 0.34), (0.12, 0.12, 0.09)),
        ball((-0.10, 0.42, 0.08), (0.34, 0.12, 0.20)),  # wings
        ball((-0.10, -0.42, 0.08), (0.34, 0.12, 0.20)),
        blend=0.22,
    )
    head = united(body, ball((0.34, 0.0, 0.62), (0.36, 0.34, 0.34)), blend=0.25)
    beak = ball((0.69, 0.0, 0.56), (0.25, 0.21, 0.13))
    eyes = [ball((0.58, side, 0.76), (0.08, 0.07, 0.09)) for side in (-0.2, 0.2)]
    return above(united(head, beak, *eyes, blend=0.10), -0.30, 0.08)


def worm() -> trimesh.Trimesh:
    """Return a worm of length 2 along z, with rings; its tail is thinner than its head."""
    along = np.linspace(0.0, 1.0, 49)
    radius = 0.105 - 0.04 * along**2 + 0.006 * np.cos(2.0 * np.pi * 12.0 * along)
    ends = np.sqrt(1.0 - (2.0 * along - 1.0) ** 12)
    # closer together at the ends, which are round
    height = 1.4 * along + 0.3 * (1.0 - np.cos(np.pi * along))
    profile = np.stack([radius * ends, height], axis=-1)
    return trimesh.creation.revolve(profile, sections=14)


def bar() -> trimesh.Trimesh:
    """Return a bar of 2 by 0.4 by 0.4 along z."""
    counts, half = np.array([4, 4, 20]), np.array([0.2, 0.2, 1.0])
    sides = []
    for axis in range(3):
        across, along = (axis + 1) % 3, (axis + 2) % 3
        u, v = np.meshgrid(np.arange(counts[across] + 1), np.arange(counts[along] + 1))
        corner = np.arange(u.size).reshape(u.shape)
        a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]
        faces = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
        for side, faces_out in ((0, faces[:, ::-1]), (counts[axis], faces)):
            place = np.full((u.size, 3), side)
            place[:, across], place[:, along] = u.ravel(), v.ravel()
            sides.append(trimesh.Trimesh(half * (2.0 * place / counts - 1.0), faces_out))
    mesh = trimesh.util.concatenate(sides)
    mesh.merge_vertices()
    return mesh


def write(mesh: trimesh.Trimesh, name: str) -> None:
    """Write an OBJ file: text, so that a change of a mesh can be read."""
    assert mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0.0
    lines = ['# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers']
    lines += ['# SPDX-License-Identifier: Apache-2.0', '# made by tools/make_meshes.py']
    lines += ['v ' + ' '.join(f'{value:.4f}' for value in vertex) for vertex in mesh.vertices]
    lines += ['f ' + ' '.join(str(index + 1) for index in face) for face in mesh.faces]
    (CONFIG / name).write_text('\n'.join(lines) + '\n')


if __name__ == '__main__':
    write(surface(duck(), (-1.1, -0.8, -0.5), (1.2, 0.8, 1.2), 0.06), 'duck.obj')
    write(worm(), 'worm.obj')
    write(bar(), 'bar.obj')
