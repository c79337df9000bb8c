# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Robots of URDFs: kinematics, collision shapes, and what their links do to bodies."""

import io
import math
import pathlib
import re

from core_helpers import assert_goes_on_bit_by_bit, bytes_of
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
import trimesh
import yourdfpy

from softbody_ros.core import (
    BodyConfig,
    ConfigError,
    ObstacleConfig,
    ObstacleRemoval,
    ObstacleUpdate,
    World,
    WorldConfig,
)
from softbody_ros.core.links import FASTEST_CORRECTION
from softbody_ros.scene.parameters import make_scene
from softbody_ros.scene.robot import Robot, RobotError, RobotState, move_robot, read_robot

CONFIG = pathlib.Path(__file__).parent.parent / 'config'
GRIPPER = (CONFIG / 'gripper.urdf').read_text()
TURN = math.pi / 2

ARM = """<robot name="arm">
<link name="base"/><link name="upper"/><link name="fore"/><link name="slide"/><link name="hand"/>
<link name="copy"/><link name="copy_of_copy"/><link name="flange"/>
<joint name="shoulder" type="revolute">
  <parent link="base"/><child link="upper"/>
  <origin xyz="0.1 -0.2 0.3" rpy="0.3 -0.4 0.5"/><axis xyz="0 0 -1"/>
</joint>
<joint name="elbow" type="continuous">
  <parent link="upper"/><child link="fore"/>
  <origin xyz="0 0.5 0" rpy="1 0 0.2"/><axis xyz="0.6 0 0.8"/>
</joint>
<joint name="rail" type="prismatic">
  <parent link="fore"/><child link="slide"/>
  <origin xyz="0 0 0.4" rpy="0 0.7 0"/><axis xyz="0 -1 0"/>
</joint>
<joint name="wrist" type="revolute">
  <parent link="slide"/><child link="hand"/>
  <origin xyz="0.2 0 0" rpy="-0.6 0 0"/>
</joint>
<joint name="mirror" type="prismatic">
  <parent link="slide"/><child link="copy"/>
  <origin xyz="0 0.1 0"/><axis xyz="0 0 1"/><mimic joint="rail" multiplier="-2" offset="0.3"/>
</joint>
<joint name="mirror_again" type="revolute">
  <parent link="copy"/><child link="copy_of_copy"/>
  <origin xyz="0 0.1 0"/><axis xyz="1 0 0"/><mimic joint="wrist" multiplier="0.5"/>
</joint>
<joint name="bolt" type="fixed">
  <parent link="hand"/><child link="flange"/><origin xyz="0 0 0.1" rpy="0 0 1"/>
</joint>
</robot>"""
BALL = '<collision><geometry><sphere radius="0.1"/></geometry></collision>'


def with_shapes(urdf, shape=BALL):
    return re.sub(r'<link name="(\w+)"/>', rf'<link name="\1">{shape}</link>', urdf)


def one_link(collision):
    return f'<robot name="r"><link name="part">{collision}</link></robot>'


def mesh_link(path, scale='1 1 1', origin=''):
    return one_link(
        f'<collision>{origin}<geometry><mesh filename="{path}" scale="{scale}"/></geometry>'
        '</collision>'
    )


def move(world, robot, state, seconds):
    move_robot(world, robot, {robot.root: state} if robot else {}, seconds)


def state_of(robot, positions, velocities=(), **values):
    q = np.array([positions.get(name, 0.0) for name in robot.joints])
    v = np.array([dict(velocities).get(name, 0.0) for name in robot.joints])
    return RobotState(q, v, **values)


def reference_poses(urdf, robot, q):
    """Return the poses (4, 4) of yourdfpy by the names of links."""
    model = yourdfpy.URDF.load(io.BytesIO(urdf.encode()), load_meshes=False)
    model.update_cfg(dict(zip(robot.joints, q, strict=True)))
    return {name: model.get_transform(name, robot.root) for name in robot.rows}


