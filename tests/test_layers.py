"""The library keeps its layers and its house rules; every finding names file, line and cause.

The rules are read from the syntax trees, so they also see imports inside functions and under
``TYPE_CHECKING``. Each rule is tried on a bad source below.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

NAME = "skfem_cosserat"
PACKAGE = Path(__file__).resolve().parent.parent / NAME

#: Lowest first: a module imports only from lines above its own, or from its own line without
#: cycles. A name is a module or a folder of the package.
LAYERS = (
    ("errors", "types", "log", "version", "figures"),
    ("pattern", "mesh", "element", "basis", "assembly"),
    ("law", "section", "hyperelastic", "profile", "rung", "strain", "kernels"),
    (
        *("frames", "kinds", "relative", "beam", "body", "joint", "load", "coupling", "damping"),
        *("drive", "foundation", "motion", "ramp", "twin"),
    ),
    ("model",),
    ("compiled", "linear", "newton"),
    ("constraints",),
    ("integrators",),
    ("history",),
    ("diagnostics",),
    ("statics", "modal", "simulate", "parallel"),
    ("export", "plot", "study", "adaptive", "advice", "cli"),
    ("__init__", "__main__"),
)
LAYER = {name: number for number, names in enumerate(LAYERS, start=1) for name in names}

#: Import names of the hard dependencies: nothing else but Python's own is imported with a module.
REQUIRED = {"numpy", "scipy", "skfem", "meshio"}
#: What a folder that is itself imported in functions only may import with its modules.
COMPILED = {("compiled", "numba"), ("compiled", "llvmlite")}
OPTIONAL = (
    *("pyvista", "matplotlib", "vtk", "vtkmodules", "numba", "llvmlite", "pypardiso", "pymetis"),
    *("h5py", "tqdm", "shapely"),
)

MAX_MODULE_LINES = 500
MAX_FUNCTION_LINES = 70

TYPE_CHECKING = {"TYPE_CHECKING", "typing.TYPE_CHECKING"}
Function = (ast.FunctionDef, ast.AsyncFunctionDef)


@dataclass(frozen=True)
class Module:
    """A source file of the package: its dotted name below the package, and its syntax tree."""

    path: Path
    name: str
    tree: ast.Module
    lines: int

    @property
    def top(self) -> str:
        return self.name.split(".")[0]

    def at(self, node: ast.AST) -> str:
        return f"{self.path}:{getattr(node, 'lineno', 1)}"


@dataclass(frozen=True)
class Import:
    """An import of a module of the package; ``target`` is dotted, ``__init__`` for the package."""

    module: Module
    node: ast.AST
    target: str


def read_package(folder: Path) -> list[Module]:
    modules = []
    for path in sorted(folder.rglob("*.py")):
        parts = path.relative_to(folder).with_suffix("").parts
        name = ".".join(parts[:-1] if len(parts) > 1 and parts[-1] == "__init__" else parts)
        source = path.read_text(encoding="utf-8")
        modules.append(Module(path, name, ast.parse(source), source.count("\n")))
    return modules


@cache
def whole_package() -> list[Module]:
    """The package as it is, read once."""
    return read_package(PACKAGE)


# -- imports ---------------------------------------------------------------------------------


def absolute_names(module: Module, node: ast.AST) -> list[str]:
    """Dotted names an import statement may bring in: ``from a import b`` gives ``a.b``."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        base = node.module or ""
        if node.level:
            parts = [NAME] if module.name == "__init__" else [NAME, *module.name.split(".")]
            up = node.level - (module.path.name == "__init__.py")
            parts = parts[: len(parts) - up]
            base = ".".join(parts + ([node.module] if node.module else []))
        return [f"{base}.{alias.name}" for alias in node.names]
    if isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant):
        function = node.func.attr if isinstance(node.func, ast.Attribute) else ""
        function = node.func.id if isinstance(node.func, ast.Name) else function
        if function in {"import_module", "__import__"}:
            return [str(node.args[0].value)]
    return []


