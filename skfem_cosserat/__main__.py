"""The command line: ``python -m skfem_cosserat VERB ...``, with the verbs of `VERBS`."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .errors import CosseratError, InputError
from .version import VERSION

if TYPE_CHECKING:
    from .model import Model


def _changes(arguments: argparse.Namespace) -> str:
    """Changes that a user of an older version has to make."""
    return files(__package__).joinpath("CHANGES").read_text(encoding="utf-8").rstrip("\n")


def _warm(arguments: argparse.Namespace) -> str:
    """Compile the kernels of runs and equilibria, which takes minutes; runs find them on disk."""
    from .constraints import Multipliers, NullSpace
    from .integrators import EnergyDecaying, EnergyMomentum, GeneralizedAlpha, Stepper
    from .integrators.compiled_step import CompiledMotion
    from .newton import NewtonSettings
    from .statics import static

    for order in sorted(set(arguments.orders)):
        for model in _models(order):
            for treatment in (NullSpace(), Multipliers()):
                for scheme in (EnergyMomentum(), GeneralizedAlpha(0.8), EnergyDecaying(0.1)):
                    Stepper(model, scheme, treatment, 1e-3, kernels="numba")
                static(model, treatment, kernels="numba", derive=False)
            system = model.freeze()
            if CompiledMotion.serves(system):
                CompiledMotion(system, NewtonSettings())
    return "kernels are compiled"


def _models(order: int) -> Iterator[Model]:
    """Cantilevers that together take all kernels of beams."""
    from .beam import Beam
    from .body import RigidBody
    from .coupling import SpringDamper
    from .frames import ground
    from .joint import JointFixed, JointSpherical
    from .load import LoadForce, LoadGravity
    from .mesh import MeshCurve
    from .model import Model
    from .section import Material, SectionCircle
    from .theory import TheoryKirchhoff, TheoryReissner

    mesh = MeshCurve.init_line((0, 0, 0), (1, 0, 0), 2, name="rod")
    section = SectionCircle(0.05, Material(5e6, 0.5, 1e3))
    for kind in ("plain", "viscous", "closed", "held"):
        own = section.damped(time=1e-3) if kind == "viscous" else section
        theory = TheoryKirchhoff() if kind == "held" else TheoryReissner()
        model = Model()
        rod = model.add("rod", Beam(mesh, own, order=order, theory=theory))
        model.add("clamp", JointFixed(ground((0, 0, 0)), rod.node("rod.start")))
        model.add("gravity", LoadGravity((0, -1.0, 0)))
        end = rod.node("rod.end")
        if kind == "plain":
            model.add("spring", SpringDamper(ground((1, 1, 0)), end, stiffness=0.1, damping=0.1))
            model.add("push", LoadForce(end, (0, 0.01, 0), follower=True))
        if kind == "closed":
            model.add("ball", JointSpherical(ground((1, 0, 0)), end))
            lump = model.add("lump", RigidBody.sphere(0.1, 0.05, position=(1, 0, 0)))
            model.add("weld", JointFixed(end, lump.at((1, 0, 0))))
        yield model


#: endings of the names of files that are meshes
MESHES = (".msh", ".vtu")


def _opened(own: argparse.Namespace) -> Any:
    """What is in the file: a mesh by the ending of its name, else a history."""
    if Path(own.file).suffix not in MESHES:
        from .history import History

        return History.load(own.file)
    if own.verb not in ("info", "plot") or vars(own).get("names"):
        text = "is a mesh, in which nothing moves: expected the history of a run"
        raise InputError(f"file {own.file!r}", text)
    from .mesh import read_mesh

    return read_mesh(own.file)


def _info(own: argparse.Namespace) -> str:
    """Say what is in a history or mesh."""
    from .notebook import table_rows

    rows = table_rows(_opened(own).summary(), "\n  ")
    return "\n".join(f"{name}: {text}" for name, text in rows.items())


def _plot(own: argparse.Namespace) -> str:
    """Draw a chart of a history (of energies, or of sensors and series by name), or a mesh."""
    _opened(own).plot(*own.names, path=own.out)
    return own.out


def _film(own: argparse.Namespace) -> str:
    """Make a film of a history (.gif or .mp4)."""
    return str(_opened(own).animate(own.out, fps=own.fps, speed=own.speed))


def _report(own: argparse.Namespace) -> str:
    """Write a page about a history (.html), with a scene that turns in any browser."""
    return str(_opened(own).report(own.out))


def _paraview(own: argparse.Namespace) -> str:
    """Write the files of a history for ParaView into a folder."""
    from .export import write_paraview

    found = write_paraview(_opened(own), own.out, every=own.every, surfaces=own.surfaces)
    return "\n".join(map(str, found))


#: words, and what each gives to be written
VERBS: dict[str, Callable[[argparse.Namespace], str]] = {
    **{"changes": _changes, "warm": _warm, "info": _info, "plot": _plot},
    **{"film": _film, "report": _report, "paraview": _paraview},
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        Default: those of the process.

    Returns
    -------
    int
        Exit code; a word that is none of `VERBS` ends the process with 2, and so do files that
        cannot be read or written and packages that are missing.

    Examples
    --------
    >>> main(["changes"])  # doctest: +ELLIPSIS
    Changes of skfem-cosserat
    ...
    """
    parser = argparse.ArgumentParser(prog="python -m skfem_cosserat")
    parser.add_argument("--version", action="version", version=VERSION)
    verbs = parser.add_subparsers(dest="verb", required=True)
    made = {word: verbs.add_parser(word, help=verb.__doc__) for word, verb in VERBS.items()}
    orders = "of the beams' elements; default: 1"
    made["warm"].add_argument("--orders", nargs="+", type=int, default=[1], help=orders)
    for word in VERBS.keys() - {"changes", "warm"}:
        made[word].add_argument("file", help="a history, or a mesh (.msh, .vtu) of info and plot")
        if word != "info":
            made[word].add_argument("-o", "--out", required=True, help="what is written")
    made["plot"].add_argument("names", nargs="*", help="energy, sensors, series")
    made["film"].add_argument("--fps", type=float, default=25.0, help="pictures a second")
    made["film"].add_argument("--speed", type=float, default=1.0, help="2: twice as fast as it was")
    made["paraview"].add_argument("--every", type=int, default=1, help="only every so many states")
    made["paraview"].add_argument("--surfaces", action="store_true", help="of beams, too")
    own, more = parser.parse_known_args(arguments)
    if more:  # names may stand behind options, too
        if own.verb != "plot" or any(word.startswith("-") for word in more):
            parser.error(f"unrecognized arguments: {' '.join(more)}")
        own.names += more
    try:
        text = VERBS[own.verb](own)
    except (CosseratError, ImportError) as error:
        parser.exit(2, f"{parser.prog} {own.verb}: {' '.join(str(error).split())}\n")
    try:
        sys.stdout.write(f"{text}\n")
        sys.stdout.flush()
    except (
        BrokenPipeError
    ):  # who reads has enough, as head has; Python flushes once more at its end
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


if __name__ == "__main__":
    sys.exit(main())