# ------------------------------------------------------------------------------------- kinematics
@pytest.mark.oldest
@pytest.mark.parametrize('urdf', [ARM, GRIPPER], ids=['arm', 'gripper'])
@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_poses_are_those_of_yourdfpy_and_twists_their_derivatives(urdf, sign):
    urdf = with_shapes(urdf)
    robot, problems = read_robot(urdf, ['*'])
    assert not problems
    random = np.random.default_rng(3)
    q, v = random.normal(size=(2, len(robot.joints)))
    v = sign * np.abs(v)
    moving = robot.motions(RobotState(q, v))
    now = reference_poses(urdf, robot, q)
    step = 1e-6
    ahead, back = (reference_poses(urdf, robot, q + h * v) for h in (step, -step))
    assert len(now) == len(robot.rows) > 3
    for name, row in robot.rows.items():
        motion, pose = moving[row], now[name]
        np.testing.assert_allclose(motion['position'], pose[:3, 3], atol=1e-14)
        np.testing.assert_allclose(motion['rotation'], pose[:3, :3], atol=1e-14)
        rate = (ahead[name] - back[name]) / (2.0 * step)
        np.testing.assert_allclose(motion['linear'], rate[:3, 3], atol=1e-8)
        spin = rate[:3, :3] @ pose[:3, :3].T
        np.testing.assert_allclose(
            motion['angular'], [spin[2, 1], spin[0, 2], spin[1, 0]], atol=1e-8
        )
    assert np.abs(moving['linear']).max() > 0.1


@pytest.mark.oldest
def test_a_root_elsewhere_moves_and_turns_everything():
    robot, _ = read_robot(with_shapes(ARM), ['hand'])
    q, v = np.random.default_rng(5).normal(size=(2, len(robot.joints)))
    quaternion = (0.1, -0.5, 0.3, 0.8)
    turn = Rotation.from_quat(quaternion).as_matrix()
    at_home = robot.motions(RobotState(q, v))
    moved = robot.motions(RobotState(q, v, (1.0, 2.0, 3.0), quaternion))
    np.testing.assert_allclose(moved['position'], at_home['position'] @ turn.T + [1, 2, 3])
    for name in ('linear', 'angular'):
        np.testing.assert_allclose(moved[name], at_home[name] @ turn.T, atol=1e-14)


@pytest.mark.oldest
def test_only_joints_that_move_chosen_links_are_needed():
    robot, _ = read_robot(with_shapes(ARM), ['fore', 'copy'])
    assert robot.joints == ('shoulder', 'elbow', 'rail')
    assert list(robot.names) == ['fore', 'copy']
    assert 'hand' not in robot.rows


@pytest.mark.oldest
def test_a_joint_that_has_turned_often_is_exact():
    robot, _ = read_robot(with_shapes(ARM), ['fore'])
    once, often = (
        robot.motions(state_of(robot, {'elbow': 0.3 + turns * math.tau})) for turns in (0, 5000)
    )
    np.testing.assert_allclose(often['rotation'], once['rotation'], atol=1e-11)


# ----------------------------------------------------------------------------------------- shapes
def only_obstacle(urdf, problems=()):
    robot, said = read_robot(urdf, ['*'])
    assert len(said) == len(problems)
    for sentence, pattern in zip(said, problems, strict=True):
        assert re.search(pattern, sentence), sentence
    world = World(WorldConfig(obstacles=()))
    move(world, robot, state_of(robot, {}), 0.5)
    (obstacle,) = world.obstacles
    return obstacle


@pytest.mark.oldest
@pytest.mark.parametrize(
    ('shape', 'kind', 'size'),
    [
        ('<box size="0.2 0.4 0.6"/>', 'box', (0.1, 0.2, 0.3)),
        ('<cylinder radius="0.2" length="0.6"/>', 'cylinder', (0.2, 0.2, 0.3)),
        ('<sphere radius="0.2"/>', 'sphere', (0.2, 0.2, 0.2)),
    ],
)
def test_primitives_are_exact_and_where_their_origin_is(shape, kind, size):
    origin = f'<origin xyz="1 2 3" rpy="{TURN} 0 0"/>'
    obstacle = only_obstacle(
        one_link(f'<collision>{origin}<geometry>{shape}</geometry></collision>')
    )
    assert (obstacle.config.type, obstacle.config.name) == (kind, 'part')
    assert obstacle.config.size == pytest.approx(size)
    assert obstacle.position == pytest.approx([1.0, 2.0, 3.0])
    assert obstacle.rotation[:, 2] == pytest.approx([0.0, -1.0, 0.0])  # its axis


