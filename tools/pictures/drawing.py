# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Pictures of worlds: bodies painted, obstacles grey; side by side with captions, or a film."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import pathlib

import numpy as np
from numpy.typing import ArrayLike
from pictures import raster
from pictures.raster import Thing, View
from PIL import Image, ImageDraw, ImageFont

from softbody_ros.core import World
from softbody_ros.core.collision.obstacles import Obstacle
from softbody_ros.core.collision.shapes import obstacle_surface

Paint = Callable[[np.ndarray], np.ndarray] | Sequence[float]
FLOOR = np.array([0.93, 0.92, 0.9])
GREY = np.array([0.8, 0.82, 0.86])
CREAM = np.array([0.98, 0.93, 0.83])
ORANGE = np.array([0.95, 0.47, 0.17])
BLUE = np.array([0.25, 0.55, 0.9])
SLATE = np.array([0.45, 0.46, 0.52])
INK, RED = (90, 88, 84), (200, 30, 60)
FINENESS = 3
"""Squared, the samples that make one pixel."""


def segments(color: np.ndarray, count: int = 6) -> Paint:
    """Return the paint of a beach ball about z: segments of a color and cream, cream poles."""

    def paint(points: np.ndarray) -> np.ndarray:
        x, y, z = points.T
        odd = (np.arctan2(y, x) * count / (2.0 * np.pi)) % 1.0 < 0.5
        pole = np.hypot(x, y) < 0.28 * abs(z)
        return np.where((odd & ~pole)[:, None], color, CREAM)

    return paint


def checks(color: np.ndarray, length: float) -> Paint:
    """Return the paint of cubes of a color and of a lighter one, alternately."""

    def paint(points: np.ndarray) -> np.ndarray:
        odd = np.floor(points / length + 1e-3).sum(axis=-1) % 2.0
        return color + 0.45 * odd[:, None] * (CREAM - color)

    return paint


def thing_of(obstacle: Obstacle) -> Thing:
    """Return an obstacle as it is now."""
    config = obstacle.config
    surface = obstacle_surface(config, 30.0)
    is_plane = config.type == 'plane'
    # a plane a little higher: it hides the creases of what lies flat on it
    lift = [0.0, 0.0, 0.006 if is_plane else 0.0]
    vertices = (surface.vertices + lift) @ obstacle.rotation.T + obstacle.position
    return Thing(vertices, surface.faces, FLOOR if is_plane else GREY, casts=not is_plane)


def photo(world: World, paints: Mapping[str, Paint], camera: View) -> Image.Image:
    """Return a picture of a world as it is now; `camera` has `FINENESS` times its pixels."""
    things = [thing_of(obstacle) for obstacle in world.obstacles]
    for name in world.names:
        surface = world.rest_shape(name).surface
        paint = paints[name] if callable(paints[name]) else np.array(paints[name])[:3]
        moved = world.positions(name)
        things.append(Thing(moved, surface.faces, paint, rest=surface.vertices, shine=0.2))
    picture = raster.smaller(raster.shaded(things, camera), FINENESS)
    return Image.fromarray(np.rint(255.0 * picture).astype(np.uint8))


def camera(
    forward: Sequence[float], low: Sequence[float], high: Sequence[float], scale: float
) -> View:
    """Return the view between two corners, m, with `scale` pixels of a photo per metre."""
    return raster.view(np.array(forward, dtype=float), low, high, FINENESS * scale)


def with_caption(picture: Image.Image, caption: str, size: int = 17) -> Image.Image:
    """Return a picture with a line of text at its lower edge."""
    result = picture.copy()
    place = (picture.width / 2, picture.height - 0.7 * size)
    ImageDraw.Draw(result).text(
        place, caption, fill=INK, font=ImageFont.load_default(size), anchor='ms'
    )
    return result


def with_arrows(
    picture: Image.Image, camera: View, arrows: Sequence[tuple[ArrayLike, ArrayLike, str]]
) -> Image.Image:
    """Return a photo with arrows: where each begins, m, what it is long, m, and what it says."""
    result, font = picture.copy(), ImageFont.load_default(15)
    draw = ImageDraw.Draw(result)
    for start, length, label in arrows:
        ends = np.asarray(start, dtype=float) + np.array([np.zeros(3), length])
        ends = camera.onto(ends)[:, :2] / FINENESS
        ends[:, 1] = picture.height - ends[:, 1]
        begin, end = ends
        forward = (end - begin) / np.linalg.norm(end - begin)
        across = np.array([-forward[1], forward[0]])
        draw.line([*begin, *(end - 8.0 * forward)], fill=RED, width=4)
        head = [end, end - 13.0 * forward + 7.0 * across, end - 13.0 * forward - 7.0 * across]
        draw.polygon([tuple(point) for point in head], fill=RED)
        x, y = begin - 14.0 * forward
        anchor = 'mm' if abs(forward[1]) > 0.5 else 'rm' if forward[0] > 0.0 else 'lm'
        draw.text((x, y), label, fill=RED, font=font, anchor=anchor)
    return result


def sheet(pictures: Sequence[Image.Image], columns: int, gap: int = 4) -> Image.Image:
    """Return pictures of one size, side by side and in rows."""
    width, height = (length + gap for length in pictures[0].size)
    rows = -(-len(pictures) // columns)
    result = Image.new('RGB', (columns * width - gap, rows * height - gap), 'white')
    for index, picture in enumerate(pictures):
        row, column = divmod(index, columns)
        result.paste(picture, (column * width, row * height))
    return result


def film(pictures: Sequence[Image.Image], milliseconds: int, path: pathlib.Path) -> None:
    """Write an endless GIF, with one palette so that what stands still does not flicker."""
    some = sheet(pictures[:: max(len(pictures) // 12, 1)], 4)
    palette = some.quantize(256, dither=Image.Dither.NONE)
    first, *others = [
        each.quantize(palette=palette, dither=Image.Dither.NONE) for each in pictures
    ]
    first.save(path, save_all=True, append_images=others, duration=milliseconds, loop=0)
