# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Everything is compiled before a simulation starts, instead of in the midst of it.

`python3 -m softbody_ros.core.warm_up` does only that, e.g. while an image is built.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
import os
import signal
import subprocess
import sys
import time

import numpy as np

from softbody_ros.core import compiled
from softbody_ros.core.collision.point_obstacles import PointObstacles
from softbody_ros.core.collision.shapes import make_shape
from softbody_ros.core.config import OBSTACLE_TYPES, BodyConfig, ObstacleConfig, WorldConfig
from softbody_ros.core.contact.members import MEMBER
from softbody_ros.core.contact.rows import ROW
from softbody_ros.core.external_inputs import ROBOT, ObstacleUpdate
from softbody_ros.core.geometry.surface import Surface
from softbody_ros.core.kinematic_tree import FRAME, TURNS, motion_of, motions
from softbody_ros.core.links import LinkShape, placements
from softbody_ros.core.world import World

SPACING = 3.0
"""Between the obstacles of a world with each kind of them, m."""
SHEET = Surface(
    np.array([(0.0, 0.0, 0.0), (0.3, 0.0, 0.0), (0.0, 0.3, 0.0), (0.3, 0.3, 0.0)]),
    np.array([(0, 1, 2), (1, 3, 2)]),
)
ROD = Surface(np.array([(0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.3, 0.0, 0.0)]), np.zeros((0, 3), int))
SECOND_PROCESS = """
from softbody_ros.core.warm_up import compile_other_half
compile_other_half({parent})
"""
BODIES: tuple[dict, ...] = (
    {'mode': 'rigid'},
    {'mode': 'linear', 'friction_model': 'viscous', 'volume_conservation': 0.0},
    {'mode': 'quadratic', 'damping': 0.1, 'thickness': 0.01},
    {'mode': 'linear', 'regions_count': 4, 'plasticity_creep': 20.0, 'plasticity_yield': 0.0},
    {'mode': 'quadratic', 'regions_count': 4, 'pins_indices': (0, 1)},
    {'mode': 'quadratic', 'plasticity_creep': 20.0, 'plasticity_yield': 0.0},
    {'mode': 'linear', 'pins_indices': (0,), 'pins_velocity_angular': (0.0, 0.0, 1.0)},
    {'mode': 'rigid', 'pins_indices': (0, 1)},
    {'mesh': SHEET, 'mode': 'quadratic'},
    {'mesh': ROD, 'mode': 'linear'},
)
"""What differs from one kind of body to the next."""


def compile_ahead(
    say: Callable[[str], None],
    warn: Callable[[str], None],
    is_stopped: Callable[[], bool] = lambda: False,
) -> bool:
    """
    Compile what this machine has no machine code of yet; takes no time if that is nothing.

    Parameters
    ----------
    say : callable
        is given a sentence before and one after; on a terminal the share that is done is shown
        besides
    warn : callable
        is given a sentence if simulations, or all starts, are slow
    is_stopped : callable
        whether the program is to end

    Returns
    -------
    bool
        whether it was not stopped.

    """
    if compiled.is_compiled() and not compiled.is_complete():
        begin = time.monotonic()
        say('compiling the simulator for this machine, once: this takes about a minute')
        try:
            _compile(is_stopped)
        except KeyboardInterrupt:
            return False
        say(f'compiled in {time.monotonic() - begin:.0f} s')
    if compiled.notice():
        warn(compiled.notice())
    return True


def _compile(is_stopped: Callable[[], bool]) -> None:
    from tqdm import tqdm  # here: on most starts nothing is compiled

    # disable=None: no bar where nobody looks
    with tqdm(
        total=100, unit='%', leave=False, disable=None, miniters=0,
        bar_format='{desc}: {percentage:.0f} %, {elapsed}', desc='compiling',
    ) as bar:  # fmt: skip

        def note(share: float) -> None:
            if is_stopped():
                raise KeyboardInterrupt
            bar.update(100.0 * share - bar.n)

        with _second_process() as second, compiled.compilations(note):

            def wait() -> None:
                while second is not None and second.poll() is None:
                    note(0.0)
                    time.sleep(0.05)

            warm_up(wait)
    compiled.mark_complete()


