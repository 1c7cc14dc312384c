"""ParaView files of real scenes, read by VTK: forces, stresses, names, units, fields of states."""

from __future__ import annotations

import numpy as np
import pytest
from test_export import read_index, read_vtu, values_of

import skfem_cosserat as sc
from skfem_cosserat.profile import ProfileI, ProfileRectangle

SOFT = sc.Section([1e3, 1.2e3, 5e3, 4.0, 6.0, 5.0], mass=1.0, inertia=(0.01, 0.02))
STEEL = sc.Material(210e9, 0.3, 7850.0)
TIP = np.array([-1.0, 4.0, 2.0])


def cantilever(section, order, elements):
    """A beam of 1 m along x, clamped at its start, pushed at its end and along it."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), elements, name="rod", nodes={"mid": 0.5})
    rod = model.add("rod", sc.Beam(mesh, section, order=order, director=(0, 0, 1)))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    model.add("tip", sc.LoadForce(rod.node("rod.end"), TIP))
    model.add("wind", sc.LoadLine(rod, (2.0, -6.0, 4.0)))
    return model, rod


def last(folder, layer="beams"):
    """Arrays of the last frame of a layer, as `read_vtu` gives them."""
    return read_vtu(folder / read_index(folder / f"{layer}.pvd")[-1][1])


def block(folder, layer, number=-1):
    """The grid of a layer in a state, with all that VTK's reader of XML files finds."""
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridReader

    reader = vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(folder / read_index(folder / f"{layer}.pvd")[number][1]))
    reader.Update()
    return reader.GetOutput()


def units(data):
    """Units of the arrays of a grid's points, cells or fields by their names."""
    from vtkmodules.vtkCommonCore import vtkDataArray

    key, found = vtkDataArray.UNITS_LABEL(), {}
    for k in range(data.GetNumberOfArrays()):
        array = data.GetAbstractArray(k)
        if array.HasInformation() and array.GetInformation().Has(key):
            found[array.GetName()] = array.GetInformation().Get(key)
    return found


def at_root(model, beam, history, folder):
    """Forces and strains (6,) at the start of the beam in the last file; reaction of the clamp."""
    sc.write_paraview(history, folder, every=max(1, len(history) - 1))
    points, _, _, at_points, _ = last(folder)
    start = np.linalg.norm(points, axis=1).argmin()  # it stays where it is
    pairs = ("N", "M"), ("Gamma", "K")
    forces, strains = (np.concatenate([at_points[name][start] for name in pair]) for pair in pairs)
    triad = history.rotation(beam.node("rod.start"))[-1]
    reaction = [triad @ history[f"joint/clamp/{kind}"][-1] for kind in ("force", "moment")]
    return forces, strains, np.concatenate(reaction)


@pytest.mark.one_quick
@pytest.mark.parametrize(("order", "coarse"), [(1, 16), (2, 8), (3, 4)])
def test_forces_at_ends_are_of_order_2p_at_rest(order, coarse, tmp_path):
    found = []
    for elements, p in ((coarse, order), (2 * coarse, order), (20, 4)):
        model, rod = cantilever(SOFT, p, elements)
        path = sc.static(model, watch=False)
        forces, strains, reaction = at_root(model, rod, path, tmp_path / f"{p} {elements}")
        assert abs(forces + reaction).max() < 1e-9
        np.testing.assert_allclose(SOFT.stiffness @ strains, forces, rtol=1e-10, atol=1e-10)
        found.append(forces)
    errors = [abs(each - found[-1]).max() for each in found[:2]]
    assert abs(np.log2(errors[0] / errors[1]) - 2 * order) < 0.3


@pytest.mark.slow
@pytest.mark.parametrize(("order", "coarse"), [(1, 8), (2, 4), (3, 2)])
def test_forces_at_ends_are_of_order_2p_in_motion(order, coarse, tmp_path):
    """Turned by the clamp, up from rest: what follows exactly one steps are the same in all."""

    def run(elements, order):
        model = sc.Model()
        turning = sc.MotionTurn((0, 1, 0), lambda t: 2.0 * t**4)
        mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), elements, name="rod")
        rod = model.add("rod", sc.Beam(mesh, SOFT, order=order, director=(0, 0, 1)))
        start = rod.node("rod.start")
        model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0), turning), start))
        history = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 2e-3, until=0.5)
        forces, _, reaction = at_root(model, rod, history, tmp_path / f"{order} {elements}")
        assert abs(forces + reaction).max() < 1e-3 * abs(forces).max()  # of the scheme's order
        return forces

    exact = run(12, 4)
    errors = [abs(run(elements, order) - exact).max() for elements in (coarse, 2 * coarse)]
    assert abs(np.log2(errors[0] / errors[1]) - 2 * order) < 0.3


