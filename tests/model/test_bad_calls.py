"""Bad calls of the whole public interface, drawn at random, end in errors of the package.

Valid calls are those in the examples of public docstrings, and a few more; in each drawn call one
argument is something else. A name that becomes public with an example is drawn, too.
"""

from __future__ import annotations

import ast
import contextlib
import copy
import doctest
import inspect
import sys
import warnings
from types import FunctionType, MethodType, ModuleType

import numpy as np
import pytest

import skfem_cosserat as sc
from skfem_cosserat.arguments import FOREIGN

X, Y, Z = np.eye(3)
NAN, INF = float("nan"), float("inf")
CALLED = "called_in_an_example"
#: a call that is taken after all would run for long
DEAR = ("answer", "refine", "stability_map", "work_precision", "Processes", "run_all")

BODY = sc.RigidBody.box(1.0, (1, 1, 1), position=(9, 9, 9))
POINT, PLACE, GROUND = sc.MassPoint(1.0, (5, 5, 5)), BODY.at((9, 9, 9)), sc.ground((9, 9, 9))
HINGE = sc.JointRevolute(GROUND, PLACE, axis=(1, 0, 0))
ROUND = sc.SectionCircle(0.1, sc.Material(1.0, 0.3, 1.0))
ROD = sc.Beam(sc.MeshCurve.init_line((0, 0, 7), (1, 0, 7), 2, "rod"), ROUND)
TIP = ROD.node("rod.end")

#: each in place of any argument
BAD = [
    *(None, True, "no such thing", "", b"text", {}, {"no": 1}, {1}, object(), 1 + 2j, sc.MassPoint),
    *(lambda *given: None, lambda *given: np.ones((2, 2, 2))),
    *(NAN, INF, -INF, -1, -1.5, 0, 0.5, 10**400, -(10**30)),
    *([], [[]], [1, [2, 3]], [[1, 2], [3]], [None], ["a", "b"], [object()], [10**400] * 3),
    *(np.ones(7), np.ones((2, 3)), np.ones((3, 3, 3)), np.zeros(3), np.full(3, NAN), 1j * X),
    *(np.array(["a", "b"]), np.full((3, 3), NAN), POINT, PLACE, HINGE, ROD),
]
#: valid calls of what no docstring calls
MORE = [
    (sc.direction, (PLACE, X)),
    (sc.point, (PLACE,)),
    (sc.Freedom, (None, ())),
    (sc.Product, (sc.point(PLACE), sc.point(PLACE))),
    (sc.Slide, ("u", X, Y)),
    (sc.Turn, ("angle", X)),
    (sc.Zero, (sc.point(PLACE),)),
    (sc.ActionFunction, (lambda *given: None,)),
    (sc.ActionLoad, ("load", 2.0)),
    (sc.ActionUnlock, ("hinge",)),
    (sc.ConditionEnergy, (1.0,)),
    (sc.ConditionReaction, (HINGE, 1.0)),
    (sc.ConditionTime, (1.0,)),
    (sc.SensorAcceleration, (TIP,)),
    (sc.SensorForce, (ROD, 0.5)),
    (sc.SensorQuantity, (lambda *given: 1.0,)),
    (sc.SensorReaction, (HINGE,)),
    (sc.SensorStrain, (ROD, 0.5)),
    (sc.SensorVelocity, (TIP,)),
    (ROD.mesh.translated, (X,)),
    (ROD.mesh.moved, (np.eye(3), X)),
    (ROD.mesh.with_beams, ({"first": [0]},)),
    (ROD.mesh.elements_satisfying, (lambda x: x[0] > 0.5,)),
    (sc.MeshCurve.init_points, ([(0, 0, 0), (1, 0, 0)],)),
    (ROUND.damped, (1e-3,)),
]


