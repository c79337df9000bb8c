# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The contact problem: solutions meet its laws, checked with an operator assembled here."""

from contact_problems import (
    LINEAR,
    QUADRATIC,
    RIGID,
    Body,
    Case,
    frame_of,
    grid_cube,
    outwards,
    solve_all,
    stack,
    updated_discs,
    width,
)
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from softbody_ros.core.contact.rows import ROW
from softbody_ros.core.contact.solver import LARGE_SWEEPS, ROUGH_SWEEPS

KINDS = {
    'rigid': (RIGID,),
    'linear': (LINEAR,),
    'quadratic': (QUADRATIC,),
    'mixed': (RIGID, LINEAR, QUADRATIC),
}
PARTICLES = 12
"""Of each deformable body."""
STIFFER = (0.0, 0.5, 0.999)
"""Shares of the particles' response along one direction that K takes away."""


def random_case(random, kinds, members, contacts, shared=True, stiffer=STIFFER):
    """Return a problem with all that there is, of random numbers."""
    counts = [kinds[i % len(kinds)] for i in range(members)]
    mobility = np.concatenate(
        [random.uniform(0.0, 2.0, PARTICLES) * (count > RIGID) for count in counts]
    )
    other = random.spawn(1)[0]
    units = other.normal(size=(members, PARTICLES, 3))
    units /= np.linalg.norm(units, axis=(1, 2))[:, None, None]
    units *= np.sqrt(other.choice(stiffer, members))[:, None, None]
    case = Case(counts, mobility, np.sqrt(mobility)[:, None] * units.reshape(-1, 3))

    def jacobian(member):
        return random.normal(size=(3, counts[member])) * (0.5 if counts[member] == RIGID else 0.2)

    def particles(member, count):
        return member * PARTICLES + random.permutation(PARTICLES)[:count]

    for k in range(contacts * members):
        one, two = k % members, int(random.integers(-1, members))
        two = -1 if two == one else two
        first = particles(one, 1)[0] if shared else one * PARTICLES + k // members
        shares = [(first, 1.0)] if counts[one] > RIGID else []
        if two >= 0 and counts[two] > RIGID and shared:
            corners = random.dirichlet((1.0, 1.0, 1.0))
            shares += [(p, -c) for p, c in zip(particles(two, 3), corners, strict=True)]
        case.add(
            one, jacobian(one), two, jacobian(two) if two >= 0 else None, shares=shares,
            frame=frame_of(random.normal(size=3)), bias=random.normal(size=3) - (0.5, 0.0, 0.0),
            compliance=0.01, friction=random.choice([0.0, 0.3, 0.6]),
            base=(random.choice([0.0, 0.2]), 0.0, 0.0),
        )  # fmt: skip
    return case, jacobian, particles


@pytest.mark.parametrize('seed', range(8))
@pytest.mark.parametrize('members', [1, 2, 5])
@pytest.mark.parametrize('kinds', KINDS.values(), ids=KINDS)
def test_a_solution_meets_the_laws_of_contact(kinds, members, seed):
    case, _, _ = random_case(np.random.default_rng(seed), kinds, members, 12)
    residual, _, _ = case.solve(1e-11)
    assert residual <= 1e-10
    case.check()


