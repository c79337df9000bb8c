#!/usr/bin/env python3
# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Time a grasp of this simulator and of MuJoCo's trilinear flex, as a Markdown table.

pip install '.[bench]' && python3 tools/benchmarks/gripper.py [--rounds]

Two fingers squeeze a ball of 642 vertices, 5 cm and 0.2 kg, by a fifth of its radius, lift it
and hold it, at 1/240 s. What is printed is CPU time for a second of simulation, of all threads of
a process; rounds go through all simulators in turn, and ratios are formed within a round. MuJoCo
is used as its example of a gripper and its manual's advice on manipulation have it: integrator
discrete, elliptic cones, impratio 10, fingers on slides with position servos.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
import importlib.metadata
import importlib.util
import multiprocessing
import statistics
import time

from contact_scenes.analytic import reference_step
from contact_scenes.base import STIFFNESS
import numpy as np
from printing import print_table, shown
import trimesh

STEP = 1 / 240
"""s"""
RADIUS, MASS, FRICTION = 0.05, 0.2, 0.8
"""m, kg"""
FINGER = (0.01, 0.02, 0.03)
"""Half extents, m."""
GAP, SQUEEZE, CLOSING = 0.01, 0.2 * RADIUS, 0.05
"""m, m, m/s"""
LIFT, LIFTING = 0.1, 0.1
"""m, m/s"""
PHASES = {'closing': (GAP + SQUEEZE) / CLOSING, 'lifting': LIFT / LIFTING, 'holding': 3.0}
"""s"""
FREQUENCY = 90.0
"""Of the ball's goals, Hz: it is pressed with about the same force as MuJoCo's of 10 kPa."""
MODES, ASLEEP = ('rigid', 'linear', 'quadratic'), ', may fall asleep'


def hand(seconds):
    """Return how far each finger has come inwards, and up, m, and its velocities, m/s."""
    end = PHASES['closing']
    inwards = min(CLOSING * seconds, GAP + SQUEEZE)
    upwards = min(max(LIFTING * (seconds - end), 0.0), LIFT)
    closing = CLOSING if seconds < end else 0.0
    return inwards, upwards, closing, LIFTING if 0.0 < upwards < LIFT else 0.0


class Ours:
    """This simulator; a rigid ball is squeezed by a hundredth of that."""

    def __init__(self, name):
        from softbody_ros.core import BodyConfig, ObstacleConfig, World, WorldConfig

        mode = name.removesuffix(ASLEEP)
        self._may_sleep = mode != name  # MuJoCo's ball does not
        ball = BodyConfig(
            name='ball', mode=mode, size=RADIUS, mass=MASS, position=(0.0, 0.0, RADIUS),
            friction_model='coulomb', friction=FRICTION, stiffness=STIFFNESS,
        )  # fmt: skip
        self._squeeze = 0.01 if mode == 'rigid' else 1.0
        self._reach = RADIUS + FINGER[0] + GAP
        fingers = [
            ObstacleConfig(name=name, type='box', size=FINGER, position=(side * 0.3, 0.0, RADIUS))
            for name, side in (('left', -1.0), ('right', 1.0))
        ]
        self._world = World(
            WorldConfig(
                time_step=STEP,
                reference_step=reference_step(FREQUENCY, STIFFNESS),
                bodies=(ball,),
                obstacles=(ObstacleConfig(name='ground'), *fingers),
            )
        )
        self._world.load_kernels()

    def step(self, seconds):
        """Step with the hand as it is at a time."""
        inwards, upwards, closing, lifting = hand(seconds)
        beyond = max(inwards - GAP, 0.0)
        inwards -= (1.0 - self._squeeze) * beyond
        closing *= self._squeeze if beyond > 0.0 else 1.0
        for name, side in (('left', -1.0), ('right', 1.0)):
            position = (side * (self._reach - inwards), 0.0, RADIUS + upwards)
            self._world.move_obstacle(name, position, linear=(-side * closing, 0.0, lifting))
        if not self._may_sleep:  # another limit would be compiled, and kept for other programs
            self._world._state.still_samples[:] = 0
        self._world.step()

    @property
    def height(self):
        """That of the centre of the ball, m."""
        return float(self._world.positions('ball')[:, 2].mean())

    @property
    def force(self):
        """With which the right finger is pressed, N."""
        return float(self._world.obstacle_wrench('right')[0][0])


