# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Spring and damper that support the weight of whole bodies, and thresholds of speed."""

from __future__ import annotations

import math

from softbody_ros.core.compiled import helper

SINKAGE = 0.01
"""Depth, in RMS radii, at which the spring supports 63 % of the weight of a body."""
SETTLED = 0.1
"""Speed, relative to a fall by `SINKAGE`, up to which there is no restitution."""
SLOW_TICKS = 2.0
"""Impacts slower than gravity causes in so many ticks do not bounce, so bodies come to rest."""
TINY = 1e-300


@helper
def support(load: float, depth: float, scale: float, h: float) -> tuple[float, float]:
    """
    Return spring acceleration, m/s², and damping, 1/s, for a load, m/s², at a depth, m.

    The spring is limited to the load; the damping is critical.
    """
    softness = max(SINKAGE * scale, 4.0 * load * h * h)
    return -load * math.expm1(-depth / softness), 2.0 * math.sqrt(load / softness)


@helper
def settling_speed(gravity: float, scale: float) -> float:
    """Return the speed, m/s, after a fall by `SINKAGE` under a gravity, m/s²: of settling."""
    return math.sqrt(max(gravity, TINY) * SINKAGE * scale)
