# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Draw the README's pictures: `python3 tests/make_pictures.py` (needs matplotlib).

The bodies are simulated by the core and drawn as flat shaded triangles, back to front.
"""

from __future__ import annotations

import pathlib

import matplotlib

matplotlib.use('Agg')
from matplotlib.collections import PolyCollection
import matplotlib.pyplot as plt
import numpy as np

from softbody_ros.core import BodyConfig, World, WorldConfig

PICTURES = pathlib.Path(__file__).parent.parent / 'resource'
ORANGE = np.array([0.93, 0.48, 0.2])
LIGHT = np.array([0.35, -0.55, 0.76])
# camera: x to the right, looking along +y, slightly from above
PITCH = np.radians(12)
RIGHT = np.array([1.0, 0.0, 0.0])
UP = np.array([0.0, np.sin(PITCH), np.cos(PITCH)])
FORWARD = np.array([0.0, np.cos(PITCH), -np.sin(PITCH)])


def draw_body(axes, vertices, faces, color):
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    order = np.argsort(-corners.mean(axis=1) @ FORWARD)
    brightness = 0.38 + 0.62 * np.clip(normals[order] @ LIGHT, 0.0, 1.0)
    screen = np.stack([corners[order] @ RIGHT, corners[order] @ UP], axis=-1)
    colors = np.clip(color * brightness[:, None], 0.0, 1.0)
    axes.add_collection(PolyCollection(screen, facecolors=colors, edgecolors=colors, lw=0.3))


def draw_shadow(axes, vertices):
    outline = vertices * [1.0, 1.0, 0.0]
    screen = np.stack([outline @ RIGHT, outline @ UP], axis=-1)
    centre, spread = screen.mean(axis=0), np.ptp(screen, axis=0) / 2
    softness = np.clip(1.0 - vertices[:, 2].min(), 0.25, 1.0)
    axes.add_patch(
        matplotlib.patches.Ellipse(centre, *(2.0 * spread), color='black', alpha=0.35 * softness)
    )


def film_strip(times, path):
    """Draw one body dropped by a metre, at several times in one row."""
    body = BodyConfig(name='ball', subdivisions=4, position=(0.0, 0.0, 1.5))
    world = World(WorldConfig(bodies=(body,)))
    faces = world.rest_shape('ball').surface.faces
    figure, axes = plt.subplots(figsize=(10, 3.6), dpi=110)
    axes.add_patch(matplotlib.patches.Rectangle((-5, -5), 30, 5.02, color='#e9e6e1', zorder=-2))
    for column, seconds in enumerate(times):
        world.step(round(seconds * 240) - world.tick)
        moved = world.positions('ball') + [1.32 * column, 0.0, 0.0]
        draw_shadow(axes, moved)
        draw_body(axes, moved, faces, ORANGE)
        axes.text(1.32 * column, -0.42, f'{seconds:.2f} s', ha='center', color='#666', size=9)
    axes.set(xlim=(-0.75, 1.32 * len(times) - 0.57), ylim=(-0.55, 2.05), aspect='equal')
    axes.axis('off')
    figure.savefig(path, bbox_inches='tight', pad_inches=0.05)
    plt.close(figure)


if __name__ == '__main__':
    film_strip([0.0, 0.35, 0.46, 0.5, 0.55, 0.7, 10.0], PICTURES / 'ball.png')