def own_imports(modules: list[Module]) -> list[Import]:
    """Imports among the modules of the package, wherever they stand."""
    known = {module.name for module in modules}
    found = []
    for module in modules:
        for node in ast.walk(module.tree):
            for name in absolute_names(module, node):
                root, _, below = name.partition(".")
                if root != NAME:
                    continue
                while below and below not in known:  # the last part may be a class or function
                    below = below.rpartition(".")[0]
                found.append(Import(module, node, below or "__init__"))
    return found


def unknown_modules(modules: list[Module]) -> list[str]:
    """Modules that the table does not hold."""
    return [
        f"{module.path}: {module.top!r} is on no line of LAYERS in {Path(__file__).name}"
        for module in modules
        if module.top not in LAYER
    ]


def upward_imports(modules: list[Module]) -> list[str]:
    """Imports of a module on a line below (a higher layer)."""
    found = []
    for each in own_imports(modules):
        source, target = each.module.top, each.target.split(".")[0]
        if LAYER.get(target, 0) > LAYER.get(source, len(LAYERS)):
            where = f"{each.module.at(each.node)}: {source} (layer {LAYER[source]}) imports"
            found.append(f"{where} {NAME}.{each.target} (layer {LAYER[target]})")
    return found


def cyclic_imports(modules: list[Module]) -> list[str]:
    """Cycles among modules, and among the names of the table.

    Inside one folder a module may name its neighbour for annotations alone.
    """
    files: dict[str, set[str]] = {}
    names: dict[str, set[str]] = {}
    run = {id(node) for module in modules for node in nodes_run(module.tree)}
    for each in own_imports(modules):
        if id(each.node) not in run and each.module.top == each.target.split(".")[0]:
            continue
        files.setdefault(each.module.name, set()).add(each.target)
        if each.module.top != each.target.split(".")[0]:
            names.setdefault(each.module.top, set()).add(each.target.split(".")[0])
    found = []
    for graph in (files, names):
        try:
            TopologicalSorter(graph).prepare()
        except CycleError as error:  # its path goes from a module to the one importing it
            found.append("imports in a circle: " + " imports ".join(reversed(error.args[1])))
    return found


def nodes_run(node: ast.AST) -> Iterator[ast.AST]:
    """Nodes below ``node`` that run some time: all but the blocks for annotations."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.If) and ast.unparse(child.test) in TYPE_CHECKING:
            child = ast.Module(child.orelse, [])
        yield child
        yield from nodes_run(child)


def nodes_run_at_import(node: ast.AST) -> Iterator[ast.AST]:
    """Nodes below ``node`` that run when the module is imported."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, (*Function, ast.Lambda)):
            continue
        if isinstance(child, ast.If) and ast.unparse(child.test) in TYPE_CHECKING:
            child = ast.Module(child.orelse, [])  # only the else branch runs
        yield child
        yield from nodes_run_at_import(child)


def optional_at_import(modules: list[Module]) -> list[str]:
    """Packages that are no hard dependency, yet needed to import a module."""
    allowed = {NAME, *REQUIRED, *sys.stdlib_module_names}
    return [
        f"{module.at(node)}: {name} is no dependency of {NAME}: import it in a function"
        for module in modules
        for node in nodes_run_at_import(module.tree)
        for name in sorted({name.split(".")[0] for name in absolute_names(module, node)})
        if name not in allowed and (module.top, name) not in COMPILED
    ]


# -- house rules -----------------------------------------------------------------------------


def prints(modules: list[Module]) -> list[str]:
    return [
        f"{module.at(node)}: print in the library"
        for module in modules
        for node in ast.walk(module.tree)
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "print"
    ]


def broad_excepts(modules: list[Module]) -> list[str]:
    found = []
    for module in modules:
        for node in ast.walk(module.tree):
            caught: list[ast.expr] = []
            if isinstance(node, ast.ExceptHandler):
                if node.type is None:
                    found.append(f"{module.at(node)}: bare except")
                    continue
                caught = node.type.elts if isinstance(node.type, ast.Tuple) else [node.type]
            elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith("suppress"):
                caught = node.args
            for name in map(ast.unparse, caught):
                if name.removeprefix("builtins.") in {"Exception", "BaseException"}:
                    found.append(f"{module.at(node)}: catches {name}")
    return found


