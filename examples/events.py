"""A chain of three bars swings down, locks its lowest joint as it stretches, and lets its end go.

``sc.Event`` joins a condition and an action; the instant is located inside of a step. Here a motor
at the first bar is switched off when the ball at the end has fallen by 0.3 m. The joint between the
second and the third bar locks when both are in line again: an impact, which takes energy. The
ball is released 0.4 m to the left of the hinge and flies on along a parabola.

Run ``python examples/events.py``. It prints each event with its time and the energy that it took;
look at where the marks are on the path of the ball in the picture.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import skfem_cosserat as sc

PICTURE = Path(__file__).with_name("pictures") / "events.png"
LENGTH, MASS, WEIGHT = 0.4, 0.5, 0.3  # m, kg, kg
GRAVITY = np.array([0, 0, -9.81])  # m/s^2


def scene() -> sc.Model:
    """The chain, stretched out to the right."""
    model = sc.Model()
    last = sc.ground((0, 0, 0))
    for k in range(3):
        middle = (LENGTH * (k + 0.5), 0.0, 0.0)
        bar = sc.RigidBody.box(MASS, (LENGTH, 0.03, 0.03), position=middle)
        model.add(f"bar {k}", bar)
        joint = sc.JointRevolute(last, bar.at((LENGTH * k, 0, 0)), axis=(0, 1, 0))
        model.add(f"joint {k}", joint)
        last = bar.at((LENGTH * (k + 1), 0, 0))
    ball = model.add("ball", sc.RigidBody.sphere(WEIGHT, radius=0.04, position=last.position))
    model.add("hook", sc.JointFixed(last, ball.at(last.position)))
    model.add("motor", sc.LoadMoment(model["bar 0"].at((0.2, 0, 0)), (0, -2.0, 0)))
    model.add("gravity", sc.LoadGravity(GRAVITY))
    return model


def events(model: sc.Model) -> list[sc.Event]:
    """What is to happen: a condition, an action, and a name."""
    ball = sc.SensorPosition(model["ball"].local((0, 0, 0)))
    low = sc.ConditionSensor(ball, level=-0.3, component=2)
    left = sc.ConditionSensor(ball, level=-0.4, component=0)
    knee = model["joint 2"]
    return [
        sc.Event(low, sc.ActionLoad(model["motor"], 0.0), direction=-1, name="motor off"),
        sc.Event(sc.ConditionCoordinate(knee, level=0.0), sc.ActionLock(knee), name="knee locks"),
        sc.Event(left, sc.ActionRelease(model["hook"]), direction=-1, name="ball let go"),
    ]


def main(
    tolerance: float = 1e-3, until: float = 1.1, out: str | Path | None = None
) -> dict[str, Any]:
    """Run with the steps that `tolerance` (relative to the extent of the scene) allows.

    Gives ``times`` (s) and ``losses`` (J) of the events by name, the largest error of the energy
    ``balance`` (J), the largest distance of the released ball from its ``parabola`` (m), ``steps``
    and ``rejected`` pairs of steps, and the ``history``.
    """
    model = scene()
    control = sc.StepControl(tolerance)
    run = model, sc.EnergyMomentum(), sc.NullSpace(), control, until
    history = sc.simulate(*run, events=events(model))
    ball = model["ball"].local((0, 0, 0))
    x, v = history.position(ball), history.velocity(ball)
    free = history.events[-1].row + 1  # the first state after the release
    t = (history.times[free:] - history.times[free])[:, None]
    flight = x[free] + v[free] * t + GRAVITY / 2 * t**2
    if out is not None:
        draw(model, history, out)
    return {
        "times": {event.name: event.time for event in history.events},
        "losses": {event.name: event.loss for event in history.events},
        "balance": float(abs(history["energy_balance"]).max()),
        "parabola": float(abs(x[free:] - flight).max()),
        "steps": history.meta["step_control"]["accepted"],
        "rejected": history.meta["step_control"]["rejected"],
        "history": history,
    }


def draw(model: sc.Model, history: sc.History, path: str | Path) -> None:
    """The chain at the start, at each event and at the end; the path of the ball."""
    figure, (axes,) = sc.figures.panels(8.5, 3.2)
    names = {0: "start", **{e.row: e.name for e in history.events}, len(history) - 1: "end"}
    ends = [model[f"bar {k}"].local((x, 0, 0)) for k in range(3) for x in (-0.2, 0.2)]
    chain = np.array([history.position(place) for place in ends])
    ball = history.position(model["ball"].local((0, 0, 0)))
    axes.plot(*ball[:, ::2].T, "k:", lw=1)
    for row, name in names.items():
        text = f"{history.times[row]:.3f} s: {name}"
        (line,) = axes.plot(*chain[:, row, ::2].T, ".-", label=text)
        axes.plot(*ball[row, ::2], "o", ms=9, color=line.get_color())
    axes.set(xlabel="x in m", ylabel="z in m", aspect="equal")
    sc.figures.legend(axes)
    sc.figures.write_figure(figure, path)


if __name__ == "__main__":
    result = main(out=PICTURE)
    print(*result["history"].events, sep="\n")
    print(f"{result['steps']} steps, {result['rejected']} pairs rejected")
    print(f"energy within {result['balance']:.1e} J, parabola within {result['parabola']:.1e} m")
    print(f"picture: {PICTURE}")