def test_points_are_doubled_where_forces_jump(tmp_path):
    """Under a force and at a kink; not elsewhere, and not without them."""
    model, rod = cantilever(SOFT, 2, 4)
    sc.write_paraview(sc.static(model, watch=False), tmp_path)
    assert len(last(tmp_path)[0]) == 9
    model.add("push", sc.LoadForce(rod.node("mid"), (0, 0, 3.0)))
    path = sc.static(model, watch=False)
    sc.write_paraview(path, tmp_path)
    points, cells, _, at_points, at_cells = last(tmp_path)
    assert len(points) == 10
    same = np.linalg.norm(points - points[-1], axis=1) == 0
    assert same.sum() == 2 and np.unique(at_points["node_id"][same]).size == 1
    nodal = path["beam/rod/nodal_resultant"][-1]
    for cell, forces in zip(cells, nodal, strict=True):
        both = np.hstack([at_points["N"][cell[:2]], at_points["M"][cell[:2]]])
        np.testing.assert_allclose(both, forces, atol=1e-7)
    np.testing.assert_allclose(at_cells["N"], path["beam/rod/resultant"][-1].mean(1)[:, :3])


def surface(section, folder):
    """Fields at the root of a cantilever's surface, and forces of the lines there."""
    model, _ = cantilever(section, 1, 4)
    path = sc.static(model, watch=False)
    sc.write_paraview(path, folder, surfaces=True)
    points, *_, at_points, _ = last(folder, "beam_surfaces")
    lines = last(folder)[3]
    six = np.concatenate([lines["N"][0], lines["M"][0]])
    root = abs(points[:, 0]) < 1e-7
    assert root.sum() == sum(map(len, section.skin))
    x = np.concatenate(section.skin)  # d1 is along z, d2 along -y
    np.testing.assert_allclose(points[root] @ [[0, 0], [0, -1], [1, 0]], x, atol=1e-7)
    return six, x, {name: at_points[name][root] for name in ("sigma", "tau", "mises")}


def test_stresses_of_a_square(tmp_path):
    c = 0.05
    six, x, found = surface(sc.SectionRectangle(2 * c, 2 * c, STEEL), tmp_path)
    inertia = (2 * c) ** 4 / 12
    sigma = six[2] / (2 * c) ** 2 + (six[3] * x[:, 1] - six[4] * x[:, 0]) / inertia
    np.testing.assert_allclose(found["sigma"], sigma, rtol=1e-12, atol=1e-12 * abs(sigma).max())
    mises = np.sqrt(found["sigma"] ** 2 + 3 * found["tau"] ** 2)
    np.testing.assert_allclose(found["mises"], mises, rtol=1e-6)
    # Timoshenko & Goodier: tables of sections 109 and 124, for nu = 1/4
    square = sc.SectionRectangle(2 * c, 2 * c, sc.Material(1.0, 0.25, 1.0)).skin_stresses()
    middle = np.flatnonzero(abs(x).min(axis=1) < 1e-15)
    assert np.linalg.norm(square[middle, 1:, 5], axis=1) * (2 * c) ** 3 == pytest.approx(
        1 / 0.2082, rel=1e-3
    )
    at_edge = middle[abs(x[middle, 0]) < 1e-15]
    assert square[at_edge, 1, 0] * (2 * c) ** 2 == pytest.approx(1.5 * 1.126, rel=1e-3)
    # the same section by its mesh, to its tolerance
    profile = ProfileRectangle(2 * c, 2 * c, STEEL).section(1e-6)
    again, _, other = surface(profile, tmp_path)
    order = [abs(profile.skin[0] - each).sum(1).argmin() for each in x]
    np.testing.assert_allclose(again, six, rtol=1e-3, atol=1e-9)
    tau = other["tau"][order]
    np.testing.assert_allclose(tau, found["tau"], atol=3e-3 * found["tau"].max())


