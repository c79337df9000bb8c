# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Coarse bodies touch with their edges: crossed planks have no vertex where they meet."""

from core_helpers import (
    assert_goes_on_bit_by_bit,
    assert_kept,
    body,
    centre,
    floating,
    momentum,
    sizes,
    totals,
)
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from solids import box

from softbody_ros.core import BodyConfig, Surface, World, WorldConfig, make_surface

MODES = ('rigid', 'linear', 'quadratic')
PLANK = 1.0, 0.2, 0.2


def plank(name, position, turn=(0.0, 0.0, 0.0), size=PLANK, **values):
    """Return a box of 8 vertices, turned by a rotation vector in degrees."""
    orientation = Rotation.from_rotvec(turn, degrees=True).as_quat()
    return body(name=name, mesh=box(size), mesh_scale=1.0, position=position,
                orientation=orientation, **values)  # fmt: skip


def on_ground(*bodies, h=1 / 120):
    return World(WorldConfig(time_step=h, bodies=bodies))


def weight_on(world, name):
    return world.contact_wrench(name)[0] / 9.81


@pytest.mark.parametrize('h', [1 / 60, 1 / 240])
@pytest.mark.parametrize('angle', [90.0, 30.0, 4.0])
@pytest.mark.parametrize('mode', MODES)
def test_a_plank_lies_across_another_one(mode, angle, h):
    # of 1 kg each; soft ones bend and flatten under their weight
    lower = plank('lower', (0.0, 0.0, 0.1), mode=mode)
    upper = plank('upper', (0.0, 0.0, 0.32), (0.0, 0.0, angle), mode=mode)
    world = on_ground(lower, upper, h=h)
    world.step(round(3 / h))
    assert centre(world, 'upper')[:2] == pytest.approx(0.0, abs=1e-3)
    assert weight_on(world, 'upper') == pytest.approx([0.0, 0.0, 1.0], abs=2e-3)
    if mode == 'rigid':
        assert centre(world, 'upper')[2] == pytest.approx(0.3, abs=1e-5)
        assert world.is_asleep('upper')
    else:
        assert centre(world, 'upper')[2] > 0.28


@pytest.mark.parametrize('mode', ['rigid', 'quadratic'])
def test_layers_of_laths_stand_and_fall_asleep(mode):
    width = 0.08
    bodies = []
    for layer in range(4):
        for place in range(3):
            x, y = (0.35 * (place - 1), 0.0) if layer % 2 else (0.0, 0.35 * (place - 1))
            bodies.append(
                plank(
                    f'lath_{layer}_{place}',
                    (x, y, width * (layer + 0.5)),
                    (0.0, 0.0, 90.0 * (layer % 2)),
                    size=(1.0, width, width),
                    mode=mode,
                )
            )
    world = on_ground(*bodies)
    world.step(480)
    assert all(world.is_asleep(config.name) for config in bodies)
    heights = [centre(world, f'lath_{layer}_1')[2] for layer in range(4)]
    sag = 1e-5 if mode == 'rigid' else 0.2 * width
    assert np.diff(heights) == pytest.approx(width, abs=sag)


@pytest.mark.parametrize('mode', ['rigid', 'quadratic'])
def test_a_plank_balances_on_a_narrow_pier(mode):
    # the vertices of the plank are beyond the pier, those of the pier beside the plank
    pier = plank('pier', (0.0, 0.0, 0.3), size=(0.2, 0.6, 0.6), mode='rigid',
                 pins_box=(-0.1, -0.3, -0.3, 0.1, 0.3, 0.3))  # fmt: skip
    world = on_ground(pier, plank('plank', (0.05, 0.0, 0.65), size=(1.0, 0.4, 0.1), mode=mode))
    world.step(240)
    assert centre(world, 'plank') == pytest.approx((0.05, 0.0, 0.65), abs=1e-3)
    assert world.is_asleep('plank')


