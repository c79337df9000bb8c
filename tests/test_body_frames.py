# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Frames of bodies in TF: tf2_ros is not on PyPI, a module of its name stands in for it."""

import sys
import types

import pytest
from scipy.spatial.transform import Rotation
from std_srvs.srv import SetBool

from softbody_ros.ros import messages

pytestmark = pytest.mark.oldest

SIM = '/softbody_sim'


@pytest.fixture
def sent(monkeypatch):
    """Return the lists of transforms that a stand-in for tf2_ros is given."""
    lists = []

    class TransformBroadcaster:
        def __init__(self, node):
            assert node.get_name() == 'softbody_sim'

        def sendTransform(self, transforms):  # the name of tf2_ros
            lists.append(transforms)

    module = types.ModuleType('tf2_ros')
    module.TransformBroadcaster = TransformBroadcaster
    monkeypatch.setitem(sys.modules, 'tf2_ros', module)
    return lists


def test_each_body_is_a_frame_of_its_name(graph, sent):
    sim = graph.sim_node(
        bodies=['one', 'two'], one__subdivisions=1, two__subdivisions=1, frame_id='map',
        two__position=[3.0, 0.0, 1.0], two__orientation=[0.0, 0.6, 0.0, 0.8],
        two__initial_velocity__angular=[1.0, 0.0, 0.0],
    )  # fmt: skip
    graph.spin_until(lambda: len(sent) > 20)
    assert {tuple(item.child_frame_id for item in frames) for frames in sent} == {('one', 'two')}
    assert {item.header.frame_id for frames in sent for item in frames} == {'map'}
    assert graph.call(SetBool, f'{SIM}/pause', data=True).success
    stamp = messages.time_message(sim._stepper.time_of(sim._world.tick))
    graph.spin_until(lambda: sent[-1][1].header.stamp == stamp)
    frame, fit = sent[-1][1].transform, sim._world.rigid_fit('two')
    shift = [getattr(frame.translation, axis) for axis in 'xyz']
    turn = Rotation.from_quat([getattr(frame.rotation, axis) for axis in 'xyzw'])
    assert shift == pytest.approx(fit.position, abs=1e-12)
    assert turn.as_matrix() == pytest.approx(fit.rotation, abs=1e-12)


def test_none_are_sent_when_they_are_off(graph, sent):
    sim = graph.sim_node(ball__subdivisions=1, publish_tf=False)
    graph.spin_until(lambda: sim._world.tick > 60)
    assert not sent
    assert graph.set_parameter(SIM, 'publish_tf', True).successful
    graph.spin_until(lambda: len(sent) > 3)
    refused = graph.set_parameter(SIM, 'publish_tf', 1)
    assert not refused.successful
