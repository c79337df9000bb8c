# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The node end to end: what it publishes, what arrives in another process, when, and at what cost.

python3 tools/benchmarks/node.py [--quick] [publishing] [memory] [startup]

Prints Markdown. All of it takes six minutes, `--quick` two to three. Every number comes from a
node and a reader that are processes of their own. The reader takes the messages as bytes: to
decode a marker of 100 000 triangles takes rclpy 0.7 s.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
import multiprocessing
import os
from pathlib import Path
import platform
import re
import struct
import subprocess
import sys
import tempfile
import time
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.utilities import get_rmw_implementation_identifier
import scipy
from sensor_msgs.msg import PointCloud2
import trimesh
from visualization_msgs.msg import Marker

from softbody_ros.ros.node import SimNode

ROOT = Path(__file__).parents[2]
PROFILE = ROOT / 'config' / 'fastdds_large_meshes.xml'
PROFILE_VARIABLE = 'FASTRTPS_DEFAULT_PROFILES_FILE'
KINDS = {'points': PointCloud2, 'mesh': Marker}
READER_DEPTH = 5
"""Messages that the reader's queue holds, as that of RViz."""
SETTLING = 1.0
"""Seconds before and after the frames that are measured."""
LONGEST_START = 60.0
"""Seconds until a process has started: to load a million vertices takes ten."""
LONGEST_DISCOVERY = 10.0
"""Seconds until a first message arrives, or none ever will."""
MILLISECOND = 1_000_000
"""ns"""

spawned = multiprocessing.get_context('spawn')


# ----------------------------------------------------------------------------------- the processes
@dataclass(frozen=True)
class Frame:
    """
    One call of the node's publishing; times are of the monotonic clock, which processes share.

    Attributes
    ----------
    stamp : int
        of the messages, ns
    outputs : frozenset of str
        topics that were due
    stepped : int
        when the step to it was done, ns
    published : int
        when everything was packed and handed to the middleware, ns

    """

    stamp: int
    outputs: frozenset[str]
    stepped: int
    published: int


class NotingNode(SimNode):
    """The node, which notes when it has stepped and when it has published."""

    def __init__(self, **node_arguments: Any) -> None:
        self.frames: list[Frame] = []
        super().__init__(**node_arguments)

    def _publish(self, outputs: set[str]) -> None:
        # called as soon as the step is done
        stamp, stepped = self._stamp(), time.monotonic_ns()
        super()._publish(outputs)
        self.frames.append(Frame(stamp, frozenset(outputs), stepped, time.monotonic_ns()))


class Child:
    """
    A process that spins a node until its result is asked for.

    Parameters
    ----------
    work : callable
        what it runs; gets the arguments and this object's ends of the connection
    arguments : tuple

    """

    def __init__(self, work: Callable, *arguments: Any) -> None:
        self.ready, self._end = spawned.Event(), spawned.Event()
        self._result, there = spawned.Pipe(duplex=False)
        self._process = spawned.Process(
            target=work, args=(*arguments, self.ready, self._end, there), daemon=True
        )
        self._process.start()

    @property
    def pid(self) -> int:
        assert self._process.pid is not None
        return self._process.pid

    def result(self) -> Any:
        """End it and return what it has noted."""
        self._end.set()
        noted = self._result.recv()
        self._process.join()
        return noted


