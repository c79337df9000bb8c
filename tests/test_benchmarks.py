# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The benchmarks of the core run: the smallest of them, without the peers."""

import json
import pathlib
import subprocess
import sys

BENCHMARKS = pathlib.Path(__file__).parent.parent / 'tools' / 'benchmarks'


def run(script, *arguments):
    return subprocess.run(
        [sys.executable, BENCHMARKS / script, '--quick', *arguments],
        capture_output=True, text=True, check=True,
    ).stdout  # fmt: skip


def test_core_benchmark_measures_a_ball_that_falls_and_lies(tmp_path):
    file = tmp_path / 'runs.json'
    table = run('core.py', '--peer', 'linear', '--json', file)
    (measured,) = json.loads(file.read_text())
    assert abs(measured['acceleration'] - 9.81) < 1e-6
    assert abs(measured['lowest']) < 1.0 and 0.1 < measured['deformation'] < 2.0
    assert measured['falling'] > 0.0 and measured['resting'] > 0.0
    assert '| W1-642 | ' in table


def test_scaling_benchmark_measures_one_body():
    table = run('scaling.py')
    assert '| 92 | ' in table and '| 162 | ' in table


def test_gripper_benchmark_measures_a_grasp():
    table = run('gripper.py')
    assert '| rigid | ' in table and '| quadratic, may fall asleep | ' in table


def test_contact_battery_measures_every_scene():
    tables = run('contact_battery.py')
    scenes = [line for line in tables.splitlines() if line.startswith('### ')]
    assert len(scenes) > 20 and tables.count('targets met') == len(scenes)
    assert 'stopped by an error' not in tables


def test_contact_battery_finds_what_is_known(tmp_path):
    scenes, file = ['elevator', 'collision', 'tumbling', 'release'], tmp_path / 'rows.json'
    run('contact_battery.py', *scenes, '--step', '1000', '--json', file)
    rows = json.loads(file.read_text())
    assert [row['scene'] for row in rows] == scenes
    assert all(measured['met'] for row in rows for measured in row['measured'].values())
