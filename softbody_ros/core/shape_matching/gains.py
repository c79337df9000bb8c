# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Gains of one tick from the parameters of a body, exact at any step size."""

from __future__ import annotations

import math

import numpy as np

from softbody_ros.core.config import MODES, BodyConfig

KAPPA = 3.0
"""Frequency of the residual of a particle, which no goal follows, relative to that of α_s: short
waves of a solid are stiffer than its long ones."""
LEAST_RESIDUAL_DAMPING = 0.7
"""Damping ratio of the residual: undamped, a particle could be held by no force at ω h = 2π."""
INCOMPRESSIBLE, STIFF = 3e3, 9.0
"""Largest frequency of changes of volume, rad/s, and its ratio to that of α_s, less 1, from which
on it is damped critically."""
CRITICAL_DAMPING = 4
"""Power of `damping` that is the least damping ratio: next to nothing, but critical for what keeps
no velocity. Undamped, even that would swing to the other side in a tick of more than a quarter of
its period."""
ADAPTATION = 0.2
"""Rate, in ω, of the volume of the fit towards that with which the enclosed volume is that at
rest. Slow beside an impact: control with a delay could feed energy into swings."""
SMALL_PHASE = 0.5
"""ω h below which a power series is exact and differences lose digits."""
FOLLOWED, RESIDUAL, BREATHING = 0, 1, 2
"""Kinds of modes: deformation that the goal follows, what no goal follows, change of volume."""


def natural_frequency(stiffness: float, reference_step: float) -> float:
    """Return ω in rad/s: cos(ω h₀) = 1 − α_s / 2, the frequency of eq. 9–10 at step h₀."""
    return math.acos(1.0 - stiffness / 2.0) / reference_step


def damping_ratio(bounciness: float) -> float:
    """Return ζ for which successive half swings have amplitudes in the ratio `bounciness`."""
    if bounciness <= 0.0:
        return 1.0
    overshoot = math.log(bounciness)
    return -overshoot / math.hypot(math.pi, overshoot)


