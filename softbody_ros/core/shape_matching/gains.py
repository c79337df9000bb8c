# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the parameters of a body mean for one tick: gains that are exact at any step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
import math

import numpy as np

from softbody_ros.core.config import BodyConfig
from softbody_ros.core.shape_matching.rest_shape import LINEAR, QUADRATIC


def natural_frequency(stiffness: float, reference_step: float) -> float:
    """Return ω in rad/s: cos(ω h₀) = 1 − α_s / 2, the frequency of eq. 9–10 at step h₀."""
    return math.acos(1.0 - stiffness / 2.0) / reference_step


def damping_ratio(bounciness: float) -> float:
    """Return ζ for which each swing has `bounciness` times the amplitude of the one before."""
    if bounciness <= 0.0:
        return 1.0
    overshoot = math.log(bounciness)
    return -overshoot / math.hypot(math.pi, overshoot)


def oscillator_gains(
    stiffness: float, bounciness: float, step: float, reference_step: float
) -> tuple[float, float]:
    """
    Return the gains s and k that step a damped oscillator exactly, whatever the step.

    With y the distance from the goal, x = x* + s y and v = v* + k y / h sample the motion of
    frequency ω and damping ζ: the map has trace 2 e cos(√(1−ζ²) ω h) and determinant e²,
    e = exp(−ζ ω h).

    Parameters
    ----------
    stiffness, bounciness : float
        α_s and α_f, from 0 to 1
    step, reference_step : float
        h and h₀, s

    """
    omega, zeta = natural_frequency(stiffness, reference_step), damping_ratio(bounciness)
    decay = math.exp(-zeta * omega * step)
    phase = math.sqrt(1.0 - zeta**2) * omega * step
    return -math.expm1(-2.0 * zeta * omega * step), (
        (1.0 - decay) ** 2 + 4.0 * decay * math.sin(phase / 2.0) ** 2
    )


@dataclass(frozen=True)
class Gains:
    """
    What the parameters of B bodies mean for one tick.

    Every array is (B,), but `pull`, `critical`, `deformation` and `volume_conservation` are
    (2, B): for positions and for velocities.

    The modes that a goal follows feel the stiffness (1 − β) α_s, the others α_s. For both to keep
    their frequency at any step, the goals of positions and of velocities each get the β that
    makes s · (1 − β_s) and k · (1 − β_k) the exact gains of the stiffness (1 − β) α_s. At the
    reference step without damping β_k = β, as published.

    `pull` is s and k / h, `critical` what they are at critical damping.
    `kept_velocity` is the share of the deformation's velocity that `damping` leaves, `creeping`
    the share of a strain that becomes permanent, `whole_body` the weight of the match of the
    whole body beside its regions.
    """

    rigid: np.ndarray
    quadratic: np.ndarray
    pull: np.ndarray
    critical: np.ndarray
    deformation: np.ndarray
    volume_conservation: np.ndarray
    elasticity: np.ndarray
    bounciness: np.ndarray
    friction: np.ndarray
    coulomb: np.ndarray
    thickness: np.ndarray
    mass: np.ndarray
    kept_velocity: np.ndarray
    yield_strain: np.ndarray
    creeping: np.ndarray
    largest_strain: np.ndarray
    whole_body: np.ndarray

    # asked in every tick: the gains of a batch stay the same for many
    @cached_property
    def features(self) -> int:
        """Number of features that the richest mode among the bodies needs."""
        return QUADRATIC if self.quadratic.any() else LINEAR

    @cached_property
    def all_quadratic(self) -> bool:
        """Whether all bodies are quadratic."""
        return bool(self.quadratic.all())

    @cached_property
    def any_rigid(self) -> bool:
        """Whether some bodies are rigid."""
        return bool(self.rigid.any())

    @cached_property
    def all_rigid(self) -> bool:
        """Whether all bodies are rigid."""
        return bool(self.rigid.all())

    @cached_property
    def any_coulomb(self) -> bool:
        """Whether some bodies have Coulomb's friction."""
        return bool(self.coulomb.any())

    @cached_property
    def damps(self) -> bool:
        """Whether some velocity of a deformation is taken."""
        return bool((self.kept_velocity < 1.0).any())

    @cached_property
    def creeps(self) -> bool:
        """Whether some deformation can become permanent."""
        return bool(self.creeping.any())

    def of(self, bodies: np.ndarray) -> Gains:
        """Return the gains of some of the bodies, given as a mask or as indices."""
        return Gains(*(getattr(self, item.name)[..., bodies] for item in fields(self)))


def make_gains(bodies: Sequence[BodyConfig], step: float, reference_step: float) -> Gains:
    """Return the gains of bodies that are stepped together."""
    rows = [_body_gains(body, step, reference_step) for body in bodies]
    return Gains(*(np.array(column).T for column in zip(*rows, strict=True)))


def _body_gains(body: BodyConfig, step: float, reference_step: float) -> tuple:
    reference_steps = step / reference_step
    kept_velocity = (1.0 - body.damping) ** reference_steps
    s, k, beta_s, beta_k = 1.0, 1.0, 0.0, 0.0
    critical = (1.0, 1.0)
    conserved_s = conserved_k = body.volume_conservation
    if body.mode != 'rigid':
        alpha, beta, kept = body.stiffness, body.deformation, body.volume_conservation

        def gains_at(share: float, bounciness: float = body.bounciness) -> tuple[float, float]:
            s, k = oscillator_gains(share * alpha, bounciness, step, reference_step)
            # the map has trace 1 − s + κ − k and determinant (1 − s) κ: no negative eigenvalue
            return s, min(k, (math.sqrt(1.0 - s) + math.sqrt(kept_velocity)) ** 2)

        s, k = gains_at(1.0)
        critical = gains_at(1.0, bounciness=0.0)
        followed_s, followed_k = gains_at(1.0 - beta)
        followed_k = min(followed_k, k)
        breathing_s, breathing_k = gains_at(1.0 - beta * (1.0 - kept))
        beta_k = 1.0 - followed_k / k if k > 0.0 else beta
        beta_s = 1.0 - followed_s / s if s > 0.0 else beta
        if k > followed_k:
            conserved_k = (breathing_k - followed_k) / (k - followed_k)
        if s > followed_s:
            conserved_s = (breathing_s - followed_s) / (s - followed_s)
    friction = body.friction
    if body.friction_model == 'viscous':
        friction = 1.0 - (1.0 - friction) ** reference_steps
    return (
        body.mode == 'rigid',
        body.mode == 'quadratic',
        (s, k / step),
        (critical[0], critical[1] / step),
        (beta_s, beta_k),
        (conserved_s, conserved_k),
        body.elasticity,
        body.bounciness,
        friction,
        body.friction_model == 'coulomb',
        body.thickness,
        body.mass,
        kept_velocity,
        body.plasticity_yield,
        -math.expm1(-body.plasticity_creep * step),
        body.plasticity_max,
        1.0 if body.mode == 'rigid' else body.regions_whole_body_weight,
    )
