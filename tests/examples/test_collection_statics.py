"""The collection's equilibria, S1 to S14: reference numbers, other data, other means, bad input.

Other data are held against scaling laws and closed forms. Where a tolerance is wider than the
reference's own uncertainty, the reason is beside it.
"""

import math
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from scipy.special import jv

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "examples" / "benchmarks"))

import static_scenes

import collection
import skfem_cosserat as sc
from collection import common, statics

FAMILIES = {
    path.stem[:3]: import_module(f"collection.{path.stem}")
    for path in sorted(Path(collection.__file__).parent.glob("s[0-9][0-9]_*.py"))
}
s01, s02, s03, s04, s05, s06, s07, s08, s09, s10, s11, s12, s13, s14 = FAMILIES.values()

#: errors that are allowed beyond the reference's uncertainty, relative to a quantity's size (or 1)
ROUNDING = {
    "S01": 2e-12,  # 16 digits are trusted: these are the mesh's, 6th order
    "S02": 1e-12,  # inextensible, 17 digits: the mesh's at alpha = 10
    "S10": 2e-12,  # 15 digits: the mesh's
    "S12": 1e-8,  # 16 digits: the mesh's, and of zeros of frequencies
}
#: the same of single quantities
OF_QUANTITY = {
    ("S01", "n"): 1e-8,  # of a strain of 1e-14 by EA = 1e4 and more
    ("S09", "Pcr"): 4e-7,  # the strip's reference is 2.2e-7 off, that of S9b 6e-9: see below
}


def within(row):
    """Error against the uncertainty of the reference, and what is allowed beyond it."""
    size = max(1.0, float(abs(np.asarray(row["reference"], dtype=float)).max()))
    least = OF_QUANTITY.get((row["id"], row["quantity"]), ROUNDING.get(row["id"], 0.0))
    return row["error"] <= max(row["trusted"], least * size)


QUICK = [name for name in ("s01", *FAMILIES) if FAMILIES[name].QUICK and name != "s06"]


LONGER = ("s02", "s04", "s05", "s07", "s09", "s10", "s11")


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[pytest.mark.slow] * (n in LONGER)) for n in dict.fromkeys(QUICK)],
)
def test_quick_cases(name):
    """Every number of the quick table is that of the reference."""
    rows = FAMILIES[name].rows()
    assert {row["case"] for row in rows} == set(FAMILIES[name].QUICK)
    assert [row for row in rows if not within(row)] == []
    assert all(row["converged"] and row["order"] == 3 for row in rows)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in FAMILIES if name not in ("s04", "s13", "s14")])
def test_all_cases(name):
    rows = FAMILIES[name].rows(quick=False)
    assert [row for row in rows if not within(row)] == []


@pytest.mark.slow
def test_helix_to_five_turns():
    """The tip comes closer and closer to the clamp: nine digits of the rod's length, not of it."""
    references = {key: v for key, v in s04.ENTRY["values"].items() if float(key) <= 0.5}
    rows = statics.table("S04", s04.main, references, 9, least=10.0)
    assert [row for row in rows if not within(row)] == []


@pytest.mark.slow
def test_table():
    rows = collection.run(["S14"])
    assert [row["quantity"] for row in rows] == 2 * ["tip", "quat", "root_moment"]
    assert set(rows[0]) == set(collection.COLUMNS)
    assert {row["id"] for row in collection.run("M3") + rows} == {"M03", "S14"}


@pytest.mark.parametrize("ids", ["Q1", ["S99"], [""], [3]])
def test_table_of_no_family(ids):
    """A lone name is one family, not its letters; an empty one not all of them."""
    with pytest.raises(sc.InputError, match="expected among"):
        collection.run(ids)


# -- other data ------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_roll_up_of_another_rod(order):
    data = {"L": 3.0, "EI": 7.0, "lam": 0.4, "EA": 1e3, "GA": 3e2}
    found = s01.main(data=data, order=order)
    expected = s01.closed_form(3.0, 0.4)
    tolerance = {1: 1e-4, 2: 1e-9, 3: 1e-11, 4: 1e-11}[order]
    for name in ("x", "y", "theta"):
        assert found[name] == pytest.approx(expected[name], abs=tolerance), name