def oscillator_gains(
    stiffness: float, bounciness: float, step: float, reference_step: float
) -> tuple[float, float]:
    """
    Return the gains s and k that step a damped oscillator exactly, at any step size.

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


def oscillator_response(
    omega: float, zeta: float, step: float
) -> tuple[float, float, float, float, float, float, float]:
    """
    Return the exact motion of a damped oscillator under a force in a tick.

    y' = Φ₁₁ y + Φ₁₂ u + Γ₁ a and u' = Φ₂₁ y + Φ₂₂ u + Γ₂ a for displacement y, velocity u = ẏ and
    acceleration a by a constant force: ÿ = −2 ζ ω ẏ − ω² y + a. In rest y = a / ω² at any step.
    A force that grows as ȧ t adds Γ₃ ȧ and Γ₁ ȧ.

    Parameters
    ----------
    omega, zeta : float
        ω, rad/s, and damping ratio from 0 to 1; without stiffness the motion is that of a free
        particle
    step : float
        h, s

    Returns
    -------
    tuple of 7 float
        Φ₁₁, Φ₁₂ in s, Φ₂₁ in 1/s, Φ₂₂, Γ₁ in s², Γ₂ in s, Γ₃ in s³

    """
    if omega * step < SMALL_PHASE:
        # derivatives of y at 0 for a = 1: each follows from the two before
        before, now = 0.0, 1.0
        position, velocity, sum_of_position = 0.5 * step * step, step, step**3 / 6.0
        term = step
        for order in range(2, 18):
            before, now = now, -2.0 * zeta * omega * now - omega * omega * before
            term *= step / order
            velocity += now * term
            position += now * term * step / (order + 1)
            sum_of_position += now * term * step * step / ((order + 1) * (order + 2))
    else:
        damped = math.sqrt(max(1.0 - zeta * zeta, 0.0)) * omega
        decay, phase = math.exp(-zeta * omega * step), damped * step
        velocity = decay * (math.sin(phase) / damped if phase > 0.0 else step)
        position = (1.0 - decay * math.cos(phase) - zeta * omega * velocity) / omega**2
        sum_of_position = (step - velocity) / omega**2 - 2.0 * zeta * position / omega
    stay = 1.0 - omega * omega * position
    return (
        stay,
        velocity,
        -omega * omega * velocity,
        stay - 2.0 * zeta * omega * velocity,
        position,
        velocity,
        sum_of_position,
    )


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


def breathing_damping(breathing: float, omega: float) -> float:
    """Return the least damping ratio of changes of volume: critical if incompressible."""
    return min(max(breathing / max(omega, 1e-12) - 1.0, 0.0) / STIFF, 1.0)


def put_modal_gains(
    record: np.void,
    body: BodyConfig,
    step: float,
    reference_step: float,
    kappa: float = KAPPA,
) -> None:
    """
    Write the responses of the modes of a body in one tick into its BODY record.

    Deformations that the goal follows have the stiffness (1 − β) α_s, the change of volume
    [1 − β (1 − volume conservation)] α_s, and the residual of each particle κ times the frequency
    of α_s. All are 0 for a rigid body, which has no such modes.

    Parameters
    ----------
    record : BODY, ()
        written: `responses` are those of `oscillator_response` for each kind of mode, in regular
        and in degenerate states, and of a body that touches something, where the elasticity
        reduces the bounciness; `stiffnesses` are ω² of the regular ones; `volume_share` is the
        share of the change of volume in the stiffness against it; `relaxation` and `compressible`
        are those of `modal_flight.flattened_volume`
    body : BodyConfig
    step, reference_step : float
        h and h₀, s
    kappa : float
        κ

    """
    record['responses'], record['stiffnesses'], record['volume_share'] = 0.0, 0.0, 0.0
    record['relaxation'] = 0.0
    if body.mode == 'rigid':
        return
    alpha, beta = body.stiffness, body.deformation
    omega = natural_frequency(alpha, reference_step)
    followed = natural_frequency((1.0 - beta) * alpha, reference_step)
    breathing = breathing_frequency(followed, omega, body.volume_conservation)
    record['stiffnesses'] = followed**2, (kappa * omega) ** 2, breathing**2
    record['relaxation'] = -math.expm1(-ADAPTATION * omega * step)
    regular, degenerate, touching = record['responses']
    least = body.damping**CRITICAL_DAMPING
    for responses, elasticity in ((regular, 1.0), (touching, body.elasticity)):
        zeta = max(damping_ratio(body.bounciness * elasticity), least)
        residual = max(zeta, LEAST_RESIDUAL_DAMPING)
        responses[FOLLOWED] = oscillator_response(followed, zeta, step)
        responses[RESIDUAL] = oscillator_response(kappa * omega, residual, step)
        responses[BREATHING] = oscillator_response(
            breathing, max(zeta, breathing_damping(breathing, omega)), step
        )
    degenerate[FOLLOWED] = degenerate[BREATHING] = oscillator_response(omega, 1.0, step)
    degenerate[RESIDUAL] = oscillator_response(kappa * omega, 1.0, step)
    unbounded = volume_stiffness(followed, omega, body.volume_conservation)
    record['compressible'] = 1.0
    if unbounded > 0.0:
        record['compressible'] = (breathing**2 - followed**2) / unbounded
    if breathing > 0.0:
        record['volume_share'] = 1.0 - (followed / breathing) ** 2


def put_gains(record: np.void, body: BodyConfig, step: float, reference_step: float) -> None:
    """
    Write the gains of a body for one tick into its BODY record.

    Fields of two numbers are for positions and for velocities.

    Deformations that the goal follows have the stiffness (1 − β) α_s, all others α_s. For the
    frequencies of both to be independent of the step, the goals of positions and of velocities
    have their own β, such that s · (1 − β_s) and k · (1 − β_k) are the exact gains of the
    stiffness (1 − β) α_s. At the reference step without damping β_k = β, as published.

    Parameters
    ----------
    record : BODY, ()
        written: `pull` is s and k / h, `critical_pull` the same at critical damping;
        `kept_velocity` the share of the velocity of deformation that `damping` leaves, `creep` the
        share of a strain that becomes permanent, `whole_body_weight` the weight of the match of
        the whole body, where its regions have the rest
    body : BodyConfig
    step, reference_step : float
        h and h₀, s

    """
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
    record['mode'] = MODES.index(body.mode)
    record['pull'], record['critical_pull'] = (s, k / step), (critical[0], critical[1] / step)
    record['deformation'] = beta_s, beta_k
    record['volume_conservation'] = conserved_s, conserved_k
    record['kept_velocity'] = kept_velocity
    record['yield_strain'] = body.plasticity_yield
    record['creep'] = -math.expm1(-body.plasticity_creep * step)
    record['largest_strain'] = body.plasticity_max
    record['whole_body_weight'] = 1.0 if body.mode == 'rigid' else body.regions_whole_body_weight
    record['elasticity'], record['bounciness'] = body.elasticity, body.bounciness
    record['friction'], record['coulomb'] = friction, body.friction_model == 'coulomb'
    record['thickness'], record['mass'] = body.thickness, body.mass
    put_modal_gains(record, body, step, reference_step)
    record['pins_linear'] = body.pins_velocity_linear
    record['pins_angular'] = body.pins_velocity_angular
