# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the scenes of the battery should measure, by formulas."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import ellipk

GRAVITY = 9.81
"""m/s²"""
SHELL = 2 / 3
"""Moment of inertia of a spherical shell over M R²."""


def reference_step(frequency, stiffness):
    """Return h₀ with cos(2π f h₀) = 1 − stiffness/2, s."""
    return math.acos(1 - stiffness / 2) / (2 * math.pi * frequency)


def grip_ratio(friction, normal_force, mass, acceleration=GRAVITY):
    """Return 2 μ N / (m a): two fingers hold a mass if it is more than 1."""
    return 2 * friction * normal_force / (mass * acceleration)


def angle_of_friction(friction):
    """Return the steepest slope on which a body sticks, atan μ, in degrees."""
    return math.degrees(math.atan(friction))


def sliding_acceleration(friction, degrees):
    """Return g (sin θ − μ cos θ) on a slope, not less than 0, m/s²."""
    angle = math.radians(degrees)
    return max(GRAVITY * (math.sin(angle) - friction * math.cos(angle)), 0.0)


def rolling_acceleration(degrees):
    """Return g sin θ / (1 + I/(M R²)) of a spherical shell that rolls, m/s²."""
    return GRAVITY * math.sin(math.radians(degrees)) / (1 + SHELL)


def friction_radius(outer, inner=0.0):
    """Return (2/3) (R³ − r³)/(R² − r²): the mean radius of a ring under even pressure, m."""
    return 2 / 3 * (outer**3 - inner**3) / (outer**2 - inner**2)


def stopping_time(inertia, speed, friction, radius):
    """
    Return I ω / (μ g r): how long a body rotates on a face, s.

    Parameters
    ----------
    inertia : float
        about the axis, for each kg, m²
    speed : float
        rad/s
    friction : float
    radius : float
        mean radius at which friction acts, m

    """
    return inertia * speed / (friction * GRAVITY * radius)


def flip_period(inertia, angular_velocity):
    """
    Return the time between two reversals of the rotation about the middle axis, without torque, s.

    With moments I₁ < I₂ < I₃, energy E, angular momentum L and L² > 2 E I₂ the components of the
    angular velocity are Jacobi's elliptic functions (Landau and Lifshitz, Mechanics, § 37), ω₂
    ~ sn τ, which reverses after 2 K(k):

        τ = t √((I₃ − I₂)(L² − 2 E I₁) / (I₁ I₂ I₃))
        k² = (I₂ − I₁)(2 E I₃ − L²) / ((I₃ − I₂)(L² − 2 E I₁))

    and the same with 1 and 3 exchanged if L² < 2 E I₂.

    Parameters
    ----------
    inertia : (3,) float
        principal moments, increasing
    angular_velocity : (3,) float
        along these axes, rad/s

    """
    inertia = np.asarray(inertia, dtype=float)
    square = np.sum((inertia * angular_velocity) ** 2)
    double_energy = np.sum(inertia * np.square(angular_velocity))
    first, middle, last = inertia
    if square < double_energy * middle:
        first, last = last, first
    steep = (last - middle) * (square - double_energy * first)
    parameter = (middle - first) * (double_energy * last - square) / steep
    return float(2 * ellipk(parameter) * math.sqrt(first * middle * last / steep))