@pytest.fixture
def wedge():
    """A closed mesh without symmetry, off its origin."""
    shape = trimesh.creation.extrude_polygon(
        trimesh.path.polygons.Polygon([(0.1, 0.2), (0.5, 0.2), (0.1, 0.5)]), 0.3
    )
    return shape


@pytest.mark.oldest
@pytest.mark.parametrize('ending', ['stl', 'obj', 'dae', 'ply', 'glb'])
@pytest.mark.parametrize('scale', [(1.0, 1.0, 1.0), (0.5, 2.0, 1.0), (-1.0, 1.0, 1.0)])
def test_mesh_files_are_scaled_and_where_they_say(wedge, tmp_path, ending, scale):
    path = tmp_path / f'wedge.{ending}'
    wedge.export(path)
    numbers = ' '.join(map(str, scale))
    obstacle = only_obstacle(mesh_link(path, numbers, '<origin xyz="0 0 1"/>'))
    assert obstacle.config.type == 'mesh'
    random = np.random.default_rng(0)
    points = np.array(scale) * random.uniform([0.0, 0.1, -0.1], [0.6, 0.6, 0.4], (300, 3))
    inside = wedge.contains(points / scale)
    assert 10 < inside.sum() < 290
    distance, _ = obstacle.closest(points + [0.0, 0.0, 1.0])
    np.testing.assert_array_equal(distance < 0.0, inside)


@pytest.mark.oldest
def test_a_collada_file_has_its_own_unit(wedge, tmp_path):
    path = tmp_path / 'wedge.dae'
    text = trimesh.exchange.dae.export_collada(wedge).decode()
    path.write_text(text.replace('</created>', '</created><unit name="cm" meter="0.01"/>'))
    obstacle = only_obstacle(mesh_link(path))
    np.testing.assert_allclose(obstacle.half_extents, [0.002, 0.0015, 0.0015], rtol=1e-6)


@pytest.mark.oldest
def test_an_open_mesh_is_its_convex_hull_and_that_is_said(tmp_path):
    ball = trimesh.creation.icosphere(2, 0.3)
    ball.update_faces(ball.triangles_center[:, 2] < 0.2)
    path = tmp_path / 'bowl.stl'
    ball.export(path)
    obstacle = only_obstacle(mesh_link(path), ['bowl.stl is not closed, so its convex hull'])
    distance, normal = obstacle.closest(np.array([(0.0, 0.0, 0.35), (0.0, 0.0, 0.0)]))
    assert distance[0] > 0.1 > 0.0 > distance[1]
    assert normal[0] == pytest.approx([0.0, 0.0, 1.0])


@pytest.mark.oldest
def test_shapes_are_made_once_and_shared_by_all_updates():
    robot, _ = read_robot(GRIPPER, ['palm'])
    world = World(WorldConfig(obstacles=()))
    trees = set()
    for lift in (0.0, 0.1, 0.2):
        move(world, robot, state_of(robot, {'hoist': lift}), 0.5)
        (palm,) = world.obstacles
        trees.add(id(palm.tree))
        assert palm.position[2] == pytest.approx(lift + 0.135)
    assert len(trees) == 1


# ----------------------------------------------------------------------------- bad descriptions
@pytest.mark.oldest
@pytest.mark.parametrize(
    ('values', 'sentence'),
    [
        (
            {'robot.pose': [0.0] * 7},
            'robot.pose is .*: its last four numbers must be a quaternion',
        ),
        ({'bodies': ['robot']}, "the name 'robot' is that of parameters of the node: .*"),
        ({'obstacles': ['robot']}, "the name 'robot' is that of parameters of the node: .*"),
    ],
)
def test_parameters_of_a_robot_that_mean_nothing_are_refused(values, sentence):
    with pytest.raises(ConfigError, match=f'^{sentence}'):
        make_scene(values)


