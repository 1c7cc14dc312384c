"""The ground shakes a damped mast: sensors record its top, a spectrum shows its first frequency.

``sc.MotionShake`` moves the ground by a record of accelerations: two seconds of noise, in which all
frequencies are present. The mast goes on swinging afterwards. The highest peak of the spectrum of
that free vibration is the first frequency of ``sc.modes``, and its amplitude decays with the
damping ratio that ``sc.RayleighDamping`` was made for.

Run ``python examples/shaken_mast.py``; look at the peak of the spectrum.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import skfem_cosserat as sc

PICTURE = Path(__file__).with_name("pictures") / "shaken_mast.png"
HEIGHT, SHAKEN = 4.0, 2.0  # m, s
RATIO = 0.01  # of critical damping, in the first mode


def record(seed: int = 1) -> sc.MotionShake:
    """Noise along x (m/s^2) that sets in and ends smoothly; the ground ends at rest."""
    times = np.linspace(0, SHAKEN, 201)
    noise = np.random.default_rng(seed).standard_normal(len(times))
    acceleration = 2.0 * np.sin(np.pi * times / SHAKEN) ** 2 * noise
    return sc.MotionShake(times, np.outer(acceleration, (1.0, 0, 0)), baseline=True)


def mast(damping: float = 0.0, motion: sc.Motion | None = None) -> sc.Model:
    """A steel tube with a lamp on its top; `damping` is the retardation time of the steel (s)."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (0, 0, HEIGHT), 4, name="mast")
    steel = sc.Material(E=210e9, nu=0.3, rho=7850)
    model = sc.Model()
    tube = sc.SectionTube(0.03, 0.027, steel)
    beam = model.add("mast", sc.Beam(mesh, tube, order=2, director=(1, 0, 0)))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0), motion), beam.node("mast.start")))
    model.add("lamp", sc.RigidBody.sphere(5.0, radius=0.1, on=beam.node("mast.end")))
    if damping:
        model.add("damping", sc.RayleighDamping(stiffness=damping))
    return model


def main(step: float = 1e-2, until: float = 16.0, out: str | Path | None = None) -> dict[str, Any]:
    """Shake and let swing: first frequency (Hz) and damping ratio, by modes and by the sensor."""
    omega = sc.modes(mast(), count=1).omega[0]
    damping = 2 * RATIO / omega  # the ratio is damping * omega/2
    motion = record()
    model = mast(damping, motion)
    modes = sc.modes(model, count=1, t=0.0)
    beam = model["mast"]
    sensors = {  # at every step; the top as seen from the moving ground
        "top": sc.SensorPosition(beam.node("mast.end"), frame=sc.ground((0, 0, 0), motion)),
        "foot": sc.SensorForce(beam, 0.0),
    }
    history = sc.simulate(
        model, sc.EnergyMomentum(), sc.NullSpace(), step, until, every=100, sensors=sensors
    )
    times, x = history.sensors["top"].times, history.sensors["top"].values[:, 0]
    free = times >= SHAKEN
    swing = x[free]
    spectrum = sc.spectrum(times[free], swing)
    # one amplitude a period
    peak = (swing[1:-1] > swing[:-2]) & (swing[1:-1] > swing[2:]) & (swing[1:-1] > 0)
    when, height = times[free][1:-1][peak], swing[1:-1][peak]
    decay = np.polyfit(when, np.log(height), 1)[0]
    result = {
        "frequency": float(modes.frequencies[0]),
        "peak": float(spectrum.peaks(1)[0]),
        "ratio": float(modes.damping_ratios[0]),
        "decay": float(-decay / omega),
        "times": times,
        "top": x,
        "moment": np.linalg.norm(history.sensors["foot"].values[:, 3:5], axis=1),
        "spectrum": spectrum,
    }
    if out is not None:
        draw(result, out)
    return result


def draw(result: dict[str, Any], path: str | Path) -> None:
    """The motion of the top against the ground, and the spectrum of its free vibration."""
    figure, (upper, lower) = sc.figures.panels(8.5, 5, 2, 1)
    upper.plot(result["times"], 1e3 * result["top"], lw=1)
    upper.axvspan(0, SHAKEN, color="0.9", label="the ground shakes")
    upper.set(xlabel="time in s", ylabel="top against ground in mm")
    lower.semilogy(result["spectrum"].frequencies, 1e3 * result["spectrum"].amplitudes)
    lower.axvline(result["frequency"], color="k", ls=":", label="first frequency by modes")
    lower.set(xlabel="frequency in Hz", ylabel="amplitude in mm", xlim=(0, 10), ylim=(1e-6, 10))
    sc.figures.legend(upper)
    sc.figures.legend(lower)
    sc.figures.write_figure(figure, path)


if __name__ == "__main__":
    result = main(out=PICTURE)
    print(f"first frequency: {result['frequency']:.3f} Hz, peak at {result['peak']:.3f} Hz")
    print(f"damping ratio: {result['ratio']:.4f}, from the decay {result['decay']:.4f}")
    print(f"largest moment at the foot: {result['moment'].max():.1f} N m\npicture: {PICTURE}")
