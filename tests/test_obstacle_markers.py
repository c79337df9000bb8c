# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What is in the way is shown: the bytes, and the topic of a real node."""

from geometry_msgs.msg import Point, Vector3
import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message, serialize_message
from scipy.spatial.transform import Rotation
from simulated_clock import ClockSource
from std_msgs.msg import ColorRGBA
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import Marker, MarkerArray

from softbody_ros.core import ObstacleConfig, World
from softbody_ros.core.collision.obstacles import made
from softbody_ros.ros import messages
from softbody_ros.ros.messages import ShownObstacle

pytestmark = pytest.mark.oldest

SIM = '/softbody_sim'
TOPIC = f'{SIM}/obstacle_markers'
SMALL = {'ball__subdivisions': 1}
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
STAMP = 1_700_000_001_123_456_789
COLOR = (0.25, 0.5, 0.75, 1.0)
TURN = Rotation.from_rotvec([0.3, -0.2, 0.9])
SIZE = (0.3, 0.4, 0.8)
TYPES = {
    'plane': (Marker.TRIANGLE_LIST, (1.0, 1.0, 1.0)),
    'box': (Marker.CUBE, (0.6, 0.8, 1.6)),
    'sphere': (Marker.SPHERE, (0.6, 0.6, 0.6)),
    'cylinder': (Marker.CYLINDER, (0.6, 0.6, 1.6)),
    'capsule': (Marker.TRIANGLE_LIST, (1.0, 1.0, 1.0)),
    'mesh': (Marker.TRIANGLE_LIST, (1.0, 1.0, 1.0)),
}


def obstacle(kind, **values):
    mesh = 'icosphere' if kind == 'mesh' else ''
    return made(
        ObstacleConfig(
            name=kind, type=kind, mesh=mesh, position=(1.0, -2.0, 3.0), size=SIZE,
            orientation=tuple(TURN.as_quat()), **values,
        )
    )  # fmt: skip


def corners_of(marker):
    return np.array([[point.x, point.y, point.z] for point in marker.points]).reshape(-1, 3)


def position_of(marker):
    return [getattr(marker.pose.position, axis) for axis in 'xyz']


def deletes_all(frame_id):
    marker = Marker(action=Marker.DELETEALL)
    marker.header.frame_id, marker.header.stamp = frame_id, messages.time_message(STAMP)
    return marker


# ------------------------------------------------------------------------------------------- bytes
@pytest.mark.parametrize('namespace', ['', 'a', 'ab', 'abc', 'wörld/wide'])
@pytest.mark.parametrize('frame_id', ['map', 'world', 'x' * 8])
def test_bytes_equal_the_object_path(frame_id, namespace):
    shown = [ShownObstacle(namespace, i, COLOR, obstacle(kind)) for i, kind in enumerate(TYPES)]
    data = messages.serialized_obstacles(STAMP, frame_id, shown)
    expected = MarkerArray(markers=[deletes_all(frame_id)])
    for item in shown:
        marker = Marker(
            ns=namespace, id=item.number, color=ColorRGBA(r=0.25, g=0.5, b=0.75, a=1.0)
        )
        marker.header = expected.markers[0].header
        marker.type, scale = TYPES[item.obstacle.config.type]
        marker.scale = Vector3(x=scale[0], y=scale[1], z=scale[2])
        marker.text = 'plane' if item.obstacle.config.type == 'plane' else ''
        quaternion = Rotation.from_matrix(item.obstacle.rotation).as_quat()
        for target, axes, values in [
            (marker.pose.position, 'xyz', item.obstacle.position),
            (marker.pose.orientation, 'xyzw', quaternion),
        ]:
            for axis, value in zip(axes, values, strict=True):
                setattr(target, axis, float(value))
        if marker.type == Marker.TRIANGLE_LIST:
            corners = item.obstacle.triangles.tolist()
            marker.points = [Point(x=x, y=y, z=z) for x, y, z in corners]
        expected.markers.append(marker)
    assert deserialize_message(data, MarkerArray) == expected
    assert len(data) == len(serialize_message(expected))


def test_nothing_in_the_way_is_only_the_deletion():
    data = messages.serialized_obstacles(STAMP, 'world', [])
    assert deserialize_message(data, MarkerArray) == MarkerArray(markers=[deletes_all('world')])


@pytest.mark.parametrize(
    ('kind', 'size'), [('capsule', SIZE), ('capsule', (0.5, 1.0, 0.2)), ('mesh', SIZE)]
)
def test_triangles_lie_on_the_surface_and_face_outwards(kind, size):
    here = made(ObstacleConfig(type=kind, mesh='torus' if kind == 'mesh' else '', size=size))
    corners = here.triangles
    distance, _ = here.closest(corners)
    np.testing.assert_allclose(distance, 0.0, atol=1e-12)
    np.testing.assert_allclose(np.abs(corners).max(axis=0), here.half_extents, rtol=1e-6)
    a, b, c = corners.reshape(-1, 3, 3).swapaxes(0, 1)
    normals, middle = np.cross(b - a, c - a), (a + b + c) / 3
    _, outwards = here.closest(middle)
    flat = np.linalg.norm(normals, axis=1) < 1e-9
    assert (np.einsum('ij,ij->i', normals, outwards)[~flat] > 0.0).all()


def test_a_plane_is_a_square_that_faces_up():
    corners = obstacle('plane').triangles
    assert corners.shape == (6, 3)
    np.testing.assert_array_equal(np.abs(corners), [[10.0, 10.0, 0.0]] * 6)
    a, b, c = corners.reshape(-1, 3, 3).swapaxes(0, 1)
    np.testing.assert_array_equal(np.cross(b - a, c - a), [[0.0, 0.0, 400.0]] * 2)


