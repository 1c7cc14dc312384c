"""Arrays of a frozen system as the compiled kernels take them: one argument for many arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from .structure import Structure

__all__ = [
    "BEAMS",
    "CONSTRAINTS",
    "ELIMINATION",
    "PLAN",
    "PLANE_BEAMS",
    "PLANE_TREE",
    "ROWS",
]
__all__ += ["TREE", "WORK", "beams", "constraints", "elimination", "plan", "plane_beams"]
__all__ += ["plane_tree", "rows", "tree", "work"]

#: elements of one interpolation: shape functions and slopes at Gauss points as tuples, so that
#: their numbers are known when compiling; first rows of y of the nodes; slots of the blocks
BEAMS = (
    *("N", "dN", "weights", "base", "slot", "lengths", "section", "stiffness", "reference", "mass"),
    *("diagonal", "rotations", "turned", "S0", "S", "predicted"),
)
#: vertices of moments and whether these follow; of each pair of vertices that a force fixed in a
#: body, or drag, couples: first rows of y of where it acts and of what it depends on, and the slot
#: of their block
FOLLOWING = ("moment_vertex", "moment_follows", "follower")
#: force elements: integers, factors of laws, matrices of invariants
COUPLINGS = ("coupling", "coupling_law", "coupling_forms")
#: elements whose lines follow from their directors: of each edge which of them, or -1; length from
#: parent to child, negative against the element; Gamma of the reference, rotations of the section
#: at both, blocks of both
SPANS = ("span", "span_reach", "span_strain", "span_rotation", "span_turned", "span_slot")
#: vertices, edges (joints from parent to child) and their coordinates
TREE = (
    *(
        "row",
        "framed",
        "free",
        "loose",
        "R",
        "triads",
        "turn",
        "swing",
        "followed",
        "value",
        "driven",
        "turning",
    ),
    *("child", "parent", "child_row", "parent_row", "parent_frame", "guide_frame", "relative"),
    *("sphere", "open", "child_offset", "parent_offset", "arm0"),
    *("fulcrum_row", "fulcrum_offset", "fulcrum_vertex", "first"),
    *("kind", "own", "axis", "right", "axis0", "guide_row", "guide_vertex"),
    *("target_row", "target_offset", "target_vertex"),
    *("centre_row", "centre_offset", "centre_vertex"),
    *("mass_data", "mass_indices", "mass_indptr"),
    *("loop_products", "loop_factors", "loop_linear", "loop_linear_factors", "loop_constant"),
    *("loop_vertices", "triple", "lump_vertex", "lumps", "point_vertex", "point_masses"),
    *FOLLOWING,
    *COUPLINGS,
    *SPANS,
)
#: the order of elimination, neighbours still to come, slots of blocks; how many are eliminated in
#: blocks, and what is called back to solve for the rest (0: none)
PLAN = (
    *("order", "edge", "parent", "size", "diag", "ptr", "neighbour", "right", "down"),
    *("update_ptr", "update", "parent_at", "to_parent", "rest"),
)
#: constraints of joints as products and linear terms of rows of y, behind them those that only tell
#: how things lie; multipliers (impulses) and what is kept of steps
CONSTRAINTS = (
    *("row", "framed", "director", "mass_data", "mass_indices", "mass_indptr"),
    *("lump_vertex", "lumps", "point_vertex", "point_masses"),
    *("products", "product_row", "left", "right", "factor", "drive_row", "drive_component"),
    *("product_place", "product_column", "curved", "linear_row", "linear", "linear_factor"),
    *("linear_place", "linear_column", "constant", "magnitude", "scaled", "step"),
    *("multiplier", "added", "last_one", "one_before", "start", "last", "before"),
    *("impulse", "g", "G_left", "G_right"),
    *FOLLOWING,
    *COUPLINGS,
)
#: as PLAN, with the multipliers of each vertex, and factors
ELIMINATION = (
    *("order", "diag", "ptr", "neighbour", "right", "down", "update_ptr", "update", "parent_at"),
    *("coordinates", "multiplier_ptr", "multipliers", "internal", "triple", "scale"),
    *("T", "X", "D", "inverse", "pivots", "panel", "x", "scratch"),
)
#: what changes during a step
WORK = (
    *("y0", "p0", "external", "ground1", "y1", "mid", "R", "momentum", "internal"),
    *("R_mixed", "change", "F", "F_mixed", "b", "x", "total", "last", "extra", "twist", "A"),
    *("mu", "mu_change", "gap", "gap_rate", "closing", "b_kept", "border", "border_twist"),
    "border_row",
    *(
        "schur",
        "schur_scratch",
        "before",
        "found",
        "carried",
        "frames",
        "inverse",
        "S_kept",
        "X_kept",
    ),
    *("S_left", "X_left", "S_right", "X_right", "C_child", "C_parent", "scratch"),
    *("dead", "moments", "followers", "coupled"),
)
#: of scenes in a plane: elements, and in the end what makes rows of y in space of their forces
PLANE_BEAMS = (
    *("N", "dN", "weights", "base", "slot", "lengths", "section", "stiffness", "reference", "mass"),
    *("rotations", "turned", "S0", "S", "predicted"),
    *("axes", "director", "resultants", "frames", "triads", "out"),
)
#: what there is by rows of y in space: first rows of the vertices, their directors by unit vectors,
#: axes of the plane, what is normal to it
ROWS = (
    *("first", "framed", "director", "axes", "rest", "y0", "y1", "ground1", "p0", "external"),
    *("R", "momentum", "internal", "carried", "mass_data", "mass_indices", "mass_indptr"),
)
#: vertices, edges and their coordinates in a plane; vertices of the ground come last
PLANE_TREE = (
    *("rows", "framed", "free", "loose", "followed", "turn", "turning"),
    *("child", "parent", "edges", "arms", "coordinates", "along", "value", "driven"),
    *("mass_blocks", "mass_indices", "mass_indptr"),
    *("lump_vertex", "lumps", "point_vertex", "point_masses"),
    *("products", "factors", "linear", "directions", "loop_constant", "loop_vertices"),
    "span_slot",
)


def beams(values: Sequence[Any]) -> Structure:
    """Structure of the fields :data:`BEAMS`."""
    return Structure("beams", BEAMS, values)


def tree(values: Sequence[Any]) -> Structure:
    """Structure of the fields :data:`TREE`."""
    return Structure("tree", TREE, values)


def plan(values: Sequence[Any]) -> Structure:
    """Structure of the fields :data:`PLAN`."""
    return Structure("plan", PLAN, values)


def constraints(values: Sequence[Any]) -> Structure:
    """Structure of the fields :data:`CONSTRAINTS`."""
    return Structure("constraints", CONSTRAINTS, values)


def elimination(values: Sequence[Any]) -> Structure:
    """Structure of the fields :data:`ELIMINATION`."""
    return Structure("elimination", ELIMINATION, values)


def work(values: Sequence[Any]) -> Structure:
    """Structure of the fields :data:`WORK`."""
    return Structure("work", WORK, values)


def plane_beams(values: Sequence[Any]) -> Structure:
    """Structure of the fields :data:`PLANE_BEAMS`."""
    return Structure("plane_beams", PLANE_BEAMS, values)


def rows(values: Sequence[Any]) -> Structure:
    """Structure of the fields :data:`ROWS`."""
    return Structure("rows", ROWS, values)


def plane_tree(values: Sequence[Any]) -> Structure:
    """Structure of the fields :data:`PLANE_TREE`."""
    return Structure("plane_tree", PLANE_TREE, values)