@contextmanager
def _second_process() -> Iterator[subprocess.Popen | None]:
    """
    Let another process compile a half meanwhile, if there is a processor for it.

    It fills the cache, from which this one takes what is ready when the other one has ended,
    however far it got.
    """
    if _processors() < 2 or compiled.cache_folder() is None:
        yield None
        return
    try:
        process = subprocess.Popen(
            [sys.executable, '-P', '-c', SECOND_PROCESS.format(parent=os.getpid())],
            env=os.environ | {'PYTHONPATH': os.pathsep.join(sys.path)},
            stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
    except OSError:  # e.g. too little memory
        yield None
        return
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def _processors() -> int:
    if hasattr(os, 'sched_getaffinity'):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def compile_other_half(parent: int) -> None:
    """
    Compile the solution of all contacts, as long as the parent lives.

    It takes as long as all else does, and `warm_up` needs it last.
    """

    def note(_: float) -> None:
        if os.getppid() != parent:
            raise KeyboardInterrupt

    with suppress(KeyboardInterrupt), compiled.compilations(note):
        world = everything()
        integrator, environment = world._integrator, world._environment
        integrator.resolve_rows(
            np.zeros(0, MEMBER), np.zeros(0, ROW), environment, world.config.time_step
        )


def warm_up(before_contact: Callable[[], None] = lambda: None) -> None:
    """
    Run every kernel: step small worlds in which everything happens that happens in worlds.

    Parameters
    ----------
    before_contact : callable
        waits for the second process, if there is one

    """
    # first what is not left to a second process
    world = everything()
    every, environment = np.arange(len(world.names)), world._environment
    world._integrator.fly(every, environment.gravity, world.config.time_step)
    world._integrator.find_rows(every, environment, world.config.time_step)
    world.rigid_fit(world.names[0])
    world.poke(world.positions(world.names[0])[0], 0.1, 0.5)
    fine = BodyConfig(mesh='box', subdivisions=0, visual_mesh='icosphere')
    World(WorldConfig(bodies=(fine,))).visual_positions(fine.name)
    before_contact()

    world = everything()
    world.step(2)
    before = world.snapshot()
    world.set_points(PointObstacles(np.array([(0.0, 0.0, 0.45), (0.3, 0.0, 0.5)]), 0.05))
    guest = ObstacleConfig(name='guest', type='sphere', position=(0.0, 0.0, 0.2))
    world.change_obstacles([ObstacleUpdate(('guests', 1), guest)])
    _move_a_link(world)
    world.apply_wrench(None, (0.0, 0.0, 1.0), (0.0, 0.1, 0.0), 1.0)
    world.apply_wrench(world.names[0], (1.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0, in_body_axes=True)
    world.override_gravity((0.0, 1.0, -9.0), 1.0)
    for name in world.names:
        fit = world.rigid_fit(name)
        world.poke(world.positions(name)[0], 0.1, 0.5)
        world.place(name, fit.position, fit.rotation)
        world.set_twist(name, np.zeros(3), np.ones(3))
    world.step(2)
    for name in world.names:
        world.contact_wrench(name), world.permanent_strain(name), world.velocities(name)
    world.configure(world.config)
    world.restore(before)
    world.reset()
    world.step()

    # rigid bodies that touch no soft ones
    blocks = [_body(i, (0.0, 0.0, 0.29 + 0.58 * i), mesh='box', mode='rigid') for i in range(2)]
    World(WorldConfig(bodies=tuple(blocks))).step(2)
    # a body is pushed into a third one, so that the tick is computed once more
    velocities = (9.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    row = [
        _body(i, (0.61 * i, 0.0, 9.0), mode='rigid', initial_velocity_linear=velocity)
        for i, velocity in enumerate(velocities)
    ]
    World(WorldConfig(bodies=tuple(row))).step(2)

    resting = World(
        WorldConfig(
            time_step=0.05,
            bodies=tuple(_body(i, (i, 0.0, 0.3), **kind) for i, kind in enumerate(BODIES[:3])),
        )
    )
    resting.step(30)  # until they sleep
    resting.apply_wrench(resting.names[0], (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), 0.1)
    resting.step()


def _move_a_link(world: World) -> None:
    """Let a link of a robot follow its joint."""
    frames, config = np.zeros(1, FRAME), ObstacleConfig(name='link', type='sphere')
    frames['parent'], frames['kind'], frames['axis'] = -1, TURNS, (0.0, 0.0, 1.0)
    frames['rotation'] = np.eye(3)
    shapes = [LinkShape((f'{ROBOT}link', 0), 'link', config, make_shape(config), 0)]
    for angle in (0.0, 0.1):
        root = motion_of((9.0, 0.0, 0.0), np.eye(3))
        moving = motions(frames, np.array([(angle, 1.0)]), root)
        present, h = world.external_inputs.dynamic_obstacles, world.config.time_step
        world.change_obstacles(placements(shapes, moving, present, world.tick, h, h, 1.0))


def everything(subdivisions: int = 1) -> World:
    """Return a world in which each kind of body touches others, and each kind of obstacle."""
    bodies: list[BodyConfig] = []
    obstacles: list[ObstacleConfig] = []
    for column, shape in enumerate(OBSTACLE_TYPES):
        x = SPACING * column
        obstacles.append(
            ObstacleConfig(
                name=shape, type=shape, mesh='box', subdivisions=0, size=(0.5, 0.5, 0.5),
                position=(x, 0.0, 0.0), velocity_angular=(0.0, 0.0, 0.1 * column),
            )
        )  # fmt: skip
        # a plane lies at 0; the tops of the others at 0.5, of a standing capsule at 1
        z = {'plane': 0.0, 'capsule': 1.0}.get(shape, 0.5) + 0.29
        for place in range(3):
            number = len(bodies)
            position = (x - 0.2 + 0.25 * (place % 2), 0.1 * place, z + 0.5 * place)
            kind = BODIES[number % len(BODIES)]
            bodies.append(_body(number, position, subdivisions, **kind))
    return World(WorldConfig(bodies=tuple(bodies), obstacles=tuple(obstacles)))


def _body(
    number: int, position: tuple[float, ...], subdivisions: int = 1, **kind: object
) -> BodyConfig:
    facts: dict = {'name': f'body{number}', 'size': 0.3, 'subdivisions': subdivisions}
    return BodyConfig(position=position, **facts | kind)


if __name__ == '__main__':
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    tell = partial(print, file=sys.stderr)
    compile_ahead(tell, tell)