@pytest.mark.parametrize("inner", [0.0, 0.03])
def test_stresses_of_circles_and_tubes(inner, tmp_path):
    a, nu = 0.05, 0.3
    tube = sc.SectionTube(a, inner, STEEL) if inner else sc.SectionCircle(a, STEEL)
    six, x, found = surface(tube, tmp_path)
    inertia, r = np.pi / 4 * (a**4 - inner**4), np.linalg.norm(x, axis=1)
    sigma = six[2] / (np.pi * (a**2 - inner**2)) + (six[3] * x[:, 1] - six[4] * x[:, 0]) / inertia
    np.testing.assert_allclose(found["sigma"], sigma, rtol=1e-10, atol=1e-12 * abs(sigma).max())
    by_hand = tube.skin_stresses()
    torsion = np.linalg.norm(by_hand[:, 1:, 5], axis=1)
    np.testing.assert_allclose(torsion, r / (2 * inertia), rtol=1e-10)
    np.testing.assert_allclose(found["tau"], np.linalg.norm(by_hand[:, 1:] @ six, axis=1))
    # no shear through the surface, by any force
    assert abs(np.einsum("ki,kir->kr", x, by_hand[:, 1:])).max() < 1e-12 / inertia * a**3
    if not inner:  # on the axis across the force, Timoshenko & Goodier, section 121
        side = abs(x[:, 0]) < 1e-12
        share = (1 + 2 * nu) / (1 + nu) / (np.pi * a**2)
        np.testing.assert_allclose(by_hand[side, 1, 0], share, rtol=1e-12)
    types = last(tmp_path, "beam_surfaces")[2]
    # two skins of two elements each, and rings or disks at both ends
    assert types.count(9) == (4 * 24 * 2 + 0 if inner else 4 * 24)
    assert types.count(7) == (2 * 24 if inner else 2)


def test_a_released_joint_stays_where_it_was(tmp_path):
    """Also in frames that are written later than the one it was released in."""
    model = sc.Model()
    bob = model.add("bob", sc.MassPoint(1.0, position=(0.3, 0, -0.4)))
    rod = model.add("rod", sc.JointDistance(sc.ground((0, 0, 0)), bob.place()))
    model.add("slip", sc.SpringDamper(sc.ground((1.0, 0, 0)), bob.place(), stiffness=2.0))
    model.add("gravity", sc.LoadGravity((0, 0, -9.81)))
    event = sc.Event(sc.ConditionTime(0.1), sc.ActionRelease(rod))
    history = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 0.02, 0.2, events=[event])
    places = history["joint/rod/position"]
    gone = np.isnan(places).any(axis=1)
    assert gone.any() and not gone.all()
    writer = sc.export.ParaViewWriter(tmp_path, history.meta, history.static)
    for k, time in enumerate(history.times):
        writer.write(time, history.row(k))
        held = places[min(k, np.flatnonzero(~gone)[-1])]
        np.testing.assert_array_equal(last(tmp_path, "joints")[0], held[None])


@pytest.fixture(scope="module")
def swing(tmp_path_factory):
    """A driven arm with a hub, a spring and a mass; its history and folder."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="boom")
    arm = sc.Beam(mesh, ProfileI(0.1, 0.2, 0.01, 0.006, STEEL).section(1e-2), director=(0, 1, 0))
    arm = model.add("arm", arm)
    pin = sc.JointRevolute(sc.ground((0, 0, 0)), arm.node("boom.start"), axis=(0, 0, 1))
    model.add("pin", pin)
    model.add("motor", sc.JointDrive(pin, lambda t: 3.0 * t**2))
    model.add("hub", sc.RigidBody.sphere(1.0, radius=0.1, on=arm.node("boom.end")))
    middle = arm.node((0.5, 0, 0))
    model.add("rope", sc.SpringDamper(sc.ground((0.5, 2.0, 0)), middle, stiffness=20.0))
    model.add("push", sc.LoadForce(middle, (0, 0, 5.0)))
    model.add("gravity", sc.LoadGravity((0, -9.81, 0)))
    history = sc.simulate(model, sc.EnergyMomentum(), sc.NullSpace(), 0.01, until=0.1)
    folder = tmp_path_factory.mktemp("swing")
    indices = sc.write_paraview(history, folder, every=5, surfaces=True)
    assert [path.stem for path in indices] == [
        *("beams", "beam_surfaces", "bodies", "joints", "drives", "loads", "couplings", "scene")
    ]
    return history, folder


def test_names_units_and_fields_of_states(swing):
    history, folder = swing
    grid = block(folder, "beams")
    assert units(grid.GetPointData()) == {
        **{"u": "m", "v": "m/s", "radius": "m", "N": "N", "M": "N m", "K": "1/m"}
    }
    fields = grid.GetFieldData()
    assert units(fields)["TimeValue"] == "s" and units(fields)["energy"] == "J"
    for name in ("energy", "energy_balance", "work_drives", "linear_momentum"):
        np.testing.assert_array_equal(
            values_of(fields.GetArray(name)).ravel(), history[name][-1].ravel()
        )
    assert fields.GetArray("TimeValue").GetValue(0) == history.times[-1]
    *_, at_points, at_cells = last(folder)
    assert [set(at_cells[name]) for name in ("beam", "part")] == [{"arm"}, {"boom"}]
    np.testing.assert_allclose(at_points["radius"], np.hypot(0.05, 0.1))
    for layer, name, kind in (("joints", "pin", "revolute"), ("drives", "motor", "angle")):
        points, _, _, at_points, _ = last(folder, layer)
        assert at_points["name"].tolist() == [name] and at_points["kind"].tolist() == [kind]
        for series in ("force", "moment"):
            np.testing.assert_array_equal(
                at_points[series][0], history[f"joint/{name}/{series}"][-1]
            )
        np.testing.assert_array_equal(points[0], history[f"joint/{name}/position"][-1])
    points, _, _, at_points, _ = last(folder, "loads")
    assert at_points["name"].tolist()[0] == "push"
    np.testing.assert_array_equal(at_points["force"][0], [0, 0, 5.0])
    np.testing.assert_array_equal(points[0], history["load/push/position"][-1, 0])
    assert last(folder, "bodies")[4]["name"][0] == "hub"
    assert last(folder, "couplings")[4]["name"].tolist() == ["rope"]


def test_blocks_of_a_scene(swing):
    """ParaView's reader of ``.pvd`` files takes each part with its name as a block."""
    import pyvista

    history, folder = swing
    reader = pyvista.get_reader(folder / "scene.pvd")
    assert reader.time_values == history.times[::5].tolist()
    names = {each.path.split("/")[0]: each for each in reader.datasets if each.time == 0.0}
    assert len(names) == 7 and all((folder / each.path).exists() for each in names.values())
    assert [each.part for each in names.values()] == list(range(7))


