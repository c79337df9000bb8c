# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What the commands without ROS share: `bake`, `sweep`, `fit`.

The `main` of each is one call of `ended`, with its parser and the function that does its work.
That raises `Refusal` where it cannot, warns by `say`, and ends by `stop_after` when a signal has
been noted. What is slow it imports itself, so that `--help` is immediate.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
import importlib.util
import os
from pathlib import Path
import signal
import sys
from typing import Any

from softbody_ros.startup import without_garbage_collection

MOST_WORKERS = 1024


class Refusal(Exception):  # noqa: N818
    """A request that cannot be fulfilled; with the reason in one sentence."""


# -------------------------------------------------------------------------------------- the course
def ended(
    parser: argparse.ArgumentParser,
    arguments: Sequence[str] | None,
    run: Callable[[argparse.Namespace], None],
    explain: Callable[[Exception], str],
) -> int:
    """
    Run a command to its end, and return its exit status.

    That is 0, or 1 after one sentence on standard error. `stop_after` ends it otherwise, with 128
    and the number of the signal.

    Parameters
    ----------
    parser : ArgumentParser
    arguments : sequence of str or None
        None: those of the process
    run : callable
        does what the options say
    explain : callable
        returns a sentence for an OSError or a MemoryError

    """
    # nothing is written yet: a signal may end the process at once, without a traceback
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    options = parser.parse_args(arguments)
    with without_garbage_collection():
        from softbody_ros.core import ConfigError, MeshError, SimulationError

    try:
        run(options)
        return 0
    except (Refusal, ConfigError, MeshError, SimulationError) as error:
        reason = str(error)
    except (OSError, MemoryError) as error:
        reason = explain(error)
    say(parser.prog, reason)
    return 1


def say(command: str, sentence: str) -> None:
    """Print a sentence on standard error, after the name of the command."""
    print(f'{command}:', sentence, file=sys.stderr)


def stop_after(signals: Sequence[int]) -> None:
    """End the program if there was a signal; `signals` is a list of `noted_signals`."""
    if signals:
        raise SystemExit(128 + signals[0])


# --------------------------------------------------------------------------------------- arguments
def make_parser(command: str, description: str, details: str) -> argparse.ArgumentParser:
    """Return a parser with texts that are printed as they are."""
    return argparse.ArgumentParser(
        prog=command,
        description=description,
        epilog=details,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )


def add_cluster(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that say where runs are made; see `require_cluster`."""
    parser.add_argument(
        '--workers', metavar='N', type=int,
        help='processes on this machine (default: one for each core)',
    )  # fmt: skip
    parser.add_argument(
        '--scheduler', metavar='ADDRESS',
        help='of a Dask cluster that makes the runs, such as tcp://10.0.0.1:8786',
    )  # fmt: skip


def require_cluster(options: argparse.Namespace) -> None:
    """Raise Refusal if the arguments of `add_cluster` cannot be used."""
    if options.workers is not None and options.scheduler is not None:
        raise Refusal('--workers is of this machine: leave it out beside --scheduler')
    if options.workers is not None and not 1 <= options.workers <= MOST_WORKERS:
        raise Refusal(
            f'--workers is {options.workers}: it must be at least 1 and at most {MOST_WORKERS}'
        )


def path_argument(text: str) -> Path:
    """Return the path of an argument; shells do not expand the ~ of --output=~/film.usdc."""
    return Path(os.path.expanduser(text))


# ------------------------------------------------------------------------------ what it works with
def scene_values(
    command: str, done: str, path: str, assignments: Sequence[str] = ()
) -> dict[str, Any]:
    """
    Return the parameter values of a scene; what is to be known about it is said.

    Parameters
    ----------
    command, done : str
        its name, and what it does with a scene, as a participle
    path : str
        of the parameter file
    assignments : sequence of str
        each `name:=value`, see `scene_file.read_scene`

    Raises
    ------
    ConfigError
        with one sentence.

    """
    from softbody_ros.scene import parameters
    from softbody_ros.scene.scene_file import NODE, SceneFile

    file = SceneFile.read(path)
    if not file.values():
        say(command, f'scene {path} has no parameters for {NODE}: the default scene is {done}')
    values, unknown = parameters.known_values(file.values(assignments))
    for name, hint in unknown.items():
        say(command, f'parameter {name} is unknown and ignored: {hint}')
    return values


def require_packages(what: str, packages: Mapping[str, str], extra: str, else_: str = '') -> None:
    """
    Raise Refusal if an optional package is missing.

    Parameters
    ----------
    what : str
        needs them
    packages : mapping of str to str
        the package to install, by the module that is imported
    extra : str
        of this package, which includes them
    else_ : str
        what else one can do

    """
    missing = [
        package for module, package in packages.items() if importlib.util.find_spec(module) is None
    ]
    if missing:
        is_not = 'which is' if len(missing) == 1 else 'which are'
        raise Refusal(
            f'{what} needs {" and ".join(missing)}, {is_not} not installed: pip install '
            f"{' '.join(missing)} (or, in the clone, '.[{extra}]'){else_}"
        )


def require_writable(output: Path) -> None:
    """Raise Refusal if no file of this name can be written."""
    if output.is_dir():
        raise Refusal(f'the output {output} is a folder: give the name of a file')
    if not output.parent.is_dir():
        raise Refusal(f'the folder of the output {output} does not exist: create {output.parent}')
    if not os.access(output.parent, os.W_OK):
        raise Refusal(f'the folder of the output {output} cannot be written to')
