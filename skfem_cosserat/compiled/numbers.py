"""Numbers of a step, its parts, and what its loop leaves behind: places in arrays."""

from ..newton import FACTORED, FIRST, ITERATIONS, KEPT, RATE, RESIDUAL
from ..newton import RECORD as LOOP
from .tables import MOST_PI, MOST_XI

__all__ = ["FACTORED", "FIRST", "ITERATIONS", "KEPT", "RATE", "RESIDUAL"]

#: see :class:`skfem_cosserat.integrators.scheme.Scheme` and :class:`skfem_cosserat.NewtonSettings`
NUMBERS = (
    *("mass", "momentum", "force", "start", "end", "weight", "length"),
    *("rotation", "mixed", "reuse", "iterations", "largest", "increment", "negligible"),
    *("stagnation", "carry_mass", "carry_momentum", "carry_force"),
    *("share", "worth", "ends", "reach", "viscous_work"),
)
MASS, MOMENTUM, FORCE, START, END, WEIGHT, LENGTH = range(7)
ROTATION, MIXED, REUSE, LIMIT, LARGEST, INCREMENT, NEGLIGIBLE = range(7, 14)
STAGNATION, CARRY_MASS, CARRY_MOMENTUM, CARRY_FORCE = range(14, 18)
SHARE, WORTH, ENDS, REACH, VISCOUS_WORK = range(18, 23)

#: what the loop over the iterations leaves behind for the next step, see
#: :data:`skfem_cosserat.newton.RECORD`; how to start: from no increment, the last one or both
#: extrapolated (0, 1, 2), and how many are known; work of the loads (J). Of several steps in one
#: go: how many are asked for and done, and matrices factored in all; how far coordinates of closed
#: loops may go before their rows are looked at, and how far they went since. Energy that moved
#: velocities took in a step (J), and whether velocities are still to be moved; whether each step
#: has loads of its own. Works (J) of actuators, lost, and of the ground through force elements; the
#: part of the scheme in what is lost
RECORD = (
    *LOOP,
    *("start", "known", "work", "asked", "done", "all_factored"),
    *("clearance", "travelled", "taken", "unmoved", "varying"),
    *("actuators", "dissipated", "ground", "numerical"),
)
GUESS, KNOWN, WORK, ASKED, DONE, ALL_FACTORED = range(9, 15)
CLEARANCE, TRAVELLED, TAKEN, UNMOVED, VARYING = range(15, 20)
ACTUATORS, DISSIPATED, BY_GROUND, BY_SCHEME = range(20, 24)
#: what is kept of these numbers for each of the steps in one go; works as in `StepWork`
LOGGED = ITERATIONS, RESIDUAL, WORK, ACTUATORS, DISSIPATED, BY_GROUND, BY_SCHEME

#: matrices of a step up to which no frame can have got to half a turn, where there are no closed
#: loops: eight increments cannot, and all increments with one matrix, each at most half as long as
#: the one before, reach no further than two of the first
SHORT = 4
#: all turns of a step together (rad), and displacements against the scene, that are no half turn
SHORT_WAY = 1.0

#: functions that take ``(s, m, w, numbers, flag)``, and those that take ``(g, w, numbers, flag)``
TREE_PARTS = (
    *("begin", "move", "balance", "size", "clear", "node_matrix", "cap", "predict_changes"),
    *("finish", "better", "nodal_mass_matrix", "factor", "sweep"),
    *("joint_begin", "joint_add", "joint_move", "joint_maps", "joint_reduce", "joint_curvature"),
    *("row_force", "row_matrix", "row_branch"),
    *("load", "couple", "hold"),
    *("flow", "flow_matrix", "flow_column", "flow_keep", "flow_correct"),
)
BEAM_PARTS = (*("beam_start", "beam_force", "beam_tangent", "beam_predicted", "beam_energy"),)
BEGIN, MOVE, BALANCE, SIZE, CLEAR, NODE_MATRIX, CAP, PREDICT_CHANGES = range(8)
FINISH, BETTER, NODAL_MASS_MATRIX, FACTOR, SWEEP = range(8, 13)
JOINT_BEGIN, JOINT_ADD, JOINT_MOVE, JOINT_MAPS, JOINT_REDUCE, JOINT_CURVATURE = range(13, 19)
ROW_FORCE, ROW_MATRIX, ROW_BRANCH, LOAD, COUPLE, HOLD = range(19, 25)
FLOW, FLOW_MATRIX, FLOW_COLUMN, FLOW_KEEP, FLOW_CORRECT = range(25, 30)
BEAM_START, BEAM_FORCE, BEAM_TANGENT, BEAM_PREDICTED, BEAM_ENERGY = range(30, 35)
#: places of addresses of ``double f(int64)``, by which Python code is called back: stages of loads
#: that are functions; loads of the next one of several steps
CALLED_BACK, NEXT_LOADS = range(35, 37)
AT_BEGIN, AT_FORCE, AT_PREDICTED, AT_MATRIX = range(4)

#: what laws that Python knows are asked for: forces, or their slopes
FORCES_OF_LAWS, SLOPES_OF_LAWS = range(2)

#: what beams of a stored energy ask for: stresses by strains, their derivative, and the energy at
#: the start of a step; functions of a law that users had compiled
STRESSES_BY_LAW, MODULI_BY_LAW, ENERGY_BY_LAW = range(3)
ENERGY, COMPLEX_ENERGY, GRADIENT, COMPLEX_GRADIENT, HESSIAN = range(5)

#: what a force element has in a step, columns of ``w.coupled``: step size; full turns of an angle
#: at the start and at the end, or how far a rotation vector went; what is dissipated, the part of
#: the scheme in it, and what the ground does (J); forces of an actuator, invariants and coordinates
#: at the start, forces by invariants, travel of the coordinates; whether full turns are counted on
#: from step to step; work of a law without potential (J)
STEP, TURNS, TURNED, LOST, NUMERICAL, GROUND, AMPLITUDE = range(7)
PI0 = AMPLITUDE + MOST_XI
XI0 = PI0 + MOST_PI
S = XI0 + MOST_XI
TRAVEL = S + MOST_PI
WINDS, PUSHED, COUPLED = range(TRAVEL + MOST_XI, TRAVEL + MOST_XI + 3)

#: of the extra velocity of energy-decaying steps, numpy's and compiled ones: what is added to the
#: diagonal of a singular matrix, of its size (where all velocities are parallel); products with the
#: whole motion, smaller than which those of a relative motion are rounding; gap, by the size of its
#: terms, that is rounding; most iterations, and halvings of an increment
FLOW_REGULAR, FLOW_NOISE, FLOW_CLOSED, FLOW_ITERATIONS, FLOW_HALVINGS = 1e-10, 1e-20, 1e-14, 60, 14

#: elements at a time: registers of 256 bits; where there are none, two of 128 bits
WIDTH = 4