def test_times_of_paths_and_modes(tmp_path):
    """A path counts by its load factor or what its control has; a buckling mode by no time."""
    model, _ = cantilever(SOFT, 2, 2)
    path = sc.static(model, control=sc.LoadControl(steps=4), watch=False)
    free = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (1, 0, 0), 4, name="rod")
    beam = free.add("rod", sc.Beam(mesh, SOFT, order=2, director=(0, 0, 1)))
    free.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), beam.node("rod.start")))
    modes = sc.modes(free, count=1)
    film = modes.animation(0)
    free.add("press", sc.LoadForce(beam.node("rod.end"), (-1.0, 0, 0)))
    still = sc.buckling(free, count=1).animation(0)
    along = sc.static(model, control=sc.ArcLength(points=2), watch=False)
    wanted = (path, "load factor"), (film, "s"), (still, "share of a cycle"), (along, "arc length")
    for k, (history, unit) in enumerate(wanted):
        sc.write_paraview(history, tmp_path / f"{k}")
        times = [t for t, _ in read_index(tmp_path / f"{k}" / "beams.pvd")]
        assert times == history.times.tolist()
        assert units(block(tmp_path / f"{k}", "beams").GetFieldData())["TimeValue"] == unit
    factor = block(tmp_path / "0", "beams", 2).GetFieldData().GetArray("load_factor").GetValue(0)
    assert factor == path["load_factor"][2]
    # forces of a mode are linear in it: inertia is all that acts beyond the clamp
    own = film["beam/rod/nodal_resultant"][0]
    assert abs(own[-1, 1]).max() < 1e-5 * abs(own[0, 0]).max()
    moved = modes.omega[0] ** 2 * (modes.system.mass @ film["increment"][0].reshape(-1, 3))
    shear = moved.reshape(-1, 4, 3)[:, 0].sum(0)
    own_axes = [[0, 0, 1], [0, -1, 0], [1, 0, 0]]
    np.testing.assert_allclose(own[0, 0, :3], own_axes @ shear, atol=1e-5 * abs(shear).max())


@pytest.mark.slow
def test_files_are_small(tmp_path):
    """2000 quadratic elements with an I-section: at most 5 MB, a quarter of what it was."""
    model = sc.Model()
    mesh = sc.MeshCurve.init_line((0, 0, 0), (10, 0, 0), 2000, name="rod")
    section = ProfileI(0.1, 0.2, 0.01, 0.006, STEEL).section(1e-2)
    rod = model.add("rod", sc.Beam(mesh, section, order=2, director=(0, 0, 1)))
    model.add("clamp", sc.JointFixed(sc.ground((0, 0, 0)), rod.node("rod.start")))
    model.add("tip", sc.LoadForce(rod.node("rod.end"), (10.0, 20.0, 30.0)))
    sc.write_paraview(sc.static(model, watch=False), tmp_path, surfaces=True)
    sizes = [path.stat().st_size for path in tmp_path.glob("*/000001.vtu")]
    assert sum(sizes) < 5e6
    assert (tmp_path / "beam_surfaces" / "000001.vtu").stat().st_size < 18_433_529 / 4
    assert (tmp_path / "beams" / "000001.vtu").stat().st_size < 1_538_334
