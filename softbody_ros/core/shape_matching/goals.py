# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Goals of a body: match of the whole body and of its regions, plastic flow.

Müller, Heidelberger, Teschner, Gross: Meshless Deformations Based on Shape Matching, SIGGRAPH
2005, sections 3.3 and 4.
"""

from __future__ import annotations

import numpy as np

from softbody_ros.core.body import RIGID
from softbody_ros.core.compiled import helper
from softbody_ros.core.geometry.vectors import (
    IDENTITY,
    ZERO,
    Matrix,
    matrix_of,
    put_column,
    put_matrix,
    put_vector,
    scaled,
    times,
    vector_of,
)
from softbody_ros.core.shape_matching.matching import (
    blend,
    degeneracy_of,
    fill,
    fit,
    linear_block,
    move_to_rest_volume,
)
from softbody_ros.core.shape_matching.plasticity import elastic_of, flowed, undeformed_of
from softbody_ros.core.shape_matching.regions import (
    add_region_goals,
    region_fit,
    region_moment,
)


@helper
def find_goal(
    body: np.void,
    shape: np.void,
    stretch: np.ndarray,
    posture: np.ndarray,
    scratch: np.ndarray,
    goal: np.ndarray,
    damping_goal: np.ndarray,
) -> float:
    """
    Match the whole body, and write the transforms of its goals (sections 3.3, 4.2, 4.3).

    Parameters
    ----------
    body : BODY
    shape : SHAPE
        with the weights of the match
    stretch : (2, S, 3, 3) float
    posture : (S, 3, 3) float
        see `goal_flight.fly_to_goals`
    scratch : (5, F, 3) float
        the first is Σ w f y, m
    goal, damping_goal : (F, 3) float
        of the pull, and those relative to which velocities are damped; dimensionless

    Returns
    -------
    float
        see `matching.degeneracy_of`

    """
    row, now, is_plastic = body['first_match'], body['now'], body['is_plastic']
    moment, fitted, volume_fit = scratch[0], scratch[1], scratch[2]
    for f in range(len(moment)):
        for axis in range(3):
            moment[f, axis] /= shape['scale']
    plastic = matrix_of(stretch[now, row])
    undeformed = undeformed_of(linear_block(moment), plastic, is_plastic)
    if body['mode'] == RIGID:
        # the goal follows no deformation, so no fit is needed
        fill(fitted, 0.0)
        blend(fitted, fitted, 0.0, 0.0, undeformed, goal)
        blend(fitted, fitted, 0.0, 0.0, undeformed, damping_goal)
        put_matrix(posture[row], undeformed)
        return 0.0
    fit(moment, undeformed, shape, fitted)
    volume = move_to_rest_volume(fitted, shape, volume_fit, scratch[3], scratch[4], 1.0)
    elastic = elastic_of(linear_block(fitted), plastic, is_plastic)
    degeneracy = degeneracy_of(fitted, elastic, volume, shape['bend_gram'])
    conserves = 1.0 if degeneracy < 1.0 else 0.0
    conserved, beta = body['volume_conservation'], body['deformation']
    regularity = 1.0 - degeneracy
    blend(fitted, volume_fit, conserves * conserved[0], regularity * beta[0], undeformed, goal)
    conserves *= conserved[1]
    blend(fitted, volume_fit, conserves, regularity * beta[1], undeformed, damping_goal)
    put_matrix(posture[row], undeformed if degeneracy > 0.0 else linear_block(fitted))
    flow(body, stretch, row, elastic, degeneracy)
    return degeneracy


@helper
def flow(body: np.void, stretch: np.ndarray, row: int, elastic: Matrix, degeneracy: float) -> None:
    """Write the plastic state of a match after the tick; degenerate states do not flow."""
    creep, now = body['creep'], body['now']
    if not (body['is_plastic'] or creep > 0.0):
        return
    plastic = matrix_of(stretch[now, row]) if body['is_plastic'] else IDENTITY
    flows = False
    if creep > 0.0 and degeneracy < 1.0:
        limits = (body['yield_strain'], creep, body['largest_strain'])
        flows, plastic = flowed(plastic, elastic, limits[0], limits[1], limits[2])
    put_matrix(stretch[1 - now, row], plastic)
    if flows:
        body['flowed'] = True


@helper
def match_regions(
    body: np.void,
    shape: np.void,
    regions: np.ndarray,
    member: np.ndarray,
    features: np.ndarray,
    weighted_features: np.ndarray,
    goals: np.ndarray,
    stretch: np.ndarray,
    match_centre: np.ndarray,
    match_posture: np.ndarray,
    degeneracy: float,
) -> None:
    """
    Match each region (section 4.4), and replace the positions of particles by their goals.

    Parameters
    ----------
    body, shape, regions, member, features, weighted_features, stretch
        see `goal_flight.fly_to_goals`; the shape with the weights of the match
    goals : (3, N) float
        positions, then weighted means of the goals by regions, m; the first particle of the body
        is in column `first_goal`
    match_centre, match_posture : (S, 3), (S, 3, 3) float
        written, see `goal_flight.fly_to_goals`
    degeneracy : float
        of the match of the whole body

    """
    first, scale, is_plastic = body['first_goal'], shape['scale'], body['is_plastic']
    for k in range(body['regions']):
        region, row = regions[shape['first_region'] + k], body['first_match'] + 1 + k
        moment, weighted = region_moment(region, member, weighted_features, goals, first)
        moment = times(1.0 / scale, moment)
        plastic = matrix_of(stretch[body['now'], row])
        undeformed = undeformed_of(moment, plastic, is_plastic)
        put_vector(match_centre[row], scaled(1.0 / region['mass'], weighted))
        put_matrix(match_posture[row], undeformed)
        if is_plastic or body['creep'] > 0.0:
            fitted = region_fit(region, moment, undeformed)
            flow(body, stretch, row, elastic_of(fitted, plastic, is_plastic), degeneracy)
    for i in range(first, first + body['count']):
        put_column(goals, i, ZERO)
    for k in range(body['regions']):
        region, row = regions[shape['first_region'] + k], body['first_match'] + 1 + k
        centre, undeformed = vector_of(match_centre[row]), matrix_of(match_posture[row])
        transform = times(scale, undeformed)
        add_region_goals(region, member, features, centre, transform, goals, first)
        if region['unspanned'][0, 0] + region['unspanned'][1, 1] + region['unspanned'][2, 2] > 1.5:
            # a point or a line has no orientation of its own
            put_matrix(match_posture[row], matrix_of(match_posture[body['first_match']]))
