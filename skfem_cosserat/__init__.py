"""Geometrically exact (Cosserat) beams and flexible multibody dynamics for scikit-fem."""

from .adaptive import Adapted, adapt
from .advice import Advice, advise
from .beam import Beam
from .body import MassPoint, RigidBody
from .constraints import Multipliers, NullSpace
from .coupling import Bushing, Cable, JointActuator, JointSpringDamper, SpringDamper
from .damping import RayleighDamping
from .diagnostics import Projection
from .drive import JointDrive
from .element import InterpolationEquidistant, InterpolationLobatto
from .errors import (
    CosseratError,
    Diverged,
    HistoryError,
    IncompatibleError,
    InputError,
    JobError,
    MeshError,
)
from .foundation import Foundation
from .frames import Motion, Place, ground, triad
from .history import History, spectrum
from .hyperelastic import SectionHyperelastic
from .integrators import (
    Asynchronous,
    Composition,
    EnergyDecaying,
    EnergyMomentum,
    Explicit,
    GeneralizedAlpha,
    State,
    Stepper,
    Variational,
)
from .joint import (
    JointCylindrical,
    JointDistance,
    JointFixed,
    JointPlanar,
    JointPointOnLine,
    JointPrismatic,
    JointRevolute,
    JointSpherical,
    JointUniversal,
)
from .linear import SolverBanded, SolverDense, SolverMetis, SolverPardiso, SolverSuperLU
from .load import FunctionOfTime, LoadForce, LoadGravity, LoadLine, LoadMoment, Table
from .mesh import MeshCurve, read_mesh, write_mesh
from .modal import Buckling, Modes, buckling, modes
from .model import Model, Planar, Planarity, System, planarity
from .model.balance import Spin
from .motion import MotionShake, MotionTurn
from .newton import NewtonSettings
from .parallel import Job, Outcome, Processes, run_all
from .profile import (
    MaterialAnisotropic,
    Profile,
    ProfileBox,
    ProfileChannel,
    ProfileCircle,
    ProfileComposite,
    ProfileI,
    ProfilePolygon,
    ProfileRectangle,
    ProfileRectangles,
    ProfileRings,
    ProfileTube,
    Region,
)
from .ramp import Harmonic, RampLinear, RampSmooth
from .section import Material, Section, SectionCircle, SectionRectangle, SectionTube
from .simulate import (
    SensorAcceleration,
    SensorForce,
    SensorPosition,
    SensorQuantity,
    SensorReaction,
    SensorStrain,
    SensorVelocity,
    initial_state,
    project,
    restart,
    simulate,
    steps,
)
from .statics import (
    ArcLength,
    Branch,
    DisplacementControl,
    LoadControl,
    branch,
    equilibrium,
    static,
)
from .study import Refinement, refine, stability_map, work_precision
from .version import VERSION

__all__ = [
    "Adapted",
    "Advice",
    "ArcLength",
    "Asynchronous",
    "Beam",
    "Branch",
    "Buckling",
    "Bushing",
    "Cable",
    "Composition",
    "CosseratError",
    "DisplacementControl",
    "Diverged",
    "EnergyDecaying",
    "EnergyMomentum",
    "Explicit",
    "Foundation",
    "FunctionOfTime",
    "GeneralizedAlpha",
    "Harmonic",
    "History",
    "HistoryError",
    "IncompatibleError",
    "InputError",
    "InterpolationEquidistant",
    "InterpolationLobatto",
    "Job",
    "JobError",
    "JointActuator",
    "JointCylindrical",
    "JointDistance",
    "JointDrive",
    "JointFixed",
    "JointPlanar",
    "JointPointOnLine",
    "JointPrismatic",
    "JointRevolute",
    "JointSpherical",
    "JointSpringDamper",
    "JointUniversal",
    "LoadControl",
    "LoadForce",
    "LoadGravity",
    "LoadLine",
    "LoadMoment",
    "MassPoint",
    "Material",
    "MaterialAnisotropic",
    "MeshCurve",
    "MeshError",
    "Model",
    "Modes",
    "Motion",
    "MotionShake",
    "MotionTurn",
    "Multipliers",
    "NewtonSettings",
    "NullSpace",
    "Outcome",
    "Place",
    "Planar",
    "Planarity",
    "Processes",
    "Profile",
    "ProfileBox",
    "ProfileChannel",
    "ProfileCircle",
    "ProfileComposite",
    "ProfileI",
    "ProfilePolygon",
    "ProfileRectangle",
    "ProfileRectangles",
    "ProfileRings",
    "ProfileTube",
    "Projection",
    "RampLinear",
    "RampSmooth",
    "RayleighDamping",
    "Refinement",
    "Region",
    "RigidBody",
    "Section",
    "SectionCircle",
    "SectionHyperelastic",
    "SectionRectangle",
    "SectionTube",
    "SensorAcceleration",
    "SensorForce",
    "SensorPosition",
    "SensorQuantity",
    "SensorReaction",
    "SensorStrain",
    "SensorVelocity",
    "SolverBanded",
    "SolverDense",
    "SolverMetis",
    "SolverPardiso",
    "SolverSuperLU",
    "Spin",
    "SpringDamper",
    "State",
    "Stepper",
    "System",
    "Table",
    "Variational",
    "adapt",
    "advise",
    "branch",
    "buckling",
    "equilibrium",
    "ground",
    "initial_state",
    "modes",
    "planarity",
    "project",
    "read_mesh",
    "refine",
    "restart",
    "run_all",
    "simulate",
    "spectrum",
    "stability_map",
    "static",
    "steps",
    "triad",
    "work_precision",
    "write_mesh",
]
__version__ = VERSION