# -------------------------------------------------------------------------------------------- node
def latest(arrays):
    """Return the markers of the last array by their namespace, without the deletion."""
    first, *markers = arrays[-1].markers
    assert (first.action, first.ns) == (Marker.DELETEALL, '')
    return {marker.ns: marker for marker in markers}


def test_a_late_joiner_sees_the_scene_and_what_others_put_there(graph):
    graph.sim_node(
        **SMALL, obstacles=['ground', 'pole'], pole__type='cylinder', pole__size=[0.1, 1.0, 2.0],
        pole__position=[1.0, 2.0, 3.0], frame_id='map',
    )  # fmt: skip
    assert graph.call(SetBool, f'{SIM}/pause', data=True).success
    theirs = Marker(ns='pole', id=7, type=Marker.SPHERE, scale=Vector3(x=0.5, y=0.5, z=0.5))
    theirs.header.frame_id = 'map'
    theirs.pose.position.x = 4.0
    sender = graph.node.create_publisher(MarkerArray, f'{SIM}/obstacles', 10)
    graph.spin_until(sender.get_subscription_count)
    sender.publish(MarkerArray(markers=[theirs]))
    arrays = graph.collect(MarkerArray, TOPIC, LATCHED)
    graph.spin_until(lambda: arrays and len(latest(arrays)) == 3)
    markers = latest(arrays)
    assert list(markers) == ['ground', 'pole', 'others/pole']
    assert {marker.header.frame_id for marker in markers.values()} == {'map'}
    assert markers['ground'].text == 'plane'
    assert (markers['pole'].id, markers['pole'].type) == (0, Marker.CYLINDER)
    assert position_of(markers['pole']) == [1.0, 2.0, 3.0]
    assert (markers['others/pole'].id, markers['others/pole'].scale.z) == (7, 0.5)
    assert position_of(markers['others/pole']) == [4.0, 0.0, 0.0]
    assert markers['others/pole'].color != markers['pole'].color

    theirs.action = Marker.DELETE
    sender.publish(MarkerArray(markers=[theirs]))
    graph.spin_until(lambda: list(latest(arrays)) == ['ground', 'pole'])


def test_it_is_published_when_something_changes_and_only_then(graph):
    sim = graph.sim_node(**SMALL)
    arrays = graph.collect(MarkerArray, TOPIC, LATCHED)
    graph.spin_until(lambda: arrays)
    assert graph.set_parameter(SIM, 'ball.mass', 2.0).successful
    assert graph.call(Trigger, f'{SIM}/reset').success
    graph.spin_until(lambda: sim._world.tick > 48)
    assert len(arrays) == 1
    assert graph.set_parameter(SIM, 'ground.position', [0.0, 0.0, -1.0]).successful
    graph.spin_until(lambda: position_of(latest(arrays)['ground']) == [0.0, 0.0, -1.0])
    assert graph.set_parameter(SIM, 'ball.mass', 1.0).successful
    graph.spin_until(lambda: sim._world.tick > 72)
    assert len(arrays) == 2


def test_what_moves_is_shown_where_it_is_also_when_the_clock_goes_back(graph):
    sim = graph.sim_node(**SMALL, use_sim_time=True, ground__velocity__linear=[0.0, 1.0, 0.0])
    arrays = graph.collect(MarkerArray, TOPIC, LATCHED)
    clock = ClockSource(graph, sim)

    def shown():
        marker = latest(arrays)['ground']
        return marker.header.stamp.nanosec, position_of(marker)[1]

    clock.send(100_000_000)
    graph.spin_until(lambda: sim._stepper.started)
    for nanoseconds, y in [(600_000_000, 0.5), (350_000_000, 0.25)]:
        clock.send(nanoseconds)
        expected = (nanoseconds, pytest.approx(y, abs=1e-9))
        graph.spin_until(lambda wanted=expected: arrays and shown() == wanted)
    assert sim._world.tick == 60
    # paused: what is changed is shown without a tick
    assert graph.call(SetBool, f'{SIM}/pause', data=True).success
    assert graph.set_parameter(SIM, 'ground.position', [0.0, 7.0, 0.0]).successful
    graph.spin_until(lambda: shown() == (350_000_000, 7.0))


def test_what_moves_is_not_packed_while_nobody_subscribes(graph, monkeypatch):
    packed = []
    original = messages.serialized_obstacles
    monkeypatch.setattr(
        messages, 'serialized_obstacles', lambda *a: packed.append(a) or original(*a)
    )
    sim = graph.sim_node(**SMALL, ground__velocity__linear=[0.0, 1.0, 0.0])
    graph.spin_until(lambda: sim._world.tick > 60)
    assert graph.call(SetBool, f'{SIM}/pause', data=True).success
    assert len(packed) == 1  # at the start
    arrays = graph.collect(MarkerArray, TOPIC, LATCHED)
    where = sim._world.obstacles[0].position[1]
    graph.spin_until(lambda: arrays and position_of(latest(arrays)['ground'])[1] == where > 0.2)


def test_it_does_not_alter_the_simulation(graph):
    scene = {'obstacles': ['box'], 'box__type': 'box', 'box__velocity__angular': [0.0, 0.3, 0.0]}
    sim = graph.sim_node(**SMALL, **scene)
    arrays = graph.collect(MarkerArray, TOPIC, LATCHED)
    graph.spin_until(lambda: len(arrays) > 20)
    world = World(sim._scene.world)
    world.step(sim._world.tick)
    assert world.positions('ball').tobytes() == sim._world.positions('ball').tobytes()
