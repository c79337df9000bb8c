# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Draw the pictures of the pages: `python3 tools/make_pictures.py`, or some: `… ball modes`.

The bodies are simulated by the core and drawn by `pictures`.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import pathlib
import shutil
import tempfile

import numpy as np
from pictures.drawing import (
    BLUE,
    CREAM,
    ORANGE,
    SLATE,
    Paint,
    camera,
    checks,
    film,
    photo,
    segments,
    sheet,
    with_arrows,
    with_caption,
)
from PIL import Image
from scene_files import ROOT, file_of_page, scene
from scipy.spatial import cKDTree

from softbody_ros.core import (
    BodyConfig,
    ObstacleConfig,
    Surface,
    World,
    WorldConfig,
    make_surface,
)
from softbody_ros.scene.parameters import mesh_path

RESOURCE = ROOT / 'resource'
DEEP_RED = np.array([0.6, 0.03, 0.08])
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


def grasp() -> None:
    """Two fingers come, squeeze a soft ball and lift it; arrows are the forces on it."""
    radius, half = 0.05, (0.01, 0.02, 0.03)
    reach, height = radius + half[0] + 0.03, radius
    ball = BodyConfig(
        name='ball', size=radius, subdivisions=4, mass=0.2, stiffness=0.5, position=(0, 0, radius),
        friction_model='coulomb', friction=0.8,
    )  # fmt: skip
    sides = {'left': -1.0, 'right': 1.0}
    fingers = [
        ObstacleConfig(name=name, type='box', size=half, position=(side * reach, 0.0, height))
        for name, side in sides.items()
    ]
    ground = ObstacleConfig(
        name='ground', type='box', size=(1.0, 1.0, 0.05), position=(0.0, 0.0, -0.05)
    )
    world = World(
        WorldConfig(
            bodies=(ball,), obstacles=(ground, *fingers),
            reference_step=reference_step(40.0, 0.5),
        )
    )  # fmt: skip
    at, h = np.array([reach, height]), world.config.time_step

    def go(seconds: float, inwards: float, upwards: float) -> None:
        nonlocal at
        speed = np.array([-inwards, upwards]) / seconds
        for _ in range(round(seconds / h)):
            for name, side in sides.items():
                world.move_obstacle(
                    name, (side * at[0], 0.0, at[1]), linear=(side * speed[0], 0.0, speed[1])
                )
            world.step()
            at = at + h * speed
        for name, side in sides.items():
            world.move_obstacle(name, (side * at[0], 0.0, at[1]))

    view = camera([0.25, 1.0, -0.3], [-0.15, -0.08], [0.15, 0.2], 1080)
    panels, per_newton = [], 0.0025
    for caption, seconds, inwards, upwards in (
        ('the fingers come', 0.1, 0.005, 0.0),
        ('they squeeze', 0.6, 0.034, 0.0),
        ('friction holds it, lifted', 1.0, 0.0, 0.06),
    ):
        go(seconds, inwards, upwards)
        world.step(round(0.5 / h))
        arrows = []
        for name, side in (sides | {'ground': 0.0}).items():
            force = -world.obstacle_wrench(name)[0]
            size = np.linalg.norm(force)
            if size > 0.01:
                where = (side * (at[0] - half[0]), -0.06, at[1]) if side else (0.0, -0.06, 0.0)
                arrows.append((where - per_newton * force, per_newton * force, f'{size:.1f} N'))
        picture = with_arrows(photo(world, {'ball': segments(ORANGE)}, view), view, arrows)
        panels.append(with_caption(picture, caption))
    sheet(panels, 3).save(RESOURCE / 'grasp.png', optimize=True)


def pressure() -> None:
    """The pressure on a ball that two fingers hold, seen with and without one of them."""
    made = scene('gripper').world
    (ball,) = made.bodies
    ball = dataclasses.replace(ball, subdivisions=4)
    world = World(dataclasses.replace(made, bodies=(ball,)))

    def go(seconds: float, inwards: float, upwards: float) -> None:
        for name, sign in (('left', 1.0), ('right', -1.0)):
            place = next(item for item in world.obstacles if item.config.name == name).position
            world.move_obstacle(name, place, linear=(sign * inwards, 0.0, upwards))
        run_to(world, world.time + seconds)

    go(0.6, 0.05, 0.0)
    go(0.6, 0.0, 0.1)
    go(0.5, 0.0, 0.0)
    felt = world.pressure('ball')
    rest = cKDTree(world.rest_shape('ball').surface.vertices)

    def paint(points: np.ndarray) -> np.ndarray:
        distance, nearest = rest.query(points, 4)
        near = 1.0 / (distance + 1e-6)
        share = (near * felt[nearest]).sum(axis=1) / near.sum(axis=1) / felt.max()
        return heat(share[:, None])

    view = camera([0.8, 0.6, -0.25], [-0.17, -0.03], [0.17, 0.2], 1300)
    panels = [with_caption(photo(world, {'ball': paint}, view), 'held by two fingers')]
    world.remove('left')
    caption = f'what one of them presses on: up to {felt.max() / 1e3:.0f} kPa'
    panels.append(with_caption(photo(world, {'ball': paint}, view), caption))
    sheet(panels, 2).save(RESOURCE / 'pressure.png', optimize=True)


