# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command `sweep`, also `python3 -m softbody_ros.ensemble.sweep`: a scene, many times."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from functools import partial
import os
from pathlib import Path
import sys
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
    say,
    stop_after,
)
from softbody_ros.signals import noted_signals

if TYPE_CHECKING:
    from softbody_ros.ensemble.mesh_transfer import Meshes
    from softbody_ros.ensemble.spec import Spec
    from softbody_ros.ensemble.store import Store
    from softbody_ros.ensemble.work import Order

PACKAGES = {name: name for name in ('dask', 'distributed', 'zarr')}
_warn = partial(say, 'sweep')
DESCRIPTION = """\
Simulates a scene many times, with other parameter values each time, on all cores or on a cluster:

  sweep bounce.yaml -o bounce
  sweep bounce.yaml -o bounce --scheduler tcp://10.0.0.1:8786
"""
DETAILS = """\
SPEC.yaml says what varies:

  scene: ball.yaml            # a parameter file of sim_node, beside this one
  seconds: 2                  # of each run; also fps, by default 60
  count: 10                   # draws for each point of the grids; also seed, by default 0
  vary:
    ball.stiffness: [0.1, 0.3, 1]
    ball.bounciness: {from: 0, to: 1, steps: 5}
    ball.mass: {log_uniform: [0.1, 10]}
  plot: ball.highest_rebound

The folder gets runs.zarr, with a group for each run, and index.csv, a table of parameters and
outcomes. The same command again does only what is missing: after Ctrl-C, a full disk, a crash, or
with a larger count. The runs have the same bits whatever makes them.
"""


def main(arguments: list[str] | None = None) -> int:
    """Sweep as the command line says; return 0, 1 with one sentence, or 128 + signal."""
    return ended(parser(), arguments, _run, _explained)


def _explained(error: Exception) -> str:
    if isinstance(error, ConnectionError):
        return f'{error}; the same command again goes on'
    reason = 'it does not fit into memory'
    if isinstance(error, OSError):
        reason = f'the store cannot be written: {error.strerror or error}'
    return f'{reason}; it is as far as it got, and the same command again goes on'


def parser() -> argparse.ArgumentParser:
    """Return the parser of the arguments."""
    result = make_parser('sweep', DESCRIPTION, DETAILS)
    result.add_argument('spec', metavar='SPEC.yaml', help='what is to be done')
    result.add_argument(
        '-o', '--output', metavar='DIR', type=path_argument,
        help='folder of the runs (default: the name of the spec, here)',
    )  # fmt: skip
    add_cluster(result)
    result.add_argument(
        '--dry-run', action='store_true',
        help='make one run, and say how long all take and how large they are',
    )  # fmt: skip
    result.add_argument(
        '--retry', action='store_true', help='do again what failed, not only what is missing'
    )
    result.add_argument(
        '--plot', metavar='OUTCOME',
        help='draw a column of index.csv over the one or two parameters that vary, as '
        'DIR/OUTCOME.png',
    )  # fmt: skip
    return result


def _run(options: argparse.Namespace) -> None:
    require_packages('sweep', PACKAGES, 'sweep')
    from softbody_ros.core.warm_up import compile_ahead
    from softbody_ros.ensemble.outcomes import names_of
    from softbody_ros.ensemble.spec import read_spec
    from softbody_ros.ensemble.store import Store, require_free

    require_cluster(options)
    spec = read_spec(options.spec)
    for name, hint in spec.unknown.items():
        _warn(f'parameter {name} of the scene is unknown and ignored: {hint}')
    outcome = _outcome(options.plot or spec.plot, spec)
    output = options.output or Path(Path(options.spec).stem)
    described, meshes = _described(spec)
    require_free(output, described)
    compile_ahead(_warn, _warn)
    if options.dry_run:
        _dry_run(options, spec, meshes, output)
        return
    stop_if_asked = partial(stop_after, noted_signals())
    with Store(output, described, names_of(spec.bodies)) as store:
        try:
            made, took = _sweep(options, spec, meshes, store, stop_if_asked)
        except BaseException:
            with suppress(OSError):  # a full disk: the older index stays
                store.write_index()
            raise
        store.write_index()
        if outcome:
            from softbody_ros.ensemble.plot import draw_plot

            draw_plot(store.rows.values(), outcome, spec, output / f'{outcome}.png')
        _report(store, output, made, took)