def spin(node: Node, end: Any) -> None:
    """Spin a node until an event is set."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not end.is_set():
        executor.spin_once(timeout_sec=0.1)


def simulate(parameters: dict[str, Any], ready: Any, end: Any, result: Any) -> None:
    """Run the node in this process; the result is its frames."""
    rclpy.init(args=['--ros-args', '--log-level', 'warn'])
    overrides = [Parameter(name, value=value) for name, value in parameters.items()]
    node = NotingNode(parameter_overrides=overrides)
    ready.set()
    spin(node, end)
    result.send(node.frames)


def read(topics: Sequence[str], count: Any, ready: Any, end: Any, result: Any) -> None:
    """
    Receive messages in this process, and count those of the first topic while it runs.

    The result is, for each topic, when each message arrived on the monotonic clock, by stamp; ns.
    """
    rclpy.init()
    node = Node('reader')
    arrivals: dict[str, dict[int, int]] = {topic: {} for topic in topics}

    def receiver(topic: str) -> Callable[[bytes], None]:
        def note(data: bytes) -> None:
            now = time.monotonic_ns()
            # 4 bytes of encapsulation, then the stamp of the header
            seconds, nanoseconds = struct.unpack_from('<iI', data, 4)
            arrivals[topic][seconds * 1_000_000_000 + nanoseconds] = now
            count.value += topic == topics[0]

        return note

    for topic in topics:
        name = f'/softbody_sim/{topic}'
        node.create_subscription(KINDS[topic], name, receiver(topic), READER_DEPTH, raw=True)
    ready.set()
    spin(node, end)
    result.send(arrivals)


def sim_node(*arguments: str, **streams: Any) -> subprocess.Popen:
    """Start the node as users do."""
    return subprocess.Popen(
        [sys.executable, '-u', '-m', 'softbody_ros', *arguments], cwd=ROOT, text=True, **streams
    )


def require_alive(process: subprocess.Popen) -> None:
    if process.poll() is not None:
        raise RuntimeError(f'the node has ended with exit code {process.returncode}')


@contextmanager
def fast_dds(profile: bool) -> Iterator[None]:
    """Let processes that start meanwhile use the shipped profile, or Fast DDS's defaults."""
    os.environ.pop(PROFILE_VARIABLE, None)
    if profile:
        os.environ[PROFILE_VARIABLE] = str(PROFILE)
    yield
    os.environ.pop(PROFILE_VARIABLE, None)


def cpu_seconds(pid: int) -> float:
    """Return the processor time that a process has taken, s, all threads."""
    fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def resident(pid: int) -> dict[str, float]:
    """Return the memory of a process, MiB: private (Anon), mapped files (File), shared (Shmem)."""
    lines = Path(f'/proc/{pid}/status').read_text()
    return {kind: int(size) / 1024 for kind, size in re.findall(r'Rss(\w+):\s+(\d+)', lines)}


def wait(event: Any, what: str) -> None:
    if not event.wait(LONGEST_START):
        raise TimeoutError(f'{what} has not started within {LONGEST_START:g} s')


# -------------------------------------------------------------------------------------- publishing
@dataclass(frozen=True)
class Case:
    """A scene, the topics that another process reads, and whether it has the profile."""

    scene: str
    parameters: dict[str, Any]
    topics: tuple[str, ...]
    profile: bool = False


def cases(folder: Path) -> list[Case]:
    """Return what is measured; mesh files are written to a folder."""
    spinning = {'gravity.magnitude': 0.0, 'ball.initial_velocity.angular': [0.5, 1.0, 0.0]}
    large = {'ball.mesh': torus(folder, 250, 200), 'mesh_rate': 60.0}
    # what is held and lies still falls asleep: its steps take no time
    asleep = {'gravity.magnitude': 0.0, 'ball.pins.indices': [0]}
    slow = {'ball.mesh': torus(folder, 1250, 800), 'time_step': 0.1, 'points_rate': 10.0}
    many = [f'ball_{index}' for index in range(200)]
    apart = {f'{name}.position': [2.0 * i, 0.0, 1.0] for i, name in enumerate(many)}
    coarse = {f'{name}.subdivisions': 1 for name in many}
    ball, hundred_thousand = 'default: 1 280 triangles', '100 000 triangles'
    million = '1 000 000 vertices'
    return [
        Case(ball, {}, ()),
        Case(ball, {}, ('points', 'mesh')),
        Case('200 balls of 42 vertices', {'bodies': many} | apart | coarse, ()),
        Case(hundred_thousand, large | spinning, ()),
        Case(hundred_thousand, large | spinning, ('points',), profile=True),
        Case(hundred_thousand, large | spinning, ('mesh',), profile=True),
        Case(hundred_thousand, large | spinning, ('mesh',)),
        Case(hundred_thousand, large | spinning, ('points', 'mesh'), profile=True),
        Case(f'{hundred_thousand}, asleep', large | asleep, ('mesh',), profile=True),
        Case(f'{million}, asleep', slow | asleep, ('points',), profile=True),
        Case(f'{million}, asleep', slow | asleep, ('points',)),
        Case(f'{million}, rigid', slow | spinning | {'ball.mode': 'rigid'}, ('points',), True),
    ]


def torus(folder: Path, major: int, minor: int) -> str:
    """Write a torus of major · minor vertices and twice as many triangles; return the path."""
    path = folder / f'torus_{major}_{minor}.ply'
    if not path.exists():
        trimesh.creation.torus(2 / 3, 1 / 3, major, minor).export(path)
    return str(path)


