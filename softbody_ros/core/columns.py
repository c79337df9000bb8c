# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Lists that are kept as columns: joined, made of ranges, looked up and summed by group."""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from typing import Any, TypeVar

import numpy as np

Columns = TypeVar('Columns', bound=Any)


def joined(parts: Sequence[Columns]) -> Columns:
    """Return dataclasses of arrays, at least one, as one: column by column."""
    if len(parts) == 1:
        return parts[0]
    names = [item.name for item in dataclasses.fields(parts[0])]
    columns = (np.concatenate([getattr(part, name) for part in parts]) for name in names)
    return type(parts[0])(*columns)


def ranges(start: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Return start[0], start[0] + 1, … (count[0] of them), start[1], …."""
    begin = np.cumsum(count) - count
    return np.arange(count.sum()) + np.repeat(start - begin, count)


def at(values: np.ndarray, group: np.ndarray) -> np.ndarray:
    """Return the values (b, …) of the group (k,) that each belongs to, (k, …), axis by axis."""
    return values.T.take(group, axis=-1).T


def summed(values: np.ndarray, group: np.ndarray, count: int) -> np.ndarray:
    """Return the sums (count, j) of values (k, j) by group (k,), in a fixed order."""
    return np.stack([np.bincount(group, column, count) for column in values.T], axis=1)