@pytest.mark.parametrize('elasticity', [0.0, 0.5, 1.0])
@pytest.mark.parametrize('speed', [1.0, 20.0])
def test_edges_that_meet_rebound_with_the_elasticity(speed, elasticity):
    # edge on edge, both standing on these; above their centres, so that they do not turn
    one = plank('one', (0.0, 0.0, 0.0), (45.0, 0.0, 0.0), mode='rigid', elasticity=elasticity)
    two = plank('two', (0.0, 0.0, 0.5), (0.0, 45.0, 0.0), size=(0.2, 1.0, 0.2), mode='rigid',
                elasticity=elasticity, initial_velocity_linear=(0.0, 0.0, -speed))  # fmt: skip
    world = floating(one, two, h=1 / 240)
    world.step(round(0.4 * 240 / speed))
    apart = momentum(world, 'two') - momentum(world, 'one')
    assert apart == pytest.approx((0.0, 0.0, elasticity * speed), abs=1e-3 * speed)


@pytest.mark.parametrize('mode', MODES)
@pytest.mark.parametrize('speed', [1.0, 8.0])
def test_edges_that_meet_anywhere_keep_the_momenta_and_do_not_pass(speed, mode):
    one = plank('one', (0.0, 0.0, 0.0), (45.0, 0.0, 0.0), mode=mode)
    two = plank('two', (0.15, 0.1, 0.5), (10.0, 45.0, 0.0), size=(0.2, 1.0, 0.2), mode=mode,
                initial_velocity_linear=(0.3, 0.2, -speed))  # fmt: skip
    world = floating(one, two, h=1 / 240)
    before, scale = totals(world), sizes(world)
    for _ in range(round(0.6 * 240 / speed)):
        world.step()
        assert_kept(world, before, scale)
        assert totals(world)[2] <= before[2] * (1.0 + 1e-9)
        assert centre(world, 'two')[2] > centre(world, 'one')[2] + 0.1
    assert momentum(world, 'two')[2] > momentum(world, 'one')[2]


def test_the_order_of_crossed_bodies_does_not_matter():
    bodies = [
        plank('a', (0.0, 0.0, 0.1), mode='rigid'),
        plank('b', (0.05, 0.1, 0.31), (0.0, 0.0, 80.0), mode='rigid'),
        plank('c', (-0.02, 0.05, 0.52), (0.0, 0.0, 20.0), mode='linear'),
    ]
    one, two = on_ground(*bodies), on_ground(*bodies[::-1])
    one.step(60), two.step(60)
    for name in 'abc':
        assert one.positions(name) == pytest.approx(two.positions(name), abs=1e-7)


def test_crossed_planks_that_are_saved_and_restored_go_on_bit_by_bit():
    world = on_ground(
        plank('lower', (0.0, 0.0, 0.1), mode='rigid'),
        plank('upper', (0.1, 0.05, 0.35), (5.0, 10.0, 70.0), mode='quadratic'),
    )
    assert_goes_on_bit_by_bit(world, 60)


@pytest.mark.parametrize('turn', [0.0, 20.0])
def test_edges_do_not_catch_where_a_box_slides_from_one_to_the_next(turn):
    values = {'mode': 'rigid', 'friction': 0.0}
    floor = [plank(name, (x, 0.0, 0.25), size=(1.0, 1.0, 0.5), **values)
             for name, x in (('first', 0.0), ('second', 1.0))]  # fmt: skip
    cube = plank('cube', (-0.2, 0.0, 0.6), (0.0, 0.0, turn), size=(0.2, 0.2, 0.2),
                 initial_velocity_linear=(1.0, 0.0, 0.0), **values)  # fmt: skip
    world = on_ground(*floor, cube)
    world.step(120)
    assert centre(world, 'cube') == pytest.approx((0.8, 0.0, 0.6), abs=1e-4)
    assert momentum(world, 'cube') == pytest.approx((1.0, 0.0, 0.0), abs=1e-3)


def test_a_box_that_stands_partly_on_another_one_is_not_pushed_aside():
    # its inner corners are 30 cm within the edge of the lower one: these edges cross there, too
    lower = plank('lower', (0.0, 0.0, 0.25), size=(1.0, 1.0, 0.5), mode='rigid')
    upper = plank('upper', (0.45, 0.1, 0.75), size=(0.5, 0.5, 0.5), mode='rigid')
    world = on_ground(lower, upper)
    world.step(240)
    assert centre(world, 'upper') == pytest.approx((0.45, 0.1, 0.75), abs=1e-5)