@pytest.mark.parametrize('seed', range(8))
@pytest.mark.parametrize(
    ('members', 'friction'), [(1, 0.0), (1, 0.2), (2, 0.2), (5, 0.0), (5, 0.1)]
)
def test_rigid_bodies_alone_meet_them_too(members, friction, seed):
    random = np.random.default_rng(seed)
    count = 8 * members
    rows = np.zeros(count, ROW)
    rows['one'] = random.integers(0, members, count)
    rows['two'] = random.integers(-1, members, count)
    rows['two'][rows['two'] == rows['one']] = -1
    # contacts around bodies of different masses, with inertia 0.1 per mass
    mass = random.choice([0.5, 1.0, 5.0], members)
    frames = Rotation.random(count, random_state=seed).as_matrix()
    arms = 0.5 * random.normal(size=(count, 2, 1, 3))
    turning = np.cross(arms, frames[:, None]) / np.sqrt(0.1)
    jacobian = np.concatenate([np.broadcast_to(frames[:, None], turning.shape), turning], axis=3)
    for side, sign in ((0, 1.0), (1, -1.0)):
        index = rows['one' if side == 0 else 'two']
        jacobian[:, side] *= sign / np.sqrt(mass[index])[:, None, None]
    jacobian[rows['two'] < 0, 1] = 0.0
    rows['bias'] = random.normal(size=(count, 3)) - (0.5, 0.0, 0.0)
    rows['compliance'] = 0.01
    rows['friction'] = friction
    rows['viscosity'] = -1.0
    rows['base'][:, 0] = random.choice([0.0, 0.2], count)
    rows['radius'] = 0.0
    result = np.zeros(3)
    room = np.zeros((count, 2, 3, width(RIGID) + 1 - RIGID))
    room[..., -1] = np.nan
    padded = np.concatenate([jacobian, room], axis=3)
    lanes = padded.shape[3]
    solve_all(
        rows, padded.reshape(-1, lanes), np.full(members, RIGID), np.empty(0),
        np.zeros((3, members, lanes)), np.empty((2, 3, 0)),
        np.empty((members, members, RIGID, RIGID)), np.empty((members, members), np.bool_),
        1e-10, result,
    )  # fmt: skip
    assert result[0] <= 1e-10
    # the same operator, written independently
    matrix = np.zeros((count, 3, members, RIGID))
    for k in range(count):
        matrix[k, :, rows['one'][k]] = jacobian[k, 0]
        if rows['two'][k] >= 0:
            matrix[k, :, rows['two'][k]] += jacobian[k, 1]
    matrix = matrix.reshape(3 * count, -1)
    force = rows['force'].ravel()
    s = (rows['bias'].ravel() + 0.01 * force + matrix @ (matrix.T @ force)).reshape(-1, 3)
    total = rows['base'] + rows['force']
    assert total[:, 0].min() >= 0.0
    assert s[:, 0].min() > -1e-8
    assert np.abs(total[:, 0] * s[:, 0]).max() < 1e-7
    size = np.linalg.norm(total[:, 1:], axis=1)
    limit = rows['friction'] * total[:, 0]
    assert (size <= limit + 1e-9).all()
    slip = np.linalg.norm(s[:, 1:], axis=1)
    sticking = size < limit - 1e-6
    assert slip[sticking] == pytest.approx(0.0, abs=1e-8)
    sliding = slip > 1e-6
    against = (total[:, 1:] * s[:, 1:]).sum(axis=1)
    assert against[sliding] == pytest.approx(-(limit * slip)[sliding], abs=1e-7)


@pytest.mark.parametrize('seed', range(4))
def test_what_other_bodies_could_do_does_not_change_the_solution(seed):
    few, _, _ = random_case(np.random.default_rng(seed), KINDS['rigid'], 3, 12)
    few.solve(1e-11)
    # the same with room for more modes, and particles that no contact acts on
    more, _, _ = random_case(np.random.default_rng(seed), KINDS['rigid'], 3, 12)
    more.counts = np.append(more.counts, QUADRATIC)
    more.mobility = np.append(more.mobility, np.ones(5))
    more.stiffer = np.append(more.stiffer, np.ones((5, 3)), axis=0)
    room = ((0, 0), (0, 0), (0, width(QUADRATIC) - width(RIGID)))
    more.jacobian = [np.pad(j, room, constant_values=np.nan) for j in more.jacobian]
    more.solve(1e-11)
    assert (more.rows['force'] == few.rows['force']).all()


