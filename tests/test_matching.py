# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Rest shapes, rotations, fits, goals and volumes, against definitions and brute force."""

from core_helpers import (
    body,
    cad_mesh,
    cloud,
    enclosed_volume,
    floating,
    random_rotation,
    rank_deficient_shapes,
    rms_displacement,
    sheared_box,
    sheet,
)
import kernels as matching
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from softbody_ros.core import MeshError, Surface, make_surface
from softbody_ros.core.shape_matching.polar_decomposition import rotation
from softbody_ros.core.shape_matching.rest_shape import make_rest_shape

pytestmark = pytest.mark.oldest

SHAPES = {
    'icosphere': make_surface('icosphere', 0.5, 2),
    'box': make_surface('box', 0.5, 2),
    'torus': make_surface('torus', 0.5, 0),
    'sheared box': sheared_box(),
    'CAD part': make_surface(cad_mesh('power_connector'), 0.5, 0),
}
DEFICIENT = rank_deficient_shapes()


def by_name(shapes):
    return pytest.mark.parametrize('surface', shapes.values(), ids=shapes.keys())


def random_transform(seed, features, amount=0.2):
    """Return a (1, 3, features) transform that deforms and turns a body."""
    random = np.random.default_rng(seed)
    transform = np.zeros((3, features))
    transform[:, :3] = np.eye(3)
    transform += amount * random.normal(size=transform.shape)
    return (random_rotation(seed) @ transform)[None]


def goals_of(transform, rest, centre=(0.0, 0.0, 0.0)):
    return matching.goals(np.array([centre]), transform, rest)


def volume_of(transform, rest):
    return enclosed_volume(goals_of(transform, rest)[0].T, rest.surface.faces)


# ------------------------------------------------------------------------------------ rest shape
@by_name(SHAPES | DEFICIENT)
def test_weights_sum_to_one_and_features_have_no_mean(surface):
    rest = make_rest_shape(surface)
    assert rest.weights.min() >= 0.0
    assert rest.weights.sum() == pytest.approx(1.0, rel=1e-14)
    assert np.all(rest.features[0] == 1.0)
    assert np.abs(rest.features[1:] @ rest.weights).max() < 1e-14
    assert rest.weights @ np.sum(rest.features[1:4] ** 2, axis=0) == pytest.approx(1.0)


def test_the_quadratic_features_are_the_products_of_the_coordinates():
    rest = make_rest_shape(sheared_box())
    x, y, z = (rest.surface.vertices - rest.centre).T / rest.scale
    products = np.stack([x * x, y * y, z * z, x * y, y * z, z * x])
    offset = rest.features[4:] - products
    assert np.abs(offset - offset[:, :1]).max() < 1e-14


def inertia(surface):
    rest = make_rest_shape(surface)
    return rest.scale**2 * (rest.features[1:4] * rest.weights) @ rest.features[1:4].T


@pytest.mark.parametrize('kind', ['icosphere', 'torus', 'capsule'])
def test_the_mass_distribution_does_not_depend_on_the_fineness(kind):
    coarse, fine = (inertia(make_surface(kind, 0.5, level)) for level in (3, 4))
    assert np.abs(coarse - fine).max() < 0.01 * np.trace(fine)


def test_the_mass_distribution_does_not_depend_on_where_a_mesh_is_fine():
    box = make_surface('box', 0.5, 3)
    corners = box.vertices[box.faces]
    fine = corners[:, :, 2].min(axis=1) > 0.3
    middle = (corners + np.roll(corners, -1, axis=1)) / 2
    parts = [corners[~fine], middle[fine]]
    for i in range(3):
        parts.append(np.stack([corners[:, i], middle[:, i], middle[:, i - 1]], axis=1)[fine])
    refined = np.vstack(parts)
    points, index = np.unique(refined.reshape(-1, 3), axis=0, return_inverse=True)
    surface = Surface(points, index.reshape(-1, 3))
    assert len(surface.vertices) > 1.3 * len(box.vertices)
    assert np.abs(make_rest_shape(surface).centre).max() < 1e-3
    assert np.abs(inertia(surface) - inertia(box)).max() < 0.01 * np.trace(inertia(box))


def test_particles_without_faces_weigh_the_same():
    assert make_rest_shape(DEFICIENT['cloud']).weights == pytest.approx(1 / 40)


def test_a_shape_without_extent_is_refused():
    with pytest.raises(MeshError, match='coincide'):
        make_rest_shape(cloud(np.ones((5, 3))))


