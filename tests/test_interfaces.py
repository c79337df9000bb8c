# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The table of topics and services is what a real node has."""

import importlib.util

import pytest
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from softbody_ros.ros.interfaces import (
    OBSTACLE_CONTACTS,
    PUBLISHED,
    RECEIVED,
    SERVICES,
    STANDARD_SERVICES,
)
from softbody_ros.ros.simulation_interfaces import FEATURES

SIM, PLAIN = '/softbody_sim', '/plain'
PACKAGES = {'tf2_ros', 'simulation_interfaces'}


@pytest.fixture
def node(graph):
    """Return a node with everything that parameters can switch on, discovered by the graph."""
    result = graph.sim_node(
        ball__subdivisions=1, robot__links=['*'], publish_tf=True, use_sim_time=True
    )
    graph.add(Node('plain', context=graph.context))
    graph.spin_until(lambda: services_of(graph, PLAIN) and services_of(graph, SIM))
    return result


def services_of(graph, name):
    return dict(graph.node.get_service_names_and_types_by_node(name[1:], '/'))


def is_there(interface):
    """Whether the packages that an interface needs are installed; parameters are set."""
    needed = interface.requires
    return needed not in PACKAGES or importlib.util.find_spec(needed) is not None


def full(name):
    return name.replace('~', SIM)


def topics_of(graph, names_and_types, infos):
    """Return types, reliabilities and durabilities of the topics of the node, by name."""
    of_any_node = {name for name, _ in names_and_types('plain', '/')}
    result = {}
    for name, kinds in names_and_types(SIM[1:], '/'):
        if name in of_any_node:
            continue
        qos = [info.qos_profile for info in infos(name) if info.node_name == SIM[1:]]
        result[name] = kinds, {(each.reliability, each.durability) for each in qos}
    return result


def quality(topic, latched):
    return (
        ReliabilityPolicy.RELIABLE if topic.reliable else ReliabilityPolicy.BEST_EFFORT,
        DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def test_published_topics_are_those_of_the_table(graph, node):
    by_node, infos = graph.node.get_publisher_names_and_types_by_node, graph.node
    expected = {
        full(name): ([topic.type], {quality(topic, topic.latched)})
        for topic in filter(is_there, PUBLISHED)
        for name in topic.names
    }
    graph.spin_until(lambda: len(by_node(SIM[1:], '/')) >= len(expected), 'all publishers')
    assert topics_of(graph, by_node, infos.get_publishers_info_by_topic) == expected


def test_subscribed_topics_are_those_of_the_table(graph, node):
    by_node, infos = graph.node.get_subscriber_names_and_types_by_node, graph.node
    expected = {
        # what is latched is also taken from publishers that keep nothing
        full(topic.name): ([topic.type], {quality(topic, kept) for kept in {topic.latched, False}})
        for topic in filter(is_there, RECEIVED)
    }
    graph.spin_until(lambda: len(by_node(SIM[1:], '/')) >= len(expected), 'all subscriptions')
    assert topics_of(graph, by_node, infos.get_subscriptions_info_by_topic) == expected


def test_queues_are_as_deep_as_the_table_says(node):
    depths = {each.topic_name: each.qos_profile.depth for each in node.publishers}
    for topic in filter(is_there, PUBLISHED):
        if topic is OBSTACLE_CONTACTS:  # the least one: those of others find room, too
            assert depths[full(topic.name)] > topic.depth
        else:
            assert depths[full(topic.name)] == topic.depth, topic.name


def test_services_are_those_of_the_table(graph, node):
    expected = {full(s.name): [s.type] for s in (*SERVICES, *STANDARD_SERVICES) if is_there(s)}
    common = {name.replace(PLAIN, SIM) for name in services_of(graph, PLAIN)}

    def own():
        found = services_of(graph, SIM)
        return {name: kinds for name, kinds in found.items() if name not in common}

    graph.spin_until(lambda: len(own()) >= len(expected), 'all services')
    assert own() == expected


def test_standard_services_are_those_that_the_simulator_answers():
    assert {service.name for service in STANDARD_SERVICES} == {f'~/{name}' for name in FEATURES}


def test_every_interface_is_described_in_full_sentences():
    for each in (*PUBLISHED, *RECEIVED, *SERVICES, *STANDARD_SERVICES):
        assert each.description[0].isupper() and each.description.endswith('.'), each.name
        assert '|' not in each.description + each.summary, each.name
        assert each.summary and not each.summary.endswith('.'), each.name
