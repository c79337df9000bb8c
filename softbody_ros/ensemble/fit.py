# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command `fit`, also `python3 -m softbody_ros.ensemble.fit`: parameters from observations."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import partial
from pathlib import Path
import sys
import threading
import time
from typing import TYPE_CHECKING

from softbody_ros.ensemble.offline_command import (
    Refusal,
    add_cluster,
    ended,
    make_parser,
    path_argument,
    require_cluster,
    require_packages,
    require_writable,
    say,
    scene_values,
    stop_after,
)
from softbody_ros.signals import noted_signals

if TYPE_CHECKING:
    import distributed
    import numpy as np
    from tqdm import tqdm

    from softbody_ros.ensemble.fit_estimates import Verdict
    from softbody_ros.ensemble.fit_problem import Outcome, Problem
    from softbody_ros.ensemble.fit_search import Solution

PACKAGES = {name: name for name in ('dask', 'distributed', 'matplotlib')}
POLL = 0.1
"""Interval at which a search looks for a signal, s."""
_warn = partial(say, 'fit')

DESCRIPTION = """\
Finds the parameters with which a scene reproduces an observation:

  fit ball.yaml film.npz -p ball.stiffness -p ball.bounciness
  fit ball.yaml my_bag --topic /camera/points -p ball.young_modulus:=[1e4,1e6] -p time_offset
  fit ball.yaml clouds -p ball.friction -p ball.mass:=0.2 --noise 0.002

OBSERVED is a film of `bake` (.npz), a bag with clouds (PointCloud2), or a folder of point files.
"""
DETAILS = """\
parameters:
  -p NAME               is fitted, within the range that objects have
  -p NAME:=[LOW,HIGH]   is fitted within bounds; by its logarithm if they are far apart
  -p NAME:=VALUE        is set, as for sim_node
  -p NAME.x             a component of a vector, such as ball.initial_velocity.linear.x
  -p time_offset        the time, s, that is added to those of the observation

A folder has .npy, .ply, or text files (.csv .txt .xyz) with x, y, z in metres. The time of a file,
s, is the last number in its name, with a decimal point, as in cloud_0.033.ply, or stands in
times.csv, with lines file,time. Times of a bag count from its first cloud.

Where a cloud has as many points as the body has vertices, each is compared with its vertex, else
with the surface. Clouds must be in the frame of the scene, without the background.

The result is OUTPUT.yaml, the scene with what was found, for --params-file, and OUTPUT.png. Runs
go to a process for each core, or with --scheduler to a cluster of Dask; the result is the same.
"""


def main(arguments: list[str] | None = None) -> int:
    """Fit as the command line says; return 0, 1 with one sentence, or 128 + signal."""
    return ended(parser(), arguments, _run, _explained)


def _explained(error: Exception) -> str:
    if isinstance(error, OSError):  # of a scheduler, or of files
        return str(error)
    return 'the observation does not fit into memory: take less of it, with --from and --to'


def parser() -> argparse.ArgumentParser:
    """Return the parser of the arguments."""
    result = make_parser('fit', DESCRIPTION, DETAILS)
    add = result.add_argument
    add('scene', metavar='SCENE.yaml', help='parameter file of sim_node')
    add('observed', metavar='OBSERVED', type=path_argument, help='film, bag or folder')
    add(
        '-p', '--param', metavar='NAME', action='append', default=[],
        help='what is fitted, or set; may be given several times',
    )  # fmt: skip
    add(
        '-o', '--output', metavar='FILE.yaml', type=path_argument,
        help='default: the name of the scene with _fit, here; the picture has the same name',
    )  # fmt: skip
    add('--topic', help='of the clouds of a bag, if it has several')
    add('--body', metavar='NAME', help='the only body that is compared (default: all)')
    add(
        '--correspondence', choices=('auto', 'yes', 'no'), default='auto',
        help='whether the points are the vertices, in order (default: if their number is that)',
    )  # fmt: skip
    add('--from', dest='begin', type=float, default=0.0, metavar='S', help='time in the scene, s')
    add('--to', dest='end', type=float, default=float('inf'), metavar='S', help='likewise')
    add(
        '--time-offset', type=float, default=0.0, metavar='S',
        help='is added to the times of the observation (default: 0)',
    )  # fmt: skip
    add(
        '--noise', type=_positive, metavar='M',
        help='standard deviation of points, m (default: 0.003, of vertices 0.001)',
    )  # fmt: skip
    add('--seed', type=_seed, default=0, help='of the search (default: 0)')
    add_cluster(result)
    return result


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < float('inf'):
        raise argparse.ArgumentTypeError(f'{text!r} must be a length above 0, in metres')
    return value


def _seed(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f'{text!r} must be a whole number from 0')
    return int(text)