@pytest.mark.parametrize('seed', range(4))
@pytest.mark.parametrize('kinds', KINDS.values(), ids=KINDS)
def test_a_solution_meets_the_laws_with_pins(kinds, seed):
    random = np.random.default_rng(seed)
    case, jacobian, particles = random_case(random, kinds, 3, 8)
    for member, count in enumerate(case.counts):
        shares = [(particles(member, 1)[0], 1.0)] if count > RIGID else []
        case.pin(
            member, jacobian(member), shares, bias=random.normal(size=3),
            compliance=0.0 if count > RIGID else 0.01,
        )  # fmt: skip
    residual, _, _ = case.solve(1e-12)
    assert residual <= 1e-12
    case.check()
    pulled = case.rows['force'][np.isinf(case.rows['base'][:, 0]), 0]
    assert seed > 0 or pulled.min() < 0.0  # forces of any sign


# ------------------------------------------------------------------------------- shared particles
def own_mobility(case):
    return (case.mobility[case.rows['particles']] * case.rows['shares'] ** 2).sum(axis=1)


@pytest.mark.parametrize('ratio', [1.0, 10.0, 100.0])
@pytest.mark.parametrize('softness', [(1.0, 0.3), (0.05, 0.02), (0.01, 0.001)])
@pytest.mark.parametrize('shift', [0.0, 0.03, 0.13])
def test_faces_of_two_cubes_whose_particles_are_in_contacts_of_both(shift, softness, ratio):
    case = stack(6, ratio, 9, *softness, shift)
    case.rows['compliance'] = 0.1 * own_mobility(case)[:, None]
    residual, _, _ = case.solve(1e-12)
    assert residual <= 1e-12
    case.check(1e-3)


def test_exactly_the_same_contact_twice():
    case = stack(4, shift=0.0)  # without any compliance: only the sum of both forces is determined
    residual, _, _ = case.solve(1e-12)
    assert residual <= 1e-12
    case.check(1e-3)


@pytest.mark.parametrize('ratio', [1.0, 10.0, 100.0])
def test_faces_without_compliance_are_solved_to_some_precision(ratio):
    # nearly the same contacts twice: the operator is almost singular
    case = stack(6, ratio, shift=0.03)
    case.solve(1e-12)
    s = case.slips()
    assert s[:, 0].min() > -1e-3 * 1e-3
    assert np.abs(s[:, 0] * (case.rows['force'][:, 0] > 0.0)).max() < 1e-3 * 1e-3


def test_a_particle_between_two_obstacles():
    body = Body(grid_cube(4), features=9)
    case = Case([body.count], body.mobility)
    for normal, gap in (((1.0, 0.0, 0.0), -0.01), ((-0.6, 0.8, 0.0), -0.02), ((-1, 0, 0), 0.011)):
        case.add(
            0, body.at({0: 1.0}, frame_of(normal)), shares=[(0, 1.0)], frame=frame_of(normal),
            bias=(gap, 0.003, 0.0), friction=0.3,
        )  # fmt: skip
    residual, _, _ = case.solve(1e-13)
    assert residual <= 1e-13
    case.check(1e-2)
    assert (case.rows['force'][:2, 0] > 0.0).all()


# ----------------------------------------------------------------- what is stiffer than particles
def squeezed(share, friction=0.5):
    """Return a cube between two plates, of whose response to a change of volume some is lost."""
    body = Body(grid_cube(5), features=9)
    case = Case([body.count], body.mobility, body.stiffer(share))
    for side in (-1.0, 1.0):
        for i in np.flatnonzero(body.q[:, 2] == side):
            frame = frame_of((0.0, 0.0, -side))
            case.add(
                0, body.at({i: 1.0}, frame), shares=[(i, 1.0)], frame=frame,
                bias=(-0.05, 0.0, 0.0), friction=friction,
            )  # fmt: skip
    case.freeze()
    return body, case


@pytest.mark.parametrize('friction', [0.0, 0.5])
def test_a_cube_whose_volume_is_stiffer_needs_more_force(friction):
    totals = []
    for share in (0.0, 0.5, 0.9, 0.999, 1.0):
        _, case = squeezed(share, friction)
        residual, _, _ = case.solve(1e-12)
        assert residual <= 1e-12
        case.check(1e-2)
        totals.append(case.rows['force'][:, 0].sum())
    # less and less more: sides bulge instead
    assert (np.diff(totals) > 0.0).all()
    assert totals[-1] > 1.02 * totals[0]


