"""What numba does to compile a kernel: only what kernels need.

Most of the time to compile goes into many small functions, so whatever is done to each of them
counts. Left out are passes for what no kernel has, such as closures; machine code of functions that
are only compiled into others; and finding anew what the same operation gives for the same types.
"""

from __future__ import annotations

import copy
import operator
from types import SimpleNamespace
from typing import Any

from llvmlite.binding import parse_assembly
from numba.core import types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.compiler_machinery import PassManager
from numba.core.datamodel import models
from numba.extending import register_model

__all__ = ["Inlining", "Pipeline"]

#: passes, as numba calls them, for closures, contexts, generators of code by literals, errors with
#: arguments and expressions of whole arrays; checks and reports
NEEDLESS = {
    *("with_lifting", "inline_closure_likes", "make_function_op_code_to_jit_function"),
    *("inline_inlinables", "inline_overloads", "Rewrite dynamic raises", "nopython_rewrites"),
    *("find_literally", "literal_unroll", "LiteralPropagation"),
    *("nopython_supported_feature_validation", "annotate_types", "dump_parfor_diagnostics"),
}
#: passes of which the first run does
ONCE = "dead_branch_prune"

_BUILTIN = type(operator.add)
_operators: dict[Any, _Operator] = {}


class _Passes(PassManager):
    """Runs passes without times, checks and reports in between."""

    def _runPass(self, index: int, made: Any, state: Any) -> None:
        made.analysis = self._analysis
        made.run_initialization(state)
        made.run_pass(state)
        made.run_finalizer(state)


class _Library(JITCodeLibrary):
    """Machine code of a kernel."""

    def _optimize_functions(self, module: Any) -> None:
        module.data_layout = self._codegen._data_layout
        for function in module.functions:
            if not function.is_declaration:
                manager, builder = self._codegen._function_pass_manager()
                manager.run(function, builder)

    def serialize_using_object_code(self) -> Any:
        """Machine code, and instead of all that it was made of the names in it."""
        self._ensure_finalized()
        names = [function.name for function in self.get_defined_functions()]
        stubs = [f'define void @"{name}"() {{ unreachable }}' for name in names]
        bitcode = parse_assembly("\n".join(stubs)).as_bitcode()
        return self.name, "object", (self._get_compiled_object(), bitcode)

    def _get_module_for_linking(self) -> Any:
        raise TypeError(f"{self.name} is called by other compiled code, but is not to be inlined")


class _Inlined(_Library):
    """Code that is only ever compiled into other code, and optimised and translated there."""

    def _get_module_for_linking(self) -> Any:
        return JITCodeLibrary._get_module_for_linking(self)

    def finalize(self) -> None:
        """Bring together what is called."""
        self._raise_if_finalized()
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """None: it is nowhere in memory."""
        return 0

    @property
    def codegen(self) -> Any:
        """Nothing to set in memory."""
        return SimpleNamespace(set_env=lambda name, env: None)


class Pipeline(Compiler):
    """Of kernels that are called."""

    library = _Library

    def compile_extra(self, function: Any) -> Any:
        """Compile a function of Python."""
        state = self.state
        state.library = self.library(state.targetctx.codegen(), function.__qualname__)
        state.library.enable_object_caching()
        state.typingctx = state.targetctx.typing_context = _remembering(state.typingctx)
        return super().compile_extra(function)

    def define_pipelines(self) -> list[PassManager]:
        """Numba's own, less what is needless."""
        (plain,) = super().define_pipelines()
        passes = _Passes("kernel")
        seen = set()
        for made, text in plain.passes:
            name = made.name()
            if name not in NEEDLESS and not (name == ONCE and name in seen):
                passes.passes.append((made, text))
            seen.add(name)
        passes.finalize()
        return [passes]


class Inlining(Pipeline):
    """Of functions that are compiled into kernels; they take and give arrays as Python owns them.

    They count no references, so they cannot make arrays.
    """

    library = _Inlined

    def compile_extra(self, function: Any) -> Any:
        """Compile a function of Python."""
        made = super().compile_extra(function)
        model = self.state.targetctx.data_model_manager[made.signature.return_type]
        if model.contains_nrt_meminfo():
            raise TypeError(f"{function.__qualname__} is inlined and gives an array")
        return made


class _Operator(types.Function):
    """One of Python's operators: what it gives for the same types is found once."""

    def __init__(self, plain: Any) -> None:
        super().__init__(plain.templates)
        self._found: dict[Any, Any] = {}

    def get_call_type(self, context: Any, args: Any, kws: Any) -> Any:
        """Signature for arguments of these types."""
        context = getattr(context, "plain", context)
        if kws:
            return super().get_call_type(context, args, kws)
        key = tuple(args)
        if key not in self._found:
            self._found[key] = super().get_call_type(context, args, kws)
        return self._found[key]


register_model(_Operator)(models.OpaqueModel)


def _remembering(context: Any) -> Any:
    """A typing context whose operators remember."""
    own = copy.copy(context)

    def resolve(value: Any) -> Any:
        kind = context.resolve_value_type(value)
        if not isinstance(value, _BUILTIN) or not isinstance(kind, types.Function):
            return kind
        if kind not in _operators:
            _operators[kind] = _Operator(kind)
        return _operators[kind]

    own.plain, own.resolve_value_type = context, resolve
    return own
