"""A truck crosses a bridge whose deck hangs on stays; the truck's place is the load factor.

A load whose amplitude is a function of time takes the load factor in place of time in
``sc.static``: a path of equilibria in which the factor is the share of the bridge that the truck
has crossed. Dead loads act in full from the start, by ``factors``. The stays are cables that are a
little too short, so that they carry the deck. In each state the supports carry what is on the
bridge, and its middle sags alike for a place of the truck and for its mirror image.

Run ``python examples/stayed_bridge.py``; look at the sag of the middle as the truck crosses.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import skfem_cosserat as sc

PICTURE = Path(__file__).with_name("pictures") / "stayed_bridge.gif"
LENGTH, PYLONS, BELOW, ABOVE = 120.0, (30.0, 90.0), -12.0, 24.0  # m
TRUCK, PANELS = 4e5, 24  # N, elements of the deck


class LoadTruck(sc.Load):
    """A force that is shared out between the two nodes of the deck beside it."""

    def __init__(self, deck: sc.Beam, x: np.ndarray) -> None:
        super().__init__()
        self.deck, self.x = deck, x

    def terms(self) -> list[sc.TermForce]:
        """Node k has its share while the truck is on the elements beside it."""
        shares = [sc.Table(self.x / LENGTH, row) for row in np.eye(len(self.x))]
        places = [self.deck.node((x, 0, 0)) for x in self.x]
        forces = [(0, 0, -TRUCK)] * len(self.x)
        return [sc.TermForce(*each) for each in zip(places, forces, shares, strict=True)]


def bridge() -> sc.Model:
    """A box girder on two abutments and two pylons, each with six pairs of stays."""
    steel = sc.Material(E=210e9, nu=0.3, rho=7850)
    girder = sc.SectionRectangle(0.4, 6.0, sc.Material(E=30e9, nu=0.2, rho=1500))
    model = sc.Model()
    line = sc.MeshCurve.init_line((0, 0, 0), (LENGTH, 0, 0), PANELS, name="deck")
    deck = model.add("deck", sc.Beam(line, girder, order=3, director=(0, 0, 1)))
    start, end = deck.node("deck.start"), deck.node("deck.end")
    model.add("abutment", sc.JointRevolute(sc.ground((0, 0, 0)), start, axis=(0, 1, 0)))
    rail = sc.JointPointOnLine(sc.ground((LENGTH, 0, 0)), end, axis=(1, 0, 0))
    model.add("bearing", rail)
    for k, x in enumerate(PYLONS):
        foot = (x, 0, BELOW)
        mesh = sc.MeshCurve.init_line(foot, (x, 0, ABOVE), 6, name="pylon")
        tower = sc.SectionRectangle(2.0, 1.0, steel)
        pylon = model.add(f"pylon {k}", sc.Beam(mesh, tower, order=2, director=(1, 0, 0)))
        model.add(f"foot {k}", sc.JointFixed(sc.ground(foot), pylon.node("pylon.start")))
        top = pylon.node("pylon.end")
        for far in (-25.0, -15.0, -5.0, 5.0, 15.0, 25.0):
            hook = deck.node((x + far, 0, 0))
            length = float(np.linalg.norm(hook.position - top.position))
            stay = sc.Cable(hook, top, 1e9 / length, length=0.998 * length)
            model.add(f"{x + far:g} m stay", stay)
    model.add("weight", sc.LoadGravity((0, 0, -9.81)))
    model.add("truck", LoadTruck(deck, line.p[0]))
    return model


def main(positions: int = 25, out: str | Path | None = None) -> dict[str, Any]:
    """Places of the truck (m), sag (m) of the middle due to it, forces (N) and moments (N m)."""
    model = bridge()
    control = sc.LoadControl(at=np.linspace(0, 1, positions)[1:])
    path = sc.static(model, control=control, factors={"weight": 1.0})
    supports = ("abutment", "bearing", "foot 0", "foot 1")
    at = np.array([(0, 0, 0), (LENGTH, 0, 0), *((x, 0, BELOW) for x in PYLONS)])[:, None]
    force, moment = (
        np.array([path[f"joint/{s}/{k}"] for s in supports]) for k in ("force", "moment")
    )
    middle = path.position(model["deck"].node((LENGTH / 2, 0, 0)))[:, 2]
    if out is not None:
        path.animate(out, fps=10, speed=0.4, camera="xz", window=(480, 270))
    return {
        "place": LENGTH * path["load_factor"],
        "sag": middle[0] - middle,
        "up": force[..., 2].sum(axis=0),
        "lever": -(np.cross(at, force) + moment)[..., 1].sum(axis=0),
        "slackest": min(path[name].min() for name in path if name.endswith("stay/force")),
        "dead": 9.81
        * sum(model[name].rigid_body().mass for name in ("deck", "pylon 0", "pylon 1")),
    }


if __name__ == "__main__":
    result = main(out=PICTURE)
    k = result["sag"].argmax()
    print(f"truck at {result['place'][k]:g} m: the middle sags by {1e3 * result['sag'][k]:.1f} mm")
    print(f"supports carry {result['up'][k] / 1e6:.4f} MN")
    print(f"picture: {PICTURE}")
