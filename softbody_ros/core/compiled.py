# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
How loops over particles and contacts are compiled: the one place that knows the options.

Kernels are plain Python functions. Where numba is not installed, or with `NUMBA_DISABLE_JIT=1`,
they run as such, about 1000 times slower: for small scenes, for pdb and for tests. Both ways give
the same numbers as long as a kernel keeps to this:

* it divides by no zero, and takes no root of a negative number: compiled, that is inf or nan, as
  of NumPy's numbers; of Python's it is an exception;
* it raises nothing itself: it returns a status, and who calls it raises.

Machine code is kept in files, for the next start, under a digest of *all* that it follows from.
Numba by itself looks at the file of a kernel only: when a helper in another file has changed, it
would go on with the machine code of before.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
import gc
import hashlib
import os
from pathlib import Path
import pickle
import shutil
import sys
import tempfile
from typing import Any, TypeVar
import uuid

import numpy as np

OLDEST = (0, 61)
"""Of Numba: those before look up the types of a tuple of more than two arrays anew in each call,
which takes a tick of one body from 0.1 to 3 ms."""
try:
    import numba
    from numba.core import (
        caching,
        codegen,
        compiler,
        compiler_machinery,
        event,
        ir,
        serialize,
        typed_passes,
    )
    from numba.core.registry import cpu_target

    if numba.version_info.short < OLDEST:
        oldest = '.'.join(map(str, OLDEST))
        raise ImportError(f'it is {numba.__version__} and must be at least {oldest}')
except Exception as error:
    # ImportError: not installed, or NumPy is newer than it knows; OSError: LLVM cannot be loaded.
    # Either way simulations run, and `notice` says why they are slow: a library must not end a
    # program, and what was installed by others is often not the user's to repair at once
    numba, _refusal = None, error

_NullCache: Any = object if numba is None else caching.NullCache
_Library: Any = object if numba is None else codegen.JITCodeLibrary
_Compiler: Any = object if numba is None else compiler.Compiler
_Pass: Any = object if numba is None else compiler_machinery.AnalysisPass
Function = TypeVar('Function', bound=Callable[..., Any])

OPTIONS = {'error_model': 'numpy', 'nogil': True, 'fastmath': False, 'no_cfunc_wrapper': True}
"""Strict sums: the bits depend neither on the number of threads nor on the processor."""
HELPER_OPTIONS = OPTIONS | {'no_cpython_wrapper': True}
"""What only kernels call can do without what Python calls: that saves a third of the time."""
BORROWING = frozenset(
    ('getattr', 'static_getitem', 'build_tuple', 'exhaust_iter', 'cast', 'phi', 'getiter',
     'iternext', 'pair_first', 'pair_second')
)  # fmt: skip
"""Expressions of Numba's that are a part of an array or tuple, if anything."""
FLAGS = (
    'OPT',
    'LOOP_VECTORIZE',
    'SLP_VECTORIZE',
    'DISABLE_INTEL_SVML',
    'BOUNDSCHECK',
    'DEBUGINFO_DEFAULT',
)
"""Of Numba's environment variables those that change the machine code and not its address."""
SOURCES = Path(__file__).parent
"""Kernels may use whatever lies in this folder; of kernels elsewhere nothing is kept."""
FAMILY = f'kernels-{sys.implementation.cache_tag}-'
"""How the name of a folder of the cache begins; a digest follows."""
GARBAGE = 50_000
"""Objects after which Python looks for garbage while it compiles: often is a tenth of the time."""
KEPT = 4
"""Of other versions' caches: another environment may use them, or one return to a version."""
CHECKSUM = hashlib.sha256().digest_size

kernels: dict[str, Any] = {}
"""What `kernel` has made, by the qualified name."""
helpers: dict[str, Any] = {}
"""What `helper` has made, by the qualified name."""
_not_kept: list[str] = []


# -------------------------------------------------------------------------------------- decorators
def kernel(function: Function) -> Function:
    """Compile a function of plain loops that Python calls; its machine code is cached."""
    made: Any = function
    if numba is not None:
        made = numba.njit(**OPTIONS)(function)
        if is_compiled() and _follows_from_sources(function):
            made._cache = _Cache(function)
    kernels[_name(function)] = made
    return made


def helper(function: Function) -> Function:
    """Compile a function that only kernels call: it becomes a part of them."""
    made: Any = function
    if numba is not None:
        made = numba.njit(pipeline_class=_HelperCompiler, **HELPER_OPTIONS)(function)
        if is_compiled():
            made.get_call_template = _without_literals(made.get_call_template)
    helpers[_name(function)] = made
    return made


class _HelperCompiler(_Compiler):
    """Compiles a helper, up to what becomes a part of kernels."""

    def __init__(self, typing: Any, target: Any, library: Any, *others: Any) -> None:
        super().__init__(typing, target, library or _Part(target.codegen(), 'helper'), *others)

    def define_pipelines(self) -> Any:
        """Return how a helper is compiled: as usual, but for the counting of references."""
        (steps,) = super().define_pipelines()
        steps.add_pass_after(_Borrow, typed_passes.IRLegalization)
        steps.finalize()
        return [steps]


