"""Geometrically exact (Cosserat) beams and flexible multibody dynamics for scikit-fem.

What a name needs is imported when it is first asked for: a scene of rigid bodies needs no meshes.
"""

import sys
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType
from typing import TYPE_CHECKING, Any

from .version import VERSION

if TYPE_CHECKING:
    from .adaptive import Adapted
    from .adaptive.adapt import adapt
    from .advice import Advice
    from .advice.advise import advise
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
    from .rung import Rung, RungFull, RungInextensible, RungRigid, RungUnshearable
    from .section import Material, Section, SectionCircle, SectionRectangle, SectionTube
    from .simulate import (
        ActionFunction,
        ActionLoad,
        ActionLock,
        ActionRelease,
        ActionStop,
        ActionUnlock,
        ConditionCoordinate,
        ConditionEnergy,
        ConditionReaction,
        ConditionSensor,
        ConditionTime,
        Event,
        SensorAcceleration,
        SensorForce,
        SensorPosition,
        SensorQuantity,
        SensorReaction,
        SensorStrain,
        SensorVelocity,
        StepAdvice,
        StepControl,
        View,
        advise_step,
        after_events,
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
        equilibrium,
        static,
    )
    from .statics.branch import branch
    from .study import Refinement, refine, stability_map, work_precision

#: where names come from
_NAMES = {
    "adaptive": ("Adapted", "adapt"),
    "advice": ("Advice", "advise"),
    "beam": ("Beam",),
    "body": ("MassPoint", "RigidBody"),
    "constraints": ("Multipliers", "NullSpace"),
    "coupling": ("Bushing", "Cable", "JointActuator", "JointSpringDamper", "SpringDamper"),
    "damping": ("RayleighDamping",),
    "diagnostics": ("Projection",),
    "drive": ("JointDrive",),
    "element": ("InterpolationEquidistant", "InterpolationLobatto"),
    "errors": (
        "CosseratError",
        "Diverged",
        "HistoryError",
        "IncompatibleError",
        "InputError",
        "JobError",
        "MeshError",
    ),
    "foundation": ("Foundation",),
    "frames": ("Motion", "Place", "ground", "triad"),
    "history": ("History", "spectrum"),
    "hyperelastic": ("SectionHyperelastic",),
    "integrators": (
        "Asynchronous",
        "Composition",
        "EnergyDecaying",
        "EnergyMomentum",
        "Explicit",
        "GeneralizedAlpha",
        "State",
        "Stepper",
        "Variational",
    ),
    "joint": (
        "JointCylindrical",
        "JointDistance",
        "JointFixed",
        "JointPlanar",
        "JointPointOnLine",
        "JointPrismatic",
        "JointRevolute",
        "JointSpherical",
        "JointUniversal",
    ),
    "linear": ("SolverBanded", "SolverDense", "SolverMetis", "SolverPardiso", "SolverSuperLU"),
    "load": ("FunctionOfTime", "LoadForce", "LoadGravity", "LoadLine", "LoadMoment", "Table"),
    "mesh": ("MeshCurve", "read_mesh", "write_mesh"),
    "modal": ("Buckling", "Modes", "buckling", "modes"),
    "model": ("Model", "Planar", "Planarity", "System", "planarity"),
    "model.balance": ("Spin",),
    "motion": ("MotionShake", "MotionTurn"),
    "newton": ("NewtonSettings",),
    "parallel": ("Job", "Outcome", "Processes", "run_all"),
    "profile": (
        "MaterialAnisotropic",
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
        "Region",
    ),
    "ramp": ("Harmonic", "RampLinear", "RampSmooth"),
    "rung": ("Rung", "RungFull", "RungInextensible", "RungRigid", "RungUnshearable"),
    "section": ("Material", "Section", "SectionCircle", "SectionRectangle", "SectionTube"),
    "simulate": (
        "ActionFunction",
        "ActionLoad",
        "ActionLock",
        "ActionRelease",
        "ActionStop",
        "ActionUnlock",
        "ConditionCoordinate",
        "ConditionEnergy",
        "ConditionReaction",
        "ConditionSensor",
        "ConditionTime",
        "Event",
        "StepAdvice",
        "StepControl",
        "View",
        "advise_step",
        "after_events",
        "SensorAcceleration",
        "SensorForce",
        "SensorPosition",
        "SensorQuantity",
        "SensorReaction",
        "SensorStrain",
        "SensorVelocity",
        "initial_state",
        "project",
        "restart",
        "simulate",
        "steps",
    ),
    "statics": (
        "ArcLength",
        "Branch",
        "DisplacementControl",
        "LoadControl",
        "branch",
        "equilibrium",
        "static",
    ),
    "study": ("Refinement", "refine", "stability_map", "work_precision"),
}
_HOME = {name: module for module, names in _NAMES.items() for name in names}


def __getattr__(name: str) -> Any:
    if name in _HOME:
        value = getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
        globals()[name] = value
        return value
    module = f"{__name__}.{name}"
    if name.startswith("_") or find_spec(module) is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return import_module(module)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


class _Package(ModuleType):
    """Names of functions stay what they are when the folder of the same name is imported."""

    def __setattr__(self, name: str, value: Any) -> None:
        if isinstance(value, ModuleType) and name in _HOME:
            value = getattr(value, name)
        super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package

__all__ = [
    "ActionFunction",
    "ActionLoad",
    "ActionLock",
    "ActionRelease",
    "ActionStop",
    "ActionUnlock",
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
    "ConditionCoordinate",
    "ConditionEnergy",
    "ConditionReaction",
    "ConditionSensor",
    "ConditionTime",
    "CosseratError",
    "DisplacementControl",
    "Diverged",
    "EnergyDecaying",
    "EnergyMomentum",
    "Event",
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
    "Rung",
    "RungFull",
    "RungInextensible",
    "RungRigid",
    "RungUnshearable",
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
    "StepAdvice",
    "StepControl",
    "Stepper",
    "System",
    "Table",
    "Variational",
    "View",
    "adapt",
    "advise",
    "advise_step",
    "after_events",
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
