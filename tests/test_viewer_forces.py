# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Forces of contacts in the viewer: what acts where, without a browser."""

import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from scene_files import ROOT
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from softbody_ros.viewer import decoding
from softbody_ros.viewer.force_arrows import arrow, turns
from softbody_ros.viewer.forces import ContactForces, Scale, is_reaction, poses_of

SIM = '/softbody_sim'
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def test_a_squeezed_ball_pushes_both_fingers_where_they_touch_it(graph):
    squeezed = [
        f'{side}.position:=[{x}, 0.0, 0.055]' for side, x in (('left', -0.057), ('right', 0.057))
    ]
    graph.process(
        '--ros-args', '--params-file', str(ROOT / 'config' / 'gripper.yaml'),
        *(argument for each in squeezed for argument in ('-p', each)),
    )  # fmt: skip
    clouds = graph.collect(PointCloud2, f'{SIM}/points', 1)
    markers = graph.collect(MarkerArray, f'{SIM}/obstacle_markers', LATCHED)
    forces = ContactForces(graph.node, SIM)

    def acting():
        forces.take()
        if not clouds or not markers:
            return []
        frame = decoding.frame(clouds[-1])
        return forces.present(frame, {'ball': 0}, poses_of(markers[-1].markers, 'world'))

    assert not acting()
    forces.listen(['ball'])
    graph.spin_until(lambda: len(acting()) == 3 and np.ptp([f.force[0] for f in acting()]) > 10.0)
    ball, *fingers = sorted(acting(), key=lambda force: not force.on_body)
    assert np.linalg.norm(ball.force) == pytest.approx(0.2 * 9.81, rel=0.2)
    np.testing.assert_allclose(ball.point, [0.0, 0.0, 0.05], atol=0.02)
    for x, finger in zip((-1, 1), sorted(fingers, key=lambda force: force.force[0]), strict=True):
        assert not finger.on_body
        assert finger.force[0] * x > 5.0
        np.testing.assert_allclose(finger.point, [0.047 * x, 0.0, 0.05], atol=0.01)
    forces.stop()
    graph.spin_until(lambda: not graph.node.count_subscribers(f'{SIM}/contacts/ball'))
    assert not acting()


def test_what_mirrors_the_forces_on_bodies_is_not_shown_twice():
    up, side = np.array([0.0, 0.0, 9.8]), np.array([4.0, 0.0, 0.0])
    assert is_reaction(-up, [side, up])
    assert is_reaction(-up - side, [side, up])  # both lie on it
    assert not is_reaction(up, [up])
    assert not is_reaction(-2.0 * up, [side, up])
    assert not is_reaction(up, [])


def test_the_longest_arrow_is_of_the_largest_force_of_the_last_moments():
    now = [0.0]
    scale = Scale(lambda: now[0])
    assert scale.longest([]) == 0.0
    assert scale.longest([np.array([0.0, 3.0, 4.0]), np.array([1.0, 0.0, 0.0])]) == 5.0
    lengths = []
    for now[0] in np.arange(0.1, 8.0, 0.1):
        lengths.append(scale.longest([np.array([0.0, 0.0, 1.0])]))
    assert lengths[0] > 4.0 and lengths[-1] == 1.0 and (np.diff(lengths) <= 0.0).all()
    now[0] = 99.0
    assert scale.longest([np.array([1e-9, 0.0, 0.0])]) == pytest.approx(0.1)  # it is not magnified


def test_arrows_point_along_the_forces():
    random = np.random.default_rng(0)
    along = random.normal(size=(50, 3))
    along = np.vstack([along, [[0, 0, 1], [0, 0, -1], [1, 0, 0]]])
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    turned = Rotation.from_quat(np.roll(turns(along), -1, axis=1)).apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(turned, along, atol=1e-12)
    vertices, faces = arrow()
    assert vertices[:, 2].min() == 0.0 and vertices[:, 2].max() == 1.0
    assert faces.max() == len(vertices) - 1