def joint(name='j', parent='a', child='b', kind='revolute', more=''):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'{more}</joint>'
    )


def pair(*joints, links='ab'):
    shapes = ''.join(f'<link name="{name}">{BALL}</link>' for name in links)
    return f'<robot name="r">{shapes}{"".join(joints)}</robot>'


@pytest.mark.oldest
@pytest.mark.parametrize(
    ('urdf', 'sentence'),
    [
        ('', 'it is no XML .* it must be a URDF'),
        ('<robot name="r"><link name="a"></robot>', 'it is no XML .*mismatched tag'),
        ('<sdf version="1.9"/>', 'it is a <sdf>, not a <robot>'),
        ('<robot name="r"/>', 'it has no links'),
        ('<robot name="r"><link/></robot>', 'cannot be read as URDF .*name'),
        (one_link('<collision/>'), 'cannot be read as URDF'),
        (one_link('<collision><geometry><box/></geometry></collision>'), 'cannot be read as URDF'),
        (one_link('<collision><geometry><blob/></geometry></collision>'), 'Unknown tag: blob'),
        (
            '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arm/></robot>',
            'it has xacro in it',
        ),
        (pair(links='aa'), 'the link a is there twice'),
        (pair(), 'it has the roots a, b'),
        (pair(joint(child='c')), "joint j has a link 'c' that is not there"),
        (pair(joint(), joint('k')), 'the link b has two parents'),
        (pair(joint(parent='c'), joint('k', 'b', 'c'), links='abc'), 'its own ancestor'),
        (pair(joint(more='<axis xyz="0 0 0"/>')), 'joint j has the axis .*: give a direction'),
        (pair(joint(more='<axis xyz="0 nan 0"/>')), 'give a direction'),
        (pair(joint(more='<axis xyz="0 1"/>')), 'give a direction'),
        (pair(joint(more='<origin xyz="1e9 0 0"/>')), 'an origin that is not within ±1e.06 m'),
        (pair(joint(more='<origin xyz="nan 0 0"/>')), 'an origin that is not within'),
        (pair(joint(more='<mimic joint="j"/>')), 'joint j mimics itself'),
        (pair(joint(more='<mimic joint="j" multiplier="nan"/>')), 'joint j mimics'),
        (
            pair(joint(more='<mimic joint="k" offset="1e9"/>'), joint('k', 'b', 'c'), links='abc'),
            r'joint j mimics k by a number beyond 1e\+06',
        ),
        (
            pair(joint(more='<mimic joint="k" offset="nan"/>'), joint('k', 'b', 'c'), links='abc'),
            r'joint j mimics k by a number beyond 1e\+06',
        ),
        (
            pair(
                joint(more='<mimic joint="k" multiplier="1e4"/>'),
                joint('k', 'b', 'c', more='<mimic joint="l" multiplier="1e4"/>'),
                joint('l', 'c', 'd'), links='abcd',
            ),
            r'joint k mimics l by a number beyond 1e\+06',
        ),
        (f'<robot>{"<a>" * 3000}{"</a>" * 3000}</robot>', 'it is nested too deeply: run check'),
    ],
)  # fmt: skip
def test_what_is_no_urdf_is_one_sentence(urdf, sentence):
    with pytest.raises(RobotError, match=sentence) as error:
        read_robot(urdf, ['*'])
    assert '\n' not in str(error.value)