# -------------------------------------------------------------------------------------- rotation
def special_moments():
    random = np.random.default_rng(0)
    turn = random_rotation(3)
    return {
        'identity': np.eye(3),
        'mirrored': turn @ np.diag([1.0, 2.0, -0.5]),
        'point reflection': -np.eye(3),
        'two directions inverted': turn @ np.diag([-1.0, -2.0, 0.5]),
        'flat': turn @ np.diag([1.0, 0.5, 0.0]),
        'line': turn @ np.diag([1.0, 0.0, 0.0]),
        'point': np.zeros((3, 3)),
        'tiny': 1e-160 * random.normal(size=(3, 3)),
        'huge': 1e90 * random.normal(size=(3, 3)),
        'badly scaled': random.normal(size=(3, 3)) * [1e-8, 1.0, 1e8],
    } | {f'random {i}': random.normal(size=(3, 3)) for i in range(20)}


@pytest.mark.parametrize('moment', special_moments().values(), ids=special_moments().keys())
def test_the_rotation_is_the_best_of_all(moment):
    R = rotation(moment[None])[0]
    assert np.linalg.det(R) == pytest.approx(1.0, abs=1e-13)
    assert np.abs(R @ R.T - np.eye(3)).max() < 1e-13
    size = np.abs(moment).max() or 1.0
    others = np.vstack(
        [
            Rotation.random(500, random_state=0).as_matrix(),
            Rotation.from_rotvec(
                np.random.default_rng(1).normal(scale=0.01, size=(500, 3))
            ).as_matrix()
            @ R,
        ]
    )
    best = np.einsum('ij,ij->', R, moment)
    assert np.einsum('kij,ij->k', others, moment).max() <= best + 1e-12 * size


def test_the_rotation_is_that_of_the_kabsch_algorithm():
    for moment in np.random.default_rng(2).normal(size=(20, 3, 3)):
        expected = Rotation.align_vectors(moment.T, np.eye(3))[0].as_matrix()
        assert rotation(moment[None])[0] == pytest.approx(expected, abs=1e-9)


@by_name(SHAPES)
def test_the_rotation_of_a_turned_body_is_its_turn(surface):
    rest, turn = make_rest_shape(surface), random_rotation(7)
    x = (turn @ surface.vertices.T)[None] + 3.0
    centre, moment = matching.moments(x, rest, 3)
    assert rotation(moment)[0] == pytest.approx(turn, abs=1e-12)
    assert centre[0] == pytest.approx(turn @ rest.centre + 3.0)


# ------------------------------------------------------------------------------------------- fit
@by_name(SHAPES)
@pytest.mark.parametrize('features', [3, 9])
@pytest.mark.parametrize('seed', range(3))
def test_the_fit_reproduces_every_deformation_that_the_mode_knows(surface, features, seed):
    rest = make_rest_shape(surface)
    transform = random_transform(seed, features)
    x = goals_of(transform, rest, (1.0, 2.0, 3.0))
    centre, moment = matching.moments(x, rest, features)
    fits = matching.fit(moment, rotation(moment), rest)
    assert matching.goals(centre, fits, rest) == pytest.approx(x, abs=1e-9)


@by_name(SHAPES | DEFICIENT)
@pytest.mark.parametrize('features', [3, 9])
def test_the_fit_is_the_least_squares_fit(surface, features):
    rest = make_rest_shape(surface)
    random = np.random.default_rng(4)
    x = goals_of(random_transform(1, 3, 0.05), rest)
    x = x + 0.05 * rest.scale * random.normal(size=x.shape)
    centre, moment = matching.moments(x, rest, features)
    fits = matching.fit(moment, rotation(moment), rest)
    found = matching.goals(centre, fits, rest)[0]

    root = np.sqrt(rest.weights)
    coefficients = np.linalg.lstsq(
        (rest.features[: 1 + features] * root).T, (x[0] * root).T, rcond=1e-6
    )[0]
    nearest = coefficients.T @ rest.features[: 1 + features]
    assert found == pytest.approx(nearest, abs=1e-8)


@by_name(SHAPES | DEFICIENT)
@pytest.mark.parametrize('features', [3, 9])
def test_a_body_in_its_rest_shape_is_at_its_goal(surface, features):
    rest = make_rest_shape(surface)
    x = (random_rotation(5) @ surface.vertices.T)[None]
    centre, moment = matching.moments(x, rest, features)
    rotations = rotation(moment)
    for beta in (0.0, 0.5, 1.0):
        fits = matching.fit(moment, rotations, rest)
        fits, _ = matching.of_rest_volume(fits, rest)
        transform = matching.blended(fits, rotations, np.array([beta]))
        assert matching.goals(centre, transform, rest) == pytest.approx(x, abs=1e-9)


def test_the_blend_goes_from_the_rotation_to_the_fit():
    fits, turn = random_transform(1, 9), random_rotation(2)[None]
    assert np.array_equal(matching.blended(fits, turn, np.array([1.0])), fits)
    rigid = matching.blended(fits, turn, np.array([0.0]))
    assert np.array_equal(rigid, matching.padded(turn))
    half = matching.blended(fits, turn, np.array([0.5]))
    assert half == pytest.approx((fits + rigid) / 2)


