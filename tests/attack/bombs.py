"""Small files that ask for much: packed, nested, exploding, endless. Each is made in a second or two, from nothing."""

from __future__ import annotations

import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import h5py
import lz4.frame
import mcap.records as records
import msgspec
import numpy as np
import pyarrow
import pyarrow.parquet
import zstandard
from mcap.data_stream import RecordBuilder

from foretouch.recordings.formats.published import About

MAGIC = b"\x89MCAP0\r\n"
BLOCK = bytes(2**24)
RULE = "=" * 80 + "\n"
BOMBS: dict[str, Callable[[Path], None]] = {}
SLOW = (
    "loose-triangles.stl", "forty-chunks.mcap", "zstd.mcap", "zstd-that-lies.mcap", "packed.mat", "equal-rows.parquet",
    "packed.npz", "open-quote.csv", "one-line.csv",
)  # fmt: skip
"""These take seconds to make, or to be refused."""


def bomb(name: str) -> Callable[[Callable[[Path], None]], Callable[[Path], None]]:
    return lambda write: BOMBS.setdefault(name, write)


def record(content: object) -> bytes:
    builder = RecordBuilder()
    content.write(builder)  # type: ignore[attr-defined]
    return builder.end()


def bag(path: Path, *data: bytes, kind: str = "std_msgs/msg/Float64", text: str = "float64 data\n") -> None:
    """An MCAP with one topic, ``/a``, and these records of data."""
    head = [
        records.Header("ros2", ""),
        records.Schema(1, text.encode(), "ros2msg", kind),
        records.Channel(1, "/a", "cdr", {}, 1),
    ]
    end = [records.DataEnd(0), records.Footer(0, 0, 0)]
    path.write_bytes(b"".join([MAGIC, *map(record, head), *data, *map(record, end), MAGIC]))


def chunk(compression: str, packed: bytes, size: int) -> bytes:
    return record(records.Chunk(compression, packed, 0, 1, 0, size))


def message(data: bytes, at: int = 0) -> bytes:
    return record(records.Message(1, at, data, at, at))


