r"""The file format: one file, blocks appended, each sound although the writer is killed later.

Layout (all text is ASCII or UTF-8, numbers in arrays little-endian, C order)::

    SKFEM-COSSERAT HISTORY 1\n                    magic and version
    <bytes:020d> <crc:08x>\n                      committed length, overwritten in place
    BLOCK <header:010d> <payload:020d> <crc:08x> <crc:08x>\n
    <header: JSON>                                kind, arrays (name, dtype, shape), ...
    <payload: arrays one after the other>
    BLOCK ...

Kinds of blocks: ``head`` (``meta`` and the static arrays, once, first), ``rows`` (some states of
all series), ``sensors`` (instants and values of sensors, NAME/t and NAME/x), ``tail`` (``status``
and changes of ``meta``; missing if the writer was killed). A block counts once the committed length
includes it; that number is changed after the bytes of the block were handed to the operating
system. CRC-32 sums guard the committed length, the headers and the payloads.
"""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from math import prod
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ..errors import HistoryError, InputError
from ..log import logger
from ..types import Array
from .data import BASIC, KINDS

_FAMILY = b"SKFEM-COSSERAT HISTORY "
_MAGIC = _FAMILY + b"1\n"
_COMMIT_BYTES = 30
_BLOCK_BYTES = 56
#: `save_file` cuts long series into blocks of about this many bytes.
_SAVE_BYTES = 2**24


@dataclass(frozen=True)
class Block:
    """Place of one block in a file."""

    header: dict[str, Any]
    start: int
    size: int
    crc: int

    @property
    def rows(self) -> int:
        """Number of states in the block."""
        return int(self.header.get("rows", 0))


@dataclass
class Scan:
    """What the headers of a file say; ``problem`` is empty if all is well."""

    path: Path
    found: int
    expected: int
    blocks: list[Block] = field(default_factory=list)
    problem: str = ""

    @property
    def rows(self) -> int:
        """Number of states in the blocks."""
        return sum(block.rows for block in self.blocks)


def _commit_line(size: int) -> bytes:
    digits = b"%020d" % size
    return b"%s %08x\n" % (digits, zlib.crc32(digits))


def _block_line(size: int, payload: int, crc: int, payload_crc: int) -> bytes:
    return b"BLOCK %010d %020d %08x %08x\n" % (size, payload, crc, payload_crc)


