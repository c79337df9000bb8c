# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The viewer's client of the parameters of a node, whose parameters come and go."""

from rclpy.node import Node

from softbody_ros.ros.parameter_services import ParameterServices
from softbody_ros.viewer.remote import Remote


class Leaving(ParameterServices):
    """Those of a node of which a body is removed while a client reads its parameters."""

    def _describe_parameters_callback(self, request, response):
        response = super()._describe_parameters_callback(request, response)
        node = self._get_node()
        if node.has_parameter('late.color'):
            node.undeclare_parameter('late.color')
        return response


class Listener:
    def __init__(self):
        self.known = None

    def described(self, descriptors, values):
        self.known = [each.name for each in descriptors], values


def test_what_is_removed_while_it_is_read_is_left_out(graph):
    node = graph.add(
        Node(
            'leaving', context=graph.context, start_parameter_services=False,
            allow_undeclared_parameters=True,
        )
    )  # fmt: skip
    Leaving(node)
    node.declare_parameter('late.color', [1.0, 0.5, 0.0, 1.0])
    node.declare_parameter('mass', 2.0)
    listener = Listener()
    remote = Remote(graph.node, '/leaving', listener)
    graph.spin_until(lambda: remote.is_there)
    graph.executor.create_task(remote.describe)
    graph.spin_until(lambda: listener.known)
    names, values = listener.known
    assert sorted(names) == sorted(values)
    assert values['mass'] == 2.0
    assert 'late.color' not in values
