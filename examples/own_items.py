"""A load, a joint and a sensor of your own: a ball slides down a slope against the drag of the air.

- ``sc.Force`` takes any function of points, velocities and time.
- A joint writes its constraints, ``rows``, and what they leave free, ``freedom``.
- A sensor names its ``items`` and gives ``values`` at each step.

The ball starts at rest. With the drag ``c v^2`` it has the speed ``w tanh(c w t/m)`` after the
time t, where w is the final speed: ``c w^2 = m g sin(slope)``.

Run ``python examples/own_items.py``; look at how the speed levels off.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import skfem_cosserat as sc

PICTURE = Path(__file__).with_name("pictures") / "own_items.png"
MASS, DRAG, SLOPE, GRAVITY = 0.2, 0.02, np.radians(30), 9.81  # kg, kg/m, rad, m/s^2


def drag(place: sc.Place, factor: float) -> sc.Force:
    """A force (N) against the velocity v of a place, with the square of its speed."""

    def law(x: Any, v: Any, t: float) -> Any:
        # complex numbers give its derivatives, so that abs() and norm() are of no use
        return -factor * np.sqrt((v * v).sum()) * v

    return sc.Force(place, law)


class JointPointOnPlane(sc.Joint):
    """The point of side b stays in a plane that is fixed in side a."""

    type = "point on plane"
    framed_sides = ("a",)  # side b may be a mass point, which has no directions

    def __init__(self, a: sc.Place, b: sc.Place, normal: Any) -> None:
        super().__init__(a, b)
        self.normal = np.array(normal, dtype=float)

    def gap(self, r: Any) -> Any:
        """What has to vanish of ``r = x_b - x_a`` in the reference."""
        return (r @ self.normal) * self.normal

    def rows(self) -> list[Any]:
        """One constraint: the normal times the difference of the points."""
        r = sc.point(self.b) - sc.point(self.a)
        return [sc.Product(sc.direction(self.a, self.normal), r)]

    def freedom(self) -> sc.Freedom:
        """No turn is held (None); the point slides along two cross products of directions."""
        u = sc.triad(self.normal)[0]
        v = np.cross(self.normal, u)
        return sc.Freedom(None, (sc.Slide("u", self.normal, -v), sc.Slide("v", self.normal, u)))


class SensorSpeed(sc.Sensor):
    """Speed (m/s) of a mass point away from where it was in the reference."""

    unit = "m/s"
    derivative = 1  # the record is differentiated in time once

    def __init__(self, point: sc.MassPoint) -> None:
        self.point = point

    def items(self) -> list[Any]:
        """What has to be in the model."""
        return [self.point]

    def values(self, system: sc.System, window: Any) -> Any:
        """The distance (k,) at the k states of the window, with coordinates q (k, n)."""
        x = window.position(self.point.place())
        return np.linalg.norm(x - self.point.place().position, axis=1)


def main(step: float = 2e-2, until: float = 4.0, out: str | Path | None = None) -> dict[str, Any]:
    """Slide: speeds (m/s), error of the energy balance (J), distance from the plane (m)."""
    normal = np.array([np.sin(SLOPE), 0, np.cos(SLOPE)])
    model = sc.Model()
    ball = model.add("ball", sc.MassPoint(MASS, position=(0, 0, 0)))
    model.add("slope", JointPointOnPlane(sc.ground((0, 0, 0)), ball.place(), normal))
    model.add("drag", drag(ball.place(), DRAG))
    model.add("gravity", sc.LoadGravity((0, 0, -GRAVITY)))
    run = model, sc.EnergyMomentum(), sc.NullSpace(), step, until
    history = sc.simulate(*run, sensors={"speed": SensorSpeed(ball)})
    final = np.sqrt(MASS * GRAVITY * np.sin(SLOPE) / DRAG)
    times, speed = history.sensors["speed"].times, history.sensors["speed"].values
    result = {
        "speed": speed,
        "theory": final * np.tanh(DRAG * final / MASS * times),
        "balance": float(abs(history["energy_balance"]).max()),
        "off_plane": float(abs(history.position(ball.place()) @ normal).max()),
    }
    if out is not None:
        figure, (axes,) = sc.figures.panels(8, 3.5)
        axes.set(xlabel="time in s", ylabel="speed in m/s")
        axes.plot(times, speed, label="computed")
        axes.plot(times[::10], result["theory"][::10], "ko", mfc="none", label="closed form")
        sc.figures.legend(axes)
        sc.figures.write_figure(figure, out)
    return result


if __name__ == "__main__":
    result = main(out=PICTURE)
    print(f"speed {result['speed'][-1]:.4f} m/s, by closed form {result['theory'][-1]:.4f} m/s")
    print(f"energy within {result['balance']:.1e} J, off the slope by {result['off_plane']:.1e} m")