@pytest.mark.parametrize('share', [0.0, 0.5, 0.999])
def test_a_displacement_is_reduced_by_the_share_along_one_direction_only(share):
    body, case = squeezed(share)
    case.solve(1e-12)
    without = case.shifts[0].T
    displacement = (
        without - body.stiffer(1.0) * np.sqrt(share) * case.modes[0, 0, width(body.count)]
    )
    volume = outwards(body.q)
    assert np.abs((volume * without).sum()) > 0.01
    assert (volume * displacement).sum() == pytest.approx(
        (1.0 - share) * (volume * without).sum(), rel=1e-9, abs=0.0
    )
    # the contacts keep what they should: of modes, and of this displacement
    chosen = case.rows['particles'][:, 0]
    y = case.modes[0, 0, : body.count]
    moved = (case.rows['normal'] * displacement[chosen]).sum(axis=1)
    gap = case.rows['bias'][:, 0] + case.jacobian[:, 0, 0, : body.count] @ y + moved
    assert np.abs(gap).max() < 1e-11


@pytest.mark.parametrize('share', [0.5, 0.999, 1.0])
@pytest.mark.parametrize('ratio', [1.0, 100.0])
def test_faces_of_two_cubes_whose_volumes_are_stiffer(ratio, share):
    case = stack(6, ratio, 9, 1.0, 0.3, 0.03, stiffer=share)
    case.rows['compliance'] = 0.1 * own_mobility(case)[:, None]
    residual, _, _ = case.solve(1e-12)
    assert residual <= 1e-12
    case.check(1e-3)


@pytest.mark.parametrize('share', [0.9, 0.999])
@pytest.mark.parametrize('friction', [0.0, 0.3, np.inf])
def test_a_cube_under_pressure_of_all_sides(friction, share):
    # nothing but what is stiffer can yield: a condition number of 1 / (1 − share), and more
    body = Body(grid_cube(5), features=3, soft=0.3)
    volume = outwards(body.q)
    volume[np.abs(volume).sum(axis=1) > 1.0] = 0.0
    case = Case([body.count], body.mobility, body.stiffer(share, volume))
    for i in np.flatnonzero(volume.any(axis=1)):
        frame = frame_of(-volume[i])
        case.add(
            0, body.at({i: 1.0}, frame), shares=[(i, 1.0)], frame=frame,
            bias=(-0.05, 0.01, 0.0), friction=friction,
        )  # fmt: skip
    residual, _, _ = case.solve(1e-12)
    assert residual <= 1e-12
    case.check(1e-2)
    expected = 0.05 / (1.0 - share) / case.mobility[0]
    assert case.rows['force'][:, 0].mean() == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize('share', [0.0, 0.9, 0.999])
@pytest.mark.parametrize('friction', [0.0, 0.5])
def test_a_cube_between_three_pairs_of_plates(friction, share):
    # particles at edges and corners are in contacts with two and three plates
    body = Body(grid_cube(5), features=9)
    case = Case([body.count], body.mobility, body.stiffer(share))
    for i, axis in np.argwhere(np.abs(body.q) > 1.0 - 1e-9):
        frame = frame_of(-np.sign(body.q[i, axis]) * np.eye(3)[axis])
        case.add(
            0, body.at({i: 1.0}, frame), shares=[(i, 1.0)], frame=frame,
            bias=(-0.05, 0.0, 0.0), friction=friction, compliance=0.1 * body.mobility[i],
        )  # fmt: skip
    residual, _, _ = case.solve(1e-12)
    assert residual <= 1e-12
    case.check(1e-1)


# ------------------------------------------------------------------------------------ other laws
def test_a_pinned_particle_carries_its_body():
    body = Body(grid_cube(4), mass=2.0, features=9)
    case = Case([body.count], body.mobility)
    case.pin(0, body.at({5: 1.0}, np.eye(3)), [(5, 1.0)], bias=(0.0, -0.1, 0.2))
    residual, _, _ = case.solve(1e-13)
    assert residual <= 1e-13
    force = np.linalg.solve(case.operator(), -case.rows['bias'].ravel())
    assert case.rows['force'].ravel() == pytest.approx(force, abs=1e-12)