def long_ones(modules: list[Module]) -> list[str]:
    found = [
        f"{module.path}: {module.lines} lines, at most {MAX_MODULE_LINES}"
        for module in modules
        if module.lines > MAX_MODULE_LINES
    ]
    for module in modules:
        for node in ast.walk(module.tree):
            if isinstance(node, Function):
                lines = (node.end_lineno or node.lineno) - node.lineno + 1
                if ast.get_docstring(node) is not None:  # saying more is no fault
                    text = node.body[0]
                    lines -= (text.end_lineno or text.lineno) - text.lineno + 1
                if lines > MAX_FUNCTION_LINES:
                    found.append(
                        f"{module.at(node)}: {node.name} has {lines} lines,"
                        f" at most {MAX_FUNCTION_LINES}"
                    )
    return found


def public_definitions(body: list[ast.stmt]) -> Iterator[ast.stmt]:
    """Public classes and functions, with the public methods of the classes."""
    for node in body:
        if isinstance(node, (*Function, ast.ClassDef)) and not node.name.startswith("_"):
            decorators = [ast.unparse(each) for each in node.decorator_list]
            if any(each.endswith((".setter", "overload", "override")) for each in decorators):
                continue  # documented at the getter, the implementation or the base
            yield node
            if isinstance(node, ast.ClassDef):
                yield from public_definitions(node.body)


def undocumented(modules: list[Module]) -> list[str]:
    found = [
        f"{module.path}: no docstring"
        for module in modules
        if ast.get_docstring(module.tree) is None
    ]
    for module in modules:
        for node in public_definitions(module.tree.body):
            if isinstance(node, (*Function, ast.ClassDef)) and ast.get_docstring(node) is None:
                found.append(f"{module.at(node)}: {node.name} has no docstring")
    return found


RULES = (
    unknown_modules,
    upward_imports,
    cyclic_imports,
    optional_at_import,
    prints,
    broad_excepts,
    long_ones,
    undocumented,
)
Rule = Callable[[list[Module]], list[str]]


@pytest.mark.parametrize("rule", RULES)
def test_library_keeps(rule: Rule):
    found = rule(whole_package())
    assert not found, "\n" + "\n".join(found)


def test_import_brings_no_optional_package():
    code = f"import sys, {NAME}; print([n for n in {OPTIONAL!r} if n in sys.modules])"
    result = subprocess.run(
        [sys.executable, "-c", code], cwd=PACKAGE.parent, capture_output=True, text=True, check=True
    )
    assert result.stdout.strip() == "[]"


# -- the rules on bad sources ----------------------------------------------------------------

CLEAN = {
    "__init__.py": '"""D."""\nfrom skfem_cosserat.model import Model\nfrom . import plot\n',
    "errors.py": '"""D."""\nfrom typing import Any\n',
    "mesh/__init__.py": '"""D."""\nfrom .lines import Line\nfrom ..errors import Bad\n',
    "mesh/lines.py": '"""D."""\nimport numpy as np\nfrom .. import errors\n',
    "joint.py": '"""D."""\nfrom .beam import Beam\nimport skfem_cosserat.mesh.lines\n',
    "beam.py": '"""D."""\nfrom . import mesh, errors\n',
    "model.py": '"""D."""\nfrom .joint import Joint\nfrom .beam import Beam\n',
    "plot.py": (
        '"""D."""\nfrom typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import pyvista\n'
        'def show():\n    """D."""\n    import pyvista\n    from .model import Model\n'
    ),
}