class FileWriter:
    """Append blocks to a history file.

    Parameters
    ----------
    path : path-like
        Name of the file; an older one is overwritten.

    Raises
    ------
    InputError
        If the file cannot be opened for writing.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        try:
            self._handle: BinaryIO = self.path.open("wb", buffering=0)
        except OSError as error:
            raise InputError(
                f"history file {str(self.path)!r}", f"cannot be written: {error.strerror}"
            ) from error
        self._end = len(_MAGIC) + _COMMIT_BYTES
        self._write(0, _MAGIC + _commit_line(self._end))

    def _write(self, offset: int, data: bytes) -> None:
        self._handle.seek(offset)
        view = memoryview(data)
        while view:
            view = view[self._handle.write(view) :]

    def append(self, header: dict[str, Any], arrays: Mapping[str, Array]) -> None:
        """Write one block and commit it.

        Parameters
        ----------
        header : dict
            JSON data with the entry ``kind``.
        arrays : mapping of str to array
            Any shapes; types as in `skfem_cosserat.history.data.KINDS`.
        """
        listing = [
            {"name": name, "dtype": array.dtype.str, "shape": list(array.shape)}
            for name, array in arrays.items()
        ]
        text = json.dumps({**header, "arrays": listing}).encode()
        payload = b"".join(array.tobytes() for array in arrays.values())
        line = _block_line(len(text), len(payload), zlib.crc32(text), zlib.crc32(payload))
        block = line + text + payload
        self._write(self._end, block)
        self._end += len(block)
        self._write(len(_MAGIC), _commit_line(self._end))

    def sync(self) -> None:
        """Wait until the bytes are on the disk."""
        os.fsync(self._handle.fileno())

    def close(self) -> None:
        """Close the file; a second call does nothing."""
        self._handle.close()


def _open(path: Path) -> BinaryIO:
    try:
        return path.open("rb")
    except OSError as error:
        raise HistoryError(
            f"history file {str(path)!r}", f"cannot be read: {error.strerror}"
        ) from error


def _start(handle: BinaryIO, path: Path) -> Scan:
    """Read magic line and committed length."""
    item = f"history file {str(path)!r}"
    magic = handle.read(len(_MAGIC))
    found = os.fstat(handle.fileno()).st_size
    if not magic:
        raise HistoryError(item, "is empty")
    if magic != _MAGIC:
        if magic.startswith(_FAMILY):
            version = magic[len(_FAMILY) :].decode("ascii", "replace").strip()
            raise HistoryError(item, f"has format version {version!r}, expected '1'")
        raise HistoryError(item, f"is not a history: it starts with {magic[:16]!r}")
    line = handle.read(_COMMIT_BYTES)
    digits = line[:20]
    if line != b"%s %08x\n" % (digits, zlib.crc32(digits)):
        return Scan(path, found, found, problem="the committed length is damaged")
    scan = Scan(path, found, int(digits))
    if found < scan.expected:
        scan.problem = f"cut short: {found} bytes found, {scan.expected} bytes expected"
    elif found > scan.expected:
        logger.info("%s: %d uncommitted bytes ignored", path, found - scan.expected)
    return scan


def _sizes(header: dict[str, Any]) -> list[int]:
    """Bytes of each array of a block; ValueError if the list is not what we write."""
    sizes = []
    for entry in header["arrays"]:
        dtype, shape = np.dtype(entry["dtype"]), entry["shape"]
        if dtype.kind not in KINDS or not all(isinstance(k, int) and k >= 0 for k in shape):
            raise ValueError(f"array {entry['name']!r} of type {dtype} and shape {shape}")
        if header["kind"] == "rows" and shape[:1] != [header["rows"]]:
            raise ValueError(f"array {entry['name']!r} does not have {header['rows']} rows")
        sizes.append(dtype.itemsize * prod(shape))
    return sizes


def _read_block(handle: BinaryIO, limit: int) -> Block:
    """Read the header of the block at the current place and step over its payload.

    Raises ValueError or a relative of it if the bytes are not a block.
    """
    line = handle.read(_BLOCK_BYTES)
    words = line.split()
    if len(words) != 5:
        raise ValueError("no block header")
    size, payload, crc, payload_crc = (*map(int, words[1:3]), *(int(w, 16) for w in words[3:]))
    if line != _block_line(size, payload, crc, payload_crc):
        raise ValueError("no block header")
    start = handle.tell() + size
    if start + payload > limit:
        raise ValueError("the block is not complete")
    text = handle.read(size)
    if zlib.crc32(text) != crc:
        raise ValueError("the header of the block is damaged")
    if not payload and payload_crc:  # other payloads are checked when they are read
        raise ValueError("the block is damaged")
    header = json.loads(text)
    if sum(_sizes(header)) != payload:
        raise ValueError("sizes of arrays and block differ")
    handle.seek(start + payload)
    return Block(header, start, payload, payload_crc)


def _scan(handle: BinaryIO, path: Path) -> Scan:
    """Find all blocks, looking at headers only."""
    scan = _start(handle, path)
    limit = min(scan.found, scan.expected)
    while handle.tell() < limit:
        place = handle.tell()
        try:
            block = _read_block(handle, limit)
        except (ValueError, KeyError, TypeError) as error:
            scan.problem = scan.problem or f"damaged at byte {place}: {error}"
            break
        if (block.header["kind"] == "head") != (not scan.blocks):
            scan.problem = scan.problem or f"damaged at byte {place}: unexpected block"
            break
        scan.blocks.append(block)
    if not scan.blocks:
        scan.problem = scan.problem or "the head is missing"
    return scan


def _arrays(handle: BinaryIO, block: Block) -> dict[str, Array] | None:
    """Arrays of a block (read-only views of its bytes); None if its sum is wrong."""
    handle.seek(block.start)
    payload = handle.read(block.size)
    if zlib.crc32(payload) != block.crc:
        return None
    arrays: dict[str, Array] = {}
    offset = 0
    sizes = _sizes(block.header)
    for entry, size in zip(block.header["arrays"], sizes, strict=True):
        dtype = np.dtype(entry["dtype"])
        if size:
            array = np.frombuffer(payload, dtype, size // dtype.itemsize, offset)
        else:
            array = np.empty(0, dtype)
        arrays[entry["name"]] = array.reshape(entry["shape"])
        offset += size
    return arrays


def _series(handle: BinaryIO, scan: Scan) -> tuple[dict[str, Array], int]:
    """Fill the series from all sound blocks; also the number of states that are sound."""
    series: dict[str, Array] = {}
    done = 0
    for block in [block for block in scan.blocks if block.header["kind"] == "rows"]:
        arrays = _arrays(handle, block)
        if arrays is None:
            scan.problem = f"damaged: wrong checksum in states {done} to {done + block.rows - 1}"
            break
        if not series:
            series = {
                name: np.empty((scan.rows, *array.shape[1:]), array.dtype)
                for name, array in arrays.items()
            }
        for name, array in series.items():
            array[done : done + block.rows] = arrays[name]
        done += block.rows
    return {name: array[:done] for name, array in series.items()}, done


def _sensors(handle: BinaryIO, scan: Scan) -> dict[str, Array]:
    """Instants and values of the sensors from all sound blocks."""
    parts: dict[str, list[Array]] = {}
    for block in [block for block in scan.blocks if block.header["kind"] == "sensors"]:
        arrays = _arrays(handle, block)
        if arrays is None:
            scan.problem = scan.problem or "damaged: wrong checksum in values of sensors"
            break
        for name, array in arrays.items():
            parts.setdefault(name, []).append(array)
    return {name: np.concatenate(each) for name, each in parts.items()}


def _finish(scan: Scan) -> dict[str, Any]:
    """Meta data with the changes of the tail and the status."""
    meta = dict(scan.blocks[0].header["meta"])
    meta["status"] = "killed"
    for block in scan.blocks:
        if block.header["kind"] == "tail":
            meta.update(block.header["meta"])
            meta["status"] = block.header["status"]
    return meta


def load_file(
    path: str | os.PathLike[str], recover: bool = False
) -> tuple[dict[str, Any], dict[str, Array], dict[str, Array], dict[str, Array]]:
    """Read ``meta``, static arrays, series, and arrays of sensors of a file.

    Parameters
    ----------
    path : path-like
        Name of the file.
    recover : bool
        Return the states in front of a damage instead of raising an error.

    Raises
    ------
    HistoryError
        If the file is no history, cut short or damaged (with the number of states that
        ``recover=True`` returns), or damaged in its head, where nothing can be recovered.
    """
    path = Path(path)
    with _open(path) as handle:
        scan = _scan(handle, path)
        head = _arrays(handle, scan.blocks[0]) if scan.blocks else None
        if head is None:
            problem = scan.problem or "damaged: wrong checksum in the head"
            raise HistoryError(
                f"history file {str(path)!r}", f"{problem}; nothing can be recovered"
            )
        series, done = _series(handle, scan)
        sensors = _sensors(handle, scan)
    if scan.problem:
        if not recover:
            raise HistoryError(
                f"history file {str(path)!r}", f"{scan.problem}; recover=True gives {done} states"
            )
        logger.warning("%s: %s; %d states recovered", path, scan.problem, done)
        scan.blocks = [block for block in scan.blocks if block.header["kind"] != "tail"]
    empty = {"t": (0,), "step": (0,), "q": (0, 0), "p": (0, 0)}
    for name in BASIC if not series else ():
        series[name] = np.zeros(empty[name], np.int64 if name == "step" else np.float64)
    return _finish(scan), {name: array.copy() for name, array in head.items()}, series, sensors


def read_meta(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Meta data of a history file and the number of its ``states``, without reading the arrays.

    Parameters
    ----------
    path : path-like
        Name of the file; it may be one that is being written.

    Returns
    -------
    dict
        ``meta`` with ``status`` (``"killed"`` as long as the writer has not closed the file) and
        ``states``, the number of committed states.

    Raises
    ------
    HistoryError
        If the file is no history, cut short, or its headers are damaged.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder) / "run.history"
    ...     writer = FileWriter(path)
    ...     writer.append({"kind": "head", "meta": {"step": 0.01}}, {})
    ...     writer.close()
    ...     read_meta(path)
    {'step': 0.01, 'status': 'killed', 'states': 0}
    """
    path = Path(path)
    with _open(path) as handle:
        scan = _scan(handle, path)
    if scan.problem:
        raise HistoryError(f"history file {str(path)!r}", scan.problem)
    return {**_finish(scan), "states": scan.rows}