@pytest.mark.parametrize('share', [0.25, 1.0])
@pytest.mark.parametrize('features', [0, 9])
def test_viscous_friction_removes_its_share_of_the_sliding(features, share):
    body = Body(grid_cube(4), features=features)
    case = Case([body.count], body.mobility)
    case.add(
        0, body.at({0: 1.0}, np.eye(3)), shares=[(0, 1.0)] if features else (), friction=np.inf,
        bias=(-0.01, 0.0, 0.0), free=(0.002, 0.0), viscosity=share,
        compliance=0.0 if features else 1e-6,
    )  # fmt: skip
    # only what is along one tangent, at the height of the centre
    case.jacobian[0][0, :, 3:] = 0.0
    residual, _, _ = case.solve(1e-13)
    assert residual <= 1e-13
    force = case.rows['force'][0]
    slip = (
        case.rows['free'][0, 0]
        + (case.operator()[1, 1] - case.rows['compliance'][0, 1]) * (force[1])
    )
    assert slip == pytest.approx((1.0 - share) * 0.002, abs=1e-8)


@pytest.mark.parametrize('share', [0.25, 1.0])
def test_viscous_friction_is_shared_out_by_area(share):
    case = Case([RIGID])
    centred = np.eye(3, RIGID)
    for softness in (1.0, 3.0):
        case.add(
            0, centred, friction=np.inf, bias=(-0.01, 0.0, 0.0), free=(0.002, -0.001),
            viscosity=share, softness=softness, compliance=1e-3,
        )  # fmt: skip
    residual, _, _ = case.solve(1e-13)
    assert residual <= 1e-13
    one, two = case.rows['force'][:, 1:]
    assert (one + two) == pytest.approx(-share * np.array((0.002, -0.001)), rel=1e-3)
    assert share == 1.0 or one == pytest.approx(3.0 * two, rel=1e-9)


@pytest.mark.parametrize('features', [3, 9])
def test_viscous_friction_is_that_of_contacts_that_press(features):
    open_ones = 0
    for seed in range(40):
        random = np.random.default_rng(seed)
        body = Body(grid_cube(3), features=features)
        case = Case([body.count], body.mobility)
        for particle in random.permutation(len(body.mobility))[:12]:
            frame = frame_of(random.normal(size=3))
            case.add(
                0, body.at({particle: 1.0}, frame), shares=[(particle, 1.0)], frame=frame,
                friction=np.inf, bias=(random.uniform(-0.01, 0.004), 0.0, 0.0),
                free=random.normal(scale=0.02, size=2), viscosity=random.choice([0.5, 1.0]),
            )  # fmt: skip
        residual, _, _ = case.solve(1e-11)
        assert residual <= 1e-11
        force = case.rows['force']
        open_ones += np.count_nonzero(force[:, 0] == 0.0)
        assert (force[:, 0] >= 0.0).all()
        assert not force[force[:, 0] == 0.0].any()
    assert open_ones > 40


# ------------------------------------------------------------------------------------- degenerate
def test_an_empty_problem():
    assert Case([RIGID]).solve()[0] == 0.0
    assert Case([]).solve()[0] == 0.0


@pytest.mark.parametrize('features', [0, 9])
def test_what_does_not_move_has_no_force(features):
    body = Body(grid_cube(3), features=features)
    case = Case([body.count], 0.0 * body.mobility)
    case.add(0, np.zeros((3, body.count)), shares=[(0, 1.0)], bias=(-1.0, 0.5, 0.0), friction=0.5)
    case.add(0, body.at({1: 1.0}, np.eye(3)), bias=(-1.0, 0.5, 0.0), friction=0.5,
             compliance=0.01)  # fmt: skip
    residual, _, _ = case.solve()
    assert residual <= 1e-11
    assert case.rows['force'][0].tolist() == [0.0, 0.0, 0.0]
    assert case.rows['force'][1, 0] > 0.0


