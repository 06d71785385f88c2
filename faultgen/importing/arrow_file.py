"""Tables of Parquet and Feather files, also of LeRobot datasets. They need the package pyarrow.

A list of numbers in a cell becomes one column for each number, as in `observation.state_1`, and a
field of a struct becomes `STRUCT.FIELD`. Columns that hold neither numbers, times nor texts, such
as images, are not read.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from faultgen.errors import InputError, one_line
from faultgen.importing.sizes import MOST_BYTES, check_size
from faultgen.importing.table import Table, named_with_units

if TYPE_CHECKING:
    import pyarrow as pa

_PARQUET, _ARROW, _OLD_FEATHER = b"PAR1", b"ARROW1", b"FEA1"
_LONGEST_LIST = 1000


def read_arrow(path: Path) -> Table:
    """Read a table.

    Args:
        path: Parquet or Feather file; or the folder of a LeRobot dataset, whose files
            `data/*/*.parquet` are joined in the order of their names.

    Returns:
        Its columns.

    Raises:
        InputError: The package pyarrow is not installed, or the file cannot be read.
    """
    try:
        import pyarrow as pa
    except ImportError:
        raise InputError(
            "Parquet and Feather files need the package pyarrow (the extra data); install it: "
            "pip install pyarrow"
        ) from None
    files = sorted(path.glob("data/**/*.parquet")) if path.is_dir() else [path]
    if not files:
        raise InputError(f"{path}: has no files data/*/*.parquet")
    try:
        parts, size = [], 0
        for file in files:
            for batch in _batches(file):
                size += batch.nbytes
                check_size(path, size, 2 * MOST_BYTES)
                parts.append(batch)
        if not parts:
            raise InputError(f"{path}: has no rows")
        table = pa.concat_tables(parts, promote_options="default")
    except InputError:
        raise
    except Exception as error:  # a damaged file can make the reader raise anything
        raise InputError(f"{path}: cannot be read ({one_line(error)})") from None
    check_size(path, 8.0 * len(table) * len(table.column_names))
    columns: dict[str, np.ndarray] = {}
    lists = False
    names, units = named_with_units(table.column_names)
    for name, column in zip(names, table.columns, strict=True):
        for own, values in _arrays(path, name, column.combine_chunks()):
            lists = lists or own != name
            columns[own] = values
    check_size(path, 8.0 * len(table) * len(columns))
    notes = [f"{len(table)} rows with {len(columns)} columns"]
    if len(files) > 1:
        notes[0] += f", from {len(files)} files"
    return Table(source=str(path), columns=columns, units=units, lists=lists, notes=tuple(notes))


def _batches(path: Path) -> Iterator[pa.Table]:
    """The columns of a file that can be read, piece by piece."""
    import pyarrow as pa

    with path.open("rb") as file:
        begin = file.read(8)
    if begin.startswith(_PARQUET):
        import pyarrow.parquet as parquet

        with parquet.ParquetFile(path) as content:
            names = [one.name for one in content.schema_arrow if _is_wanted(one.type)]
            for group in range(content.num_row_groups):
                claimed = content.metadata.row_group(group)
                needed = sum(
                    claimed.column(k).total_uncompressed_size
                    for k in range(claimed.num_columns)
                    if claimed.column(k).path_in_schema.split(".list.")[0] in names
                )
                check_size(path, needed, 2 * MOST_BYTES)
                yield content.read_row_group(group, columns=names)
        return
    if begin.startswith(_ARROW):
        with pa.memory_map(str(path)) as file:
            content = pa.ipc.open_file(file)
            for k in range(content.num_record_batches):
                batch = pa.Table.from_batches([content.get_batch(k)])
                yield batch.select([one.name for one in batch.schema if _is_wanted(one.type)])
        return
    if begin.startswith(_OLD_FEATHER):
        from pyarrow import feather

        table = feather.read_table(path)
        yield table.select([one.name for one in table.schema if _is_wanted(one.type)])
        return
    raise InputError(f"{path}: is neither a Parquet nor a Feather file")


def _is_wanted(kind: Any) -> bool:
    """Whether a column has numbers, times or texts, or lists or structs of them."""
    import pyarrow.types as types

    if types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind):
        return _is_wanted(kind.value_type)
    if types.is_struct(kind):
        return any(_is_wanted(one.type) for one in kind)
    if types.is_dictionary(kind):
        return _is_wanted(kind.value_type)
    return bool(
        types.is_integer(kind)
        or types.is_floating(kind)
        or types.is_decimal(kind)
        or types.is_boolean(kind)
        or types.is_temporal(kind)
        or types.is_string(kind)
        or types.is_large_string(kind)
    )


def _arrays(path: Path, name: str, column: Any) -> Iterator[tuple[str, np.ndarray]]:
    """Names and values of a column; several for a list or struct."""
    import pyarrow as pa
    import pyarrow.types as types

    kind = column.type
    if types.is_struct(kind):
        for k in range(kind.num_fields):
            if _is_wanted(kind[k].type):
                yield from _arrays(path, f"{name}.{kind[k].name}", column.field(k))
        return
    if types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind):
        if types.is_fixed_size_list(kind):
            counts = np.full(len(column), kind.list_size)
        else:
            counts = np.diff(column.offsets.to_numpy())
        count = int(counts[0]) if len(counts) else 0
        if column.null_count or (counts != count).any():
            raise InputError(
                f"{path}: column '{name}' holds lists of {counts.min()} to {counts.max()} numbers"
                f", or cells without a list; write lists of the same length"
            )
        if count > _LONGEST_LIST:
            return
        check_size(path, 8.0 * len(column) * count)
        inner = column.flatten()
        for k in range(count):
            places = pa.array(np.arange(k, k + count * len(column), count))
            yield from _arrays(path, f"{name}_{k + 1}", inner.take(places))
        return
    if types.is_temporal(kind):
        if types.is_timestamp(kind) and kind.tz is not None:
            column = column.cast(pa.timestamp(kind.unit))
        if types.is_time(kind):  # clock times, such as 09:30:00.004
            column = column.cast(pa.string())
        elif types.is_duration(kind):
            column = column.cast(pa.int64())
    if types.is_decimal(kind):
        column = column.cast(pa.float64())
    values = column.to_numpy(zero_copy_only=False)
    yield name, values.astype(float) if values.dtype.kind == "b" else values
