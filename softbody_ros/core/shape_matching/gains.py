# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Gains of one tick from the parameters of a body, exact at any step size."""

from __future__ import annotations

import math

import numpy as np

from softbody_ros.core.config import MODES, BodyConfig
from softbody_ros.core.shape_matching.material import KAPPA, Material, volume_stiffness

LEAST_RESIDUAL_DAMPING = 0.7
"""Damping ratio of the residual: undamped, a particle could be held by no force at ω h = 2π."""
STIFF = 9.0
"""Ratio of the frequency of changes of volume to that of α_s, less 1, from which on their damping
is critical."""
CRITICAL_DAMPING = 4
"""Power of `damping` that is the least damping ratio: next to nothing, but critical for what keeps
no velocity. Undamped, even that would swing to the other side in a tick of more than a quarter of
its period."""
ADAPTATION = 0.2
"""Rate, in ω, of the volume of the fit towards that with which the enclosed volume is that at
rest. Slow beside an impact: control with a delay could feed energy into swings."""
LARGEST_EXPONENT = 700.0
"""Beyond which exponentials are no floats."""
SLOW_IMPACT = 4.0
"""ω h up to which all of the energy of an impact may be in the deformation."""
SMALL_PHASE = 0.5
"""ω h below which a power series is exact and differences lose digits."""
FOLLOWED, RESIDUAL, BREATHING = 0, 1, 2
"""Kinds of modes: deformation that the goal follows, what no goal follows, change of volume."""
REGULAR, DEGENERATE, TOUCHING = 0, 1, 2
"""States of a body with responses of their own, see `put_gains`."""


def damping_ratio(bounciness: float) -> float:
    """Return ζ for which successive half swings have amplitudes in the ratio `bounciness`."""
    if bounciness <= 0.0:
        return 1.0
    overshoot = math.log(bounciness)
    return -overshoot / math.hypot(math.pi, overshoot)


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


def unresolved_restitution(omega: float, zeta: float, step: float) -> float:
    """
    Return ε of the contacts of a deformable body whose impact is too short for the tick.

    That is the one of a damped spring that is let go when it would pull (Schwager, Pöschel 2007,
    Granular Matter 9, eq. 16–18), less what of the energy may be in the deformation at the end of
    the tick: the constant force that reverses the velocity v in it deforms by up to 4 v / (ω² h),
    undamped. For slower ones ε is 0: what is deformed rebounds.
    """
    phase = omega * step
    if phase <= SLOW_IMPACT:
        return 0.0
    share = math.sqrt(1.0 - (SLOW_IMPACT / phase) ** 2)
    root = math.sqrt(max(1.0 - zeta * zeta, 0.0))
    if root < 1e-6:
        return share * math.exp(-2.0)
    half = math.pi - math.atan2(2.0 * zeta * root, 1.0 - 2.0 * zeta * zeta)
    return share * math.exp(-zeta / root * half)


def breathing_damping(breathing: float, omega: float) -> float:
    """Return the least damping ratio of changes of volume: critical if incompressible."""
    return min(max(breathing / max(omega, 1e-12) - 1.0, 0.0) / STIFF, 1.0)


def put_gains(
    record: np.void,
    body: BodyConfig,
    material: Material,
    step: float,
    reference_step: float,
    kappa: float = KAPPA,
) -> None:
    """
    Write the gains of a body for one tick into its BODY record.

    Parameters
    ----------
    record : BODY, ()
        written: `kept_velocity`, the share of the velocity of deformation that `damping` leaves;
        `creep`, the share of a strain that becomes permanent; `whole_body_weight`, the weight of
        the match of the whole body, where its regions have the rest; and what follows
    body : BodyConfig
    material : Material
        of it
    step, reference_step : float
        h and h₀, s
    kappa : float
        κ of bodies without goals of their particles

    """
    reference_steps = step / reference_step
    friction = body.friction
    if body.friction_model == 'viscous':
        friction = 1.0 - (1.0 - friction) ** reference_steps
    is_rigid = body.mode == 'rigid'
    record['mode'] = MODES.index(body.mode)
    record['follows_goals'] = not is_rigid and material.has_goals
    record['kept_velocity'] = (1.0 - body.damping) ** reference_steps
    record['yield_strain'] = body.plasticity_yield
    record['creep'] = -math.expm1(-body.plasticity_creep * step)
    record['largest_strain'] = body.plasticity_max
    record['whole_body_weight'] = body.regions_whole_body_weight if body.regions_count else 1.0
    record['elasticity'] = body.elasticity
    if not is_rigid:
        record['elasticity'] = unresolved_restitution(material.followed, _damping(body), step)
    record['friction'], record['coulomb'] = friction, body.friction_model == 'coulomb'
    record['thickness'], record['mass'] = body.thickness, material.mass
    record['pins_linear'] = body.pins_velocity_linear
    record['pins_angular'] = body.pins_velocity_angular
    record['pins_shift'] = step * np.array(body.pins_velocity_linear)
    record['pins_acceleration'] = 0.0
    record['responses'], record['stiffnesses'], record['volume_share'] = 0.0, 0.0, 0.0
    record['relaxation'] = record['look_ahead'] = 0.0
    record['lasting'] = 1.0
    record['deformation'] = record['volume_conservation'] = 0.0
    if record['follows_goals']:
        _put_goal_gains(record, body, material, step)
    elif not is_rigid:
        _put_modal_gains(record, body, material, step, kappa)


