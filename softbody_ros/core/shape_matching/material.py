# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Mass and frequencies of a body, from whichever of its settings say them.

A homogeneous strain e of a body of mass m and volume V has, by shape matching, the elastic energy
½ m Σ w |e x|² ω², where ω² is f for the deviatoric part of e and b for the change of volume. In an
isotropic solid it is V (G |dev e|² + ½ K (tr e)²) (Landau and Lifshitz, Theory of Elasticity, eq.
4.3). With Σ w x xᵀ = s²/3 in each direction both are the same for 2 G = A f and 3 K = A b, A =
m s² / (3 V), and Young's modulus is 9 K G / (3 K + G) (eq. 5.9). Plates touch only some of the
particles, which yield by the rest of their displacements, of stiffness r = ω², besides; on two
faces of a cube that adds f / r of the strain, and more where the surface has a share t of the
mass. So

    E = C · A · 3 b f / (2 b + f) / (1 + f / (r t)).

Of regions, which follow no strain, f and b have their share, by their squared extent.

C = 1.2 makes up for what that does not describe: a contact of a small area is stiffer here than in
a solid (Hertz), by about 2. With it, plates without friction that squeeze a cube by 5 to 20 % feel
0.9 to 1.05 of E A ε, and a ball 1.7 to 1.8 of Hertz's force, with a deformation of 0.5 and volume
that is conserved; with regions 1.1, and 0.8 to 1.3 (solids: 1.4, and 0.9 to 1.5). Limits: with a
deformation of 0.9, or without conservation of volume, a ball is up to 3 times as stiff as by
Hertz. An elongated body is stiffer along its longest axis, and softer along its shortest one, by
the ratio of its squared extent to the mean.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

import numpy as np

from softbody_ros.core.config import BodyConfig, ConfigError
from softbody_ros.core.shape_matching.regions import Regions
from softbody_ros.core.shape_matching.rest_shape import LINEAR, RestShape

KAPPA = 3.0
"""Frequency of the residual of a particle, which no goal follows, relative to that of α_s: short
waves of a solid are stiffer than its long ones."""
INCOMPRESSIBLE = 3e3
"""Largest frequency of changes of volume, rad/s, unless that of the residual is larger."""
SMALL_CONTACTS = 1.2
"""C."""
ITERATIONS = 16
"""For the frequency of a modulus: each divides the relative error by three or more."""


@dataclass(frozen=True)
class Material:
    """
    Mass and stiffness of a body.

    Attributes
    ----------
    mass : float
        kg
    frequency : float
        ω of the pull towards the goal, rad/s
    deformation, volume_conservation : float
        shares, as in the settings
    has_goals : bool
        whether its particles have goals of their own, as with regions or pins
    regions_weight : float
        weight of the match of regions, beside that of the whole body
    regions_extent : float
        squared extent of regions, relative to that of the body
    volume, extent : float
        V, m³, 0 of a surface that is not closed, and the RMS distance s of the mass from its
        centre, m
    at_surface : float
        t, share of the mass
    stiffness, reference_step : float
        α_s and h₀, s, if the frequency is that of these, else 0

    """

    mass: float
    frequency: float
    deformation: float
    volume_conservation: float
    has_goals: bool
    regions_weight: float
    regions_extent: float
    volume: float
    extent: float
    at_surface: float
    stiffness: float = 0.0
    reference_step: float = 0.0

    @property
    def followed(self) -> float:
        """√f, the frequency of deformations that the goal follows, rad/s."""
        return self._frequency_of(1.0 - self.deformation)

    @property
    def breathing(self) -> float:
        """√b, the frequency of changes of volume, rad/s."""
        conservation = self.volume_conservation
        if self.has_goals:
            return self._frequency_of(1.0 - self.deformation * (1.0 - conservation))
        return breathing_frequency(self.followed, self.frequency, conservation)

    @property
    def density(self) -> float:
        """Mass per enclosed volume, kg/m³; 0 of a surface that is not closed."""
        return self.mass / self.volume if self.volume > 0.0 else 0.0

    @property
    def young_modulus(self) -> float:
        """E, Pa; 0 of a surface that is not closed."""
        pull = self.frequency**2
        regions = self.regions_weight * self.regions_extent * pull
        f = (1.0 - self.regions_weight) * self.followed**2 + regions
        b = (1.0 - self.regions_weight) * self.breathing**2 + regions
        if f == 0.0 or self.volume == 0.0:
            return 0.0
        inertia = self.mass * self.extent**2 / (3.0 * self.volume)
        rest = pull if self.has_goals else KAPPA**2 * pull
        return (
            SMALL_CONTACTS
            * inertia
            * 3.0
            * b
            * f
            / (2.0 * b + f)
            / (1.0 + f / (rest * self.at_surface))
        )

    def _frequency_of(self, share: float) -> float:
        """Return that of a deformation that is pulled by a share of the stiffness, rad/s."""
        if self.reference_step > 0.0:
            return natural_frequency(share * self.stiffness, self.reference_step)
        return math.sqrt(share) * self.frequency


