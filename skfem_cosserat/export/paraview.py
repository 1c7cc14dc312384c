"""ParaView series: an index (``.pvd``) for each layer and one file (``.vtu``) for each frame."""

from __future__ import annotations

import json
import logging
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..history import History
from ..log import logger
from ..types import Array, ArrayLike, Floats
from .layers import BeamLayer, BodyLayer, CouplingLayer, JointLayer, Layer, SurfaceLayer

__all__ = ["ParaViewWriter", "prepare_folder", "write_paraview"]

_HEAD = b'<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
_TAIL = b"  </Collection>\n</VTKFile>\n"


class _Index:
    """A ``.pvd`` file that is complete after each frame: the closing tags are overwritten."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._end = len(_HEAD)
        path.write_bytes(_HEAD + _TAIL)

    def add(self, time: float, name: str) -> None:
        """Append a frame; ``name`` is relative to the index."""
        line = f'    <DataSet timestep="{float(time)!r}" part="0" file="{name}"/>\n'.encode()
        with self.path.open("r+b", buffering=0) as handle:
            handle.seek(self._end)
            handle.write(line + _TAIL)
        self._end += len(line)


def prepare_folder(folder: Path) -> None:
    """Make the folder and try to write into it: to be called before long work.

    Parameters
    ----------
    folder : pathlib.Path
        Made with its parents if there is none; what is in it stays.

    Raises
    ------
    InputError
        If it cannot be made or written; the message names the folder.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as parent:
    ...     prepare_folder(Path(parent) / "runs" / "swing")
    ...     (Path(parent) / "runs" / "swing").is_dir()
    True
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".probe.{os.getpid()}.tmp"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise InputError(
            f"folder {str(folder)!r}", f"cannot be written: {error.strerror}"
        ) from error


class ParaViewWriter:
    """Write frames one by one, also while a simulation runs.

    For each layer of the scene there is an index ``beams.pvd``, ``bodies.pvd`` (rigid bodies and
    mass points), ``joints.pvd``, ``couplings.pvd`` (springs, cables, bushings as lines) and, on
    request, ``beam_surfaces.pvd``; open these in ParaView. An index is complete after each frame,
    so a run that was killed can be looked at. Names that belong to the numbers ``beam_id``,
    ``part_id``, ``section_id``, ``body_id``, ``joint_id``, ``coupling_id`` and joint ``type`` are
    in ``names.json``.

    **The points are written where they are (deformed).** ``u`` is for colours: the filter *Warp By
    Vector* with ``u`` would show the motion twice.

    Beams have at points ``u, v`` (m, m/s), section directors ``d1, d2, d3`` in space (at a node
    where several sections meet the triad of the node), the quaternion ``q_wxyz`` from the section's
    frame to space, and ``node_id`` (-1 between nodes); at cells the resultants ``N, M`` in the
    section's frame and ``n, m`` in space (N, N m), the strains ``Gamma, K`` (-, 1/m), averaged over
    the Gauss points of the cell, and ``beam_id, part_id, section_id``. Elements of order 1 are
    2-node lines, of order 2 quadratic lines; those of higher order are cut into ``order`` equal
    2-node lines.

    Parameters
    ----------
    folder : path-like
        Created if needed. Files of an earlier export are overwritten.
    meta, static : mapping
        As in `skfem_cosserat.History`.
    reference : (n,), optional
        Coordinates from which ``u`` is counted. Default: the static array ``reference`` if there is
        one, otherwise the first state that is written.
    surfaces : bool
        Write the swept section surfaces too.
    compress : bool
        Compress with zlib: a quarter smaller, several times slower.

    Raises
    ------
    InputError
        If the folder cannot be written or a static array is missing.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> meta, static = {"points": [{"name": "tip"}]}, {"point/tip/offset": np.array(0)}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     writer = ParaViewWriter(folder, meta, static)
    ...     files = writer.write(0.0, {"q": np.zeros(3)})
    ...     [path.name for path in writer.indices]
    ['bodies.pvd']
    """

    def __init__(
        self,
        folder: str | os.PathLike[str],
        meta: Mapping[str, Any],
        static: Mapping[str, Array],
        *,
        reference: ArrayLike | None = None,
        surfaces: bool = False,
        compress: bool = False,
    ) -> None:
        self.folder = Path(folder)
        self._compression = "zlib" if compress else None
        if reference is None:
            reference = static.get("reference")
        self._reference: Floats | None = None
        if reference is not None:
            self._reference = np.array(reference, dtype=float)
        self._layers = _layers(meta, static, surfaces)
        prepare_folder(self.folder)
        self._indices = []
        for layer in self._layers:
            (self.folder / layer.name).mkdir(exist_ok=True)
            for frame in (self.folder / layer.name).glob("[0-9]" * 6 + ".vtu"):
                frame.unlink()  # of a longer earlier export: the index would not name it
            self._indices.append(_Index(self.folder / f"{layer.name}.pvd"))
        self._frame = 0
        names = json.dumps(_names(meta, self._layers), indent=1)
        (self.folder / "names.json").write_text(names, encoding="utf-8")

    @property
    def indices(self) -> list[Path]:
        """The index files, to be opened in ParaView."""
        return [index.path for index in self._indices]

    def write(self, time: float, row: Mapping[str, ArrayLike]) -> list[Path]:
        """Write one frame.

        Parameters
        ----------
        time : float
            In s.
        row : mapping of str to array
            ``q (n,)`` and, as far as known, ``v``, ``beam/{name}/strain``,
            ``beam/{name}/resultant``, ``joint/{name}/position`` (joints without it are left out),
            ``joint/{name}/force`` and ``joint/{name}/moment``.

        Returns
        -------
        list of Path
            The ``.vtu`` files of this frame.

        Raises
        ------
        InputError
            If an entry of the row is missing or has a wrong shape.
        """
        arrays = {name: np.asarray(value) for name, value in row.items()}
        if "q" not in arrays:
            raise InputError("row entry 'q'", "is missing; the export needs it")
        if self._reference is None:
            self._reference = np.array(arrays["q"], dtype=float)
        meshes = [layer.mesh(arrays, self._reference) for layer in self._layers]
        written = []
        for layer, index, mesh in zip(self._layers, self._indices, meshes, strict=True):
            if mesh is None:
                level = logging.DEBUG if self._frame else logging.WARNING
                logger.log(level, "%s: nothing recorded for this layer", index.path)
                continue
            name = f"{layer.name}/{self._frame:06d}.vtu"
            path = self.folder / name
            mesh.write(path, file_format="vtu", binary=True, compression=self._compression)
            index.add(time, name)
            written.append(path)
        self._frame += 1
        return written