# ------------------------------------------------------------------------------- degeneracy
def degeneracy(transform, rest):
    fits = np.asarray(transform, dtype=float)[None]
    return matching.degeneracy(fits, matching.relative_volume(fits, rest), rest)[0]


@pytest.mark.parametrize('features', [3, 9])
@pytest.mark.parametrize('seed', range(5))
def test_a_body_that_is_only_squashed_sheared_or_bent_has_not_strayed(features, seed):
    rest = make_rest_shape(SHAPES['sheared box'])
    assert degeneracy(random_transform(seed, features, 0.1)[0], rest) == 0.0
    turn = random_rotation(seed)
    for squash in (np.diag([1.3, 1.0, 0.75]), np.diag([2.0, 0.7, 0.7]), 0.8 * np.eye(3)):
        assert degeneracy(turn @ squash, rest) == 0.0


@pytest.mark.parametrize(
    'transform',
    [
        -np.eye(3),
        np.diag([1.0, 1.0, -1.0]),
        np.diag([1.0, 1.0, 0.0]),
        np.diag([1.0, 0.0, 0.0]),
        np.zeros((3, 3)),
        10.0 * np.eye(3),
        np.diag([100.0, 1.0, 1.0]),
        np.diag([10.0, 10.0, 0.01]),
    ],
)
def test_only_the_rest_shape_leads_out_of_inverted_flat_and_huge_states(transform):
    assert degeneracy(transform, make_rest_shape(SHAPES['sheared box'])) == 1.0


def test_a_body_that_is_bent_too_far_has_strayed():
    rest, bend = make_rest_shape(SHAPES['icosphere']), np.zeros((3, 9))
    bend[:, :3], bend[0, 4] = np.eye(3), 5.0
    assert degeneracy(bend, rest) == 1.0


def test_coefficients_that_move_nothing_are_no_bend():
    ball = make_rest_shape(SHAPES['icosphere'])
    noise = 1.0 + 1e-4 * np.random.default_rng(1).standard_normal((ball.surface_count, 1))
    surface = Surface(ball.surface.vertices * noise, ball.surface.faces)
    fit = np.zeros((3, 9))
    fit[:, :3], fit[2, 3:6] = np.eye(3), 100.0  # of x² + y² + z²
    assert degeneracy(fit, make_rest_shape(surface)) == 0.0
    fit[2, 7] = 1.0  # and of y z
    assert degeneracy(fit, make_rest_shape(surface)) > 0.0


# ---------------------------------------------------------------------------------------- volume
@by_name(SHAPES)
@pytest.mark.parametrize('features', [3, 9])
@pytest.mark.parametrize('seed', range(4))
def test_the_relative_volume_is_that_of_the_goal_mesh(surface, features, seed):
    rest = make_rest_shape(surface)
    transform = random_transform(seed, features)
    expected = volume_of(transform, rest) / enclosed_volume(surface.vertices, surface.faces)
    found = matching.relative_volume(transform, rest)[0]
    assert found == pytest.approx(expected, rel=1e-10, abs=1e-10)


def test_the_relative_volumes_of_a_stack_are_those_of_its_members():
    rest = make_rest_shape(SHAPES['torus'])
    stack = np.concatenate([random_transform(seed, 9) for seed in range(5)])
    alone = [matching.relative_volume(one[None], rest)[0] for one in stack]
    assert matching.relative_volume(stack, rest) == pytest.approx(alone, rel=1e-13)


@by_name({'sheet': sheet(), 'cloud': DEFICIENT['cloud'], 'rod': DEFICIENT['rod']})
def test_the_volume_of_an_open_shape_is_the_determinant(surface):
    rest = make_rest_shape(surface)
    transform = random_transform(3, 9)
    expected = np.linalg.det(transform[0, :, :3])
    assert matching.relative_volume(transform, rest)[0] == pytest.approx(expected)


@by_name(SHAPES)
@pytest.mark.parametrize('features', [3, 9])
@pytest.mark.parametrize('seed', range(4))
def test_the_gradient_of_the_volume_is_its_derivative(surface, features, seed):
    rest, transform = make_rest_shape(surface), random_transform(seed, features, 0.1)
    change = 1e-6 * np.random.default_rng(seed).normal(size=transform.shape)
    before, after = (matching.relative_volume(transform + way * change, rest) for way in (-1, 1))
    expected = (after - before) / 2
    found = np.sum(matching.volume_gradient(transform, rest) * change)
    assert found == pytest.approx(expected[0], abs=1e-14, rel=1e-6)


