# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Four particles at a time: lanes are used like a number, and are a vector in a register.

A compiler must not reorder a sum of floats, so that a plain loop waits for each addition to end
before the next one. A sum of lanes is four sums side by side, added up at the end: as fast as the
processor adds vectors, and with the same bits on each of them and in plain Python.
"""

from __future__ import annotations

import operator
from typing import Any, TypeAlias

import numpy as np

from softbody_ros.core.compiled import helper, is_compiled
from softbody_ros.core.geometry.vectors import Vector

Lanes: TypeAlias = float
"""A number to type checkers, so that functions of vectors of numbers take vectors of lanes."""
LANES = 4
"""A register of AVX2, which has 16: enough for the sums over a tile."""
LaneVector: TypeAlias = Vector
"""The vectors of four particles."""
OPERATORS = {operator.add: 'fadd', operator.sub: 'fsub', operator.mul: 'fmul'}
"""And the instructions of LLVM for them; one operand may be a float."""

if is_compiled():
    from llvmlite import ir
    from numba.core import types
    from numba.core.cgutils import get_or_insert_function
    from numba.core.typing import templates
    from numba.extending import intrinsic, lower_builtin, models, register_model

    DOUBLES, INT32 = ir.VectorType(ir.DoubleType(), LANES), ir.IntType(32)
    INTEGERS, BITS = (ir.VectorType(ir.IntType(bits), LANES) for bits in (64, 1))
    MANGLED = f'v{LANES}f64.p0v{LANES}f64'
    """For LLVM 14; later ones drop what is after p0."""
    ALIGNMENT = ir.Constant(INT32, 8)
    """Of lanes in a row, in bytes."""

    class LanesType(types.Type):
        """What Numba knows of lanes."""

    lanes_type = LanesType('Lanes')

    @register_model(LanesType)
    class _Model(models.PrimitiveModel):
        def __init__(self, manager: Any, kind: Any) -> None:
            super().__init__(manager, kind, DOUBLES)

    def _define(what: Any, instruction: str) -> None:
        operands = [(lanes_type,) * 2, (lanes_type, types.float64), (types.float64, lanes_type)]

        class Template(templates.AbstractTemplate):
            def generic(self, args: Any, kws: Any) -> Any:
                return templates.signature(lanes_type, *args) if args in operands else None

        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            lanes = [
                value if kind == lanes_type else _repeated(builder, value, DOUBLES)
                for value, kind in zip(args, signature.args, strict=True)
            ]
            return getattr(builder, instruction)(*lanes)

        templates.infer_global(what)(Template)
        for pair in operands:
            lower_builtin(what, *pair)(generate)

    for _operator, _instruction in OPERATORS.items():
        _define(_operator, _instruction)

    def _repeated(builder: Any, value: Any, kind: Any) -> Any:
        result = ir.Constant(kind, ir.Undefined)
        for k in range(LANES):
            result = builder.insert_element(result, value, ir.Constant(INT32, k))
        return result

    def _pointer(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        field = signature.args[0]
        assert (field.layout, field.dtype) == ('C', types.float64), field
        data = context.make_array(field)(context, builder, args[0]).data
        return builder.bitcast(builder.gep(data, [args[1]]), DOUBLES.as_pointer())

    def _mask(builder: Any, count: Any) -> Any:
        numbers = ir.Constant(INTEGERS, list(range(LANES)))
        return builder.icmp_signed('<', numbers, _repeated(builder, count, INTEGERS))

    @intrinsic
    def lanes_of(context: Any, value: Any) -> Any:
        """Return equal lanes."""

        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            return _repeated(builder, args[0], DOUBLES)

        return lanes_type(types.float64), generate

    def _selected(order: str) -> Any:
        def choose(context: Any, one: Any, two: Any) -> Any:
            def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
                return builder.select(builder.fcmp_ordered(order, *args), *args)

            return lanes_type(lanes_type, lanes_type), generate

        return intrinsic(choose)

    # the lesser, and the larger, ones of two lanes, each; those of the second one where one is NaN
    lower, higher = _selected('<'), _selected('>')

    @intrinsic
    def lane(context: Any, lanes: Any, k: Any) -> Any:
        """Return one of the lanes."""

        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            return builder.extract_element(*args)

        return types.float64(lanes_type, types.intp), generate

    @intrinsic
    def _load(context: Any, field: Any, k: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            pointer = _pointer(context, builder, signature, args)
            return builder.load(pointer, align=ALIGNMENT.constant)

        return lanes_type(field, types.intp), generate

    @intrinsic
    def _store(context: Any, field: Any, k: Any, lanes: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            pointer = _pointer(context, builder, signature, args)
            builder.store(args[2], pointer, align=ALIGNMENT.constant)
            return context.get_dummy_value()

        return types.void(field, types.intp, lanes_type), generate

    @intrinsic
    def _load_some(context: Any, field: Any, k: Any, count: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            pointer = _pointer(context, builder, signature, args)
            kind = ir.FunctionType(DOUBLES, [pointer.type, INT32, BITS, DOUBLES])
            load = get_or_insert_function(builder.module, kind, f'llvm.masked.load.{MANGLED}')
            zeros = ir.Constant(DOUBLES, [0.0] * LANES)
            return builder.call(load, [pointer, ALIGNMENT, _mask(builder, args[2]), zeros])

        return lanes_type(field, types.intp, types.intp), generate

    @intrinsic
    def _store_some(context: Any, field: Any, k: Any, count: Any, lanes: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            pointer = _pointer(context, builder, signature, args)
            kind = ir.FunctionType(ir.VoidType(), [DOUBLES, pointer.type, INT32, BITS])
            store = get_or_insert_function(builder.module, kind, f'llvm.masked.store.{MANGLED}')
            builder.call(store, [args[3], pointer, ALIGNMENT, _mask(builder, args[2])])
            return context.get_dummy_value()

        return types.void(field, types.intp, types.intp, lanes_type), generate

else:

    class _Plain(tuple[float, ...]):
        """Lanes in plain Python."""

        __slots__ = ()

    def _forwards(what: Any) -> Any:
        def result(one: _Plain, two: Any) -> _Plain:
            # a NumPy number times lanes is an array
            lanes = isinstance(two, (_Plain, np.ndarray))
            return _Plain(map(what, one, two if lanes else [two] * LANES))

        return result

    def _backwards(what: Any) -> Any:
        return lambda two, one: _Plain(map(what, [one] * LANES, two))

    for _operator in OPERATORS:
        setattr(_Plain, f'__{_operator.__name__}__', _forwards(_operator))
        setattr(_Plain, f'__r{_operator.__name__}__', _backwards(_operator))

    def lanes_of(value: float) -> Any:
        """Return equal lanes."""
        return _Plain([value] * LANES)

    def lower(one: Any, two: Any) -> Any:
        """Return the lesser ones of two lanes."""
        return _Plain(a if a < b else b for a, b in zip(one, two, strict=True))

    def higher(one: Any, two: Any) -> Any:
        """Return the larger ones of two lanes."""
        return _Plain(a if a > b else b for a, b in zip(one, two, strict=True))

    def lane(lanes: Any, k: int) -> float:
        """Return one of the lanes."""
        return lanes[k]

    def _load(field: np.ndarray, k: int) -> Any:
        return _Plain(field.reshape(-1)[k : k + LANES].tolist())

    def _store(field: np.ndarray, k: int, lanes: Any) -> None:
        field.reshape(-1)[k : k + LANES] = lanes

    def _load_some(field: np.ndarray, k: int, count: int) -> Any:
        return _Plain(field.reshape(-1)[k : k + count].tolist() + [0.0] * (LANES - count))

    def _store_some(field: np.ndarray, k: int, count: int, lanes: Any) -> None:
        field.reshape(-1)[k : k + count] = lanes[:count]


@helper
def lanes_at(field: np.ndarray, row: int, i: int, left: int) -> Lanes:
    """Return columns i … i + 3 of one row of a field (k, n), with zeros beyond the `left` ones."""
    k = row * field.shape[1] + i
    if left >= LANES:
        return _load(field, k)
    return _load_some(field, k, left)


@helper
def weights_at(weights: np.ndarray, i: int, left: int) -> Lanes:
    """Return elements i … i + 3 of an array (n,), with zeros beyond the `left` ones."""
    if left >= LANES:
        return _load(weights, i)
    return _load_some(weights, i, left)


@helper
def vectors_at(field: np.ndarray, i: int, left: int) -> LaneVector:
    """Return columns i … i + 3 of a field (3, n), with zeros beyond the `left` ones."""
    return lanes_at(field, 0, i, left), lanes_at(field, 1, i, left), lanes_at(field, 2, i, left)


@helper
def put_lanes(field: np.ndarray, row: int, i: int, left: int, lanes: Lanes) -> None:
    """Write columns i … i + 3, up to the `left` ones, of one row of a field (k, n)."""
    k = row * field.shape[1] + i
    if left >= LANES:
        _store(field, k, lanes)
    else:
        _store_some(field, k, left, lanes)


@helper
def put_vectors(field: np.ndarray, i: int, left: int, vectors: LaneVector) -> None:
    """Write columns i … i + 3, up to the `left` ones, of a field (3, n)."""
    put_lanes(field, 0, i, left, vectors[0])
    put_lanes(field, 1, i, left, vectors[1])
    put_lanes(field, 2, i, left, vectors[2])


@helper
def no_vectors() -> LaneVector:
    """Return vectors of which all are zero, where a sum begins."""
    return lanes_of(0.0), lanes_of(0.0), lanes_of(0.0)


@helper
def total(lanes: Lanes) -> float:
    """Return the sum of the lanes."""
    return (lane(lanes, 0) + lane(lanes, 2)) + (lane(lanes, 1) + lane(lanes, 3))


@helper
def totals(vectors: LaneVector) -> Vector:
    """Return the sum of the vectors of all lanes."""
    return total(vectors[0]), total(vectors[1]), total(vectors[2])