BAD: list[tuple[Rule, dict[str, str], str]] = [
    (unknown_modules, {"helpers.py": ""}, "'helpers' is on no line"),
    (unknown_modules, {"helpers/a.py": ""}, "'helpers' is on no line"),
    (
        upward_imports,
        {"beam.py": "\nfrom .model import Model"},
        "beam.py:2: beam (layer 4) imports",
    ),
    (upward_imports, {"beam.py": "from . import model"}, "skfem_cosserat.model (layer 5)"),
    (upward_imports, {"beam.py": "import skfem_cosserat.model"}, "skfem_cosserat.model (layer 5)"),
    (upward_imports, {"beam.py": "from skfem_cosserat import model"}, "skfem_cosserat.model"),
    (upward_imports, {"beam.py": "def f():\n    from .model import M"}, "beam.py:2:"),
    (upward_imports, {"beam.py": "if TYPE_CHECKING:\n    from .model import M"}, "beam.py:2:"),
    (upward_imports, {"beam.py": "from . import Model"}, "skfem_cosserat.__init__ (layer 13)"),
    (upward_imports, {"beam.py": "import skfem_cosserat"}, "skfem_cosserat.__init__ (layer 13)"),
    (upward_imports, {"beam.py": "import_module('skfem_cosserat.model')"}, "skfem_cosserat.model"),
    (upward_imports, {"mesh/lines.py": "from ..model import M"}, "lines.py:1: mesh (layer 2)"),
    (upward_imports, {"mesh/__init__.py": "from ..model import M"}, "__init__.py:1: mesh"),
    (cyclic_imports, {"beam.py": "from .joint import J"}, "beam imports joint imports beam"),
    (cyclic_imports, {"mesh/lines.py": "from . import Line"}, "mesh imports mesh.lines"),
    (
        cyclic_imports,
        {"beam/a.py": "from ..joint import J", "beam/b.py": "", "joint.py": "from .beam import b"},
        "beam imports joint imports beam",
    ),
    (
        optional_at_import,
        {"plot.py": "import pyvista as pv"},
        "plot.py:1: pyvista is no dependency",
    ),
    (optional_at_import, {"plot.py": "try:\n    from tqdm import tqdm\nfinally: 1"}, "py:2: tqdm"),
    (optional_at_import, {"plot.py": "class A:\n    import vtk"}, "plot.py:2: vtk"),
    (optional_at_import, {"plot.py": "if TYPE_CHECKING: 1\nelse:\n    import h5py"}, "py:3: h5py"),
    (prints, {"cli.py": "def f():\n    print(1)"}, "cli.py:2: print"),
    (broad_excepts, {"cli.py": "try: 1\nexcept: 2"}, "cli.py:2: bare except"),
    (broad_excepts, {"cli.py": "try: 1\nexcept Exception: 2"}, "cli.py:2: catches Exception"),
    (broad_excepts, {"cli.py": "try: 1\nexcept (OSError, BaseException): 2"}, "BaseException"),
    (broad_excepts, {"cli.py": "with suppress(Exception): 2"}, "cli.py:1: catches Exception"),
    (long_ones, {"cli.py": "\n" * 501}, "501 lines, at most 500"),
    (long_ones, {"cli.py": "class A:\n def f(self):\n" + "  1\n" * 80}, "f has 81 lines"),
    (undocumented, {"cli.py": ""}, "cli.py: no docstring"),
    (undocumented, {"cli.py": '"""D."""\ndef f(): 1'}, "cli.py:2: f has no docstring"),
    (undocumented, {"cli.py": '"""D."""\nclass A: 1'}, "cli.py:2: A has no docstring"),
    (undocumented, {"cli.py": '"""D."""\nclass A:\n "D."\n def f(self): 1'}, "py:4: f has no"),
]


def write_package(folder: Path, sources: dict[str, str]) -> list[Module]:
    for name, source in sources.items():
        path = folder / NAME / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(source, encoding="utf-8")
    return read_package(folder / NAME)


@pytest.mark.parametrize("rule", RULES)
def test_clean_package_passes(rule: Rule, tmp_path: Path):
    assert rule(write_package(tmp_path, CLEAN)) == []


@pytest.mark.parametrize(("rule", "sources", "words"), BAD)
def test_bad_source_is_named(rule: Rule, sources: dict[str, str], words: str, tmp_path: Path):
    found = rule(write_package(tmp_path, CLEAN | sources))
    assert any(words in each for each in found), found


@pytest.mark.parametrize("source", ["def f(self):\n" + "  1\n" * 69, "\n" * 500])
def test_lengths_at_the_limit_pass(source: str, tmp_path: Path):
    assert long_ones(write_package(tmp_path, {"cli.py": source})) == []