class _Borrow(_Pass):
    """
    Lets a helper that neither makes nor returns arrays use those of its caller without counting.

    Numba counts the references to each array that a function is given, and to each one of a tuple
    of arrays, by atomic operations of the processor. Those were a tenth of a tick. The caller
    keeps its arrays as long as the helper runs.
    """

    _name = 'borrow'

    def __init__(self) -> None:
        pass  # abstract in Numba

    def run_pass(self, state: Any) -> bool:
        """Compile what follows without counting if it may be so."""
        if not _owns_arrays(state):
            state.targetctx = state.targetctx.subtarget(enable_nrt=False)
        return False


if numba is not None:
    compiler_machinery.register_pass(mutates_CFG=False, analysis_only=True)(_Borrow)


def _owns_arrays(state: Any) -> bool:
    """Return whether a function of known types makes, gets or returns references of its own."""

    def is_counted(kind: Any) -> bool:
        return bool(state.targetctx.data_model_manager[kind].contains_nrt_meminfo())

    def borrows(value: Any) -> bool:
        if not isinstance(value, ir.Expr):
            return True  # an argument, or another name
        if value.op == 'getitem':
            return not is_counted(state.typemap[value.index.name])
        if value.op != 'call':
            return value.op in BORROWING
        function = state.typemap[value.func.name]
        if isinstance(function, numba.types.BoundFunction):
            return bool(function.typing_key == 'array.view')
        return isinstance(function, numba.types.NamedTupleClass)

    return is_counted(state.return_type) or any(
        is_counted(state.typemap[assignment.target.name]) and not borrows(assignment.value)
        for block in state.func_ir.blocks.values()
        for assignment in block.find_insts(ir.Assign)
    )


class _Part(_Library):
    """
    The code of a helper and of what it calls, not made machine code.

    That happens in the kernels of which it becomes a part. Numba would do it at each level of
    calls, with all below: a fifth of the time, for machine code that nobody calls.
    """

    def _finalize_final_module(self) -> None:
        self._finalized = True

    @property
    def codegen(self) -> Any:
        """What is told the address of the function's environment: there is no machine code."""
        return self

    def set_env(self, name: str, environment: Any) -> None:
        """Do nothing, see `codegen`."""


def _without_literals(resolve: Callable[..., Any]) -> Callable[..., Any]:
    """
    Return what finds the types of a call, as if no integer were a literal.

    Numba would compile f(x, 0), f(x, 1) and f(x, i) one after the other. LLVM knows the values all
    the same where it inlines them.
    """

    def widened(kind: Any) -> Any:
        if isinstance(kind, numba.types.IntegerLiteral):
            return numba.types.unliteral(kind)
        return kind

    def resolve_call(args: Iterable[Any], kws: dict[str, Any]) -> Any:
        by_name = {name: widened(kind) for name, kind in kws.items()}
        return resolve(tuple(map(widened, args)), by_name)

    return resolve_call


def _name(function: Callable[..., Any]) -> str:
    return f'{function.__module__}.{function.__qualname__}'


def is_compiled() -> bool:
    """Return whether kernels are machine code, instead of plain Python."""
    return numba is not None and not numba.config.DISABLE_JIT


def notice() -> str:
    """Return one sentence for who starts a simulation: why it, or the start, is slow; or ''."""
    slow = 'bodies are simulated by plain Python, about 1000 times slower'
    if numba is None:
        if isinstance(_refusal, ModuleNotFoundError) and _refusal.name == 'numba':
            return f'numba is not installed: {slow}; pip install numba'
        reason = ' '.join(str(_refusal).split()).rstrip('.')
        return f'numba cannot be loaded ({reason}): {slow}; pip install --upgrade numba'
    if not is_compiled():
        return f'NUMBA_DISABLE_JIT is set: {slow}'
    if _not_kept:
        return (
            f'the compiled simulator cannot be kept ({_not_kept[0]}): it is compiled anew at each '
            'start; let NUMBA_CACHE_DIR be a folder that can be written to'
        )
    return ''


@contextmanager
def compilations(note: Callable[[float], None]) -> Iterator[None]:
    """
    Call `note` some thousand times while kernels are compiled, with the share that is done.

    That is the share of kernels and helpers, or of kernels that are in the cache if that is more:
    another process may compile as well. A KeyboardInterrupt of `note` ends the compilation.
    """
    seen: set[str] = set()
    names = kernels.keys() | helpers.keys()
    share = 0.0

    class Listener(event.Listener):
        def on_start(self, step: Any) -> None:
            nonlocal share
            name = f'{step.data["module"]}.{step.data["qualname"]}'
            if name in names and name not in seen:
                seen.add(name)
                share = max(len(seen) / len(names), min(_kept_count() / len(kernels), 1.0))
            note(share)

        def on_end(self, step: Any) -> None:
            pass

    # compiling leaves much garbage in cycles, but for memory it may wait
    thresholds = gc.get_threshold()
    gc.set_threshold(GARBAGE, *thresholds[1:])
    try:
        with event.install_listener('numba:run_pass', Listener()):
            yield
    finally:
        gc.set_threshold(*thresholds)