@pytest.mark.slow
def test_roll_up_counts_turns():
    assert s01.main(1.5, order=4, elements=16)["theta"] == pytest.approx(3 * np.pi, abs=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["2", "h=0.1,alpha=2"])
def test_elastica_of_any_size(case):
    """With alpha fixed all lengths are proportional; the moment at the root is force times x."""
    unit = s02.main(case, order=4, elements=8)
    h = {} if case == "2" else {"h": 0.2}
    found = s02.main(case, {"L": 2.0, "EI": 5.0, **h}, order=4, elements=8)
    assert [found["x"], found["y"]] == pytest.approx([2 * unit["x"], 2 * unit["y"]], rel=1e-11)
    assert found["theta"] == pytest.approx(unit["theta"], rel=1e-11)
    assert found["root_moment"] == pytest.approx(2 * 5 / 4 * found["x"], rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_inextensible_rods_of_every_order(order):
    """By their theory, extrapolated from three meshes."""
    limit = {1: 1e-8, 2: 1e-11, 3: 2e-12, 4: 2e-12}[order]
    elastica = s02.main("5", order=order)
    for name, value in s02.VALUES["S2_elastica_inextensible"]["5"].items():
        if name in s02.FIELDS:
            assert elastica[name] == pytest.approx(float(value), rel=limit), name
    bend = s03.main("Kirchhoff inextensible;P=450", order=order)["tip"]
    reference = s03.ENTRY["values"]["cases"]["Kirchhoff inextensible;P=450"]["tip"]
    assert bend == pytest.approx(reference, abs=50 * limit)


@pytest.mark.slow
def test_compliances_left_out_one_by_one():
    """Stiffer and stiffer beams approach the one that cannot shear, and the one without either."""
    for EA in (500.0, None):
        limit = s02.main(data={"alpha": 2.0, "EA": EA, "GA": None}, order=4, elements=8)
        errors = []
        for stiff in (1e5, 1e6):
            data = {"alpha": 2.0, "EA": EA or 10 * stiff, "GA": stiff}
            found = s02.main(data=data, order=4, elements=8)
            errors.append(abs(found["y"] - limit["y"]))
        assert errors[0] < 1e-4 and errors[0] / errors[1] == pytest.approx(10, rel=0.01)
    unstretched = s02.main(data={"alpha": 2.0, "GA": 300.0}, order=4, elements=8)
    stiff = s02.main(data={"alpha": 2.0, "GA": 300.0, "EA": 1e7}, order=4, elements=8)
    assert unstretched["x"] == pytest.approx(stiff["x"], abs=1e-6)
    assert (unstretched["EA"], unstretched["GA"]) == (None, 300.0)


@pytest.mark.slow
def test_elastica_by_force_or_by_stiffness():
    """The force in place of alpha; EA in place of the thickness that it follows from."""
    value = s02.VALUES["S2_elastica_reissner"]["h=0.1,alpha=5"]
    assert s02.main("h=0.1,alpha=1", {"P": 5.0})["x"] == pytest.approx(value["x"], abs=1e-11)
    data = {"alpha": 5, "EA": value["EA"], "GA": value["GA"]}
    assert s02.main(data=data)["y"] == pytest.approx(value["y"], abs=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize("section", list(s03.SECTIONS))
def test_bend_under_another_load(section):
    """Cases of one section by the load of another; the load turned round mirrors the answer."""
    reference = s03.ENTRY["values"]["cases"][f"{section};P=300"]["tip"]
    found = s03.main(f"{section};P=600", {"P": 300}, order=4)["tip"]
    assert found == pytest.approx(reference, abs=1e-9)
    mirrored = s03.main(f"{section};P=600", {"P": -300}, order=4, elements=8)["tip"]
    assert mirrored == pytest.approx([*reference[:2], -reference[2]], abs=2e-9)


@pytest.mark.slow
def test_bend_of_another_modulus():
    """Twice the moduli under twice the load: the same shape, twice the moment and the energy."""
    data = {"E": 2e7, "G": 1e7, "P": 1200.0}
    one, two = (s03.main(data=each, order=4, elements=8) for each in (None, data))
    assert two["tip"] == pytest.approx(one["tip"], abs=1e-9)
    assert two["root_moment"] == pytest.approx(
        2 * np.array(one["root_moment"]), rel=1e-10, abs=1e-6
    )
    assert two["strain_energy"] == pytest.approx(2 * one["strain_energy"], rel=1e-10)


@pytest.mark.slow
def test_helix_by_number_or_by_load():
    first = s04.main(0.1, order=4)
    again = s04.main(data={"lam": 0.2, "M": 100 * math.pi, "F": 25.0}, order=4)
    assert again["tip"] == pytest.approx(first["tip"], abs=1e-11)
    assert again["quat_tip"] == pytest.approx(first["quat_tip"], abs=1e-11)


@pytest.mark.slow
def test_princeton_with_shear_stiffnesses_exchanged():
    """What is computed beside it is the same beam with other data."""
    one = s05.main(order=4, elements=4)
    data = {"GA_flap": s05.DATA["GA_chord"], "GA_chord": s05.DATA["GA_flap"]}
    other = s05.main(data=data, order=4, elements=4)
    assert [other[f"tip_{name}"] for name in ("axial", "flap", "chord")] == one["tip_swappedGA"]


@pytest.mark.slow
def test_lee_frame_of_another_material_and_size():
    """Limit loads are proportional to EI/L^2 where L^2 EA/EI stays what it is."""
    data = {"L": 60.0, "at": 12.0, "E": 1e6, "I": 0.5}
    found = s06.main("0", data, order=4, elements=20)
    reference = s06.ENTRY["values"]
    for key in s06.CASES:
        k = int(key)
        assert found[key]["P"] == pytest.approx(reference[k]["P"] / 7.2, rel=1e-6)
        assert found[key]["v"] == pytest.approx(reference[k]["v"] / 2, rel=1e-6)


@pytest.mark.slow
def test_toggle_at_other_displacements():
    """Loads are asked for in any sequence; pulled up it only grows stiffer."""
    reference = dict(map(tuple, s07.ENTRY["values"]["curve"]))
    found = s07.main("curve", {"w": [0.24, 0.0, -0.1, 0.1]})["curve"]
    assert [w for w, _ in found] == [0.24, 0.0, -0.1, 0.1]
    assert found[0][1] == pytest.approx(reference[0.24], rel=1e-8)
    assert found[1][1] == 0.0
    assert found[2][1] < -found[3][1] == pytest.approx(-reference[0.1], rel=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("treatment", ["null-space", "multipliers"])
def test_toggle_without_shear(treatment):
    """Against shooting (DOP853, rtol 1e-13) with the same GA: two limit points, w and P."""
    found = s07.main("limit_points", {"GA": 1e12}, order=4, elements=14, treatment=treatment)
    reference = [
        [0.23205486225042085, 33.861233002664086],
        [0.3916895711912225, 31.26258310941577],
    ]
    assert np.array(found["limit_points"]) == pytest.approx(np.array(reference), rel=2e-9)


@pytest.mark.slow
def test_arch_of_another_size_and_of_little_compliance():
    """Loads go with EI/R^2; what small compliances change goes with them."""
    options = {"order": 4, "elements": 24, "treatment": "multipliers"}
    reference = s08.ENTRY["values"]
    found = s08.main(data={"R": 3.0, "EI": 7.0}, **options)
    assert found["Pcr_R2_EI"] == pytest.approx(reference["Pcr_R2_EI"], rel=2e-8)
    assert found["crown_rot"] == pytest.approx(reference["crown_rot"], rel=2e-7)
    place = np.array(found["crown_disp"]) / 3.0
    assert place == pytest.approx(np.array(reference["crown_disp"]) / 100.0, rel=2e-8)
    one, two = (s08.main(data={"EA": stiff, "GA": stiff}, **options)["Pcr"] for stiff in (4e6, 8e6))
    off = [reference["Pcr"] - load for load in (one, two)]
    assert off[0] / off[1] == pytest.approx(2.0, rel=0.01)


@pytest.mark.slow
def test_limit_point_by_loads_and_by_frequencies():
    """The same from either; from a guess that is off as well, and none from no guess."""
    section = static_scenes.plane_section(1e6, 4e6, 4e6)
    scene = static_scenes.arch(8, section=section)
    asked = statics.Asked(4, 8, sc.NullSpace(), common.Cost())
    path = asked.search(scene, sc.DisplacementControl(scene.point, s08.DOWN, 115.0))
    (point,) = statics.limit_points(asked, scene, path, 1, s08.DOWN)
    place = -point.displacement[1]
    for guess in (1.001 * place, 0.97 * place):
        found = statics.highest(asked, scene, s08.DOWN, guess)
        assert found.load == pytest.approx(point.load, rel=1e-11)
        assert found.displacement == pytest.approx(point.displacement, rel=1e-8)
        assert found.angle == pytest.approx(point.angle, rel=1e-7)
    assert asked.cost.converged
    assert math.isnan(statics.highest(asked, scene, s08.DOWN, math.nan).load)
    assert not asked.cost.converged


@pytest.mark.slow
def test_prandtl_of_another_strip():
    """c is a number: it does not depend on the strip."""
    j = s09.main("c", {"L": 100.0, "t": 1.0, "GJ": 3e5}, order=4, elements=10)["c"] / 2
    assert jv(-0.25, j) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "repeated"), [("Pcr", 3.31327752061047), ("load +e1", 1.0875178408408)]
)
def test_lateral_buckling_against_repeated_references(case, repeated):
    """The same shooting solutions as the entries', with steps of 1/60 of the length."""
    assert s09.main(case, order=4, elements=8)["Pcr"] == pytest.approx(repeated, rel=1e-9)


@pytest.mark.slow
def test_hinged_frame_of_another_size():
    found = s09.main("Mcr", {"L": 100.0, "EI2": 1e4, "GJ": 2e4}, order=4, elements=10)["Mcr"]
    assert found == pytest.approx(math.pi * math.sqrt(2e8) / 100, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("supports", [0, 1])
def test_column_of_another_section(supports):
    """Thick, so that shear and extension count; with shear stiffness of its own."""
    data = {"h": 0.2, "L": 1.5, "GA": 1e9}
    found = s10.main(s10.CASES[supports], data, order=4)
    inputs = statics.inputs(s10.DATA, data)
    expected = s10.closed_form(inputs, pinned=supports == 0)
    assert found["Pcr"] == pytest.approx(expected, rel=1e-11)
    assert found["Pcr_over_PE"] < 0.98


@pytest.mark.slow
def test_deployable_ring_of_another_size():
    """Closes to a third of any radius; the torque goes with EI/R."""
    assert s11.main(data={"R": 10.0, "E": 1e6}, order=4, elements=48)["ux_B"] == pytest.approx(
        -40 / 3, abs=1e-8
    )
    thin = {"R": 2000.0, "h": 100.0, "w": 100 / 3, "J": 9.753e-3 * 1e8}
    found = s11.main(45, thin, order=4, elements=32)
    reference = s11.ENTRY["values"]["45"]
    assert found["Mx"] == pytest.approx(1e6 * reference["Mx"], rel=1e-8)
    assert found["ux_B"] == pytest.approx(100 * reference["ux_B"], rel=1e-8)


@pytest.mark.slow
def test_twisted_ring_of_another_size():
    data = {"R": 3.0, "EI": 5.0, "GJ": 7.0}
    found = s12.main(data=data, order=4, elements=24)
    for name, value in s12.closed_form(**data).items():
        assert found[name] == pytest.approx(value, rel=5e-8), name


@pytest.mark.slow
def test_slender_arc_of_any_size():
    """Lengths are proportional under P L^2/EI fixed; slenderness as a number."""
    one = s14.main(1000, order=4)
    two = s14.main(1000, {"L": 2.0, "EI": 3.0, "P": 5 * 3 / 4}, order=4)
    assert two["tip"] == pytest.approx(2 * np.array(one["tip"]), rel=1e-11)
    assert two["quat"] == pytest.approx(one["quat"], abs=1e-11)


# -- means -----------------------------------------------------------------------------------------

SMALL = {
    "s01": 8,
    "s02": 8,
    "s03": 8,
    "s04": 16,
    "s05": 4,
    "s06": 10,
    "s07": 4,
    "s09": 4,
    "s10": 6,
    "s11": 16,
    "s13": 4,
    "s14": 8,
}
#: cases that are short
CASES = {"s07": "curve", "s09": "load +e1", "s11": 90, "s13": "path", "s04": 0.05}


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=pytest.mark.slow) if n == "s06" else n for n in SMALL]
)
@pytest.mark.slow
def test_treatments_agree(name):
    """To rounding, and no integrator, step or instants have any part in it."""
    family, case = FAMILIES[name], CASES.get(name)
    options = {"order": 3, "elements": SMALL[name]}
    one = family.main(case, treatment="null-space", **options)
    two = family.main(
        case, treatment="multipliers", integrator="variational", step=0.1, times=[1.0], **options
    )
    assert two["converged"] and two["unknowns"] > one["unknowns"]
    assert two["step"] == 0.1 and two["elements"] == one["elements"] >= SMALL[name]
    cost = ("cost_s", "unknowns", "newton_iterations", "converged", "order", "elements", "step")
    for quantity in set(one) - set(cost):
        if isinstance(one[quantity], dict) or one[quantity] is None:
            continue
        a, b = np.array(one[quantity]), np.array(two[quantity])
        assert abs(a - b).max() < 1e-8 * max(1.0, abs(a).max()), quantity


