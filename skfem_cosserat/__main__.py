"""The command line: ``python -m skfem_cosserat changes``, ``python -m skfem_cosserat warm``."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from importlib.resources import files
from typing import TYPE_CHECKING

from .version import VERSION

if TYPE_CHECKING:
    from .model import Model

__all__ = ["main"]


def _changes(arguments: argparse.Namespace) -> str:
    """Changes that a user of an older version has to make."""
    return files(__package__).joinpath("CHANGES").read_text(encoding="utf-8")


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
    return "kernels are compiled\n"


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


#: words, and what each gives to be written
VERBS: dict[str, Callable[[argparse.Namespace], str]] = {"changes": _changes, "warm": _warm}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        Default: those of the process.

    Returns
    -------
    int
        Exit code; a word that is none of `VERBS` ends the process with 2, and so do kernels that
        cannot be compiled as numba is missing.

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
    own = parser.parse_args(arguments)
    try:
        text = VERBS[own.verb](own)
    except ImportError as error:
        parser.error(str(error))
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except (
        BrokenPipeError
    ):  # who reads has enough, as head has; Python flushes once more at its end
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


if __name__ == "__main__":
    sys.exit(main())
