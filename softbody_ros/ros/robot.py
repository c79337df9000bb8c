# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The links of a robot: from its description and the states of its joints to moving obstacles.

States are only noted when they come, and used once in each cycle of the node: of joint states at
1 kHz the last one before a tick counts. Each use is one action in the history.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from functools import partial
import time

import numpy as np
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from softbody_ros.core.external_inputs import Twist, is_link
from softbody_ros.ros import message_parsing
from softbody_ros.ros.frames import Lookup, Pose
from softbody_ros.ros.interfaces import JOINT_STATES, ROBOT_DESCRIPTION
from softbody_ros.scene.parameters import NodeConfig
from softbody_ros.scene.robot import (
    STILL,
    Robot,
    RobotError,
    RobotState,
    move_robot,
    read_robot,
)
from softbody_ros.timeline.stepper import Stepper

AT_ORIGIN = NodeConfig().robot_pose
"""The pose that stands for that of TF, if there is one."""
PATIENCE = 1.0
"""Seconds for which joints are waited for, after the first state of one of them."""
UNHEARD = 5.0
"""Seconds after which it is said that nothing is received."""
LARGEST_AGE = 0.1
"""Largest difference between the stamp of a state and the time of a tick, s, which its velocities
are trusted to bridge; beyond it the clocks may be different ones."""