@pytest.mark.oldest
@pytest.mark.parametrize(
    ('urdf', 'sentence'),
    [
        (mesh_link('/nowhere/part.stl'), 'left out: mesh file /nowhere/part.stl does not exist'),
        (mesh_link('package://nowhere/part.stl'), "package 'nowhere' is not installed"),
        (mesh_link('part.step'), 'nor a file that ends in .stl, .obj, .ply, .off, .glb, .dae'),
        (mesh_link('/part.stl', '1 0 1'), 'its mesh is .* with the scale'),
        (mesh_link('/part.stl', '2 1'), r'with the scale \[2.0, 1.0\]: .* one number or three'),
        (mesh_link('/part.stl', '1 1 1 1'), r'with the scale \[1.0, 1.0, 1.0, 1.0\]'),
        (one_link(BALL.replace('0.1', '-1')), r'part\.size is .*: each element must be from'),
        (one_link(BALL.replace('0.1', 'nan')), r'part\.size is'),
        (
            one_link(f'{BALL}<collision><origin xyz="0 0 9e9"/>{BALL[11:]}'),
            'collision shape 1 of link part is left out',
        ),
        (pair(joint(more='<mimic joint="k"/>')), 'joint j mimics k, not there: it has its own'),
        (pair(joint(kind='planar')), 'joint j is planar, which is not followed'),
        (pair(joint(kind='floating')), 'joint j is floating, which is not followed'),
    ],
)
def test_what_of_a_urdf_cannot_be_used_is_said_and_the_rest_is(urdf, sentence):
    robot, (problem,) = read_robot(urdf, ['*'])
    assert re.search(sentence, problem), problem
    assert isinstance(robot, Robot)


@pytest.mark.oldest
def test_patterns_that_match_nothing_are_said():
    robot, problems = read_robot(GRIPPER, ['left_fingr', 'x*', 'palm', 'ceiling'])
    assert list(robot.names) == ['palm']
    assert 'no such link: did you mean left_finger?' in problems[0]
    assert "names 'x*'" in problems[1]
    assert problems[2] == 'link ceiling has no collision shape: it is not in the way'


@pytest.mark.oldest
def test_names_are_those_of_links_as_far_as_topics_can_have_them():
    links = ['left/tip-1', '2nd', 'a.b', 'a_b', 'ball']
    shapes = ''.join(f'<link name="{name}">{BALL}</link>' for name in ['root', *links])
    joints = ''.join(joint(name, 'root', name, 'fixed') for name in links)
    robot, _ = read_robot(f'<robot name="r">{shapes}{joints}</robot>', ['*'], taken=['ball'])
    assert robot.names == {
        'root': 'root', 'left/tip-1': 'left_tip_1', '2nd': 'link_2nd', 'a.b': 'a_b',
        'a_b': 'robot_a_b', 'ball': 'robot_ball',
    }  # fmt: skip


@pytest.mark.oldest
def test_a_declared_encoding_and_what_is_not_kinematics_are_no_problem():
    text = GRIPPER.replace('<?xml version="1.0"?>', '<?xml version="1.0" encoding="latin-1"?>')
    text = text.replace('</robot>', '<gazebo><plugin name="ü"/></gazebo><transmission/></robot>')
    robot, problems = read_robot(text, ['*finger'])
    assert not problems and list(robot.names) == ['left_finger', 'right_finger']


# ------------------------------------------------------------------------------------ in a world
FIRM = {'reference_step': 0.00128}
BALL_BODY = BodyConfig(name='ball', size=0.05, subdivisions=2, mass=0.2, position=(0.0, 0.0, 0.05))


def gripped(ticks_per_state=5, velocities=True, h=1 / 240, until=4.0, watch=lambda *_: None):
    """Close the gripper on the ball, lift it by 0.2 m from 1.5 to 3 s; return world and robot."""
    world = World(WorldConfig(time_step=h, bodies=(BALL_BODY,), **FIRM))
    robot, _ = read_robot(GRIPPER, ['*finger', 'palm'], 1.3)
    previous = None
    period = ticks_per_state * h
    while world.time < until:
        if world.tick % ticks_per_state == 0:
            q = {
                'grip': np.interp(world.time, [0.0, 1.0], [0.07, 0.0465]),
                'hoist': np.interp(world.time, [1.5, 3.0], [0.0, 0.2]),
            }
            v = {name: (q[name] - (previous or q)[name]) / period for name in q}
            previous = q
            approach = period if world.tick else 0.0
            state = state_of(robot, q, v if velocities else {}, approach=approach)
            move(world, robot, state, 0.5)
        world.step()
        watch(world, robot)
    return world, robot


