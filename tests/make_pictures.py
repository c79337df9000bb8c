# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Draw the README's pictures: `python3 tests/make_pictures.py` (needs matplotlib).

The bodies are simulated by the core and drawn as flat shaded triangles: one alone back to front,
a scene by `raster`.
"""

from __future__ import annotations

import dataclasses
import pathlib

import matplotlib

matplotlib.use('Agg')
from matplotlib.collections import PolyCollection
import matplotlib.pyplot as plt
import numpy as np
import raster

from softbody_ros import parameters
from softbody_ros.bake.obstacle_surface import obstacle_surface
from softbody_ros.core import BodyConfig, Surface, World, WorldConfig, make_surface
from softbody_ros.scene_file import read_scene

PICTURES = pathlib.Path(__file__).parent.parent / 'resource'
FLOOR = np.array([0.93, 0.92, 0.9])
GREY = np.array([0.8, 0.82, 0.86])
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


def gallery(scenes, path):
    """Draw what has become of a body in each scene: (caption, config of the body, seconds)."""
    figure, axes = plt.subplots(1, len(scenes), figsize=(3.6 * len(scenes), 3.2), dpi=110)
    for panel, (caption, body, seconds) in zip(axes, scenes, strict=True):
        world = World(WorldConfig(bodies=(body,)))
        world.step(round(seconds * 240))
        panel.add_patch(matplotlib.patches.Rectangle((-5, -5), 30, 5.02, color='#e9e6e1'))
        moved = world.positions(body.name) - [body.position[0], 0.0, 0.0]
        draw_shadow(panel, moved)
        draw_body(panel, moved, world.rest_shape(body.name).surface.faces, ORANGE)
        panel.text(0.0, -0.42, caption, ha='center', color='#666', size=9)
        panel.set(xlim=(-1.35, 1.35), ylim=(-0.55, 1.85), aspect='equal')
        panel.axis('off')
    figure.subplots_adjust(0, 0, 1, 1, wspace=0)
    figure.savefig(path, bbox_inches='tight', pad_inches=0.05)
    plt.close(figure)


def bar(**settings):
    """Return a soft bar, held at its left end."""
    box = make_surface('box', 0.5, 5)
    surface = Surface(box.vertices * [2.4, 0.3, 0.3], box.faces)
    held = (-2.0, -1.0, -1.0, -1.1, 1.0, 1.0)
    place = (0.0, 0.0, 1.5)
    return BodyConfig(
        mesh=surface, stiffness=0.05, damping=0.02, pins_box=held, position=place, **settings
    )


def triangles_of(obstacle):
    """Return the corners of an obstacle's triangles, those of a plane far apart."""
    surface = obstacle_surface(obstacle.config, reach=30.0)
    return surface.vertices[surface.faces] @ obstacle.rotation.T + obstacle.position


def moment(scene, world):
    """Return a picture of the world of a scene as it is now."""
    corners, colors = [], []
    for obstacle in world.obstacles:
        corners.append(triangles_of(obstacle))
        color = FLOOR if obstacle.config.type == 'plane' else GREY
        colors.append(np.tile(color, (len(corners[-1]), 1)))
    for name in world.names:
        faces = world.rest_shape(name).surface.faces
        corners.append(world.positions(name)[faces])
        colors.append(np.tile(scene.appearances[name].color[:3], (len(faces), 1)))
    camera = raster.view(np.array([0.25, 1.0, -0.62]), [-2.9, -1.5], [2.35, 2.0], 236)
    picture = raster.shaded(np.concatenate(corners), np.concatenate(colors), camera)
    return raster.smaller(picture, 3)


def story(path, moments):
    """Draw moments of config/contact.yaml: (caption, seconds, angular velocity of the paddle)."""
    scene = parameters.make_scene(read_scene(str(PICTURES.parent / 'config' / 'contact.yaml')))
    world = World(scene.world)
    columns = 3
    figure, axes = plt.subplots(len(moments) // columns, columns, figsize=(12.4, 5.54), dpi=100)
    for panel, (caption, seconds, turn) in zip(axes.flat, moments, strict=True):
        world.configure(with_paddle(scene.world, turn))
        world.step(round(seconds / scene.world.time_step) - world.tick)
        panel.imshow(moment(scene, world), interpolation='none')
        panel.text(
            0.98, 0.03, caption, transform=panel.transAxes, ha='right', color='#444', size=9
        )
        panel.axis('off')
    figure.subplots_adjust(0, 0, 1, 1, wspace=0.01, hspace=0.015)
    figure.savefig(path, pad_inches=0)
    plt.close(figure)


def with_paddle(config, turn):
    """Return the config with another angular velocity of the paddle about z, rad/s."""
    turned = [
        dataclasses.replace(item, velocity_angular=(0.0, 0.0, turn))
        if item.name == 'paddle'
        else item
        for item in config.obstacles
    ]
    return dataclasses.replace(config, obstacles=tuple(turned))


if __name__ == '__main__':
    film_strip([0.0, 0.35, 0.46, 0.5, 0.55, 0.7, 10.0], PICTURES / 'ball.png')
    gallery(
        [
            ('a bar held at one end', bar(), 10.0),
            (
                'the same with 10 regions',
                bar(regions_count=10, regions_whole_body_weight=0.1),
                10.0,
            ),
            (
                'a ball that keeps its dent',
                BodyConfig(
                    subdivisions=4, regions_count=16, plasticity_creep=20.0, plasticity_yield=0.05
                ),
                5.0,
            ),
        ],
        PICTURES / 'bodies.png',
    )
    story(
        PICTURES / 'contact.png',
        [
            ('0 s', 0.0, 0.0),
            ('0.7 s', 0.7, 0.0),
            ('1.3 s', 1.3, 0.0),
            ('2 s', 2.0, 0.0),
            ('10 s', 10.0, 0.0),
            ('12 s, the paddle turns', 12.0, 1.0),
        ],
    )
