# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command `bake`, also `python3 -m softbody_ros.bake`: a scene as a film in files."""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from functools import partial
import importlib
import importlib.util
from pathlib import Path
import sys
import time
from typing import TYPE_CHECKING, Any

from softbody_ros.ensemble.offline_command import (
    Refusal,
    ended,
    make_parser,
    path_argument,
    require_packages,
    require_writable,
    say,
    scene_values,
    stop_after,
)
from softbody_ros.signals import noted_signals

if TYPE_CHECKING:
    from softbody_ros.bake.writing import Writer
    from softbody_ros.ensemble.film import Film

USD = ('softbody_ros.bake.usd', 'UsdWriter', 'pxr', 'usd-core')
GLTF = ('softbody_ros.bake.gltf', 'GltfWriter', 'pygltflib', 'pygltflib')
NPZ = ('softbody_ros.bake.npz', 'NpzWriter', 'numpy', 'numpy')
FORMATS = {'.usdc': USD, '.usda': USD, '.usd': USD, '.glb': GLTF, '.npz': NPZ}
"""By suffix: module, writer, the module that it requires, and the package of that."""
LARGE_GLB = 100e6
_warn = partial(say, 'bake')

DESCRIPTION = """\
Simulates a scene offline, as fast as it goes, and writes it as a film:

  bake contact.yaml --seconds 5 --fps 60 --output contact.usdc
  bake contact.yaml -p plum.stiffness:=0.05 -o soft.usdc -o soft.npz

The scene is a parameter file of sim_node; `ros2 param dump /softbody_sim` makes one of what runs.
"""
DETAILS = """\
output:
  .usdc .usda .usd  USD for Maya, Blender, Houdini, Omniverse, usdview: z up, metres
  .glb              glTF for the web, a morph target for each frame: y up, metres
  .npz              NumPy, to the last bit of the simulation
USD needs usd-core, glTF pygltflib: in the clone, pip install '.[bake]' gets both

Frame k shows the tick of the scene (time_step) that is nearest to the time k / fps. Nothing is
interpolated: where the ticks do not divide a frame, it is up to half a tick early or late. Time
is simulated time; time_scale and the rates of topics mean nothing here.

Of a binary USD file only the newest frames are in memory; of .npz all of them, 24 bytes for each
vertex and frame, of .glb about 100, of .usda 30. A file of the same name is replaced when the new
one is whole; after Ctrl-C it is as it was.
"""


def main(arguments: list[str] | None = None) -> int:
    """Bake as the command line says; return 0, 1 with one sentence, or 128 + signal."""
    return ended(parser(), arguments, _run, _explained)


def _explained(error: Exception) -> str:
    if isinstance(error, OSError):
        return f'the film cannot be written: {error.strerror or error}'
    return 'the film does not fit into memory: take fewer frames or coarser meshes'


def parser() -> argparse.ArgumentParser:
    """Return the parser of the arguments."""
    result = make_parser('bake', DESCRIPTION, DETAILS)
    result.add_argument('scene', metavar='SCENE.yaml', help='parameter file of sim_node')
    result.add_argument(
        '--seconds', type=float, default=5.0, help='length in simulated time (default: 5)'
    )
    result.add_argument(
        '--fps', type=float, default=60.0, help='frames a simulated second (default: 60)'
    )
    result.add_argument(
        '-o', '--output', metavar='FILE', action='append', type=path_argument, default=[],
        help='may be given several times (default: the name of the scene, here, as .usdc if '
        'usd-core is installed, else as .npz)',
    )  # fmt: skip
    result.add_argument(
        '-p', '--param', metavar='NAME:=VALUE', action='append', default=[],
        help='another value of a parameter, as for sim_node; may be given several times',
    )  # fmt: skip
    return result


def _run(options: argparse.Namespace) -> None:
    from softbody_ros.core.warm_up import compile_ahead
    from softbody_ros.ensemble.running import run

    values = scene_values('bake', 'baked', options.scene, options.param)
    outputs = options.output or [_default_output(options.scene)]
    writers = [_writer(path) for path in outputs]
    places = [path.resolve() for path in outputs]
    for path, place in zip(outputs, places, strict=True):
        if places.count(place) > 1:
            raise Refusal(f'the output {path} is given twice: give each file its own name')
    film = run(values, {}, options.seconds, options.fps)
    for sentence in film.world.notes:
        _warn(sentence)
    for path in outputs:
        _warn_if_large(path, film)
    compile_ahead(_warn, _warn)
    signals = noted_signals()
    begin = time.perf_counter()
    _write(film, writers, outputs, signals)
    _report(film, outputs, time.perf_counter() - begin)


def _default_output(scene: str) -> Path:
    has_usd = importlib.util.find_spec('pxr') is not None
    return Path(Path(scene).stem + ('.usdc' if has_usd else '.npz'))


def _writer(path: Path) -> Any:
    """Return the writer class for the suffix of a file."""
    if path.suffix not in FORMATS:
        raise Refusal(
            f'the output {path} has an unknown suffix: end it with one of {", ".join(FORMATS)}'
        )
    require_writable(path)
    module, writer, needed, package = FORMATS[path.suffix]
    require_packages(path.suffix, {needed: package}, 'bake', ', or bake an .npz')
    return getattr(importlib.import_module(module), writer)


def _warn_if_large(path: Path, film: Film) -> None:
    if path.suffix != '.glb':
        return
    from softbody_ros.bake.gltf import size

    expected = size(film)
    if expected > LARGE_GLB:
        _warn(
            f'{path} will have {expected / 1e6:.0f} MB, which viewers load slowly: take fewer '
            'frames, or .usdc'
        )


def _write(film: Film, kinds: list[Any], outputs: list[Path], signals: list[int]) -> None:
    from tqdm import tqdm

    from softbody_ros.whole_file import whole_file

    with ExitStack() as stack:
        writers: list[Writer] = [
            kind(stack.enter_context(whole_file(path)), film)
            for kind, path in zip(kinds, outputs, strict=True)
        ]
        # disable=None: no bar unless on a terminal
        for frame in tqdm(
            film.frames(), total=len(film.times), unit='frame', disable=None, leave=False
        ):
            for writer in writers:
                writer.add(frame)
            stop_after(signals)
        for writer in writers:
            writer.finish()
            stop_after(signals)


def _report(film: Film, outputs: list[Path], took: float) -> None:
    count = len(film.times)
    what = f'{count} frame{"s" if count > 1 else ""}, {film.seconds:g} s at {film.fps:g} fps'
    for path in outputs:
        print(f'{path}: {what}, {path.stat().st_size / 1e6:.1f} MB')
    print(f'baked in {took:.1f} s, {film.seconds / took:.1f} × real time')


if __name__ == '__main__':
    sys.exit(main())
