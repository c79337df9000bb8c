# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Test runs at a time, and nodes of others, do not share a domain id."""

from domain_ids import IDS, Domain, claimed
from python_processes import ROOT, begun
import rclpy
from rclpy.context import Context
from rclpy.node import Node

CLAIM = """
import signal
from domain_ids import Domain
domains = [Domain() for _ in range(10)]
print(*(domain.id for domain in domains), flush=True)
signal.pause()
"""


def test_processes_have_different_ids_and_what_was_a_killed_ones_is_free_again():
    here = [Domain() for _ in range(10)]
    process = begun(CLAIM, ROOT / 'tools')
    there = [int(number) for number in process.stdout.readline().split()]
    assert len({*there, *(domain.id for domain in here)}) == 20
    assert {*there} < {*IDS}
    assert not any(claimed(number) for number in there)
    process.kill()
    process.communicate()
    for domain in here:
        domain.give_back()
    # another run may have had one at once
    claims = list(filter(None, map(claimed, there)))
    assert claims
    for claim in claims:
        claim.close()


def test_an_id_with_nodes_that_claim_nothing_is_left_alone(monkeypatch):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    domain, context = Domain(), Context()
    rclpy.init(context=context, domain_id=domain.id)
    node = Node('stranger', context=context)
    domain.give_back()
    assert claimed(domain.id) is None
    node.destroy_node()
    rclpy.try_shutdown(context=context)