def _run(options: argparse.Namespace) -> None:
    output = _output(options)
    require_packages('fit', PACKAGES, 'sweep')
    require_cluster(options)
    problem = _problem(options)
    from softbody_ros.core.warm_up import compile_ahead

    compile_ahead(_warn, _warn)
    signals = noted_signals()
    begin = time.perf_counter()
    solution = _search(problem, options, signals)
    from softbody_ros.ensemble.fit_estimates import judge
    from softbody_ros.ensemble.fit_report import summary, text_table

    verdict = judge(problem.unknowns, solution, problem.noise)
    _write(problem, verdict, output, options.observed)
    stop_after(signals)
    print(text_table(verdict))
    print(summary(problem, solution, verdict, time.perf_counter() - begin))
    for sentence in verdict.warnings:
        _warn(sentence)
    print(f'{output}, {output.with_suffix(".png")}')


def _output(options: argparse.Namespace) -> Path:
    output: Path = options.output or Path(f'{Path(options.scene).stem}_fit.yaml')
    if output.suffix not in ('.yaml', '.yml'):
        raise Refusal(f'the output {output} has an unknown suffix: end it with .yaml')
    for file in (output, output.with_suffix('.png')):
        require_writable(file)
    return output


def _problem(options: argparse.Namespace) -> Problem:
    from softbody_ros.ensemble.fit_parameters import OFFSET, make_unknown, separate
    from softbody_ros.ensemble.fit_targets import Choice, make_problem
    from softbody_ros.ensemble.observation_files import read_observation
    from softbody_ros.scene import parameters

    fitted, assigned = separate(options.param)
    if not fitted:
        hint = ', or with bounds, as -p ball.stiffness:=[0.1,0.9]' if assigned else ''
        raise Refusal(f'nothing is fitted: name parameters, such as -p ball.stiffness{hint}')
    if OFFSET in assigned:
        raise Refusal(f'{OFFSET} is fitted with -p {OFFSET}, and set with --time-offset')
    scene = scene_values('fit', 'fitted', options.scene) | assigned
    names = parameters.scene_lists(scene).bodies
    unknowns = [make_unknown(scene, name, bounds) for name, bounds in fitted.items()]
    choice = Choice(
        options.body,
        {'auto': None, 'yes': True, 'no': False}[options.correspondence],
        options.begin, options.end, options.time_offset, options.noise, options.seed,
    )  # fmt: skip
    observation = read_observation(options.observed, names, options.topic)
    return make_problem(scene, unknowns, observation, choice)


def _search(problem: Problem, options: argparse.Namespace, signals: list[int]) -> Solution:
    from tqdm import tqdm

    from softbody_ros.ensemble.cluster import cluster
    from softbody_ros.ensemble.fit_search import search

    with (
        cluster(options.scheduler, options.workers) as client,
        # disable=None: no bar unless on a terminal
        tqdm(unit='run', disable=None, leave=False, desc='fitting') as bar,
    ):
        evaluate = ClusterRuns(client, problem, bar, signals)
        return search(problem, evaluate, options.seed)


class ClusterRuns:
    """Runs on a cluster, called by the threads of a search; ends them after a signal."""

    def __init__(
        self,
        client: distributed.Client,
        problem: Problem,
        bar: tqdm,
        signals: Sequence[int] = (),
    ) -> None:
        from softbody_ros.ensemble.fit_problem import evaluate

        self._client = client
        self._evaluate = partial(evaluate, problem)
        self._bar = bar
        self._signals = signals
        self._lock = threading.Lock()

    def __call__(self, places: Sequence[np.ndarray]) -> list[Outcome]:
        """Return the outcomes at coordinates, in order."""
        import distributed

        # pure=False: no two runs are one, so that none waits for a thread that has been stopped
        futures = self._client.map(self._evaluate, list(places), pure=False)
        waiting = set(futures)
        while waiting:
            if self._signals:
                self._client.cancel(futures)
                stop_after(self._signals)
            try:
                done = distributed.wait(waiting, POLL, 'FIRST_COMPLETED').done
            except TimeoutError:
                continue
            waiting -= done
            with self._lock:
                self._bar.update(len(done))
        return [_outcome(future) for future in futures]


def _outcome(future: distributed.Future) -> Outcome:
    import distributed

    from softbody_ros.ensemble.fit_problem import Outcome

    try:
        return future.result()
    except distributed.KilledWorker:
        return Outcome(None, 'the run ended several workers, perhaps for lack of memory')


def _write(problem: Problem, verdict: Verdict, output: Path, observed: Path) -> None:
    from softbody_ros.ensemble.fit_report import picture, scene_text
    from softbody_ros.whole_file import whole_file

    text = scene_text(problem, verdict, str(observed))
    try:
        with whole_file(output) as scene:
            scene.write_text(text, encoding='utf-8')
        data = picture(problem, verdict)
        with whole_file(output.with_suffix('.png')) as drawing:
            drawing.write_bytes(data)
    except OSError as error:
        raise Refusal(f'the result cannot be written: {error.strerror or error}') from None


if __name__ == '__main__':
    sys.exit(main())