def heat(share: np.ndarray) -> np.ndarray:
    """Return colors (k, 3) from cream over orange to red for shares (k, 1) from 0 to 1."""
    low = CREAM + np.minimum(2.0 * share, 1.0) * (ORANGE - CREAM)
    return low + np.maximum(2.0 * share - 1.0, 0.0) * (DEEP_RED - ORANGE)


def reference_step(frequency: float, stiffness: float) -> float:
    """Return the `reference_step`, s, with which a stiffness is a natural frequency, Hz."""
    return math.acos(1.0 - stiffness / 2.0) / (2.0 * math.pi * frequency)


def stack() -> None:
    """Boxes that carry others: 1, 10 and 100 times as heavy, and a tower of five soft cubes."""
    ground, size, panels = ObstacleConfig(name='ground'), 0.1, []
    view = camera([0.35, 1.0, -0.25], [-0.75, -0.2], [0.75, 1.05], 250)
    common = {'size': size, 'friction_model': 'coulomb', 'friction': 0.5}
    block = make_surface('box', size, 4)
    bodies, paints = [], {}
    for place, ratio in enumerate((1.0, 10.0, 100.0)):
        for level, mass in enumerate((1.0, ratio)):
            name = f'rigid{place}{level}'
            position = (0.4 * (place - 1), 0.0, size + 2.0 * size * level)
            bodies.append(
                BodyConfig(
                    name=name, mesh=block, mode='rigid', mass=mass, position=position, **common
                )
            )
            paints[name] = np.array(SLATE if level and ratio > 1.0 else BLUE)
    world = World(WorldConfig(bodies=tuple(bodies), obstacles=(ground,)))
    run_to(world, 5.0)
    panels.append(with_caption(photo(world, paints, view), 'rigid: 1, 10 and 100 times as heavy'))
    for caption, ratios in (
        ('90 Hz: 1 and 10 times as heavy', (1.0, 10.0)),
        ('five at 40 Hz', (1.0,)),
    ):
        bodies, paints = [], {}
        levels = 5 if len(ratios) == 1 else 2
        for place, ratio in enumerate(ratios):
            for level in range(levels):
                name = f'soft{place}{level}'
                x = 0.5 * (place - 0.5) if len(ratios) > 1 else 0.0
                bodies.append(
                    BodyConfig(
                        name=name, mesh=block, mode='quadratic', stiffness=0.5,
                        mass=ratio if level else 1.0, position=(x, 0.0, size + 2.0 * size * level),
                        **common,
                    )
                )  # fmt: skip
                paints[name] = checks(ORANGE if level % 2 else BLUE, 0.05)
        frequency = 40.0 if levels == 5 else 90.0
        world = World(
            WorldConfig(
                bodies=tuple(bodies),
                obstacles=(ground,),
                reference_step=reference_step(frequency, 0.5),
            )
        )
        run_to(world, 5.0)
        panels.append(with_caption(photo(world, paints, view), caption))
    sheet(panels, 3).save(RESOURCE / 'stack.png', optimize=True)


def materials() -> None:
    """Small things of several materials fall and come to rest; then they are all of jelly."""
    world, colors = scene_and_colors('small_things')
    view = camera([0.25, 1.0, -0.45], [-0.16, -0.09], [0.2, 0.3], 980)
    panels = []
    for seconds, caption in ((0.0, 'from 20 cm'), (0.3, '0.3 s'), (2.0, 'at rest')):
        run_to(world, seconds)
        panels.append(with_caption(photo(world, colors, view), caption))
    jelly = {'young_modulus': 1500.0, 'mode': 'quadratic'}
    softened = tuple(dataclasses.replace(body, **jelly) for body in world.config.bodies)
    world.configure(dataclasses.replace(world.config, bodies=softened))
    world.reset()
    run_to(world, 0.26)
    panels.append(with_caption(photo(world, colors, view), 'all of 1.5 kPa, landing'))
    sheet(panels, 4).save(RESOURCE / 'materials.png', optimize=True)


