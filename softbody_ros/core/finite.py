# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Arrays of finite numbers, checked where they enter a world."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from softbody_ros.core.config import ConfigError

LARGEST = 1e100
"""Of what is squared, or counted in ticks: far beyond anything, and finite after that."""


def finite_rows(values: ArrayLike, count: int, what: str) -> np.ndarray:
    """Return values as an array (count, 3) of finite numbers."""
    return finite_array(values, (count, 3), what, 'x, y, z of each vertex')


def finite_vector(values: ArrayLike, what: str) -> np.ndarray:
    """Return values as a new array (3,) of finite numbers."""
    return _bounded(np.array(finite_array(values, (3,), what, 'x, y, z')), what)


def finite_number(value: float, what: str) -> float:
    """Return a finite number."""
    return float(_bounded(finite_array(value, (), what, 'one number'), what))


def _bounded(values: np.ndarray, what: str) -> np.ndarray:
    if (np.abs(values) > LARGEST).any():
        raise ConfigError(f'{what}: a number of it is larger than {LARGEST:g}, which none must be')
    return values


def finite_array(values: ArrayLike, shape: tuple[int, ...], what: str, meaning: str) -> np.ndarray:
    """
    Return values as an array of finite numbers.

    Raises
    ------
    ConfigError
        if they are no such numbers, or the shape is another one.

    """
    try:
        array = np.asarray(values, float)
    except (TypeError, ValueError):
        raise ConfigError(f'{what}: it is no array of numbers, it must be {meaning}') from None
    if array.shape != shape:
        raise ConfigError(f'{what}: its shape is {array.shape}, it must be {shape}, {meaning}')
    if not np.isfinite(array).all():
        wrong = array[~np.isfinite(array)].flat[0]
        raise ConfigError(f'{what}: a number of it is {wrong}, all must be finite')
    return array
