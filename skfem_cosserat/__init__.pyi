"""Public names, each with the module it comes from: read when one is first asked for."""

from . import (
    accuracy as accuracy,
    diagnostics as diagnostics,
    errors as errors,
    export as export,
    figures as figures,
    history as history,
    mesh as mesh,
    plot as plot,
    study as study,
)
from .basis import (
    DirectorBasis as DirectorBasis,
    ElementLoad as ElementLoad,
    ElementMatrix as ElementMatrix,
    error_norms as error_norms,
)
from .beam import (
    Beam as Beam,
)
from .beamdyn import (
    BladeBeamDyn as BladeBeamDyn,
    read_beamdyn as read_beamdyn,
)
from .body import (
    MassPoint as MassPoint,
    RigidBody as RigidBody,
)
from .checks import (
    check as check,
)
from .constraints import (
    Multipliers as Multipliers,
    NullSpace as NullSpace,
    Treatment as Treatment,
)
from .coupling import (
    Bushing as Bushing,
    Cable as Cable,
    Foundation as Foundation,
    JointActuator as JointActuator,
    JointLimits as JointLimits,
    JointSpringDamper as JointSpringDamper,
    SpringDamper as SpringDamper,
)
from .damping import (
    RayleighDamping as RayleighDamping,
)
from .diagnostics import (
    Projection as Projection,
)
from .joint import JointDrive as JointDrive
from .element import (
    InterpolationEquidistant as InterpolationEquidistant,
    InterpolationLobatto as InterpolationLobatto,
)
from .errors import (
    AccuracyWarning as AccuracyWarning,
    CosseratError as CosseratError,
    CosseratWarning as CosseratWarning,
    Diverged as Diverged,
    FrozenError as FrozenError,
    HistoryError as HistoryError,
    IncompatibleError as IncompatibleError,
    IncompleteWarning as IncompleteWarning,
    InputError as InputError,
    JobError as JobError,
    MeshError as MeshError,
    ModelWarning as ModelWarning,
    PerformanceWarning as PerformanceWarning,
    StorageError as StorageError,
)
from .export import (
    write_csv as write_csv,
    write_paraview as write_paraview,
)
from .force import (
    Controller as Controller,
    Force as Force,
)
from .frames import (
    Motion as Motion,
    MotionShake as MotionShake,
    MotionTurn as MotionTurn,
    Place as Place,
    ground as ground,
    triad as triad,
)
from .history import (
    History as History,
    spectrum as spectrum,
)
from .hyperelastic import (
    SectionHyperelastic as SectionHyperelastic,
)
from .integrators import (
    Composition as Composition,
    EnergyDecaying as EnergyDecaying,
    EnergyMomentum as EnergyMomentum,
    Evaluation as Evaluation,
    Explicit as Explicit,
    GeneralizedAlpha as GeneralizedAlpha,
    Integrator as Integrator,
    Scheme as Scheme,
    State as State,
    StepBalance as StepBalance,
    StepData as StepData,
    StepWork as StepWork,
    Stepper as Stepper,
    Variational as Variational,
)
from .joint import (
    Freedom as Freedom,
    Joint as Joint,
    JointCylindrical as JointCylindrical,
    JointDistance as JointDistance,
    JointFixed as JointFixed,
    JointPlanar as JointPlanar,
    JointPointOnLine as JointPointOnLine,
    JointPrismatic as JointPrismatic,
    JointRevolute as JointRevolute,
    JointSpherical as JointSpherical,
    JointUniversal as JointUniversal,
    Slide as Slide,
    Turn as Turn,
)
from .linear import (
    Factors as Factors,
    SingularMatrixError as SingularMatrixError,
    Solver as Solver,
    SolverBanded as SolverBanded,
    SolverDense as SolverDense,
    SolverPardiso as SolverPardiso,
    SolverSuperLU as SolverSuperLU,
)
from .load import (
    Load as Load,
    LoadForce as LoadForce,
    LoadGravity as LoadGravity,
    LoadLine as LoadLine,
    LoadMoment as LoadMoment,
    LoadStrain as LoadStrain,
    TermAcceleration as TermAcceleration,
    TermForce as TermForce,
    TermLine as TermLine,
    TermMoment as TermMoment,
    TermStrain as TermStrain,
)
from .time_function import (
    FunctionOfTime as FunctionOfTime,
    Harmonic as Harmonic,
    RampLinear as RampLinear,
    RampSmooth as RampSmooth,
    Table as Table,
)
from .load_form import (
    EnergyForm as EnergyForm,
    LoadForm as LoadForm,
)
from .mesh import (
    MeshCurve as MeshCurve,
    read_mesh as read_mesh,
    write_mesh as write_mesh,
)
from .modal import (
    Buckling as Buckling,
    Modes as Modes,
    buckling as buckling,
    modes as modes,
)
from .model import (
    Model as Model,
    Planar as Planar,
    Planarity as Planarity,
    System as System,
    planarity as planarity,
)
from .model.balance import (
    Spin as Spin,
)
from .newton import (
    NewtonSettings as NewtonSettings,
)
from .accuracy import (
    Job as Job,
    Outcome as Outcome,
    Processes as Processes,
    run_all as run_all,
)
from .obstacle import (
    Cylinder as Cylinder,
    Obstacle as Obstacle,
    Plane as Plane,
    Sphere as Sphere,
)
from .profile import (
    MaterialAnisotropic as MaterialAnisotropic,
    Profile as Profile,
    ProfileBox as ProfileBox,
    ProfileChannel as ProfileChannel,
    ProfileCircle as ProfileCircle,
    ProfileComposite as ProfileComposite,
    ProfileI as ProfileI,
    ProfilePolygon as ProfilePolygon,
    ProfileRectangle as ProfileRectangle,
    ProfileRectangles as ProfileRectangles,
    ProfileRings as ProfileRings,
    ProfileTube as ProfileTube,
    Region as Region,
)
from .relative import (
    Expression as Expression,
    Product as Product,
    Zero as Zero,
    direction as direction,
    point as point,
)
from .run import (
    Action as Action,
    ActionFunction as ActionFunction,
    ActionLoad as ActionLoad,
    ActionLock as ActionLock,
    ActionOutcome as ActionOutcome,
    ActionRelease as ActionRelease,
    ActionStop as ActionStop,
    ActionUnlock as ActionUnlock,
    Condition as Condition,
    ConditionCoordinate as ConditionCoordinate,
    ConditionEnergy as ConditionEnergy,
    ConditionReaction as ConditionReaction,
    ConditionSensor as ConditionSensor,
    ConditionTime as ConditionTime,
    Event as Event,
    Sensor as Sensor,
    SensorAcceleration as SensorAcceleration,
    SensorForce as SensorForce,
    SensorPosition as SensorPosition,
    SensorQuantity as SensorQuantity,
    SensorReaction as SensorReaction,
    SensorStrain as SensorStrain,
    SensorVelocity as SensorVelocity,
    StepControl as StepControl,
    View as View,
    Window as Window,
    after_events as after_events,
    carry_state as carry_state,
    initial_state as initial_state,
    project as project,
    restart as restart,
    simulate as simulate,
    steps as steps,
)
from .theory import (
    Theory as Theory,
    TheoryReissner as TheoryReissner,
    TheoryInextensible as TheoryInextensible,
    TheoryRigid as TheoryRigid,
    TheoryKirchhoff as TheoryKirchhoff,
)
from .servo import JointServo as JointServo
from .section import (
    Material as Material,
    Section as Section,
    SectionCircle as SectionCircle,
    SectionRectangle as SectionRectangle,
    SectionTube as SectionTube,
)
from .section_field import (
    SectionAlong as SectionAlong,
    SectionField as SectionField,
    SectionTable as SectionTable,
    SectionTaper as SectionTaper,
)
from .statics import (
    ArcLength as ArcLength,
    Branch as Branch,
    DisplacementControl as DisplacementControl,
    LoadControl as LoadControl,
    equilibrium as equilibrium,
    static as static,
)
from .statics.branch import (
    branch as branch,
)
from .accuracy.tolerance import (
    Answer as Answer,
    answer as answer,
)
from .accuracy import (
    Refinement as Refinement,
    refine as refine,
    stability_map as stability_map,
    work_precision as work_precision,
)

from .version import citation as citation

__version__: str