def _kept_count() -> int:
    folder = cache_folder()
    return len(list(folder.glob('*.nbc'))) if folder else 0


# ------------------------------------------------------------------------------------------- cache
class _Cache(_NullCache):
    """
    The machine code of one kernel: a file for each signature and processor.

    In place of Numba's own, which besides has an index: of two processes that write at a time, it
    may be left with the entry of the one for the machine code of the other.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self._start = f'{_name(function)}-{function.__code__.co_firstlineno}'

    @property
    def cache_path(self) -> str:
        """The folder, for Numba's statistics."""
        return str(cache_folder() or '')

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """Return what has been compiled for a signature, None if nothing has."""
        target_context.refresh()
        path = self._path(signature)
        if path is None:
            return None
        try:
            content = path.read_bytes()
            checksum, content = content[:CHECKSUM], content[CHECKSUM:]
            if hashlib.sha256(content).digest() != checksum:
                return None  # what a power cut has left must not run
            return compiler.CompileResult._rebuild(target_context, *pickle.loads(content))
        except Exception:
            return None  # whatever it is, compiling helps

    def save_overload(self, signature: Any, result: Any) -> None:
        """Keep what has been compiled; where that cannot be, `notice` says so."""
        path = self._path(signature)
        # an address within this process means nothing to the next one
        if path is None or result.library.has_dynamic_globals:
            return
        try:
            content = serialize.dumps(result._reduce())
        except Exception as error:  # a Numba that has changed these
            _not_kept.append(f'{type(error).__name__}: {error}')
            return
        _write(path, hashlib.sha256(content).digest() + content)

    def _path(self, signature: Any) -> Path | None:
        folder = cache_folder()
        key = hashlib.sha256(repr((signature, _processor())).encode()).hexdigest()
        return folder and folder / f'{self._start}-{key[:16]}.nbc'


@cache
def cache_folder() -> Path | None:
    """
    Return the folder for machine code that follows from these sources; None if it can be nowhere.

    Below NUMBA_CACHE_DIR, beside the sources, or among the user's caches, in the order of Numba.
    """
    given = numba.config.CACHE_DIR
    user = os.environ.get('XDG_CACHE_HOME') or os.path.expanduser('~/.cache')
    places = [Path(given).absolute()] if given else []
    places.append(SOURCES / '__pycache__')
    if os.path.isabs(user):  # expanduser leaves the ~ of somebody without a home
        places.append(Path(user) / 'softbody_ros')
    for place in places:
        folder = place / (FAMILY + digest()[:16])
        try:
            if _marker(folder).is_file():
                return folder  # complete: who has installed it may be the only one who writes
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
        except OSError:
            continue
        return folder
    _not_kept.append(f'nowhere in {", ".join(map(str, places))}')
    return None


@cache
def digest() -> str:
    """Return a digest of all that machine code follows from, except for the processor."""
    total = hashlib.sha256()
    for path in sorted(SOURCES.rglob('*.py')):
        content = path.read_bytes()
        total.update(f'{path.relative_to(SOURCES)} {len(content)} '.encode() + content)
    flags = [getattr(numba.config, flag, None) for flag in FLAGS]
    versions = [numba.__version__, np.__version__, sys.version]
    total.update(repr([OPTIONS, HELPER_OPTIONS, flags, versions]).encode())
    return total.hexdigest()


def _follows_from_sources(function: Callable[..., Any]) -> bool:
    """Return whether the digest knows all that a kernel consists of."""
    path = Path(function.__code__.co_filename)
    return path.is_file() and path.is_relative_to(SOURCES) and function.__closure__ is None


def _processor() -> tuple[str, ...]:
    return cpu_target.target_context.codegen().magic_tuple()


def _write(path: Path, content: bytes) -> None:
    """Write a file that others see whole or not at all; where that cannot be, note it."""
    unfinished = path.with_name(f'{path.name}.{uuid.uuid4().hex[:8]}')
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        unfinished.write_bytes(content)
        unfinished.replace(path)
    except OSError as error:
        _not_kept.append(f'{error.strerror} in {path.parent}')
        with suppress(OSError):
            unfinished.unlink()


# ------------------------------------------------------------------------------ what is left to do
def _marker(folder: Path) -> Path:
    key = hashlib.sha256(repr(_processor()).encode()).hexdigest()
    return folder / f'complete-{key[:16]}'


def is_complete() -> bool:
    """Return whether `mark_complete` was called, by any process: nothing is left to compile."""
    folder = cache_folder()
    return folder is not None and _marker(folder).is_file()


def mark_complete() -> None:
    """Tell later processes that all is in the cache, and remove caches of old versions."""
    folder = cache_folder()
    if folder is None or _not_kept:
        return
    _write(_marker(folder), b'')
    with suppress(OSError):  # another process may tidy up as well
        others = [path for path in folder.parent.glob(FAMILY + '*') if path != folder]
        for old in sorted(others, key=lambda path: path.stat().st_mtime)[:-KEPT]:
            shutil.rmtree(old)
