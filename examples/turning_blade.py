"""Vibrations of a blade on a turning rotor: its frequencies grow with the speed.

The blade is clamped on the axis of the rotor. ``sc.Spin`` is the turning frame from which it is
seen: ``sc.static`` stretches the blade by the centrifugal force, ``sc.modes`` finds its vibrations
about that state. Frequencies of flapping (out of the plane of rotation) agree with those of Ritz's
method with polynomials. With equal stiffness both ways, the blade swings in the plane of rotation
with ``omega_lag^2 = omega_flap^2 - Omega^2``.

Run ``python examples/turning_blade.py``; it draws the frequencies against the speed (Southwell's
diagram) and writes a mode at the highest speed for ParaView: ``turning_blade_results/beams.pvd``.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import eigh

import skfem_cosserat as sc

PICTURE = Path(__file__).with_name("pictures") / "turning_blade.png"
LENGTH, EI, MASS = 1.0, 20.0, 0.8  # m, N m^2, kg/m
#: time scale: frequencies times this are dimensionless
SCALE = (MASS * LENGTH**4 / EI) ** 0.5
SPEEDS = (0, 1, 2, 4, 8, 12)  # of the rotor, dimensionless


def ritz(speed: float, count: int = 9) -> np.ndarray:
    """First two dimensionless frequencies of flapping, with x^2 times Legendre polynomials."""
    x, weights = np.polynomial.legendre.leggauss(40)
    x, weights = (x + 1) / 2, weights / 2
    square = np.polynomial.Polynomial([0, 0, 1])
    bases = [np.polynomial.Legendre.basis(k, [0, 1]) for k in range(count)]
    shapes = [square * base.convert(kind=np.polynomial.Polynomial) for base in bases]
    w, slope, bend = (np.array([shape.deriv(k)(x) for shape in shapes]) for k in range(3))
    tension = speed**2 * (1 - x**2) / 2  # of the centrifugal force
    K = (weights * bend) @ bend.T + (weights * tension * slope) @ slope.T
    return np.sqrt(eigh(K, (weights * w) @ w.T, eigvals_only=True))[:2]


def blade(elements: int = 6, order: int = 4) -> sc.Model:
    """A thin blade along x from the axis: no shear, no extension, hardly any inertia of turning."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (LENGTH, 0, 0), elements, name="blade")
    section = sc.Section.from_constants(
        EA=1e6, GA=4e5, EI=(EI, EI), GJ=15.0, mass=MASS, inertia=(1e-9, 1e-9)
    )
    model = sc.Model()
    beam = sc.Beam(
        mesh, section, order=order, director=(0, 0, 1), theory=sc.TheoryInextensible(torsion=False)
    )
    model.add("blade", beam)
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), beam.node("blade.start")))
    return model


def main(
    speeds: Sequence[float] = SPEEDS,
    out: str | Path | None = None,
    paraview: str | Path | None = None,
) -> dict[str, Any]:
    """Dimensionless frequencies of flapping and lagging at dimensionless speeds, two of each."""
    system = blade().freeze()
    flap, lag = [], []
    for speed in speeds:
        state = None
        if speed:
            spin = sc.Spin((0, 0, speed / SCALE))
            state = sc.static(system, control=sc.LoadControl(steps=1), spin=spin, watch=False)
        modes = sc.modes(system, state, count=4)
        omega = SCALE * modes.omega  # lag 1, flap 1, lag 2, flap 2 at all of these speeds
        lag.append(omega[[0, 2]])
        flap.append(omega[[1, 3]])
    if paraview is not None:
        sc.write_paraview(modes.animation(2), paraview)
    result = {"speeds": np.array(speeds), "flap": np.array(flap), "lag": np.array(lag)}
    result["ritz"] = np.array([ritz(speed) for speed in speeds])
    if out is not None:
        draw(result, out)
    return result


def draw(result: dict[str, Any], path: str | Path) -> None:
    """Southwell's diagram."""
    figure, (axes,) = sc.figures.panels(8.5, 4.5)
    colours = list(sc.figures.PALETTE.values())
    for name, style in (("flap", "-"), ("lag", "--")):
        for k, omega in enumerate(result[name].T):
            axes.plot(result["speeds"], omega, style, color=colours[k], label=f"{name} {k + 1}")
    axes.plot(result["speeds"], result["ritz"], "ko", mfc="none", label=["Ritz", None])
    axes.set(xlabel="speed of the rotor, dimensionless", ylabel="angular frequency, dimensionless")
    sc.figures.legend(axes)
    sc.figures.write_figure(figure, path)


if __name__ == "__main__":
    result = main(out=PICTURE, paraview="turning_blade_results")
    print("speed   flap 1   flap 2    lag 1    lag 2     Ritz 1   Ritz 2  (times sqrt(m L^4/EI))")
    for speed, flap, lag, known in zip(*result.values(), strict=True):
        print(f"{speed:5g}", *(f"{value:8.4f}" for value in (*flap, *lag)), end="  ")
        print(*(f"{value:8.4f}" for value in known))
    print(f"picture: {PICTURE}; for ParaView: turning_blade_results/beams.pvd")