@by_name(SHAPES)
@pytest.mark.parametrize('features', [3, 9])
@pytest.mark.parametrize('seed', range(4))
def test_the_goal_keeps_the_rest_volume(surface, features, seed):
    rest = make_rest_shape(surface)
    transform = random_transform(seed, features, 0.1)
    before = abs(matching.relative_volume(transform, rest)[0] - 1.0)
    kept, volume = matching.of_rest_volume(transform, rest)
    expected = enclosed_volume(surface.vertices, surface.faces)
    assert volume[0] == pytest.approx(matching.relative_volume(transform, rest)[0], rel=1e-14)
    assert volume_of(kept, rest) == pytest.approx(expected, rel=max(before**3, 1e-12))


@by_name(SHAPES)
@pytest.mark.parametrize('features', [3, 9])
@pytest.mark.parametrize('seed', range(2))
def test_no_goal_of_the_rest_volume_is_nearer_to_the_particles(surface, features, seed):
    rest, transform = make_rest_shape(surface), random_transform(seed, features, 0.05)
    f, w = rest.features[1 : 1 + features], rest.weights

    def distance(other):
        return np.sum(((other - transform)[0] @ f) ** 2 @ w)

    kept, _ = matching.of_rest_volume(transform, rest)
    random = np.random.default_rng(seed)
    for size in (0.0, 1e-3, 1e-2, 1e-1):
        other = kept + size * random.normal(size=kept.shape)
        other *= np.cbrt(1.0 / matching.relative_volume(other, rest))
        assert distance(kept) <= distance(other) * (1.0 + 1e-2)
    scaled = transform * np.cbrt(1.0 / matching.relative_volume(transform, rest))
    assert distance(kept) <= distance(scaled) * (1.0 + 1e-2)


@pytest.mark.parametrize('size', [0.75, 0.9, 1.2, 1.35])
def test_a_goal_that_is_only_too_large_or_too_small_is_scaled(size):
    rest, turn = make_rest_shape(SHAPES['icosphere']), random_rotation(5)[None]
    kept, _ = matching.of_rest_volume(size * turn, rest)
    assert kept == pytest.approx(turn, abs=1e-12)


@by_name({'sheet': sheet(), 'rod': DEFICIENT['rod']})
@pytest.mark.parametrize('features', [3, 9])
def test_a_shape_without_volume_has_none_to_keep(surface, features):
    rest, transform = make_rest_shape(surface), 1.2 * random_transform(1, features, 0.02)
    kept, volume = matching.of_rest_volume(transform, rest)
    assert np.array_equal(kept, transform)
    assert volume[0] == 1.0


# ------------------------------------------------------------------ shapes that span little space
@by_name(DEFICIENT)
@pytest.mark.parametrize('mode', ['rigid', 'linear', 'quadratic'])
def test_a_shape_that_spans_little_comes_back_when_it_is_disturbed(surface, mode):
    world = floating(body(surface, mode=mode, initial_velocity_angular=(0.3, 0.2, 0.1)), h=1 / 240)
    scale = world.rest_shape('body').scale
    random = np.random.default_rng(3)
    x = world.positions('body')
    world.set_state('body', x + 0.1 * scale * random.normal(size=x.shape))
    assert rms_displacement(world) > 0.03
    world.step(480)
    assert rms_displacement(world) < 0.01


def squashed(kind, x, random):
    """Return positions that no longer have the rest shape's topology."""
    return {
        'inverted': x * (1.0, 1.0, -1.0),
        'reflected': -x,
        'flat': x * (1.0, 1.0, 0.0),
        'line': x * (1.0, 0.0, 0.0),
        'point': x * 0.0,
        'random': random.normal(size=x.shape),
        'huge': 100.0 * x,
        'tiny': 1e-9 * x,
    }[kind]


@pytest.mark.parametrize('mode', ['rigid', 'linear', 'quadratic'])
@pytest.mark.parametrize(
    'kind', ['inverted', 'reflected', 'flat', 'line', 'point', 'random', 'huge', 'tiny']
)
@by_name({name: SHAPES[name] for name in ('icosphere', 'sheared box')})
def test_any_state_comes_back_to_the_rest_shape(surface, kind, mode):
    world = floating(body(surface, mode=mode), h=1 / 240)
    x = world.positions('body') - world.rest_shape('body').centre
    world.set_state('body', squashed(kind, x, np.random.default_rng(8)))
    world.step(720)
    assert rms_displacement(world) < 0.01


def test_a_body_at_rest_stays_where_it_is():
    for mode in ('rigid', 'linear', 'quadratic'):
        world = floating(body(sheared_box(), mode=mode))
        before = world.positions('body')
        world.step(500)
        assert np.abs(world.positions('body') - before).max() < 1e-11