@pytest.mark.parametrize('h', [1 / 60, 1 / 240])
@pytest.mark.parametrize('speed', [5.0, 20.0])
@pytest.mark.parametrize('turn', [0.0, 30.0])
def test_thin_plates_do_not_pass_through_each_other(turn, speed, h):
    # up to 17 times their thickness in a tick; turned, no corner of one is above the other
    size = 1.0, 1.0, 0.02
    one = plank('one', (0.0, 0.0, 0.0), size=size, mode='rigid', elasticity=0.5)
    two = plank('two', (0.11, 0.07, 0.4), (0.0, 0.0, turn), size=size, mode='rigid',
                elasticity=0.5, initial_velocity_linear=(0.0, 0.0, -speed))  # fmt: skip
    world = floating(one, two, h=h)
    before, scale = totals(world), sizes(world)
    world.step(round(0.6 / (speed * h)) + 2)
    assert_kept(world, before, scale)
    assert totals(world)[2] <= before[2] * (1.0 + 1e-9)
    apart = momentum(world, 'two') - momentum(world, 'one')
    assert centre(world, 'two')[2] > centre(world, 'one')[2] and apart[2] > 0.1 * speed


@pytest.mark.parametrize('speed', [2.0, 5.0])
def test_soft_bars_that_twist_do_not_pass_through_each_other(speed):
    # their faces fold along the diagonals, which are the edges that meet then
    one = plank('one', (0.0, 0.0, 0.0), size=(1.0, 0.02, 0.02), mode='quadratic')
    two = plank('two', (0.11, 0.07, 0.4), size=(0.02, 1.0, 0.02), mode='quadratic',
                initial_velocity_linear=(0.0, 0.0, -speed))  # fmt: skip
    world = floating(one, two, h=1 / 240)
    world.step(round(0.7 * 240 / speed))
    assert centre(world, 'two')[2] > centre(world, 'one')[2]


@pytest.mark.parametrize(
    ('turn', 'place'),
    [
        (90.0, (0.041, -0.069)),
        (45.0, (0.004, 0.135)),
        (90.0, (-0.124, -0.079)),
        (45.0, (0.133, 0.003)),
    ],
)
def test_soft_bars_that_warp_do_not_pass_through_each_other(turn, place):
    # of 2 cm, at 5 m/s: the impact warps their faces, which then overlap at their diagonals
    cube = make_surface('box', 1.0, 0)
    bar = Surface(cube.vertices * (0.5, 0.05, 0.01), cube.faces)
    orientation = Rotation.from_euler('z', turn, degrees=True).as_quat()
    shared = {'mesh': bar, 'mesh_scale': 1.0, 'stiffness': 0.8}
    one = BodyConfig(name='one', position=(*place, 0.31), orientation=orientation,
                     initial_velocity_linear=(0.0, 0.0, -5.0), **shared)  # fmt: skip
    two = BodyConfig(name='two', position=(0.0, 0.0, 0.0), **shared)
    world = World(WorldConfig(time_step=1 / 60, gravity_magnitude=0.0, bodies=(one, two)))
    for _ in range(16):
        world.step()
        height = height_where_they_cross(world)
        if height is None:
            break
        assert height > 0.0


def height_where_they_cross(world):
    """Return how far the middle of bar `one` is above that of `two`; None if they do not cross."""
    ends = []
    for name in ('one', 'two'):
        x, along = world.positions(name), world.rest_shape(name).surface.vertices[:, 0]
        ends.append((x[along < 0.0].mean(axis=0), x[along > 0.0].mean(axis=0)))
    (a, b), (c, d) = ends
    share = np.linalg.solve(np.stack([b - a, c - d], axis=1)[:2], (c - a)[:2])
    if not ((share > 0.0) & (share < 1.0)).all():
        return None
    return (a + share[0] * (b - a) - c - share[1] * (d - c))[2]