def _outcome(asked: str, spec: Spec) -> str:
    """Return the full name of what is to be plotted, '' for nothing."""
    if not asked:
        return ''
    require_packages('a plot', {'matplotlib': 'matplotlib'}, 'sweep')
    from softbody_ros.ensemble.plot import axes_of, full_name

    axes_of(spec)
    return full_name(asked, spec)


def _described(spec: Spec) -> tuple[dict, Meshes]:
    """Return what decides on the runs, as JSON, and the mesh files among it."""
    from softbody_ros.ensemble.mesh_transfer import read_meshes
    from softbody_ros.ensemble.variation import Grid

    values = list(spec.scene.items())
    for each in spec.variations:
        listed = each.values if isinstance(each, Grid) else each.numbers
        values += [(each.name, value) for value in listed]
    meshes = read_meshes(values)
    return spec.described | {'meshes': meshes.names}, meshes


def _sweep(
    options: argparse.Namespace,
    spec: Spec,
    meshes: Meshes,
    store: Store,
    stop_if_asked: Callable[[], None],
) -> tuple[int, float]:
    """Make the runs that are missing; return how many these were, and the time it took, s."""
    from tqdm import tqdm

    from softbody_ros.ensemble.cluster import cluster
    from softbody_ros.ensemble.dispatch import completed

    kept = {run for run, row in store.rows.items() if row['status'] == 'done' or not options.retry}
    todo = [run for run in range(len(spec)) if run not in kept]
    if todo:
        with cluster(options.scheduler, options.workers) as client:
            begin = time.perf_counter()
            orders = _orders(spec, meshes, todo)
            with closing(completed(client, orders, meshes, stop_if_asked)) as runs:
                # disable=None: no bar unless on a terminal
                for order, files in tqdm(
                    runs, total=len(todo), unit='run', disable=None, leave=False, smoothing=0.1
                ):
                    store.add(order.number, files)
            took = time.perf_counter() - begin
        return len(todo), took
    return 0, 0.0


def _orders(spec: Spec, meshes: Meshes, runs: list[int]) -> Iterator[Order]:
    from softbody_ros.ensemble.work import Order

    for number in runs:
        yield Order(
            number, spec.scene, spec.values(number), spec.seconds, spec.fps, meshes.names,
            meshes.key,
        )  # fmt: skip


def _dry_run(options: argparse.Namespace, spec: Spec, meshes: Meshes, output: Path) -> None:
    from softbody_ros.ensemble.cluster import cluster
    from softbody_ros.ensemble.dispatch import threads
    from softbody_ros.ensemble.store import attributes_of, stored
    from softbody_ros.ensemble.work import files_of

    cores = options.workers or len(os.sched_getaffinity(0))
    if options.scheduler is not None:
        with cluster(options.scheduler) as client:
            cores = max(threads(client), 1)
    [order] = _orders(spec, meshes, [0])
    files_of(order, {})  # the first one has to load machine code
    begin = time.perf_counter()
    files = files_of(order, {})
    took, size = time.perf_counter() - begin, sum(map(len, files.values()))
    if attributes_of(files)['status'] == 'failed':
        raise Refusal(f'the first run fails: {attributes_of(files)["error"]}')
    left = len(set(range(len(spec))) - set(stored(output)))
    print(f'{len(spec)} runs, of which {len(spec) - left} are done')
    print(f'one takes {took:.2f} s and {_size(size)}')
    on = f'{cores} core{"s" if cores > 1 else ""}'
    print(f'{left} take about {_duration(left * took / cores)} on {on}, and {_size(left * size)}')


def _report(store: Store, output: Path, made: int, took: float) -> None:
    failures = [(run, row) for run, row in sorted(store.rows.items()) if row['status'] != 'done']
    if failures:
        run, row = failures[0]
        which = (
            f'run {run}' if len(failures) == 1 else f'{len(failures)} runs, the first is {run},'
        )
        _warn(f'{which} failed: {row["error"]}')
    print(f'{output}: {len(store.rows)} runs, {len(failures)} failed')
    if made:
        print(f'{made} made in {_duration(took)}, {60.0 * made / took:.0f} in a minute')


def _size(count: float) -> str:
    for unit in ('kB', 'MB', 'GB', 'TB'):
        count /= 1000.0
        if count < 1000.0 or unit == 'TB':
            break
    return f'{count:.3g} {unit}'


def _duration(seconds: float) -> str:
    if seconds < 60.0:
        return f'{seconds:.1f} s'
    minutes = round(seconds / 60.0)
    hours, minutes = divmod(minutes, 60)
    return f'{hours} h {minutes} min' if hours else f'{minutes} min'


if __name__ == '__main__':
    sys.exit(main())
