# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Mass inside a closed surface: the moments of the volume, by hidden inner particles."""

from core_helpers import sheet
import numpy as np
import pytest
from solids import box, closed_surfaces, hollow_ball, hull, moved, of_the_solid
import trimesh

from softbody_ros.core import MeshError, Surface, make_surface
from softbody_ros.core.geometry.solid_moments import solid_moments
from softbody_ros.core.shape_matching.regions import make_regions
from softbody_ros.core.shape_matching.rest_shape import make_rest_shape, make_solid_rest_shape
from softbody_ros.core.shape_matching.solid import FARTHEST

pytestmark = pytest.mark.oldest

PRECISION = 1e-9


def inertia_of(points, weights):
    """Return the centre (3,), and the inertia tensor about it per mass (3, 3)."""
    centre = weights @ points
    arms = points - centre
    second = (arms * weights[:, None]).T @ arms
    return centre, np.trace(second) * np.eye(3) - second


@pytest.mark.parametrize('name', closed_surfaces())
def test_mass_centre_and_inertia_are_those_of_the_volume(name):
    surface = closed_surfaces()[name]
    rest, (volume, centre, inertia) = make_solid_rest_shape(surface), of_the_solid(surface)
    assert rest.weights.min() >= 0.0
    assert rest.weights.sum() == pytest.approx(1.0, abs=PRECISION)
    found, tensor = inertia_of(rest.particles, rest.weights)
    assert found == pytest.approx(centre, abs=PRECISION * rest.scale)
    assert tensor == pytest.approx(inertia, abs=PRECISION * np.abs(inertia).max())
    assert rest.volume == pytest.approx(volume, rel=PRECISION)
    # what the simulation uses: centre, and Σ w q qᵀ at the offsets q
    assert rest.centre == pytest.approx(centre, abs=PRECISION * rest.scale)
    second = rest.scale**2 * (rest.q * rest.weights) @ rest.q.T
    tensor = np.trace(second) * np.eye(3) - second
    assert tensor == pytest.approx(inertia, abs=PRECISION * np.abs(inertia).max())


@pytest.mark.parametrize('name', closed_surfaces())
def test_there_are_few_inner_particles_not_far_from_the_centre(name):
    surface = closed_surfaces()[name]
    rest, solid = make_solid_rest_shape(surface), solid_moments(surface.vertices, surface.faces)
    inside = rest.weights[rest.surface_count :]
    assert 1 <= len(rest.inner) <= 6
    assert rest.particle_count == rest.surface_count + len(rest.inner) == len(rest.q.T)
    assert (inside > 0.0).all()
    assert rest.weights[: rest.surface_count].sum() > 0.01
    # in RMS extents of the solid in each direction, from the mean of the inner particles
    arms = rest.inner - inside @ rest.inner / inside.sum()
    distances = np.sqrt(np.einsum('ki,ij,kj->k', arms, np.linalg.inv(solid.second), arms))
    assert distances.max() < FARTHEST * (1.0 + 1e-6)


@pytest.mark.parametrize('mesh', ['icosphere', 'box'])
def test_of_a_ball_or_a_cube_two_fifths_are_in_the_centre(mesh):
    rest = make_solid_rest_shape(make_surface(mesh, 0.5, 4))
    assert rest.inner == pytest.approx(np.zeros((1, 3)), abs=1e-12)
    assert rest.weights[-1] == pytest.approx(0.4, rel=0.01)


@pytest.mark.parametrize('seed', range(5))
def test_in_a_convex_body_inner_particles_are_inside(seed):
    surface = hull(seed)
    mesh = trimesh.Trimesh(surface.vertices, surface.faces)
    assert mesh.contains(make_solid_rest_shape(surface).inner).all()


def test_moments_of_a_box_are_exact():
    extents, place = np.array([1.0, 2.0, 3.0]), np.array([5.0, -7.0, 11.0])
    surface = box(extents, 1, place)
    solid = solid_moments(surface.vertices, surface.faces)
    assert solid.volume == pytest.approx(6.0, rel=1e-14)
    assert solid.centre == pytest.approx(place, rel=1e-14)
    assert solid.second == pytest.approx(np.diag(extents**2) / 12.0, abs=1e-14)
    turned_out = solid_moments(surface.vertices, surface.faces[:, ::-1])
    assert turned_out.volume == pytest.approx(-6.0, rel=1e-14)