@pytest.mark.slow
def test_a_mesh_that_gives_way():
    """Four linear elements do not close a circle: no number, no exception."""
    found = s01.main(order=1, elements=4)
    assert not found["converged"] and found["newton_iterations"] > 0
    assert all(math.isnan(found[name]) for name in s01.FIELDS)


@pytest.mark.slow
def test_right_angle_frame_under_the_names_of_its_entry():
    """The entry nests its load below Pcr."""
    entry = "S9b_right_angle_cantilever_frame"
    nested, flat = (s09.main(c, order=4, elements=4)["Pcr"] for c in (entry, "load +e1"))
    assert list(nested) == list(common.entry(entry)["values"]["Pcr"])
    assert nested["load +e1"] == flat


@pytest.mark.slow
def test_what_does_not_buckle():
    """A square section has no weak side to buckle to; a flat toggle no limit points."""
    square = s09.main(data={"t": 30.0}, order=4, elements=4)
    assert math.isnan(square["Pcr"]) and not square["converged"]
    flat = s07.main("limit_points", {"rise": 0.1}, order=4, elements=4)
    assert np.isnan(flat["limit_points"]).all() and not flat["converged"]


# -- bad input -------------------------------------------------------------------------------------


@pytest.mark.one_quick
@pytest.mark.parametrize("name", FAMILIES)
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"case": "no such case"}, "case: 'no such case'"),
        ({"data": {"no such input": 1.0}}, "'no such input' is unknown, expected among"),
        ({"data": 5}, "data: 5, expected a dict"),
        ({"order": 5}, "argument order: 5, expected 1, 2, 3 or 4"),
        ({"order": [3]}, r"argument order: \[3\], expected 1, 2, 3 or 4"),
        ({"elements": 0}, "elements = 0, expected a positive integer"),
        ({"elements": True}, "elements = True, expected a positive integer"),
        ({"step": -0.1}, "step = -0.1, expected a finite number above 0"),
        ({"times": ["soon"]}, "times = 'soon', expected a number"),
        ({"integrator": "none"}, "integrator: 'none' is unknown"),
        ({"treatment": "none"}, "treatment: 'none' is unknown"),
    ],
)
def test_bad_arguments(name, arguments, message):
    with pytest.raises(sc.InputError, match=message):
        FAMILIES[name].main(**arguments)


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("s01", {"EI": -1.0}, "EI = -1.0, expected a positive finite number"),
        ("s02", {"alpha": math.inf}, "alpha = inf, expected a finite number"),
        ("s03", {"R": "wide"}, "R = 'wide', expected a positive finite number"),
        ("s05", {"GJ": None}, "GJ = None, expected a positive finite number"),
        ("s07", {"GA": None}, "GA = None, .* no beams without shear"),
        ("s07", {"EA": None}, "EA = None, .* without extension"),
        ("s14", {"EA": None}, "EA = None, expected a positive finite number"),
        ("s06", {"at": 120.0}, "at = 120.0, expected less than L = 120.0"),
        ("s13", {"axis": (0, 0, 0)}, "an axis of three components, not all zero"),
    ],
)
def test_bad_data(name, data, message):
    with pytest.raises(sc.InputError, match=message):
        FAMILIES[name].main(data=data)