def _layers(meta: Mapping[str, Any], static: Mapping[str, Array], surfaces: bool) -> list[Layer]:
    """Layers that have something to show."""
    layers: list[Layer] = []
    if meta.get("beams"):
        layers.append(BeamLayer(meta, static))
        if surfaces:
            layers.append(SurfaceLayer(meta, static))
    if meta.get("bodies") or meta.get("points"):
        layers.append(BodyLayer(meta, static))
    if meta.get("joints"):
        layers.append(JointLayer(meta, static))
    if meta.get("couplings"):
        layers.append(CouplingLayer(meta, static))
    return layers


def _names(meta: Mapping[str, Any], layers: list[Layer]) -> dict[str, Any]:
    """Names behind the numbers in the files."""
    beams = meta.get("beams", [])
    bodies = [*meta.get("bodies", []), *meta.get("points", [])]
    types = [name for layer in layers if isinstance(layer, JointLayer) for name in layer.types]
    return {
        "beam_id": [beam["name"] for beam in beams],
        "part_id": {beam["name"]: list(beam.get("parts", [])) for beam in beams},
        "section_id": {beam["name"]: list(beam.get("sections", [])) for beam in beams},
        "body_id": [body["name"] for body in bodies],
        "joint_id": [joint["name"] for joint in meta.get("joints", [])],
        "coupling_id": [coupling["name"] for coupling in meta.get("couplings", [])],
        "type": types,
    }


def _selection(times: Floats, every: int, fps: float | None) -> list[int]:
    """Numbers of the states to be written."""
    if isinstance(every, bool) or not isinstance(every, int | np.integer) or every < 1:
        raise InputError("argument every", f"got {every!r}, expected an integer of at least 1")
    if fps is None:
        return list(range(0, len(times), every))
    if every != 1:
        raise InputError("arguments every, fps", f"got {every} and {fps}, expected only one")
    if not fps > 0.0:
        raise InputError("argument fps", f"got {fps}, expected a positive number of frames per s")
    if not len(times):
        return []
    count = int(np.floor((times[-1] - times[0]) * fps * (1.0 + 1e-12))) + 1
    wanted = times[0] + np.arange(count) / fps
    right = np.clip(np.searchsorted(times, wanted), 1, max(1, len(times) - 1))
    left = right - 1
    right = np.minimum(right, len(times) - 1)
    nearest = np.where(wanted - times[left] <= times[right] - wanted, left, right)
    return [int(i) for i in np.unique(nearest)]


def write_paraview(
    history: History,
    folder: str | os.PathLike[str],
    every: int = 1,
    fps: float | None = None,
    surfaces: bool = False,
    compress: bool = False,
) -> list[Path]:
    """Write a history as ParaView series; see `ParaViewWriter` for what is in the files.

    Parameters
    ----------
    history : History
        Recorded states.
    folder : path-like
        Created if needed.
    every : int
        Write each ``every``-th state.
    fps : float, optional
        Write so many frames per second of simulated time instead (the states closest in time, with
        their own times).
    surfaces : bool
        Write the swept section surfaces too.
    compress : bool
        Compress the files.

    Returns
    -------
    list of Path
        The index files, to be opened in ParaView.

    Raises
    ------
    InputError
        If the folder cannot be written or an argument is out of range.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> q = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    >>> series = {"t": [0.0, 0.1], "step": [0, 1], "q": q, "p": q}
    >>> meta, static = {"points": [{"name": "tip"}]}, {"point/tip/offset": np.array(0)}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [path.name for path in write_paraview(History(meta, static, series), folder)]
    ['bodies.pvd']
    """
    chosen = _selection(history.times, every, fps)
    reference = history.static.get("reference")
    if reference is None and len(history):
        reference = history["q"][0]
    writer = ParaViewWriter(
        folder,
        history.meta,
        history.static,
        reference=reference,
        surfaces=surfaces,
        compress=compress,
    )
    for i in chosen:
        writer.write(float(history.times[i]), history.row(i))
    logger.info("%d frames written to %s", len(chosen), folder)
    return writer.indices