def test_a_cavity_is_no_mass():
    outside, inside = 1.0, 0.5
    rest = make_solid_rest_shape(hollow_ball(inside, 4))
    second = (rest.q**2 @ rest.weights) * rest.scale**2
    expected = (outside**5 - inside**5) / (outside**3 - inside**3) / 5.0
    assert second == pytest.approx(expected, rel=0.01)  # of the facets
    assert rest.weights[: rest.surface_count].sum() > 0.75


def test_the_share_of_the_surface_depends_on_the_form_alone():
    share = [
        make_solid_rest_shape(surface).weights[-1]
        for surface in (hull(1), moved(hull(1), 1e3), moved(hull(1), 1e-3, (1.0, 2.0, 3.0)))
    ]
    assert share == pytest.approx([share[0]] * 3, rel=1e-9)


def test_the_same_mesh_has_the_same_bits():
    one, two = (make_solid_rest_shape(hull(2)) for _ in range(2))
    assert one.inner.tobytes() == two.inner.tobytes()
    assert one.weights.tobytes() == two.weights.tobytes()
    assert one.q.tobytes() == two.q.tobytes()


def test_mass_at_the_surface_is_as_it_was():
    surface = hull(0)
    rest = make_rest_shape(surface)
    assert len(rest.inner) == 0
    assert rest.particle_count == rest.surface_count == len(surface.vertices)
    assert rest.particles.tobytes() == surface.vertices.tobytes()
    assert rest.weights == pytest.approx(rest.areas / rest.areas.sum(), rel=1e-12)
    assert rest.volume > 0.0
    assert make_rest_shape(sheet()).volume == 0.0


def test_what_encloses_nothing_is_refused():
    cube = box((1.0, 1.0, 1.0))
    with pytest.raises(MeshError, match='mass_distribution is volume, but the surface is open'):
        make_solid_rest_shape(sheet())
    with pytest.raises(MeshError, match='open and encloses none'):
        make_solid_rest_shape(Surface(cube.vertices, cube.faces[1:]))
    with pytest.raises(MeshError, match='folded or inside out'):
        make_solid_rest_shape(Surface(cube.vertices, cube.faces[:, ::-1]))
    with pytest.raises(MeshError, match='folded or inside out'):
        make_solid_rest_shape(Surface(cube.vertices * (1.0, 1.0, 0.0), cube.faces))


def test_inner_particles_follow_an_affine_motion_exactly():
    rest, random = make_solid_rest_shape(hull(4)), np.random.default_rng(0)
    affine, shift = random.normal(size=(3, 3)), random.normal(size=(3, 1))
    surface = affine @ rest.surface.vertices.T + shift
    expected = affine @ rest.inner.T + shift
    assert rest.inner_following(surface) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(('mesh', 'count'), [('icosphere', 8), ('capsule', 5), ('box', 1)])
def test_regions_have_all_of_the_mass(mesh, count):
    rest = make_solid_rest_shape(make_surface(mesh, 0.5, 2))
    regions = make_regions(rest, count, 3)
    shares = np.bincount(regions.particle, regions.features[0])
    assert shares == pytest.approx(np.ones(rest.particle_count), rel=1e-12)
    assert regions.mass.sum() == pytest.approx(1.0, rel=1e-9)
    assert len(regions.main_region) == regions.membership.shape[0] == rest.particle_count
    at_surface = np.bincount(regions.particle)[: rest.surface_count]
    assert at_surface.max() == min(count, 3)


def test_the_centre_of_a_ball_leans_to_no_region():
    rest = make_solid_rest_shape(make_surface('icosphere', 0.5, 3))
    regions = make_regions(rest, 12, 3)
    share = regions.features[0, regions.particle == rest.surface_count]
    assert share == pytest.approx(np.full(12, 1 / 12), rel=1e-6)
