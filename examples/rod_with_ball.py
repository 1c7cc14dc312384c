"""A rubber rod swings down from its hinge and carries a ball: a first scene in time.

The rod starts at rest along x; gravity acts along -y. The energy-momentum scheme keeps the total
energy to rounding. Run ``python examples/rod_with_ball.py``: it makes a film of the swing and
writes files for ParaView; open ``rod_with_ball_results/scene.pvd`` there, or run ``paraview.py`` of
that folder.
"""

from pathlib import Path

import skfem_cosserat as sc

PICTURE = Path(__file__).with_name("pictures") / "rod_with_ball.gif"


def main(elements=16, step=2e-3, until=0.5, modulus=5e6, out=None, paraview=None) -> dict:
    """Swing: times (s), heights of the ball (m), drift of the energy (J), and the history."""
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), elements, name="rod")
    rubber = sc.SectionCircle(radius=1e-2, material=sc.Material(E=modulus, nu=0.5, rho=1100))
    model = sc.Model()
    rod = model.add("rod", sc.Beam(mesh, rubber, director=(0, 1, 0)))
    hinge = sc.JointRevolute(sc.ground((0, 0, 0)), rod.node("rod.start"), axis=(0, 0, 1))
    model.add("hinge", hinge)
    model.add("ball", sc.RigidBody.sphere(0.05, radius=0.02, on=rod.node("rod.end")))
    model.add("gravity", sc.LoadGravity((0, -9.81, 0)))

    history = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), step, until)
    total = history["energy"] + history["external"]  # kinetic, elastic and potential energy
    if paraview is not None:
        sc.write_paraview(history, paraview, every=5)
    if out is not None:
        history.animate(out, fps=25, speed=0.5, camera="xy", window=(480, 360))
    return {
        "times": history.times,
        "height": history.position(rod.node("rod.end"))[:, 1],
        "drift": float(abs(total - total[0]).max()),
        "history": history,
    }


if __name__ == "__main__":
    result = main(out=PICTURE, paraview="rod_with_ball_results")
    print(f"drift of the energy: {result['drift']:.1e} J")
    print(f"ball after {result['times'][-1]:g} s: {result['height'][-1]:.3f} m above the hinge")
    print(f"picture: {PICTURE}; for ParaView: rod_with_ball_results/*.pvd")
