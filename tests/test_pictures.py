# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What draws the pictures of the pages draws: bodies, their paint and their shadows."""

import numpy as np
from pictures.drawing import FLOOR, ORANGE, camera, checks, film, photo
from PIL import Image

from softbody_ros.core import BodyConfig, World, WorldConfig

VIEW = camera([0.0, 1.0, -0.5], [-1.0, -0.6], [1.5, 1.9], 24)


def picture(height, paint):
    body = BodyConfig(name='ball', position=(0.0, 0.0, height))
    image = photo(World(WorldConfig(bodies=(body,))), {'ball': paint}, VIEW)
    return np.asarray(image, dtype=float) / 255.0


def test_body_is_round_in_its_color_and_its_shadow_is_on_the_floor():
    image = picture(1.0, ORANGE)
    colored = image[..., 0] - image[..., 2] > 0.15
    assert abs(colored.sum() / (np.pi * (0.5 * 24) ** 2) - 1.0) < 0.05
    grey = ~colored & (np.ptp(image, axis=-1) < 0.1)
    darkness = image[0, 0].mean() - image.mean(axis=-1)
    assert (darkness[grey] > 0.1).sum() > 200, 'the shadow'
    assert abs(image[0, 0] / image[0, 0].max() - FLOOR / FLOOR.max()).max() < 0.02


def test_paint_sticks_to_the_body():
    plain, checked = picture(1.0, ORANGE), picture(1.0, checks(ORANGE, 0.25))
    differs = np.abs(plain - checked).max(axis=-1) > 0.05
    assert 0.3 < differs.sum() / (np.pi * (0.5 * 24) ** 2) < 0.7


def test_film_plays_all_frames_for_ever(tmp_path):
    frames = [Image.new('RGB', (8, 8), (40 * shade, 90, 20)) for shade in range(5)]
    film(frames, 40, tmp_path / 'film.gif')
    with Image.open(tmp_path / 'film.gif') as read:
        assert (read.n_frames, read.info['duration'], read.info['loop']) == (5, 40, 0)