def on_links(world, robot):
    present = world.external_inputs.dynamic_obstacles
    return {link.name: link.wrench(present, world.obstacle_wrench) for link in robot.links}


def test_the_gripper_lifts_the_ball_and_feels_its_weight():
    world, robot = gripped()
    assert world.rigid_fit('ball').position[2] == pytest.approx(0.25, abs=0.003)
    assert not world.obstacle_wrench('ground')[0].any()
    (left, _), (right, _) = (
        on_links(world, robot)[f'{side}_finger'] for side in ('left', 'right')
    )
    weight = 0.2 * 9.81
    assert left == pytest.approx([-right[0], 0.0, -weight / 2], rel=2e-3, abs=2e-3)
    assert right == pytest.approx([right[0], 0.0, -weight / 2], rel=2e-3, abs=2e-3)
    assert 5.0 < right[0] < 30.0
    assert world.is_asleep('ball')


def test_what_bodies_feel_is_what_links_do_in_every_tick():
    seen = []

    def watch(world, robot):
        if world.is_asleep('ball'):
            return
        forces = [force for force, _ in on_links(world, robot).values()]
        total = -np.sum(forces, axis=0) - world.obstacle_wrench('ground')[0]
        np.testing.assert_allclose(world.contact_wrench('ball')[0], total, atol=1e-9)
        seen.append(np.abs(forces).max())

    gripped(until=2.5, watch=watch)
    assert max(seen) > 5.0


def test_the_wrench_on_a_link_is_about_its_origin():
    world, robot = gripped(until=1.3)
    # the ball touches at the height of its middle, seen from the origin of the finger in the palm
    force, torque = on_links(world, robot)['left_finger']
    present = world.external_inputs.dynamic_obstacles
    origin, _ = robot.links[1].pose(present[robot.links[1].keys[0]].obstacle)
    np.testing.assert_allclose(origin, [-0.0465, 0.0, 0.115], atol=1e-6)
    arm = -torque[1] / force[0]
    assert arm == pytest.approx(0.115 - 0.049, abs=2e-3)


