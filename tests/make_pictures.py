# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Draw the README's pictures: `python3 tests/make_pictures.py`, or some of them: `… ball modes`.

The bodies are simulated by the core and drawn by `pictures`.
"""

from __future__ import annotations

import argparse
import dataclasses

import numpy as np
from pictures.drawing import (
    BLUE,
    ORANGE,
    SLATE,
    Paint,
    camera,
    checks,
    film,
    photo,
    segments,
    sheet,
    with_caption,
)
from PIL import Image
from scene_files import ROOT, scene

from softbody_ros.core import BodyConfig, Surface, World, WorldConfig, make_surface
from softbody_ros.scene.parameters import mesh_path

RESOURCE = ROOT / 'resource'
LYING = (0.0, 0.7071, 0.0, 0.7071)
"""An orientation in which z of the mesh is x of the world."""


def run_to(world: World, seconds: float) -> None:
    world.step(round(seconds / world.config.time_step) - world.tick)


def scene_and_colors(name: str) -> tuple[World, dict[str, Paint]]:
    made = scene(name)
    return World(made.world), {key: each.color for key, each in made.appearances.items()}


def ball() -> None:
    """A body drops by one metre, squashes like an egg and settles."""
    body = BodyConfig(
        name='ball', subdivisions=4, position=(0.0, 0.0, 1.5), orientation=(0.32, 0.12, 0.0, 0.94),
        initial_velocity_angular=(0.6, 0.0, 0.0),
        stiffness=0.14, bounciness=0.7, deformation=0.6, elasticity=0.9,
    )  # fmt: skip
    world = World(WorldConfig(bodies=(body,)))
    view = camera([0.0, 1.0, -0.22], [-1.2, -0.5], [1.4, 2.05], 170)
    frames = []
    for frame in range(115):
        run_to(world, frame * 0.02)
        picture = photo(world, {'ball': segments(ORANGE)}, view)
        frames.append(with_caption(picture, f'{world.time:.2f} s, at half speed', 15))
    film(frames, 40, RESOURCE / 'ball.gif')


def modes() -> None:
    """What each mode does when a bar is pushed aside, turned, and held in its middle."""
    bar = make_surface(mesh_path('package://softbody_ros/config/bar.obj'), 0.75, 0)
    foot, middle = (-1.0, -1.0, -1.0, 1.0, 1.0, -0.7), (-1.0, -1.0, -0.06, 1.0, 1.0, 0.06)
    view = camera([0.2, 1.0, -0.3], [-1.62, -0.5], [1.88, 1.75], 118)
    panels = []
    for mode, color, does in (
        ('rigid', SLATE, 'keeps its shape'),
        ('linear', BLUE, 'stretches and shears'),
        ('quadratic', ORANGE, 'bends and twists, too'),
    ):
        common = {'mesh': bar, 'mode': mode, 'stiffness': 0.2, 'deformation': 0.96}
        bodies = (
            BodyConfig(
                name='pushed', position=(-1.2, 0.0, 0.75), pins_box=foot,
                initial_velocity_linear=(3.2, 0.0, 0.0), **common,
            ),
            BodyConfig(
                name='turned', position=(-0.25, 0.0, 0.75), pins_box=foot,
                initial_velocity_angular=(0.0, 0.0, 14.0), **common,
            ),
            BodyConfig(
                name='held', position=(0.95, 0.0, 0.75), orientation=LYING, pins_box=middle,
                **common,
            ),
        )  # fmt: skip
        world = World(WorldConfig(bodies=bodies))
        run_to(world, 0.15)
        paints = dict.fromkeys(world.names, checks(color, 0.075))
        panels.append(with_caption(photo(world, paints, view), f'{mode}: {does}'))
    sheet(panels, 3).save(RESOURCE / 'modes.png', optimize=True)


def scenes() -> None:
    """A moment of each scene that is not shown elsewhere."""
    moments = {
        'sphere': 0.55,
        'cubes': 0.43,
        'twisting_bar': 0.1,
        'worm': 3.0,
        'mesh_file': 3.0,
    }
    panels = []
    for name, seconds in moments.items():
        world, colors = scene_and_colors(name)
        run_to(world, seconds)
        panels.append(with_caption(moment(world, colors), f'{name}.yaml', 15))
    sheet(panels, 5).save(RESOURCE / 'scenes.png', optimize=True)


def moment(world: World, colors: dict[str, Paint]) -> Image.Image:
    """Return a square picture that the bodies fill."""
    forward = np.array([0.3, 1.0, -0.4])
    points = np.concatenate([world.positions(name) for name in world.names])
    view = camera(forward, [0.0, 0.0], [1.0, 1.0], 1.0)
    seen = view.onto(points)[:, :2] / view.scale
    low, high = seen.min(axis=0), seen.max(axis=0)
    half = 0.72 * (high - low).max()
    middle = (low + high) / 2 - [0.0, 0.08 * half]
    return photo(world, colors, camera(forward, middle - half, middle + half, 122 / half))


def bodies() -> None:
    """A held bar, the same with regions, and a ball that keeps its dent."""
    held = (-2.0, -1.0, -1.0, -1.1, 1.0, 1.0)
    box = make_surface('box', 0.5, 5)
    bar = BodyConfig(
        name='body', mesh=Surface(box.vertices * [2.4, 0.3, 0.3], box.faces),
        stiffness=0.05, damping=0.02, pins_box=held, position=(0.0, 0.0, 1.5),
    )  # fmt: skip
    shown = {
        'a bar held at one end': (bar, checks(BLUE, 0.15), 10.0),
        'the same with 10 regions': (
            dataclasses.replace(bar, regions_count=10, regions_whole_body_weight=0.1),
            checks(BLUE, 0.15),
            10.0,
        ),
        'a ball that keeps its dent': (
            BodyConfig(
                name='body', subdivisions=4, regions_count=16, plasticity_creep=20.0,
                plasticity_yield=0.05,
            ),
            segments(ORANGE),
            5.0,
        ),
    }  # fmt: skip
    view = camera([0.0, 1.0, -0.22], [-1.4, -0.5], [1.4, 1.95], 145)
    panels = []
    for caption, (body, paint, seconds) in shown.items():
        world = World(WorldConfig(bodies=(body,)))
        run_to(world, seconds)
        panels.append(with_caption(photo(world, {'body': paint}, view), caption))
    sheet(panels, 3).save(RESOURCE / 'bodies.png', optimize=True)


def contact() -> None:
    """Moments of the scene contact.yaml; at last its paddle turns."""
    world, colors = scene_and_colors('contact')
    view = camera([0.25, 1.0, -0.62], [-2.9, -1.5], [2.35, 2.0], 79)
    moments = {0.0: 0.0, 0.7: 0.0, 1.3: 0.0, 2.0: 0.0, 10.0: 0.0, 12.0: 1.0}
    panels = []
    for seconds, turn in moments.items():
        world.configure(with_paddle(world.config, turn))
        run_to(world, seconds)
        caption = f'{seconds:g} s' + (', the paddle turns' if turn else '')
        panels.append(with_caption(photo(world, colors, view), caption, 15))
    sheet(panels, 3).save(RESOURCE / 'contact.png', optimize=True)


def viewer() -> None:
    """The page of the viewer (needs Chromium)."""
    from pictures.page import page

    page('contact', 330, 'body', (1100, 680)).save(RESOURCE / 'viewer.png', optimize=True)


def with_paddle(config: WorldConfig, turn: float) -> WorldConfig:
    """Return the config with another angular velocity of the paddle about z, rad/s."""
    turned = [
        dataclasses.replace(item, velocity_angular=(0.0, 0.0, turn))
        if item.name == 'paddle'
        else item
        for item in config.obstacles
    ]
    return dataclasses.replace(config, obstacles=tuple(turned))


PICTURES = {each.__name__: each for each in (ball, modes, scenes, bodies, contact, viewer)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('names', nargs='*', metavar='NAME', help=f'of {", ".join(PICTURES)}')
    names = parser.parse_args().names or list(PICTURES)
    for name in names:
        if name not in PICTURES:
            parser.error(f'there is no picture {name}: choose from {", ".join(PICTURES)}')
        PICTURES[name]()


if __name__ == '__main__':
    main()