def squeeze() -> None:
    """Forces of plates on a cube and on a ball, and those of elastic solids."""
    import matplotlib

    matplotlib.use('Agg')
    import matplotlib.pyplot as plt
    from squeezing import cube, forces_of_plates, hertz

    strains, modulus = np.linspace(0.02, 0.25, 12), 1e5
    figure, panels = plt.subplots(1, 2, figsize=(9, 3.4), layout='constrained')
    solids = {'cube': ('box', cube, 'E A ε'), 'ball': ('icosphere', hertz, 'Hertz')}
    for panel, (what, (mesh, law, label)) in zip(panels, solids.items(), strict=True):
        panel.plot(100 * strains, law(modulus, strains), 'k-', label=label)
        share = 0.25 if what == 'cube' else 1.0
        low, high = (1 - share, 1 + share) if what == 'cube' else (0.5, 2.0)
        panel.fill_between(
            100 * strains, low * law(modulus, strains), high * law(modulus, strains),
            color='0.92', label=f'{low:g} … {high:g} times that',
        )  # fmt: skip
        values = {'mesh': mesh, 'young_modulus': modulus, 'subdivisions': 3}
        for name, more, mark in (
            ('quadratic, 1/60 s', {}, 'o'),
            ('linear, 1/240 s', {'mode': 'linear'}, '+'),
            ('8 regions, 1/240 s', {'regions_count': 8}, 'x'),
        ):
            forces = forces_of_plates(strains, 1 / 60 if not more else 1 / 240, **values, **more)
            panel.plot(100 * strains, forces[:, 1], mark, label=name, fillstyle='none')
        panel.set(title=f'{what} of 10 cm, 100 kPa', xlabel='squeezed by / %', ylabel='force / N')
        panel.legend(frameon=False, fontsize=8)
    figure.savefig(RESOURCE / 'squeeze.png', dpi=100)


def plates() -> None:
    """A ball between plates bulges, and keeps its volume."""
    ground = ObstacleConfig(name='ground')
    view = camera([0.2, 1.0, -0.22], [-0.95, -0.25], [0.95, 1.4], 190)
    ball = BodyConfig(
        name='ball', subdivisions=4, position=(0.0, 0.0, 0.5), friction_model='coulomb',
        friction=0.5, volume_conservation=1.0,
    )  # fmt: skip
    plate = ObstacleConfig(
        name='plate', type='box', size=(0.7, 0.7, 0.03), position=(0.0, 0.0, 1.08)
    )
    world = World(WorldConfig(bodies=(ball,), obstacles=(ground, plate)))
    shape, h = world.rest_shape('ball'), world.config.time_step
    panels = []
    for share in (0.0, 0.3, 0.5):
        low, high = world.obstacles[1].position[2], 1.03 + 0.001 - share
        ticks = round(abs(high - low) / 0.25 / h)
        for tick in range(ticks):
            height = low + (high - low) * tick / ticks
            world.move_obstacle('plate', (0, 0, height), linear=(0, 0, (high - low) / ticks / h))
            world.step()
        world.move_obstacle('plate', (0.0, 0.0, high))
        world.step(round(1.0 / h))
        x = world.positions('ball')
        faces = shape.surface.faces
        volume = np.linalg.det(x[faces]).sum() / np.linalg.det(shape.surface.vertices[faces]).sum()
        wide = np.ptp(x[:, 0]) / np.ptp(shape.surface.vertices[:, 0])
        force = float(world.obstacle_wrench('plate')[0][2])
        arrow = [((0.0, -0.75, high + 0.33), (0.0, 0.0, -0.25), f'{force:.0f} N')]
        picture = photo(world, {'ball': segments(ORANGE)}, view)
        picture = with_arrows(picture, view, arrow if force > 0.1 else [])
        caption = f'{100 * share:.0f} %: volume {volume:.3f}, width {wide:.2f}'
        panels.append(with_caption(picture, caption))
    sheet(panels, 3).save(RESOURCE / 'plates.png', optimize=True)


def viewer() -> None:
    """The page of the viewer (needs Chromium)."""
    from pictures.page import page

    page('contact', 330, 'body', (1100, 680)).save(RESOURCE / 'viewer.png', optimize=True)


def sweep() -> None:
    """What the command draws of the spec in the page."""
    from softbody_ros.ensemble.sweep import main as sweep_main

    with tempfile.TemporaryDirectory() as folder:
        spec = pathlib.Path(folder) / 'bounce.yaml'
        spec.write_text(file_of_page('how_to/many_runs.md', 'bounce.yaml'))
        if sweep_main([str(spec), '-o', f'{folder}/bounce']):
            raise SystemExit(1)
        shutil.copy(f'{folder}/bounce/ball.highest_rebound.png', RESOURCE / 'sweep.png')


def with_paddle(config: WorldConfig, turn: float) -> WorldConfig:
    """Return the config with another angular velocity of the paddle about z, rad/s."""
    turned = [
        dataclasses.replace(item, velocity_angular=(0.0, 0.0, turn))
        if item.name == 'paddle'
        else item
        for item in config.obstacles
    ]
    return dataclasses.replace(config, obstacles=tuple(turned))


DRAWN = (
    ball,
    modes,
    scenes,
    bodies,
    contact,
    grasp,
    pressure,
    stack,
    plates,
    materials,
    squeeze,
    viewer,
    sweep,
)
PICTURES = {each.__name__: each for each in DRAWN}


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