@dataclass(frozen=True)
class Observation:
    """
    What happened in some seconds of a case.

    Attributes
    ----------
    seconds : float
    cores : float
        processor time of the node per second, all threads
    frames : list of Frame
        those of the node
    arrivals : dict of str to dict of int to int
        for each topic the times at which messages arrived, by stamp, ns

    """

    seconds: float
    cores: float
    frames: list[Frame]
    arrivals: dict[str, dict[int, int]]


def observe(case: Case, seconds: float) -> Observation:
    """Run a node and a reader, and return what happened while both were at it."""
    count = spawned.Value('q', 0)
    with fast_dds(case.profile):
        sim = Child(simulate, case.parameters)
        reader = Child(read, case.topics, count)
    wait(sim.ready, 'the node')
    wait(reader.ready, 'the reader')
    deadline = time.monotonic() + LONGEST_DISCOVERY
    while case.topics and not count.value and time.monotonic() < deadline:
        time.sleep(0.01)
    time.sleep(SETTLING)
    begin, cpu_before = time.monotonic_ns(), cpu_seconds(sim.pid)
    time.sleep(seconds)
    end, cpu_after = time.monotonic_ns(), cpu_seconds(sim.pid)
    time.sleep(SETTLING)
    arrivals, frames = reader.result(), sim.result()
    elapsed = 1e-9 * (end - begin)
    return Observation(
        seconds=elapsed,
        cores=(cpu_after - cpu_before) / elapsed,
        frames=[frame for frame in frames if begin <= frame.stepped < end],
        arrivals={
            topic: {stamp: moment for stamp, moment in times.items() if begin <= moment < end}
            for topic, times in arrivals.items()
        },
    )


def rows_of(case: Case, seen: Observation) -> list[list[str]]:
    """Return a row of the table for each topic that is read, one if none is."""
    rows = []
    for topic in case.topics or ('points',):
        frames = [frame for frame in seen.frames if topic in frame.outputs]
        work = np.median([frame.published - frame.stepped for frame in frames])
        row = [case.scene, f'{len(frames) / seen.seconds:.1f}', f'{seen.cores:.2f}']
        row += [f'{work / MILLISECOND:.2f}']
        if case.topics:
            row += [topic, 'yes' if case.profile else 'no', *arrival_of(topic, frames, seen)]
        else:
            row += ['nobody', '', '', '', '']
        rows.append(row)
    return rows


def arrival_of(topic: str, frames: list[Frame], seen: Observation) -> list[str]:
    """Return how many messages of a topic arrived per second, and how late, ms."""
    times = seen.arrivals[topic]
    late = [times[frame.stamp] - frame.stepped for frame in frames if frame.stamp in times]
    half, most = np.percentile(late or [np.nan], [50, 99]) / MILLISECOND
    return [f'{len(times) / seen.seconds:.1f}', f'{half:.1f}', f'{most:.1f}']


def publishing(quick: bool) -> None:
    """What is published, what arrives, how late, and what it costs."""
    header = ['scene', 'frames/s', 'node, cores', 'pack and publish, ms']
    header += ['another process reads', 'profile', 'arrive/s', 'step to receipt, ms', '99 %, ms']
    with tempfile.TemporaryDirectory() as folder:
        rows = []
        for case in cases(Path(folder)):
            rows += rows_of(case, observe(case, 3.0 if quick else 10.0))
    print_table(header, rows)


# ------------------------------------------------------------------------------------------ memory
def memory(quick: bool) -> None:
    """Resident memory while a reader gets a cloud and a mesh at each of 2400 ticks a second."""
    frames = 10_000 if quick else 100_000
    # ten times as fast as the clock, and every tick is a frame; the history is full early
    parameters = ['time_scale:=10.0', 'points_rate:=10000.0', 'mesh_rate:=10000.0']
    parameters += ['ball.subdivisions:=2', 'history.memory:=1.0']
    arguments = [word for parameter in parameters for word in ('-p', parameter)]
    count = spawned.Value('q', 0)
    reader = Child(read, ('points', 'mesh'), count)
    wait(reader.ready, 'the reader')
    rows = []
    with sim_node('--ros-args', '--log-level', 'warn', *arguments) as process:
        begin = time.monotonic()
        for share in (0.01, 0.1, 0.5, 1.0):
            while count.value < share * frames:
                require_alive(process)
                time.sleep(0.01)
            sizes = resident(process.pid)
            rows.append(
                [f'{share * frames:.0f}', f'{time.monotonic() - begin:.1f}']
                + [f'{sum(sizes.values()):.1f}']
                + [f'{sizes[kind]:.1f}' for kind in ('Anon', 'File', 'Shmem')]
            )
        process.terminate()
    reader.result()
    header = ['frames received', 's', 'resident, MiB', 'private', 'mapped files', 'shared']
    print_table(header, rows)


