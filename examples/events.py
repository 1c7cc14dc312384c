"""A chain of three bars swings down, locks its lowest joint as it stretches, and lets its end go.

Three events, each located in time: a motor at the first bar is switched off when the ball at the
end has fallen by 0.3 m; the joint between the second and the third bar locks when they are in
line again (an inelastic impact, which takes energy); and the ball is released when it gets to
0.4 m on the other side, to fly on along a parabola. Steps follow from a tolerance.

Run ``python examples/events.py``; it prints what happened and, with ``--out``, draws a picture
(needs matplotlib).
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy: small matrices

import argparse
from pathlib import Path
from typing import Any

import numpy as np

import skfem_cosserat as sc
from skfem_cosserat.figures import new_figure, write_figure

LENGTH, MASS, WEIGHT = 0.4, 0.5, 0.3  # m, kg, kg
GRAVITY = 9.81  # m/s^2


def scene() -> tuple[sc.System, dict[str, Any]]:
    """The chain, stretched out to the right, and what the events are about."""
    model = sc.Model()
    last, items = sc.ground((0, 0, 0)), {}
    for k, name in enumerate(("first", "second", "third")):
        middle = (LENGTH * (k + 0.5), 0.0, 0.0)
        bar = sc.RigidBody.box(MASS, (LENGTH, 0.03, 0.03), position=middle)
        model.add(name, bar)
        joint = sc.JointRevolute(last, bar.at((LENGTH * k, 0, 0)), axis=(0, 1, 0))
        items[f"joint {k}"] = model.add(f"joint {k}", joint)
        last = bar.at((LENGTH * (k + 1), 0, 0))
        items[name] = bar
    ball = model.add("ball", sc.RigidBody.sphere(WEIGHT, radius=0.04, position=last.position))
    items["hook"] = model.add("hook", sc.JointFixed(last, ball.at(last.position)))
    items["ball"] = ball
    items["motor"] = model.add("motor", sc.LoadMoment(items["first"].at((0.2, 0, 0)), (0, -2.0, 0)))
    model.add("gravity", sc.LoadGravity((0, 0, -GRAVITY)))
    return model.freeze(), items


def events(items: dict[str, Any]) -> list[sc.Event]:
    """What is to happen."""
    ball = items["ball"].at((3 * LENGTH, 0, 0))
    return [
        sc.Event(
            sc.ConditionSensor(sc.SensorPosition(ball), level=-0.3, component=2),
            sc.ActionLoad(items["motor"], 0.0),
            direction=-1,
            name="motor off",
        ),
        sc.Event(
            sc.ConditionCoordinate(items["joint 2"], level=0.0),
            sc.ActionLock(items["joint 2"]),
            name="knee locks",
        ),
        sc.Event(
            sc.ConditionSensor(sc.SensorPosition(ball), level=-0.4, component=0),
            sc.ActionRelease(items["hook"]),
            direction=-1,
            name="ball let go",
        ),
    ]


def main(
    tolerance: float = 1e-3, until: float = 1.1, out: str | Path | None = None
) -> dict[str, Any]:
    """Run the scene.

    Parameters
    ----------
    tolerance : float
        Of the whole run, relative to its extent.
    until : float
        End (s).
    out : path, optional
        Picture to write.

    Returns
    -------
    dict
        ``times`` (s) and ``losses`` (J) of the events by name, ``balance``: largest error of the
        balance of energy (J), ``parabola``: largest distance (m) of the released ball from its
        parabola, ``steps`` and ``rejected``, ``history``.
    """
    system, items = scene()
    run = system, sc.EnergyMomentum(), sc.NullSpace(), sc.StepControl(tolerance), until
    history = sc.simulate(*run, events=events(items))
    ball = items["ball"].local((0, 0, 0))
    parabola = np.nan
    for event in history.events:
        if event.name == "ball let go":
            row = event.row + 1
            t = (history.times[row:] - event.time)[:, None]
            x, v = history.position(ball), history.velocity(ball)
            flight = x[row] + v[row] * t + np.array([0, 0, -GRAVITY / 2]) * t**2
            parabola = float(abs(x[row:] - flight).max())
    control = history.meta["step_control"]
    if out is not None:
        _picture(items, history, out)
    return {
        "times": {event.name: event.time for event in history.events},
        "losses": {event.name: event.loss for event in history.events},
        "balance": float(abs(history["energy_balance"]).max()),
        "parabola": parabola,
        "steps": control["accepted"],
        "rejected": control["rejected"],
        "history": history,
    }


def _picture(items: dict[str, Any], history: sc.History, path: str | Path) -> None:
    """The chain at some instants, the way of the ball, and where something happened."""
    figure = new_figure(6.0, 4.5)
    axes = figure.add_subplot()
    rows = sorted({event.row for event in history.events} | {0, len(history) - 1})
    for row in rows:
        points = [np.zeros(3)]
        for name in ("first", "second", "third"):
            middle = history.position(items[name].local((0, 0, 0)))[row]
            points.append(2 * middle - points[-1])
        x = np.array(points)
        axes.plot(x[:, 0], x[:, 2], "o-", lw=1.5, label=f"{history.times[row]:.3f} s")
    way = history.position(items["ball"].local((0, 0, 0)))
    axes.plot(way[:, 0], way[:, 2], "k:", lw=1)
    for event in history.events:
        axes.annotate(event.name, way[event.row, ::2])
    axes.set(xlabel="x in m", ylabel="z in m", aspect="equal")
    axes.legend()
    write_figure(figure, path)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tolerance", type=float, default=1e-3)
    parser.add_argument("--until", type=float, default=1.1)
    parser.add_argument("--out", default=None)
    result = main(**vars(parser.parse_args()))
    for record in result["history"].events:
        print(record)
    print(f"{result['steps']} steps, {result['rejected']} pairs rejected")
    print(
        f"balance of energy within {result['balance']:.1e} J, parabola {result['parabola']:.1e} m"
    )
