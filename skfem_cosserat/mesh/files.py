"""Reading and writing meshes of lines: gmsh, VTU and what else meshio reads."""

from __future__ import annotations

from os import PathLike

from .mesh import MeshCurve

__all__ = ["read_mesh", "write_mesh"]


def read_mesh(path: str | PathLike[str]) -> MeshCurve:
    """Mesh from the straight lines of a file.

    Elements are chords; where those of one beam meet at a small angle they share a mean tangent
    (``feature_angle`` of :class:`MeshCurve`). Lines of a beam that point against each other are
    turned; lines in no group belong to no beam (``mesh.unnamed_elements()``); points that belong
    to no line are dropped.

    Parameters
    ----------
    path : path
        gmsh ``.msh`` 4.1 or 2.2: physical lines are beams, physical points are named nodes. VTU:
        cell data ``beam:NAME`` and point data ``node:NAME``, 1 for members and 0 for others. Other
        formats as far as meshio reads them: sets of cells are beams, sets of points are nodes.

    Raises
    ------
    MeshError
        If the file cannot be read, has no lines, has quadratic lines, or names a point that
        belongs to no line.

    Examples
    --------
    >>> import tempfile, os
    >>> path = os.path.join(tempfile.mkdtemp(), "line.msh")
    >>> write_mesh(path, MeshCurve.init_line((0, 0, 0), (1, 0, 0), 3, name="boom"))
    >>> list(read_mesh(path).beams)
    ['boom']
    """
    return MeshCurve.load(path)


def write_mesh(path: str | PathLike[str], mesh: MeshCurve, file_format: str | None = None) -> None:
    """Write vertices, elements and names without loss.

    Curves are not written: a file knows straight lines only. Coordinates keep all their digits.

    Parameters
    ----------
    path : path
        Ends in ``.msh`` or ``.vtu``.
    mesh : MeshCurve
        The mesh.
    file_format : str, optional
        ``"gmsh"`` (ASCII 4.1, default for ``.msh``), ``"gmsh22"`` (ASCII 2.2) or ``"vtu"``.

    Raises
    ------
    MeshError
        If the format is unknown or cannot hold a name.

    Examples
    --------
    >>> import tempfile, os
    >>> mesh = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 3, name="boom")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_mesh(os.path.join(folder, "boom.msh"), mesh)
    ...     os.listdir(folder)
    ['boom.msh']
    """
    mesh.save(path, file_format=file_format)
