"""A long thin blade tumbles freely; every element goes at a step of its own.

A short part in its middle is meshed finely and a hundred times as stiff as the rest, so that its
elements need steps a tenth as long as those of the others. The asynchronous integrator evaluates
the others a tenth as often; energy stays within a bound and momenta are exact, from a blade that is
nearly rigid to a soft one, whose ends flap.
"""

from __future__ import annotations

import argparse
import time
from typing import Any

import numpy as np

import skfem_cosserat as sc

#: Young's moduli of the soft part (Pa)
BLADES = {"nearly rigid": 1e10, "middle": 1e8, "soft": 3e6}
#: how much stiffer the middle is; elements before it, in it and after it
STIFFER, COUNTS = 100.0, (20, 10, 20)
LENGTH, MIDDLE = 1.0, 0.05
SPIN = 6.0  # rad/s, about the axis across the blade's plane


def blade(modulus: float) -> sc.System:
    """A free blade, 20 mm x 2 mm, that turns about its middle and is bent by its velocities."""
    half = 0.5 * (LENGTH - MIDDLE)
    cuts = np.array([0.0, half, half + MIDDLE, LENGTH])
    legs = zip(("first", "middle", "last"), cuts[:-1], cuts[1:], COUNTS, strict=True)
    pieces = [
        sc.MeshCurve.init_line((a, 0, 0), (b, 0, 0), count, name=name) for name, a, b, count in legs
    ]
    mesh = pieces[0].joined(*pieces[1:])
    soft, stiff = (
        sc.SectionRectangle(0.02, 0.002, sc.Material(E, 0.3, 1200.0))
        for E in (modulus, STIFFER * modulus)
    )

    def velocity(X: np.ndarray) -> np.ndarray:
        s = X[:, 0] - 0.5 * LENGTH
        flap = 0.1 * SPIN * LENGTH * (1 - (2 * s / LENGTH) ** 2)
        return np.column_stack([0 * s, SPIN * s, flap])

    model = sc.Model()
    sections = {"first": soft, "middle": stiff, "last": soft}
    spin = (0.0, 0.0, SPIN)
    motion: dict[str, Any] = {"velocity": velocity, "angular_velocity": spin}
    model.add("blade", sc.Beam(mesh, sections, director=(0, 1, 0), lumped=True, **motion))
    return model.freeze()


def run(modulus: float, element_steps: int, kernels: str = "auto") -> dict[str, float]:
    """Energy, momenta and evaluations of elements over so many steps of the fastest element."""
    system = blade(modulus)
    integrator = sc.Asynchronous()
    limits = sc.Asynchronous(safety=1.0).limits(system)[0]
    step = 0.999 * integrator.safety * float(limits.max())
    counts = integrator.counts(system, step)[0]
    fast = limits < 0.5 * limits.max()
    f, r = float(fast.mean()), float(limits[~fast].min() / limits[fast].max())
    every = int(np.ceil(element_steps / counts.max()))
    begun = time.perf_counter()
    history = sc.simulate(
        system,
        integrator,
        sc.Multipliers(),
        step=step,
        until=every * step,
        every=max(1, every // 400),
        kernels=kernels,
    )
    seconds = time.perf_counter() - begun
    energy = history["energy"]
    kinetic = history["kinetic"][0]
    errors = {
        name: float(abs(history[name] - history[name][0]).max() / abs(history[name][0]).max())
        for name in ("linear_momentum", "angular_momentum")
    }
    halves = np.array_split(energy - energy[0], 2)
    saving = len(counts) * counts.max() / counts.sum()
    return {
        "fine share": f,
        "step ratio": r,
        "element steps": float(every * counts.max()),
        "saving": float(saving),
        "ideal": 1 / (f + (1 - f) / r),
        "energy error": float(abs(energy - energy[0]).max() / kinetic),
        "first half": float(abs(halves[0]).max() / kinetic),
        "second half": float(abs(halves[1]).max() / kinetic),
        "strain energy": float(history["strain_energy"].max() / kinetic),
        "angular momentum": errors["angular_momentum"],
        "linear momentum": float(
            abs(history["linear_momentum"] - history["linear_momentum"][0]).max()
        ),
        "seconds": seconds,
    }


def main(element_steps: int = 100_000, kernels: str = "auto") -> dict[str, dict[str, float]]:
    """Numbers of :func:`run` for the blades from nearly rigid to soft."""
    return {name: run(E, element_steps, kernels) for name, E in BLADES.items()}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--element-steps", type=int, default=100_000, help="of the fastest element")
    for blade_name, numbers in main(parser.parse_args().element_steps).items():
        print(f"{blade_name}:", ", ".join(f"{key} {value:.4g}" for key, value in numbers.items()))