def packed_zeros(size: int, head: bytes = b"") -> bytes:
    """Zeros after a head, of this size together; who makes them does not hold them."""
    packer = zstandard.ZstdCompressor().compressobj(size=size)
    parts = [packer.compress(head)] + [packer.compress(BLOCK) for _ in range((size - len(head)) // len(BLOCK))]
    return b"".join([*parts, packer.compress(bytes((size - len(head)) % len(BLOCK))), packer.flush()])


@bomb("zstd.mcap")
def _(path: Path) -> None:
    bag(path, chunk("zstd", packed_zeros(2**31), 2**31))


@bomb("zstd-that-lies.mcap")
def _(path: Path) -> None:
    bag(path, chunk("zstd", packed_zeros(2**31), 1000))


@bomb("lz4-that-lies.mcap")
def _(path: Path) -> None:
    packer = lz4.frame.LZ4FrameCompressor()
    parts = [packer.begin(), *(packer.compress(BLOCK) for _ in range(64)), packer.flush()]
    bag(path, chunk("lz4", b"".join(parts), 1000))


@bomb("forty-chunks.mcap")
def _(path: Path) -> None:
    """Each as large as one may be, a single message, and all of them 10 GB."""
    size = 2**28
    head = struct.pack("<BQHIQQ", 5, size - 9, 1, 0, 0, 0) + b"\0\1\0\0"
    bag(path, *[chunk("zstd", packed_zeros(size, head), size)] * 40)


@bomb("nested.mcap")
def _(path: Path) -> None:
    inner = message(b"\0\1\0\0" + bytes(8))
    for _ in range(2000):
        inner = chunk("", inner, len(inner))
    bag(path, inner)


def typed(path: Path, kind: str, text: str, data: bytes = b"\0\1\0\0" + bytes(64)) -> None:
    bag(path, *(message(data, at * 10**6) for at in range(3)), kind=kind, text=text)


def towers(innermost: str, levels: int = 12) -> str:
    parts = [f"{RULE}MSG: x/L{level}\nx/L{level + 1}[256] a\n" for level in range(levels)]
    return "x/L0[256] a\nfloat64 q\n" + "".join(parts) + f"{RULE}MSG: x/L{levels}\n{innermost}\n"


def hdf5(path: Path, samples: int) -> None:
    with h5py.File(path, "w") as file:
        for name in ("time_s", "position_m", "force_N"):
            file.create_dataset(name, shape=(samples,), dtype="f8", chunks=(10**6,), compression="gzip")


@bomb("deep.h5")
def _(path: Path) -> None:
    with h5py.File(path, "w") as file:
        group = file
        for _ in range(2000):
            group = group.create_group("g")


@bomb("packed.npz")
def _(path: Path) -> None:
    """A column of a gigabyte of zeros, which takes eight as counts."""
    units = {"time": 1e6, "position": 1e6, "force": 1e6}
    np.savez(path, about=np.array(msgspec.json.encode(About("a", "b", "c", "MIT", 0.3, units)).decode()))
    packed = zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED, compresslevel=1)
    with packed as archive, archive.open("time.npy", "w", force_zip64=True) as column:
        np.lib.format.write_array_header_1_0(column, {"descr": "|i1", "fortran_order": False, "shape": (2**30,)})
        for _ in range(2**30 // len(BLOCK)):
            column.write(BLOCK)


@bomb("packed.mat")
def _(path: Path) -> None:
    count, name = 15 * 10**7, b"force"
    head = struct.pack("<IIII", 6, 8, 6, 0) + struct.pack("<IIii", 5, 8, count, 1)
    head += struct.pack("<II", 1, len(name)) + name.ljust(8, b"\0") + struct.pack("<II", 9, 8 * count)
    packer = zlib.compressobj(1)
    parts = [packer.compress(struct.pack("<II", 14, len(head) + 8 * count) + head)]
    parts += [packer.compress(BLOCK) for _ in range(8 * count // len(BLOCK))]
    packed = b"".join([*parts, packer.compress(bytes(8 * count % len(BLOCK))), packer.flush()])
    start = b"MATLAB 5.0 MAT-file".ljust(116) + bytes(8) + struct.pack("<H", 0x0100) + b"IM"
    path.write_bytes(start + struct.pack("<II", 15, len(packed)) + packed)


@bomb("equal-rows.parquet")
def _(path: Path) -> None:
    zeros = pyarrow.array(np.zeros(10**6))
    table = pyarrow.table(dict.fromkeys(("time_s", "position_m", "force_N"), zeros))
    with pyarrow.parquet.ParquetWriter(path, table.schema, compression="zstd") as writer:
        for _ in range(80):
            writer.write_table(table)


FACET = b"facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 0.1 0 0\nvertex 0 0.1 0\nendloop\nendfacet\n"


def ply(vertices: int, kind: str, content: bytes) -> bytes:
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {vertices}\n{axes}"
    head += f"element face {max(1, vertices - 3)}\nproperty list {kind} int vertex_indices\nend_header\n"
    return head.encode() + content


@bomb("loose-triangles.stl")
def _(path: Path) -> None:
    """Nine hundred thousand that have no edge in common: each is a hole that could be filled."""
    count = 900_000
    table = np.zeros(count, dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    table["corners"] = np.random.default_rng(0).random((count, 3, 3)) * 0.1
    path.write_bytes(b"x" * 80 + struct.pack("<I", count) + table.tobytes())


HEAD = b"time_s,position_m,force_N\n"
BYTES: dict[str, Callable[[], bytes]] = {
    "one-line.csv": lambda: HEAD + b"1" * 50_000_000,
    "open-quote.csv": lambda: HEAD + b'"' + b"0,1,2\n" * 5_000_000,
    "large-numbers.csv": lambda: HEAD + b"0,0,0\n1,1e400,nan\n2," + b"9" * 200_000 + b",1\n",
    "wide.csv": lambda: b",".join(b"c%d" % i for i in range(300_000)) + b"\n" + b",".join([b"1"] * 300_000) + b"\n",
    "deep.toml": lambda: b"a = " + b"[" * 8_000 + b"]" * 8_000,
    "long-key.toml": lambda: b"[" + b"a." * 7_999 + b"a]\nx = 1\n",
    "long.toml": lambda: b"[" + b"a." * 199_999 + b"a]\nx = 1\n",
    "count.stl": lambda: b"x" * 80 + struct.pack("<I", 2**32 - 1) + bytes(500),
    "bad-token.stl": lambda: b"solid a\n" + FACET * 9 + FACET.replace(b"0.1 0 0", b"0.1 o 0") + b"endsolid a\n",
    "not-finite.stl": lambda: b"solid a\n" + FACET.replace(b"0.1 0 0", b"1e400 0 0") * 9 + b"endsolid a\n",
    "far-index.obj": lambda: b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4000000000\nf -1 -2 -3\n",
    "count.ply": lambda: ply(4_000_000_000, "uchar", bytes(1000)),
    "long-list.ply": lambda: ply(3, "uint", bytes(36) + struct.pack("<I", 2**32 - 1) + bytes(100)),
}
BOMBS |= {name: (lambda path, made=made: path.write_bytes(made())) for name, made in BYTES.items()}
BOMBS |= {
    "type-within-itself.mcap": lambda path: typed(
        path, "x/msg/A", f"x/A a\nfloat64 b\n{RULE}MSG: x/A\nx/A a\nfloat64 b\n"
    ),
    "exploding-type.mcap": lambda path: typed(path, "x/msg/T", towers("float64 b")),
    "exploding-type-of-nothing.mcap": lambda path: typed(path, "x/msg/T", towers("uint8 C=1")),
    "long-sequence.mcap": lambda path: typed(
        path, "x/msg/T", "string[] s\n", b"\0\1\0\0" + struct.pack("<I", 2**32 - 1) + bytes(4000)
    ),
    "unwritten.h5": lambda path: hdf5(path, 5 * 10**8),
    "endless.h5": lambda path: hdf5(path, 10**13),
}
