# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The links of a robot: from its description and the states of its joints to moving obstacles.

States are only noted when they come, and used once in each cycle of the node: of joint states at
1 kHz the last one before a tick counts. Each use is one action in the history.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
import time

import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from softbody_ros.ros import message_parsing
from softbody_ros.scene.parameters import NodeConfig
from softbody_ros.scene.robot import Robot, RobotError, RobotState, move_robot, read_robot
from softbody_ros.timeline.stepper import Stepper

DESCRIPTION, JOINT_STATES = '/robot_description', '/joint_states'
PATIENCE = 1.0
"""Seconds for which joints are waited for, after the first state of one of them."""
UNHEARD = 5.0
"""Seconds after which it is said that nothing is received."""
LARGEST_AGE = 0.1
"""Largest difference between the stamp of a state and the time of a tick, s, which its velocities
are trusted to bridge; beyond it the clocks may be different ones."""


class RobotLinks:
    """
    Moves the links of a robot in the world of a stepper.

    Parameters
    ----------
    stepper : Stepper
    settings : callable
        returns the present NodeConfig
    warn : callable
        says a sentence about a topic
    changed : callable
        is told another robot, or None, when its links are others

    """

    def __init__(
        self,
        stepper: Stepper,
        settings: Callable[[], NodeConfig],
        warn: Callable[[str, str], None],
        changed: Callable[[Robot | None], None],
    ) -> None:
        self._stepper, self._settings = stepper, settings
        self._warn, self._changed = warn, changed
        self._text = ''
        self._used: tuple[str, tuple[str, ...]] = ('', ())
        self._friction = -1.0
        self._robot: Robot | None = None
        self._joints: dict[str, _Joint] = {}
        self._heard_since: float | None = None
        self._on_since = time.monotonic()
        self._said: set[str] = set()
        self._due = False
        self._last: tuple[Robot | None, RobotState, tuple, int] | None = None
        self._last_stamp = 0
        self._messages = 0

    # -------------------------------------------------------------------------------- messages
    def describe(self, message: String, _: NodeConfig) -> str:
        """Use the description of a robot; return a warning, or ''."""
        self._text = message.data
        return self._read()

    def note_joints(self, message: JointState, _: NodeConfig) -> str:
        """Note the state of some joints; return a warning, or ''."""
        stamp, readings, problem = message_parsing.joint_readings(message)
        self._messages += 1
        for name, position, velocity in readings:
            joint = self._joints.get(name)
            if joint is None:
                joint = self._joints[name] = _Joint(position)
            joint.position, joint.stated, joint.stamp = position, velocity, stamp
            joint.is_new = True
        if self._heard_since is None and self._robot is not None:
            self._note_whether_heard(self._robot)
        self._due = True
        return problem

    def configure(self) -> None:
        """Use other parameters."""
        problem = self._read()
        if problem:
            self._warn(DESCRIPTION, problem)
        self._due = True

    # ------------------------------------------------------------------------------- the robot
    def _read(self) -> str:
        settings = self._settings()
        links, friction = settings.robot_links, settings.robot_friction
        if (self._text, links) == self._used:
            if self._robot is not None and friction != self._friction:
                self._robot, self._due = self._robot.with_friction(friction), True
            self._friction = friction
            return ''
        self._used, self._friction = (self._text, links), friction
        self._on_since = time.monotonic()
        if not links or not self._text:
            self._use(None)
            return ''
        world = self._stepper.world
        taken = [*world.names, *(config.name for config in world.config.obstacles)]
        try:
            robot, problems = read_robot(self._text, links, friction, taken)
        except RobotError as error:
            return f'it is ignored: {error}'
        self._use(robot)
        for problem in problems[1:]:
            self._say(DESCRIPTION, problem)
        return problems[0] if problems else ''

    def _use(self, robot: Robot | None) -> None:
        if robot is None and self._robot is None:
            return
        self._robot, self._due, self._heard_since = robot, True, None
        if robot is not None:
            self._note_whether_heard(robot)
        self._changed(robot)

    def _note_whether_heard(self, robot: Robot) -> None:
        if any(name in self._joints for name in robot.joints):
            self._heard_since = time.monotonic()

    def _say(self, topic: str, sentence: str) -> None:
        """Warn, once about the same thing."""
        if sentence not in self._said:
            self._said.add(sentence)
            self._warn(topic, sentence)

    # --------------------------------------------------------------------------------- a cycle
    def update(self) -> None:
        """Move the links as the joint states say that have come since the last call."""
        robot = self._robot
        if not self._due and (robot is None or self._is_there(robot)):
            return
        if self._stepper.replaying:
            return
        if robot is not None and not self._has_joints(robot):
            return
        self._due = False
        settings = self._settings()
        state, seconds = self._state(robot, settings), settings.input_timeout
        world = self._stepper.world
        last = self._last
        self._last = robot, state, settings.robot_pose, world.time_jumps
        if robot is not None and last is not None and self._is_there(robot):
            still = not (state.velocities.any() or last[1].velocities.any())
            same = last[0] is robot and last[2:] == self._last[2:]
            if same and still and np.array_equal(state.positions, last[1].positions):
                return
        self._stepper.act(
            partial(move_robot, robot=robot, state=state, seconds=seconds), state.nbytes
        )

    def _is_there(self, robot: Robot) -> bool:
        """Whether the world has the links: not if its clock went back to before they came."""
        present = self._stepper.world.external_inputs.dynamic_obstacles
        return all(shape.key in present for shape in robot.shapes)

    def _has_joints(self, robot: Robot) -> bool:
        """Whether all joints are known, or have been waited for long enough."""
        missing = [name for name in robot.joints if name not in self._joints]
        if not missing:
            return True
        since = self._heard_since
        if since is None or time.monotonic() < since + PATIENCE:
            return False
        self._say(
            JOINT_STATES,
            f'nobody sends {_listed(missing)} of the robot: where that is unknown, 0 is taken',
        )
        return True

    def _state(self, robot: Robot | None, settings: NodeConfig) -> RobotState:
        """Return the state of the joints at the present tick."""
        stepper = self._stepper
        names = robot.joints if robot is not None else ()
        pace = stepper.time_scale
        runs = not stepper.paused and pace > 0.0
        now, newest = stepper.time_of(stepper.world.tick), 0
        gap = settings.input_timeout
        positions, velocities = np.zeros(len(names)), np.zeros(len(names))
        for row, name in enumerate(names):
            joint = self._joints.get(name)
            if joint is None:
                continue
            velocity = joint.used(gap)
            age = 1e-9 * (now - joint.stamp)
            bridged = age if runs and joint.stamp and abs(age) <= LARGEST_AGE else 0.0
            positions[row] = joint.position + velocity * bridged
            velocities[row] = velocity / pace if pace > 0.0 else 0.0
            newest = max(newest, joint.stamp)
        since_last, self._last_stamp = 1e-9 * (newest - self._last_stamp), newest
        approach = pace * since_last if runs and newest and 0.0 < since_last <= gap else 0.0
        pose = settings.robot_pose
        same_root = self._last is not None and self._last[2] == pose
        return RobotState(
            positions, velocities, pose[:3], pose[3:], approach if same_root else 0.0
        )

    # ------------------------------------------------------------------------------ diagnostics
    def report(self) -> dict[str, str]:
        """Return what is known of the robot, for the diagnostics; say what is missing."""
        links = self._settings().robot_links
        if not links:
            return {}
        waited = time.monotonic() > self._on_since + UNHEARD
        robot = self._robot
        if waited and not self._text:
            self._say(
                DESCRIPTION,
                'robot.links is set, but no robot is described there: start robot_state_publisher',
            )
        elif waited and robot is not None and robot.joints and self._heard_since is None:
            self._say(
                JOINT_STATES,
                f'nobody sends {_listed(robot.joints)} of the robot: it is not in the way yet',
            )
        messages, self._messages = self._messages, 0
        return {
            'links of the robot': str(len(robot.names) if robot is not None else 0),
            'joint states (1/s)': str(messages),
        }


@dataclass
class _Joint:
    """The last state of a joint, and the one that was used before."""

    position: float
    stated: float | None = None
    stamp: int = 0
    is_new: bool = False
    velocity: float = 0.0
    position_before: float = 0.0
    stamp_before: int = 0

    def used(self, longest_gap: float) -> float:
        """Return its velocity, which is computed if it is not stated."""
        if not self.is_new:
            return self.velocity
        gap = 1e-9 * (self.stamp - self.stamp_before)
        if self.stated is not None:
            self.velocity = self.stated
        elif self.stamp_before and 0.0 < gap <= longest_gap:
            self.velocity = (self.position - self.position_before) / gap
        else:
            self.velocity = 0.0
        self.position_before, self.stamp_before, self.is_new = self.position, self.stamp, False
        return self.velocity


def _listed(names: list[str] | tuple[str, ...]) -> str:
    more = f' and {len(names) - 4} more' if len(names) > 4 else ''
    what = 'joint ' if len(names) == 1 else 'the joints '
    return what + ', '.join(names[:4]) + more