def public():
    """Public functions and classes by name, those of public modules included."""
    found = {}
    for name in sc.__all__:
        with contextlib.suppress(ImportError):  # an extra that is not installed
            thing = getattr(sc, name)
            inside = vars(thing).values() if isinstance(thing, ModuleType) else [thing]
            for each in inside:
                own = str(getattr(each, "__module__", "")).startswith("skfem_cosserat")
                known = isinstance(each, type | FunctionType) and not each.__name__.startswith("_")
                if own and known and not (isinstance(each, type) and issubclass(each, Exception)):
                    found[each.__qualname__] = each
    return found


class Recorded(ast.NodeTransformer):
    """Calls go by way of a function that keeps them."""

    def visit_Call(self, node):
        self.generic_visit(node)
        if isinstance(node.func, ast.Name) and node.func.id == "super":
            return node
        return ast.Call(ast.Name(CALLED, ast.Load()), [node.func, *node.args], node.keywords)


def owner(function):
    """Class of a method, or the function or class itself."""
    if not isinstance(function, MethodType):
        return function
    return function.__self__ if inspect.isclass(function.__self__) else type(function.__self__)


@pytest.fixture(scope="module")
def examples(tmp_path_factory):
    """A valid call of each function, class and method, and the types of what calls gave."""
    calls, seen, known = {}, set(), public()

    def called(function, *args, **kwargs):
        found = owner(function)
        out = function(*args, **kwargs)
        name = getattr(found, "__qualname__", "")
        ours = str(getattr(function, "__module__", "")).startswith("skfem_cosserat")
        if name and known.get(name) is found and ours:  # others are methods of scikit-fem
            calls.setdefault((name, function.__name__), (function, args, kwargs))
            seen.update((name, type(out).__qualname__))
        return out

    for function, args in MORE:
        called(function, *args)
    finder, runner = doctest.DocTestFinder(), doctest.DocTestRunner()
    with contextlib.chdir(tmp_path_factory.mktemp("examples")), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name, thing in known.items():
            module = sys.modules[thing.__module__]
            for test in finder.find(thing, name, module, globs=vars(module) | {CALLED: called}):
                for example in test.examples:
                    tree = Recorded().visit(ast.parse(example.source))
                    example.source = ast.unparse(ast.fix_missing_locations(tree)) + "\n"
                runner.run(test, out=lambda text: None, clear_globs=False)
    return calls, seen


#: bases of what a user writes anew, what those are given, and what reads files
WRITTEN = {"Integrator", "Joint", "Load", "SectionField", "StepBalance", "Theory"}
WRITTEN |= {"Evaluation", "StepData", "StepWork", "BladeBeamDyn", "read_beamdyn"}


@pytest.mark.slow
def test_every_public_name_is_drawn(examples):
    names = {
        name
        for name, thing in public().items()
        if getattr(sc, name, None) is thing and not inspect.isabstract(thing)
    }
    assert names - examples[1] == WRITTEN


@pytest.mark.slow
def test_bad_calls_end_in_errors_of_the_package(examples, tmp_path):
    """At most one of a hundred in an error of Python or numpy."""
    draw = np.random.default_rng(20)
    cases = [
        (call, parameter, bad)
        for (name, _), call in examples[0].items()
        if name not in DEAR
        for parameter in inspect.signature(call[0]).parameters.values()
        if parameter.kind is not parameter.VAR_KEYWORD
        for bad in BAD
    ]
    foreign = []
    drawn = draw.choice(len(cases), 2000, replace=False)
    with contextlib.chdir(tmp_path), warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        for (function, args, kwargs), parameter, bad in map(cases.__getitem__, drawn):
            given = inspect.signature(function).bind(*args, **kwargs)
            several = parameter.kind is parameter.VAR_POSITIONAL
            given.arguments[parameter.name] = (bad,) if several else bad
            if isinstance(getattr(function, "__self__", None), sc.Model):
                function, given = copy.deepcopy((function, given))  # which it changes
            try:
                function(*given.args, **given.kwargs)
            except (sc.CosseratError, ImportError):  # or an extra that is not installed
                continue
            except FOREIGN as error:
                foreign.append(f"{function.__qualname__}({parameter.name}={bad!r:.60}): {error!r}")
    assert len(foreign) <= len(drawn) / 100, "\n".join(foreign)