MOST_JOINTS = 1000
"""Joints that are remembered, beyond those of the robot: another one may have them."""
MOST_SAID = 1000


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
    lookup : callable
        returns where a frame is, or None; see `frames`

    """

    def __init__(
        self,
        stepper: Stepper,
        settings: Callable[[], NodeConfig],
        warn: Callable[[str, str], None],
        changed: Callable[[Robot | None], None],
        lookup: Lookup,
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
        self._is_used = False  # whether there has ever been a robot
        self._lookup = lookup
        self._last: _Used | None = None
        self._last_roots: dict[str, Pose] | None = None
        self._twists: dict[str, Twist] = {}
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
                if len(self._joints) >= MOST_JOINTS and not self._has_joint(name):
                    self._say(
                        JOINT_STATES.name,
                        f'more than {MOST_JOINTS} joints are named there: of the others only '
                        'those of the robot are used',
                    )
                    continue
                joint = self._joints[name] = _Joint(position)
            joint.position, joint.stated, joint.stamp = position, velocity, stamp
            joint.is_new = True
        robot = self._robot
        if robot is not None and any(name in robot.joints for name, *_ in readings):
            self._due = True
            self._heard_since = self._heard_since or time.monotonic()
        return problem

    def _has_joint(self, name: str) -> bool:
        return self._robot is not None and name in self._robot.joints

    def configure(self) -> None:
        """Use other parameters."""
        problem = self._read()
        if problem:
            self._warn(ROBOT_DESCRIPTION.name, problem)

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
            self._say(ROBOT_DESCRIPTION.name, problem)
        return problems[0] if problems else ''

    def _use(self, robot: Robot | None) -> None:
        if robot is None and self._robot is None:
            return
        self._robot, self._due, self._heard_since = robot, True, None
        self._last_roots, self._is_used, self._twists = None, True, {}
        if robot is not None and len(self._joints) >= MOST_JOINTS:
            self._joints = {
                name: joint for name, joint in self._joints.items() if name in robot.joints
            }
        if robot is not None and any(name in self._joints for name in robot.joints):
            self._heard_since = time.monotonic()
        self._changed(robot)

    @property
    def names(self) -> Collection[str]:
        """Names of the links as obstacles."""
        return self._robot.names.values() if self._robot is not None else ()

    def _say(self, topic: str, sentence: str) -> None:
        """Warn, once about the same thing."""
        if sentence not in self._said:
            if len(self._said) >= MOST_SAID:
                self._said.clear()  # descriptions that change for ever
            self._said.add(sentence)
            self._warn(topic, sentence)

    # --------------------------------------------------------------------------------- a cycle
    def update(self) -> None:
        """Move the links as what has come since the last call says."""
        stepper = self._stepper
        if stepper.replaying or not self._is_used:
            return
        robot, settings, states = self._robot, self._settings(), {}
        roots = self._roots(robot, settings) if robot is not None else None
        if robot is None or roots is None:
            robot = None  # where it is is not known yet
        elif roots == self._last_roots and not self._due and self._is_there(robot):
            return
        else:
            states = self._states(robot, roots, settings)
            self._last_roots, self._due = roots, False
        if robot is None and self._is_there(None):
            return
        last, now = self._last, (robot, states, stepper.world.time_jumps)
        self._last = now
        if robot is not None and self._is_there(robot) and _is_same(last, now):
            return
        seconds = settings.input_timeout
        stepper.act(
            partial(move_robot, robot=robot, states=states, seconds=seconds),
            sum(state.nbytes for state in states.values()),
        )

    def _is_there(self, robot: Robot | None) -> bool:
        """Whether the world has just these links: not if its clock went back to before."""
        present = self._stepper.world.external_inputs.dynamic_obstacles
        shapes = robot.shapes if robot is not None else ()
        return sum(map(is_link, present)) == len(shapes) and all(
            shape.key in present for shape in shapes
        )

    def _roots(self, robot: Robot, settings: NodeConfig) -> dict[str, Pose] | None:
        """Return where its root is, or each of its links if nobody sends joints; None: unknown."""
        is_default = settings.robot_pose == AT_ORIGIN
        if self._has_joints(robot):
            pose = self._lookup(robot.root, 0) if is_default else None
            if pose is None:
                pose = Pose(settings.robot_pose[:3], settings.robot_pose[3:], 0)
            return {robot.root: pose}
        if not is_default or self._heard_since is not None:
            return None
        result = {}
        for link in robot.names:
            pose = self._lookup(link, 0)
            if pose is None:
                return None
            result[link] = pose
        return result

    def _has_joints(self, robot: Robot) -> bool:
        """Whether all joints are known, or have been waited for long enough."""
        missing = [name for name in robot.joints if name not in self._joints]
        if not missing:
            return True
        since = self._heard_since
        if since is None or time.monotonic() < since + PATIENCE:
            return False
        self._say(
            JOINT_STATES.name,
            f'nobody sends {_listed(missing)} of the robot: where that is unknown, 0 is taken',
        )
        return True

    def _states(
        self, robot: Robot, roots: Mapping[str, Pose], settings: NodeConfig
    ) -> dict[str, RobotState]:
        """Return the state of the robot, or of each of its links, at the present tick."""
        stepper = self._stepper
        pace, gap = stepper.time_scale, settings.input_timeout
        runs = not stepper.paused and pace > 0.0
        now = stepper.time_of(stepper.world.tick)
        names = robot.joints if robot.root in roots else ()
        joints = [
            (row, self._joints[name]) for row, name in enumerate(names) if name in self._joints
        ]
        positions, velocities = np.zeros(len(names)), np.zeros(len(names))
        newest = max((joint.stamp for _, joint in joints), default=0)
        age = 1e-9 * (now - newest)
        age = age if runs and newest and abs(age) <= LARGEST_AGE else 0.0
        for row, joint in joints:
            velocity = joint.used(gap)
            # another publisher may have sent it, and may have ended
            late = min(1e-9 * (newest - joint.stamp), gap) if joint.stamp else 0.0
            positions[row] = joint.position + velocity * (late + (age if late < gap else 0.0))
            velocities[row] = velocity / pace if pace > 0.0 and late < gap else 0.0
        newest = max([newest, *(pose.stamp for pose in roots.values())])
        since_last, self._last_stamp = 1e-9 * (newest - self._last_stamp), newest
        approach = pace * since_last if runs and newest and 0.0 < since_last <= gap else 0.0
        states = {}
        for name, pose in roots.items():
            before = self._last_roots.get(name) if self._last_roots else None
            still = before is None or pose.stamp == 0 or pose.stamp == before.stamp
            twist = self._twists.get(name, STILL) if before is not None else STILL
            if before is not None and not still:
                twist = _twist_between(before, pose, gap, pace)
            if pose.stamp == 0:
                twist = STILL
                if before is not None and before[:2] != pose[:2]:
                    approach = 0.0  # somebody has set the parameter
            self._twists[name] = twist
            states[name] = RobotState(
                positions, velocities, pose.position, pose.orientation, twist, approach
            )
        return states

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
                ROBOT_DESCRIPTION.name,
                'robot.links is set, but no robot is described there: start robot_state_publisher',
            )
        elif waited and robot is not None and robot.joints and self._heard_since is None:
            self._say(
                JOINT_STATES.name,
                f'nobody sends {_listed(robot.joints)} of the robot: it is not in the way yet',
            )
        messages, self._messages = self._messages, 0
        return {
            'links of the robot': str(len(robot.names) if robot is not None else 0),
            'joint states (1/s)': str(messages),
        }


_Used = tuple[Robot | None, dict[str, RobotState], int]
"""A robot and its states, and how often time had jumped then."""


def _is_same(last: _Used | None, now: _Used) -> bool:
    """Whether a robot stands still where it stood still."""
    if (
        last is None
        or last[0] is not now[0]
        or last[2] != now[2]
        or last[1].keys() != now[1].keys()
    ):
        return False
    return all(_stand_still_at_one_place(last[1][name], now[1][name]) for name in now[1])


def _stand_still_at_one_place(one: RobotState, other: RobotState) -> bool:
    moves = any(state.velocities.any() or state.root_twist != STILL for state in (one, other))
    same_root = (one.root_position, one.root_orientation) == (
        other.root_position,
        other.root_orientation,
    )
    return not moves and same_root and np.array_equal(one.positions, other.positions)


def _twist_between(before: Pose, after: Pose, longest_gap: float, pace: float) -> Twist:
    """Return the velocity, by simulated time, with which a frame came from a pose to another."""
    seconds = 1e-9 * (after.stamp - before.stamp) * pace
    if not (before.stamp and 0.0 < seconds <= longest_gap * pace):
        return STILL
    linear = (np.array(after.position) - before.position) / seconds
    turn = Rotation.from_quat(after.orientation) * Rotation.from_quat(before.orientation).inv()
    return tuple(linear.tolist()), tuple((turn.as_rotvec() / seconds).tolist())


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
