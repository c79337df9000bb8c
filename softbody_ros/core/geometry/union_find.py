# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Connected components by union-find: each element has a parent, the least of each is its own."""

from __future__ import annotations

import numpy as np

from softbody_ros.core.compiled import helper


@helper
def root_of(parent: np.ndarray, k: int) -> int:
    """Return the least element of the component of k; paths are halved on the way."""
    while parent[k] != k:
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k


@helper
def unite(parent: np.ndarray, one: int, two: int) -> None:
    """Unite the components of two elements."""
    one, two = root_of(parent, one), root_of(parent, two)
    parent[max(one, two)] = min(one, two)