def test_a_body_without_modes_moves_by_its_particles():
    case = Case([0, RIGID], [0.5])
    case.add(0, np.zeros((3, 0)), shares=[(0, 1.0)], bias=(-1.0, 0.2, 0.0), friction=0.5)
    residual, _, _ = case.solve()
    assert residual <= 1e-11
    assert case.rows['force'][0] == pytest.approx((2.0, -0.4, 0.0), abs=1e-12)


@pytest.mark.parametrize('features', [0, 3, 9])
def test_friction_without_limit(features):
    case = stack(4, features=features, friction=np.inf)
    if features:
        case.rows['compliance'] = 0.1 * own_mobility(case)[:, None]
    residual, _, _ = case.solve(1e-12)
    assert residual <= 1e-12
    case.check(1e-3)


# ---------------------------------------------------------------------------------------- descent
@pytest.mark.parametrize('stiffer', [0.0, 0.5, 0.999])
@pytest.mark.parametrize('kinds', [KINDS['quadratic'], KINDS['mixed']])
def test_every_step_decreases_the_objective(kinds, stiffer):
    case, _, _ = random_case(np.random.default_rng(1), kinds, 3, 8, stiffer=(stiffer,))
    case.freeze()
    case.rows['friction'] = 0.0
    before, operator = 0.0, case.operator()
    for number in range(90):
        case.step(number % 3)
        force = case.rows['force'].ravel()
        after = force @ (case.rows['bias'].ravel() + 0.5 * operator @ force)
        assert after <= before + 1e-13 * abs(before)
        before = after
    case.check()


@pytest.mark.parametrize('is_rough', [False, True])
def test_forces_are_within_their_cones_however_early_it_ends(is_rough):
    for seed in range(4):
        case, _, _ = random_case(np.random.default_rng(seed), KINDS['mixed'], 5, 12)
        residual, sweeps, steps = case.solve(1e-12, is_large=True, is_rough=is_rough)
        assert residual > 1e-12
        assert (sweeps, steps) == (ROUGH_SWEEPS if is_rough else LARGE_SWEEPS, 0)
        total = case.rows['base'] + case.rows['force']
        assert total[:, 0].min() >= 0.0
        size = np.linalg.norm(total[:, 1:], axis=1)
        assert (size <= case.rows['friction'] * total[:, 0] + 1e-12).all()


@pytest.mark.parametrize('seed', range(6))
def test_sweeps_find_the_contacts_that_others_close_among_many_that_are_idle(seed):
    random, number = np.random.default_rng(seed), 80
    case = Case([LINEAR], np.full(number, 2.0))
    for k in range(number):
        # those at one end tilt the body, which closes those at the other that are open at first
        place = k / (number - 1) - 0.5
        jacobian = 0.02 * random.normal(size=(3, LINEAR))
        jacobian[0, :2] = 0.1, place
        gap = -0.3 if place > 0.4 else 0.02 + 0.3 * (place + 0.5)
        bias = gap, *(0.1 * random.normal(size=2))
        case.add(0, jacobian, shares=[(k, 1.0)], bias=bias, compliance=0.01, friction=0.3)
    residual, sweeps, steps = case.solve(1e-9, is_large=True)
    assert residual <= 1e-9 and steps == 0 and 4 < sweeps < LARGE_SWEEPS
    closed = case.rows['force'][:, 0] > 0.0
    was_open = case.rows['bias'][:, 0] > 0.0
    assert (closed & was_open).any()
    assert closed.sum() < 0.5 * number
    case.check()


def test_radii_of_discs_that_alternate_are_taken_in_their_middle():
    """Between two states of a box that a belt rubs against a wall they did, for ever."""
    rows = np.zeros(1, ROW)
    rows['friction'], rows['radius'] = 0.5, 3.0
    for normal, radius in ((2.0, 1.0), (6.0, 2.0), (6.0, 3.0)):
        rows['force'][0, 0] = normal
        updated_discs(rows, True)
        assert rows['radius'][0] == radius