# ---------------------------------------------------------------------------------------- start-up
def startup(quick: bool) -> None:
    """Starts of the default scene, while a reader runs that has been started 0.5 to 3.5 s ago."""
    # participants announce themselves every 3 s: the time until they meet depends on the phase
    ages = np.random.default_rng(0).permutation(np.linspace(0.5, 3.5, 5 if quick else 15))
    start_once(0.0)  # warms the file cache
    stages = zip(*[start_once(age) for age in ages], strict=True)
    names = ['everything is imported', 'the node is made, its first frame is due']
    names += ['the first cloud has arrived']
    print_table(
        ['s after the start of the process', 'least', 'median', 'most'],
        [
            [name] + [f'{value:.2f}' for value in (min(times), np.median(times), max(times))]
            for name, times in zip(names, stages, strict=True)
        ],
    )
    print_table(['imports of', 's'], import_times())


def start_once(age: float) -> list[float]:
    """Return when each stage of a start is reached, s, and let the reader run for `age` before."""
    begin = time.monotonic()
    with sim_node('--help', stdout=subprocess.PIPE) as process:
        process.stdout.readline()
        imported = time.monotonic() - begin
        process.communicate()

    count = spawned.Value('q', 0)
    reader = Child(read, ('points',), count)
    wait(reader.ready, 'the reader')
    time.sleep(age)
    begin = time.monotonic()
    with sim_node(stderr=subprocess.PIPE) as process:
        process.stderr.readline()  # what the node says as soon as it is made
        made = time.monotonic() - begin
        while not count.value:
            require_alive(process)
            time.sleep(0.01)
        process.terminate()
    arrived = 1e-9 * min(reader.result()['points'].values()) - begin
    return [imported, made, arrived]


def import_times() -> list[list[str]]:
    """Return how long the imports take that each package starts, longest first."""
    lines = subprocess.run(
        [sys.executable, '-X', 'importtime', '-c', 'import softbody_ros.ros.node'],
        cwd=ROOT, check=True, capture_output=True, text=True,
    ).stderr  # fmt: skip
    total: Counter[str] = Counter()
    for own, module in re.findall(r'import time:\s+(\d+) \|\s+\d+ \|\s+([\w.]+)', lines):
        package = module.split('.')[0]
        kind = package
        if package.endswith(('_msgs', '_interfaces', '_srvs')) or package in ('rclpy', 'rpyutils'):
            kind = 'rclpy and messages'
        elif package not in ('numpy', 'scipy', 'trimesh', 'softbody_ros'):
            kind = 'the standard library and others'
        total[kind] += int(own)
    return [[kind, f'{1e-6 * own:.2f}'] for kind, own in total.most_common()]


# ------------------------------------------------------------------------------------------ output
def print_table(header: list[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a Markdown table."""
    for row in [header, ['---'] * len(header), *rows]:
        print('| ' + ' | '.join(row) + ' |', flush=True)
    print(flush=True)


def machine() -> str:
    """Return what the numbers depend on."""
    model = re.search(r'model name\s*: (.*)', Path('/proc/cpuinfo').read_text())
    return (
        f'{os.cpu_count()} × {model.group(1) if model else platform.machine()}, '
        f'Linux {platform.release()}, Python {platform.python_version()}, '
        f'NumPy {np.__version__}, SciPy {scipy.__version__}, trimesh {trimesh.__version__}, '
        f'{get_rmw_implementation_identifier()}; load before: {os.getloadavg()[0]:.1f}'
    )


def main() -> None:
    parts = {'publishing': publishing, 'memory': memory, 'startup': startup}
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[1])
    parser.add_argument('parts', nargs='*', metavar='PART', help=f'{", ".join(parts)}; or all')
    parser.add_argument('--quick', action='store_true', help='shorter, noisier')
    arguments = parser.parse_args()
    unknown = set(arguments.parts) - set(parts)
    if unknown:
        parser.error(f'unknown: {", ".join(unknown)}')
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    print(machine(), end='\n\n')
    for name in arguments.parts or parts:
        print(f'**{name}**: {parts[name].__doc__}\n')
        parts[name](arguments.quick)


if __name__ == '__main__':
    main()