class MuJoCo:
    """A flex whose vertices follow a cage of 8 nodes (trilinear), 10 kPa, damping 0.05 s."""

    def __init__(self, _):
        import mujoco

        self._mujoco = mujoco
        ball = trimesh.creation.icosphere(subdivisions=3, radius=RADIUS)
        mesh = trimesh.exchange.obj.export_obj(ball, include_normals=False).encode()
        self._model = mujoco.MjModel.from_xml_string(self._xml(), {'ball.obj': mesh})
        self._data = mujoco.MjData(self._model)

    def _xml(self):
        contact = f'friction="{FRICTION} .005 .0001" condim="6"'
        reach, half = RADIUS + FINGER[0] + GAP, ' '.join(map(str, FINGER))
        fingers = ''.join(
            f'<body name="{name}" pos="{side * reach} 0 0" gravcomp="1">'
            f'<joint name="{name}" type="slide" axis="{-side} 0 0"/>'
            f'<geom name="{name}" type="box" size="{half}" mass=".5" {contact}/></body>'
            for name, side in (('left', -1.0), ('right', 1.0))
        )
        servos = ''.join(
            f'<position joint="{name}" kp="1e5" dampratio="1"/>'
            for name in ('up', 'left', 'right')
        )
        return f"""<mujoco>
          <option timestep="{STEP}" integrator="discrete" cone="elliptic" impratio="10"/>
          <size memory="300M"/>
          <worldbody>
            <geom name="ground" type="plane" size="5 5 .1" {contact}/>
            <body name="hand" pos="0 0 {RADIUS}" gravcomp="1">
              <inertial pos="0 0 0" mass="1" diaginertia=".01 .01 .01"/>
              <joint name="up" type="slide" axis="0 0 1"/>{fingers}
            </body>
            <flexcomp type="mesh" file="ball.obj" name="ball" pos="0 0 {RADIUS}" dim="2"
                      radius=".001" mass="{MASS}" dof="trilinear">
              <elasticity young="1e4" poisson=".1" damping=".05" elastic2d="none"/>
              <contact selfcollide="none" {contact}/>
            </flexcomp>
          </worldbody>
          <actuator>{servos}</actuator>
        </mujoco>"""

    def step(self, seconds):
        """Step with the hand as it is at a time."""
        inwards, upwards, _, _ = hand(seconds)
        self._data.ctrl[:] = upwards, inwards, inwards
        self._mujoco.mj_step(self._model, self._data)

    @property
    def height(self):
        """That of the centre of the ball, m."""
        return float(self._data.flexvert_xpos.reshape(-1, 3)[:, 2].mean())

    @property
    def force(self):
        """With which the right finger is pressed, N."""
        total, buffer = 0.0, np.zeros(6)
        for index in range(self._data.ncon):
            contact = self._data.contact[index]
            names = [self._model.geom(geom).name if geom >= 0 else '' for geom in contact.geom]
            if 'right' in names:
                self._mujoco.mj_contactForce(self._model, self._data, index, buffer)
                total += abs(float(np.array(contact.frame).reshape(3, 3)[0, 0] * buffer[0]))
        return total


SIMULATORS = dict.fromkeys((*MODES, MODES[-1] + ASLEEP), Ours) | {'MuJoCo': MuJoCo}


def measured_apart(name, quick):
    """Return what `measured` does, from a process of its own."""
    with ProcessPoolExecutor(1, multiprocessing.get_context('spawn')) as process:
        return process.submit(measured, name, quick).result()


def measured(name, quick):
    """Return CPU seconds for a second of each phase, force and height of a grasp, by name."""
    simulator = SIMULATORS[name](name)
    simulator.step(0.0)  # what is done once
    start, ticks, values, total = simulator.height, 0, {}, 0.0
    for phase, seconds in PHASES.items():
        count = 3 if quick else round(seconds / STEP)
        begin = time.process_time()
        for _ in range(count):
            ticks += 1
            simulator.step(ticks * STEP)
        spent = time.process_time() - begin
        total += spent
        values[phase] = spent / (count * STEP)
    values['all'] = total / (ticks * STEP)
    return values | {'force': simulator.force, 'rise': simulator.height - start}


def main():
    """Run the rounds and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument('--rounds', type=int, help='5 by default')
    parser.add_argument('--quick', action='store_true', help='a few ticks, of two modes')
    arguments = parser.parse_args()
    names = list(SIMULATORS)
    if arguments.quick:
        names = [MODES[0], MODES[-1] + ASLEEP]
    elif importlib.util.find_spec('mujoco') is None:
        names.remove('MuJoCo')
        print("MuJoCo is not installed and is left out: pip install '.[bench]'\n")
    runs = []
    for _ in range(arguments.rounds or (1 if arguments.quick else 5)):
        runs.append({name: measured_apart(name, arguments.quick) for name in names})
    rows = []
    for name in names:
        middle = {key: statistics.median(run[name][key] for run in runs) for key in runs[0][name]}
        ratios = [run[name]['all'] / run['MuJoCo']['all'] for run in runs if 'MuJoCo' in run]
        rows.append(
            [
                name,
                *(shown(1e3 * middle[phase]) for phase in (*PHASES, 'all')),
                shown(statistics.median(ratios)) if ratios else '',
                shown(middle['force']),
                shown(1e3 * middle['rise']),
            ]
        )
    header = ['', *PHASES, 'all', 'all, to MuJoCo', 'force, N', 'rise, mm']
    print_table('ms of CPU time for a second, medians of the rounds', header, rows)
    if 'MuJoCo' in names:
        print(f'mujoco {importlib.metadata.version("mujoco")}')


if __name__ == '__main__':
    main()
