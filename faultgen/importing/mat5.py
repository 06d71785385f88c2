"""Arrays of numbers in MATLAB files of version 5 to 7.

They are read here because SciPy's reader ends the whole program on some damaged files. Texts,
sparse and complex matrices, and arrays of structs are left out.

Source: MathWorks, "MAT-File Format", chapter 1.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, Literal

import numpy as np

from faultgen.importing.sizes import MOST_BYTES, check_size

Order = Literal["<", ">"]
"""Order of the bytes of a number, as in `struct`."""

_COMPRESSED, _MATRIX = 15, 14  # miCOMPRESSED, miMATRIX
_CELL, _STRUCT = 1, 2  # mxCELL_CLASS, mxSTRUCT_CLASS
_COMPLEX = 0x0800  # flag of a matrix
_STORED = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8"} | {
    12: "i8",
    13: "u8",
}
"""Type of stored values by data type (miINT8 to miUINT64)."""
_MEANT = {6: "f8", 7: "f4", 8: "i1", 9: "u1", 10: "i2", 11: "u2", 12: "i4", 13: "u4"} | {
    14: "i8",
    15: "u8",
}
"""Type of a matrix by its class (mxDOUBLE to mxUINT64). Doubles that are whole may be stored as
single bytes."""
_DEEPEST = 30  # structs in structs


def order_of(begin: bytes) -> Order | None:
    """Tell in which order a file has its bytes.

    Args:
        begin: The first 128 bytes of the file.

    Returns:
        '<' or '>' as in `struct`; None if it is no file of version 5 to 7.
    """
    orders: dict[bytes, Order] = {b"IM": "<", b"MI": ">"}
    return orders.get(begin[126:128])


def read_mat5(path: Path, file: BinaryIO) -> Iterator[tuple[str, np.ndarray]]:
    """Read the arrays of a file.

    Args:
        path: The file, for messages.
        file: The same, at its beginning.

    Yields:
        Name and values, of the shape that the file states. Fields of a struct ``log`` are
        ``log.q`` and so on.

    Raises:
        InputError: The arrays are too large.
        ValueError: The file is damaged.
    """
    check_size(path, path.stat().st_size)
    order: Order = order_of(file.read(128)) or "<"
    size = 0
    while len(tag := file.read(8)) == 8:
        kind, count = struct.unpack(f"{order}II", tag)
        content = file.read(count)
        if len(content) < count:
            raise ValueError("it is cut off")
        matrices: list[bytes | memoryview] = [content] if kind == _MATRIX else []
        if kind == _COMPRESSED:
            content = zlib.decompressobj().decompress(content, MOST_BYTES + 1)
            check_size(path, len(content))
            matrices = [inner for kind, inner in _elements(content, order) if kind == _MATRIX]
        for matrix in matrices:
            for name, values in _arrays(matrix, order, "", path):
                size += values.nbytes
                check_size(path, size)
                yield name, values


def _elements(content: bytes | memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Type and content of the elements in a part of the file."""
    view, at = memoryview(content), 0
    while at + 8 <= len(view):
        kind, count = struct.unpack_from(f"{order}II", view, at)
        if kind >> 16:  # a small element has everything in eight bytes
            yield kind & 0xFFFF, view[at + 4 : at + 4 + min(kind >> 16, 4)]
            at += 8
            continue
        if at + 8 + count > len(view):
            raise ValueError("it is damaged or cut off")
        yield kind, view[at + 8 : at + 8 + count]
        at += 8 + count + (-count % 8)


def _arrays(
    matrix: bytes | memoryview, order: Order, named: str, path: Path, depth: int = 0
) -> Iterator[tuple[str, np.ndarray]]:
    """Arrays of numbers in a matrix; `named` replaces its own name, which fields do not have."""
    parts = list(_elements(matrix, order))
    if depth > _DEEPEST or len(parts) < 4:
        return
    if len(parts[0][1]) < 4 or len(parts[1][1]) % 4:
        raise ValueError("it is damaged")
    (flags,) = struct.unpack_from(f"{order}I", parts[0][1])
    shape = tuple(np.frombuffer(parts[1][1], f"{order}i4").tolist())
    name = named or bytes(parts[2][1]).decode("latin-1").rstrip("\0")
    meant = _MEANT.get(flags & 0xFF)
    if meant is not None:
        kind, content = parts[3]
        if flags & _COMPLEX or kind not in _STORED:
            return
        stored = np.dtype(_STORED[kind])
        count = len(content) // stored.itemsize
        if min(shape, default=0) < 0 or math.prod(shape) != count:
            raise ValueError(f"{name} claims shape {shape}, but has {count} values")
        check_size(path, count * np.dtype(meant).itemsize)
        values = np.frombuffer(content, stored.newbyteorder(order), count)
        if count:
            yield name, values.astype(meant).reshape(shape, order="F")
    elif flags & 0xFF == _STRUCT and math.prod(shape) == 1 and len(parts[3][1]) >= 4:
        (length,) = struct.unpack_from(f"{order}i", parts[3][1])
        names = bytes(parts[4][1]) if len(parts) > 4 else b""
        fields = [names[k : k + length] for k in range(0, len(names), length)] if length > 0 else []
        for field, (kind, inner) in zip(fields, parts[5:], strict=False):
            own = field.split(b"\0")[0].decode("latin-1")
            if kind == _MATRIX:
                yield from _arrays(inner, order, f"{name}.{own}", path, depth + 1)
    elif flags & 0xFF == _CELL and math.prod(shape) == 1 and parts[3][0] == _MATRIX:
        yield from _arrays(parts[3][1], order, name, path, depth + 1)