def make_material(
    body: BodyConfig,
    rest: RestShape,
    reference_step: float,
    has_goals: bool = False,
    regions: Regions | None = None,
) -> Material:
    """
    Return mass and stiffness of a body.

    Parameters
    ----------
    body : BodyConfig
    rest : RestShape
    reference_step : float
        h₀, s
    has_goals : bool
        whether its particles have goals of their own, as with regions or pins
    regions : Regions, optional

    Raises
    ------
    ConfigError
        see `require_volume`.

    """
    require_volume(body, rest)
    volume = max(rest.volume, 0.0)
    mass = body.density * volume if body.density > 0.0 else body.mass
    second_moment = float(np.trace(rest.gram[:LINEAR, :LINEAR]))  # Σ w |q|²
    given = Material(
        mass=mass,
        frequency=2.0 * math.pi * body.natural_frequency,
        deformation=body.deformation,
        volume_conservation=body.volume_conservation,
        has_goals=has_goals,
        regions_weight=0.0 if regions is None else 1.0 - body.regions_whole_body_weight,
        regions_extent=0.0 if regions is None else regions.spread / second_moment,
        volume=volume,
        extent=math.sqrt(second_moment) * rest.scale,
        at_surface=float(rest.weights[: rest.surface_count].sum()),
    )
    if body.young_modulus > 0.0:
        material = replace(given, frequency=1.0)
        for _ in range(ITERATIONS):
            change = math.sqrt(body.young_modulus / material.young_modulus)
            material = replace(material, frequency=change * material.frequency)
        return material
    if body.natural_frequency > 0.0:
        return given
    return replace(
        given,
        frequency=natural_frequency(body.stiffness, reference_step),
        stiffness=body.stiffness,
        reference_step=reference_step,
    )


def require_volume(body: BodyConfig, rest: RestShape) -> None:
    """Raise ConfigError if a surface that is not closed has a density or a modulus."""
    for name, value in (('density', body.density), ('young_modulus', body.young_modulus)):
        if value > 0.0 and rest.volume <= 0.0:
            raise ConfigError(
                f'{body.prefix}{name} is {value:g}, but its mesh encloses no volume: close it, '
                'or set 0'
            )


def natural_frequency(stiffness: float, reference_step: float) -> float:
    """Return ω in rad/s: cos(ω h₀) = 1 − α_s / 2, the frequency of eq. 9–10 at step h₀."""
    return math.acos(1.0 - stiffness / 2.0) / reference_step


def stiffness_at(frequency: float, reference_step: float) -> float | None:
    """Return α_s of a frequency, rad/s; None if it would be more than 1."""
    phase = frequency * reference_step
    return 2.0 * (1.0 - math.cos(phase)) if phase <= math.pi / 3.0 else None


def breathing_frequency(followed: float, omega: float, conservation: float) -> float:
    """
    Return the frequency of changes of volume, rad/s.

    Its square is that of modes that the goal follows without conservation, grows by all of that of
    the stiffness at a half, and tends to that of incompressible bodies, which is bounded.
    """
    square = followed * followed + volume_stiffness(followed, omega, conservation)
    return min(math.sqrt(square), max(INCOMPRESSIBLE, KAPPA * omega))


def volume_stiffness(followed: float, omega: float, conservation: float) -> float:
    """Return what conservation adds to the square of the frequency of changes of volume, 1/s²."""
    ratio = conservation / max(1.0 - conservation, 1e-12)
    return ratio * max(omega * omega - followed * followed, 0.0)
