"""Writes Apache Parquet: columns of numbers and texts without nulls, and lists of these; plain pages, not compressed."""

import pathlib
import struct
from typing import Any, Dict, List, Mapping, Sequence, Tuple

import numpy as np

Column = Any  # an array of one or two dimensions, of float32, float64 or int64; or a list of str, or of lists of them

_PHYSICAL = {"float32": (4, "<f4"), "float64": (5, "<f8"), "int64": (2, "<i8")}
_BYTES = 6
_REQUIRED, _REPEATED = 0, 2
_UTF8, _LIST = 0, 3  # converted types
_PLAIN, _RLE = 0, 3


# ---- Thrift's compact protocol: a struct is {number of the field: value}; int is i32, Long is i64.


class _Long(int):
    pass


def _varint(n: int) -> bytes:
    out = bytearray()
    while n >= 0x80:
        out.append(n & 0x7F | 0x80)
        n >>= 7
    return bytes(out + bytes([n]))


def _kind(value: Any) -> int:
    return 6 if isinstance(value, _Long) else 5 if isinstance(value, int) else 8 if isinstance(value, (str, bytes)) else 9 if isinstance(value, list) else 12


def _encoded(value: Any) -> bytes:
    if isinstance(value, int):
        return _varint(value << 1 if value >= 0 else (-value << 1) - 1)
    if isinstance(value, (str, bytes)):
        data = value.encode() if isinstance(value, str) else value
        return _varint(len(data)) + data
    if isinstance(value, list):
        kind = _kind(value[0])
        head = bytes([len(value) << 4 | kind]) if len(value) < 15 else bytes([0xF0 | kind]) + _varint(len(value))
        return head + b"".join(map(_encoded, value))
    out, before = b"", 0
    for number, each in sorted(value.items()):
        assert number - before < 16
        out += bytes([number - before << 4 | _kind(each)]) + _encoded(each)
        before = number
    return out + b"\0"


# ---- columns


def _values(column: Column) -> Tuple[int, bytes, int, int]:
    """Physical type, plain values, their number, and how many a row has; 0: one, and no list."""
    if isinstance(column, np.ndarray):
        physical, dtype = _PHYSICAL[column.dtype.name]
        return physical, column.astype(dtype).tobytes(), column.size, column.shape[1] if column.ndim == 2 else 0
    size = len(column[0]) if isinstance(column[0], list) else 0
    texts = [text.encode() for row in column for text in (row if size else [row])]
    return _BYTES, b"".join(struct.pack("<I", len(text)) + text for text in texts), len(texts), size


def _levels(runs: Sequence[Tuple[int, int]]) -> bytes:
    data = b"".join(_varint(count << 1) + bytes([level]) for count, level in runs if count)
    return struct.pack("<I", len(data)) + data


def _schema(name: str, column: Column) -> List[Dict[int, Any]]:
    physical, _, _, size = _values(column)
    leaf = {1: physical, 3: _REQUIRED, 4: "element" if size else name, **({6: _UTF8} if physical == _BYTES else {})}
    if not size:
        return [leaf]
    return [{3: _REQUIRED, 4: name, 5: 1, 6: _LIST}, {3: _REPEATED, 4: "list", 5: 1}, leaf]


def write(path: pathlib.Path, groups: Sequence[Mapping[str, Column]], metadata: Mapping[str, str] = {}) -> None:
    """A group of rows each, all with the same columns; in a list every row has as many elements, at least one."""
    path.parent.mkdir(parents=True, exist_ok=True)
    row_groups: List[Dict[int, Any]] = []
    with path.open("wb") as file:
        file.write(b"PAR1")
        for group in groups:
            rows, chunks, begin = len(next(iter(group.values()))), [], file.tell()
            for name, column in group.items():
                physical, page, count, size = _values(column)
                if size:
                    page = _levels([(1, 0), (size - 1, 1)] * rows) + _levels([(count, 1)]) + page
                header = {1: 0, 2: len(page), 3: len(page), 5: {1: count, 2: _PLAIN, 3: _RLE, 4: _RLE}}
                at = file.tell()
                file.write(_encoded(header) + page)
                length = _Long(file.tell() - at)
                about = {1: physical, 2: [_PLAIN, _RLE], 3: [name, "list", "element"] if size else [name], 4: 0, 5: _Long(count), 6: length, 7: length,
                         9: _Long(at)}  # fmt: skip
                chunks.append({2: _Long(at), 3: about})
            row_groups.append({1: chunks, 2: _Long(file.tell() - begin), 3: _Long(rows)})
        columns = [element for name, column in groups[0].items() for element in _schema(name, column)]
        footer: Dict[int, Any] = {1: 1, 2: [{4: "schema", 5: len(groups[0])}, *columns], 3: _Long(sum(g[3] for g in row_groups)), 4: row_groups}
        if metadata:
            footer[5] = [{1: key, 2: value} for key, value in metadata.items()]
        footer[6] = "twoport"
        data = _encoded(footer)
        file.write(data + struct.pack("<I", len(data)) + b"PAR1")