def save_file(
    path: str | os.PathLike[str],
    meta: dict[str, Any],
    static: Mapping[str, Array],
    series: Mapping[str, Array],
    sensors: Mapping[str, Array],
) -> None:
    """Write a complete file under a temporary name, then give it its name.

    Parameters
    ----------
    path : path-like
        Name of the file; an older one is replaced.
    meta : dict
        JSON data.
    static, series : mapping of str to array
        Arrays; series have a common first axis.
    sensors : mapping of str to array
        NAME/t and NAME/x of each sensor.

    Raises
    ------
    InputError
        If the folder does not exist or cannot be written.
    """
    path = Path(path)
    if path.is_dir():
        raise InputError(f"history file {str(path)!r}", "cannot be written: it is a folder")
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        writer = FileWriter(temporary)
    except InputError as error:
        raise InputError(f"history file {str(path)!r}", str(error).partition(": ")[2]) from error
    rows = len(series["t"])
    stride = max(1, _SAVE_BYTES * max(rows, 1) // max(1, sum(a.nbytes for a in series.values())))
    try:
        writer.append({"kind": "head", "meta": meta}, static)
        for first in range(0, max(rows, 1), stride):
            part = {name: array[first : first + stride] for name, array in series.items()}
            writer.append({"kind": "rows", "rows": len(part["t"])}, part)
        if sensors:
            writer.append({"kind": "sensors"}, sensors)
        status = meta.get("status", "completed")
        writer.append({"kind": "tail", "status": status, "meta": {}}, {})
        writer.sync()
        writer.close()
        temporary.replace(path)
    finally:
        writer.close()
        temporary.unlink(missing_ok=True)