@pytest.mark.parametrize('ticks_per_state', [1, 5, 24])
@pytest.mark.parametrize('velocities', [True, False])
def test_what_is_held_does_not_slip_however_seldom_states_come(ticks_per_state, velocities):
    heights = []

    def watch(world, robot):
        if world.time > 1.45:
            finger = world.external_inputs.dynamic_obstacles['robot:left_finger', 0]
            offset = world.rigid_fit('ball').position - finger.obstacle.position
            heights.append(offset[2])

    gripped(ticks_per_state, velocities, watch=watch)
    # it sags a little when the ground lets go
    assert np.ptp(heights) < 2.5e-3
    assert abs(heights[-1] - heights[len(heights) // 2]) < 3e-4


def test_links_are_exactly_where_states_say_when_the_next_one_comes():
    world = World(WorldConfig(bodies=(), obstacles=()))
    robot, _ = read_robot(with_shapes(ARM), ['*'])
    random = np.random.default_rng(1)
    q, v = random.normal(size=(2, len(robot.joints)))
    move(world, robot, RobotState(q, v), 0.5)
    period = 5 / 240
    for _ in range(20):
        q, v = q + random.normal(scale=0.01, size=len(q)), random.normal(size=len(v))
        target = robot.motions(RobotState(q, v))[-len(robot.shapes) :]
        move(world, robot, RobotState(q, v, approach=period), 0.5)
        world.step(5)
        for obstacle, motion in zip(world.obstacles, target, strict=True):
            turn = Rotation.from_rotvec(period * motion['angular']).as_matrix()
            np.testing.assert_allclose(obstacle.rotation, turn @ motion['rotation'], atol=1e-12)
            there = motion['position'] + period * motion['linear']
            np.testing.assert_allclose(obstacle.position, there, atol=1e-12)
            assert obstacle.config.velocity_linear == pytest.approx(motion['linear'])
            assert obstacle.config.velocity_angular == pytest.approx(motion['angular'])


def test_links_go_on_for_the_timeout_and_then_stand_still():
    world = World(WorldConfig(bodies=(), obstacles=()))
    robot, _ = read_robot(GRIPPER, ['left_finger'])
    move(world, robot, state_of(robot, {}, {'hoist': 0.1}), 0.25)
    world.step(240)
    assert world.obstacles[0].position[2] == pytest.approx(0.06 + 0.025, abs=1e-12)
    assert not world.obstacles[0].moves


def test_a_leap_is_no_motion():
    world = World(WorldConfig(bodies=(), obstacles=()))
    robot, _ = read_robot(GRIPPER, ['left_finger'])
    move(world, robot, state_of(robot, {}), 0.5)
    leap = 2.0 * FASTEST_CORRECTION * 0.02
    move(world, robot, state_of(robot, {'hoist': leap}, approach=0.02), 0.5)
    assert world.obstacles[0].position[2] == pytest.approx(0.06 + leap)
    assert not world.obstacles[0].moves


def test_absurd_joints_make_no_absurd_obstacles():
    world = World(WorldConfig(bodies=(BALL_BODY,)))
    robot, _ = read_robot(with_shapes(ARM), ['*'])
    for value in (1e6, -1e6):
        q = np.full(len(robot.joints), value)
        move(world, robot, RobotState(q, 1e6 * q, (value,) * 3, approach=0.01), 0.5)
        world.step(3)
        for obstacle in world.obstacles:
            assert np.isfinite(obstacle.position).all()
    assert np.isfinite(world.positions('ball')).all()


def test_a_robot_is_replaced_and_removed_as_a_whole():
    world = World(WorldConfig())
    arm, _ = read_robot(with_shapes(ARM), ['*'])
    gripper, _ = read_robot(GRIPPER, ['*'])
    table = ObstacleUpdate(('mine', 1), ObstacleConfig(name='marker', type='box'))
    world.change_obstacles([table])
    move(world, arm, state_of(arm, {}), 0.5)
    assert len(world.obstacles) == 2 + 8
    move(world, gripper, state_of(gripper, {}), 0.5)
    names = [obstacle.config.name for obstacle in world.obstacles]
    assert names == ['ground', 'marker', 'palm', *2 * ['left_finger'], *2 * ['right_finger']]
    world.change_obstacles([ObstacleRemoval()])  # of others: a DELETEALL
    assert [obstacle.config.name for obstacle in world.obstacles][:2] == ['ground', 'palm']
    move(world, None, RobotState(np.zeros(0), np.zeros(0)), 0.5)
    assert [obstacle.config.name for obstacle in world.obstacles] == ['ground']


def test_a_finger_that_starts_to_move_wakes_what_lies_on_it_and_one_elsewhere_does_not():
    bodies = [
        BodyConfig(name=name, size=0.05, subdivisions=1, position=(x, 0.0, z))
        for name, x, z in (('low', 5.0, 0.05), ('high', 0.0, 0.205))
    ]
    world = World(WorldConfig(bodies=tuple(bodies), **FIRM))
    robot, _ = read_robot(GRIPPER, ['palm'])
    move(world, robot, state_of(robot, {}), 0.5)
    world.step(480)
    assert world.is_asleep('low') and world.is_asleep('high')
    move(world, robot, state_of(robot, {}, {'hoist': 0.1}, approach=0.01), 0.5)
    world.step(5)
    assert world.is_asleep('low') and not world.is_asleep('high')


@pytest.mark.oldest
def test_a_snapshot_in_the_middle_of_an_approach_continues_bit_by_bit():
    world = World(WorldConfig(bodies=(BALL_BODY,), **FIRM))
    robot, _ = read_robot(GRIPPER, ['*finger', 'palm'], 1.3)
    move(world, robot, state_of(robot, {'grip': 0.05}), 0.5)
    world.step(60)
    move(world, robot, state_of(robot, {'grip': 0.047}, {'grip': -0.1}, approach=0.02), 0.5)
    world.step(2)
    assert_goes_on_bit_by_bit(
        world, 20,
        state=lambda world: (bytes_of(world), world.obstacles[-1].position.tobytes()),
    )  # fmt: skip