def _put_modal_gains(
    record: np.void, body: BodyConfig, material: Material, step: float, kappa: float
) -> None:
    """
    Write the responses of the modes of a body in one tick, see `modal_flight`.

    Deformations that the goal follows have the stiffness (1 − β) α_s, the change of volume that of
    `breathing_frequency`, and the residual of each particle κ times the frequency of α_s.

    `responses` are those of `oscillator_response` for each kind of mode, in regular and in
    degenerate states, and of a body that touches something, where the elasticity reduces the
    bounciness; `stiffnesses` are ω² of the regular ones; `volume_share` is the share of the change
    of volume in the stiffness against it; `relaxation` and `compressible` are those of
    `modal_flight.flattened_volume`.
    """
    omega, followed, breathing = material.frequency, material.followed, material.breathing
    record['stiffnesses'] = followed**2, (kappa * omega) ** 2, breathing**2
    record['relaxation'] = -math.expm1(-ADAPTATION * omega * step)
    regular, degenerate, touching = record['responses']
    for responses, zeta in ((regular, _damping(body, 1.0)), (touching, _damping(body))):
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


def _damping(body: BodyConfig, elasticity: float | None = None) -> float:
    """Return ζ of a body that touches something, or with another elasticity."""
    bounciness = body.bounciness * (body.elasticity if elasticity is None else elasticity)
    return max(damping_ratio(bounciness), body.damping**CRITICAL_DAMPING)


def _put_goal_gains(record: np.void, body: BodyConfig, material: Material, step: float) -> None:
    """
    Write the response of particles to their goals in one tick, see `goal_flight`.

    A deformation of which goals follow the share β turns by φ' with cos φ' = β + (1 − β) cos φ in
    a tick, undamped: φ, ω h at the reference step, is such that its frequency is the same at any
    step. So forces at rest do not depend on the step; nor does the damping ratio ζ, for which
    goals follow another share of the velocity. `responses` have, in
    place of Γ₃, the share of the velocity relative to the goals that damping leaves; `lasting` is
    that of the damping of what turns by more than a right angle. `stiffnesses` are those at the
    reference step.
    """
    omega, followed, breathing = material.frequency, material.followed, material.breathing
    phase = omega * step
    record['stiffnesses'] = followed**2, omega**2, breathing**2
    zeta = _damping(body, 1.0)
    record['deformation'] = body.deformation, 0.0
    record['volume_conservation'] = body.volume_conservation, 0.0
    if phase > 0.0:
        record['deformation'][1] = share = 1.0 - _damped_share(followed * step, phase, zeta)
        if share > 0.0:
            kept = (1.0 - _damped_share(breathing * step, phase, zeta)) / share
            record['volume_conservation'][1] = 1.0 - kept
    turn = _residual_turn(followed * step, phase, body.deformation)
    # what turns by more than a right angle in a tick cannot swing with its goal
    least = LEAST_RESIDUAL_DAMPING * min(max(2.0 * phase / math.pi - 1.0, 0.0), 1.0)
    record['lasting'] = math.exp(-2.0 * least * phase)
    ratios = (_damping(body, 1.0), 1.0, _damping(body))
    for state, zeta in zip((REGULAR, DEGENERATE, TOUCHING), ratios, strict=True):
        zeta = max(zeta, least)
        # of the damped oscillator, by a turn after a loss of velocity
        growth = math.cosh(min(zeta * turn, LARGEST_EXPONENT))
        cosine = math.cos(math.sqrt(1.0 - zeta * zeta) * turn) / growth
        record['responses'][state, RESIDUAL], ahead = turn_about_goal(
            omega, math.acos(min(cosine, 1.0)), math.exp(-2.0 * zeta * phase), step
        )
        record['look_ahead'][state] = ahead


def turn_about_goal(
    omega: float, angle: float, kept: float, step: float
) -> tuple[tuple[float, float, float, float, float, float, float], float]:
    """
    Return the undamped motion about a goal in a tick, and the time τ from its start to the match.

    Parameters
    ----------
    omega : float
        ω, rad/s, which in rest says how far a force displaces
    angle : float
        by which it turns in a tick, φ ≥ 0
    kept : float
        share of the velocity relative to the goal that damping leaves
    step : float
        h, s

    Returns
    -------
    response : tuple of 7 float
        cos φ, sin φ / ω in s, −ω sin φ in 1/s, cos φ, Γ₁ in s², Γ₂ in s, and the share kept
    time : float
        τ = tan(φ / 2) / ω, s; less for more than a right angle, where the goal could overtake

    """
    if angle < 1e-6:
        return (1.0, step, -omega * omega * step, 1.0, 0.5 * step * step, step, kept), 0.5 * step
    # ω of the swing is that of the stiffness, whatever damping does to the angle
    sine, half = math.sin(angle), math.sin(0.5 * angle)
    change = 2.0 * half * half
    time = math.tan(0.5 * angle) / omega if angle <= math.pi / 2.0 else max(sine, 0.0) / omega
    position, velocity = change / omega**2, sine / omega
    return (1.0 - change, velocity, -omega * sine, 1.0 - change, position, velocity, kept), time


def _residual_turn(slow: float, phase: float, share: float) -> float:
    """Return φ for which what goals follow by a share turns by the angle `slow` in a tick."""
    if phase >= math.pi or share == 1.0:
        return phase
    return math.acos(max((math.cos(slow) - share) / (1.0 - share), -1.0))


def _damped_share(slow: float, phase: float, zeta: float) -> float:
    """Return 1 − f of the velocity of goals, for which it is damped with the same ratio ζ."""
    if zeta == 0.0:
        return slow / phase
    return math.expm1(-2.0 * zeta * slow) / math.expm1(-2.0 * zeta * phase)
