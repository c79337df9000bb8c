# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Contacts that wait take part in the tick in which others would close them."""

import pytest

from softbody_ros.core import BodyConfig, ObstacleConfig, World, WorldConfig

SIZE, SPEED, HALF = 0.05, 0.3, 0.02
"""Of the ball, m; of plates, m/s; half their thickness, m."""


@pytest.mark.parametrize('gap', [0.0002, 0.0005, 0.001])
@pytest.mark.parametrize('h', [1 / 240, 1 / 60])
@pytest.mark.parametrize('mode', ['linear', 'quadratic'])
def test_a_ball_that_plates_squeeze_fast_bulges_into_no_wall(mode, h, gap):
    ball = BodyConfig(
        name='ball', mode=mode, size=SIZE, position=(0.0, 0.0, 0.0), stiffness=0.05,
        volume_conservation=1.0, friction=0.3,
    )  # fmt: skip
    boxes = [
        ObstacleConfig(
            name=name, type='box', size=(0.2, 0.2, HALF), position=(0.0, 0.0, s * (SIZE + HALF)),
            velocity_linear=(0.0, 0.0, -s * SPEED),
        )
        for name, s in (('top', 1), ('bottom', -1))
    ] + [
        ObstacleConfig(
            name=name, type='box', size=(HALF, 0.2, 0.2),
            position=(side * (SIZE + gap + HALF), 0.0, 0.0),
        )
        for name, side in (('left', -1), ('right', 1))
    ]  # fmt: skip
    world = World(
        WorldConfig(time_step=h, gravity_magnitude=0.0, bodies=(ball,), obstacles=tuple(boxes))
    )
    meets = False
    for _ in range(round(0.04 / h)):
        world.step()
        x = world.positions('ball')[:, 0]
        assert abs(x).max() < SIZE + gap + 1e-6 * SIZE
        meets = meets or world.obstacle_wrench('left')[1][0] != 0.0
    assert meets
