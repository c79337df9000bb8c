# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A /clock that a test moves, forwards and back."""

from rosgraph_msgs.msg import Clock

SECOND = 1_000_000_000


class ClockSource:
    """Publishes /clock as fast as the node takes it, so that no message is lost."""

    def __init__(self, graph, sim):
        self.graph, self.sim = graph, sim
        self.publisher = graph.node.create_publisher(Clock, '/clock', 10)
        graph.spin_until(self.publisher.get_subscription_count, 'a subscriber of /clock')

    def send(self, nanoseconds):
        message = Clock()
        message.clock.sec, message.clock.nanosec = divmod(int(nanoseconds), SECOND)
        self.publisher.publish(message)

    def show(self, nanoseconds):
        """Send a time and wait until the node has got it."""
        self.send(nanoseconds)
        self.graph.spin_until(
            lambda: self.sim.get_clock().now().nanoseconds == nanoseconds, f'clock {nanoseconds}'
        )

    def settle(self):
        """Wait until the world is where the clock is."""
        stepper, clock = self.sim._stepper, self.sim.get_clock()
        self.graph.spin_until(
            lambda: (
                stepper.started
                and not stepper.replaying
                and not self.sim._jumped_back
                and stepper.lag(clock.now().nanoseconds) < self.sim._world.config.time_step
            ),
            'the tick of the clock',
        )

    def reach(self, nanoseconds):
        """Send a time and wait until the world is there."""
        self.show(nanoseconds)
        self.settle()
