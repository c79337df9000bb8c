# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The corners of the grid that tools/benchmarks/contact_grid.py runs in full."""

import dataclasses

from drops import HEIGHT, decay_rate, drop_config, fall, grid, without_gravity
import numpy as np
import pytest

from softbody_ros.core import World

CORNERS = grid(
    stiffness=(0.05, 1.0),
    bounciness=(0.0, 0.9, 1.0),
    deformation=(0.0, 0.9),
    elasticity=(0.0, 1.0),
)


@pytest.fixture(scope='module')
def dropped():
    """Return a world 4 s after the drop, and what has been observed until then."""
    world = World(drop_config(CORNERS, subdivisions=2))
    drop, finite = fall(world, 4.0)
    return world, drop, finite


def test_no_drop_leaves_the_finite_numbers(dropped):
    _, drop, finite = dropped
    assert finite
    assert all(np.isfinite(values).all() for values in dataclasses.astuple(drop))


def test_no_body_gets_more_energy_than_it_fell_with(dropped):
    _, drop, _ = dropped
    gain = (drop.energy - drop.energy[0]).max(axis=0) / HEIGHT
    for body, value in zip(CORNERS, gain, strict=True):
        assert value < 0.02, body


def test_no_body_is_left_in_the_ground(dropped):
    _, drop, _ = dropped
    assert drop.depth.max() < 1e-9


def test_without_gravity_each_damped_body_finds_its_shape(dropped):
    world, _, _ = dropped
    without_gravity(world)
    rates = [decay_rate(body, world.config.reference_step) for body in world.config.bodies]
    damped = np.array(rates) > 0.0
    # the softest deformation decays from the worst RMS at impact, 100 %, to 0.1 % in this time
    seconds = 7.0 / min(np.array(rates)[damped])
    free, finite = fall(world, seconds, every=240)
    assert finite
    for body, rms, is_damped in zip(CORNERS, free.rms[-1], damped, strict=True):
        assert rms <= 0.01 or not is_damped, body


def test_undamped_oscillations_stay_bounded_by_their_start():
    """Goals scaled to their volume, which have no potential, let them grow to twice their size."""
    undamped = grid(
        stiffness=(0.05, 0.2, 1.0), bounciness=(1.0,), deformation=(0.5, 0.9), elasticity=(1.0,)
    )
    world = World(drop_config(undamped, subdivisions=2))
    world.step(240 * 3)
    without_gravity(world)
    free, finite = fall(world, 30.0, every=4)
    assert finite
    start, end = free.rms[: 60 * 5].max(axis=0), free.rms[-60 * 5 :].max(axis=0)
    assert start.min() > 0.005
    for body, growth in zip(undamped, end / start, strict=True):
        assert growth < 1.05, body
