"""Kernels as machine code: found on disk, loaded and called without numba (but on Windows).

Numba compiles kernels, part by part (:mod:`.jit`). What it has made is kept here as it is, and the
next process hands it to the linker of LLVM: that takes a few milliseconds, the import of numba and
its own cache a quarter of a second. Names of files tell sources, processor and kinds of arguments
apart, so there is nothing to be asked but whether a file is there.

Kernels may need functions of the C library (``sin``), but nothing of numba: they take no memory,
see :func:`.simd.local`, and are called by their addresses.
"""

from __future__ import annotations

import ctypes
import hashlib
import json
import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from enum import IntEnum, auto
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from .structures import ArrayField

#: kind of an array of numbers: those of a step, which all parts take
VECTOR = ArrayField(np.dtype(float).str, 1)


class Source(IntEnum):
    """Sources of kernels: this process and the disk alone, or the compiler, too."""

    DISK = auto()
    COMPILER = auto()


class NotKept(Exception):
    """A kernel is in none of the places that it may come from."""


def compile_errors() -> tuple[type[Exception], ...]:
    """Exceptions that numba raises where it cannot compile, or lacks what jit.py asks of it."""
    found = ImportError, OSError, AttributeError, TypeError, NotImplementedError
    try:
        from numba.core.errors import NumbaError
    except (ImportError, OSError):  # numba cannot be imported
        return found
    return NumbaError, *found


#: what tells kernels apart: family and name of the function, kinds of its arguments
Key = tuple[str, str, tuple[Any, ...]]
#: of kernels that are in this process
_ADDRESSES: dict[Key, int] = {}
_LOADING = threading.Lock()
#: threads bind scenes one after the other: the second finds all kernels there, and starts no helper
BINDING = threading.Lock()
#: variables of numba, behind NUMBA_, that machine code depends on
OPTIONS = "CPU_NAME", "CPU_FEATURES", "ENABLE_AVX", "OPT", "LOOP_VECTORIZE", "SLP_VECTORIZE"
#: folders where some have been seen
_PROMISING: set[Path] = set()


def _begin_anew() -> None:
    """In a process that was forked while a thread, which it has not, was loading."""
    global _LOADING, BINDING
    _LOADING, BINDING = threading.Lock(), threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_begin_anew)


@cache
def stamp() -> str:
    """Digest of all sources that are compiled."""
    digest = hashlib.sha256()
    folder = Path(__file__).parent
    others = [folder.parent / name for name in ("newton.py", "law.py", "model/coordinates.py")]
    for path in [*sorted(folder.rglob("*.py")), *others]:
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


@cache
def _linker() -> Any:
    """That of LLVM; what is linked stays as long as the process."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = llvm.Target.from_default_triple().create_target_machine()
    return llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)


@cache
def _processor() -> str:
    """Description of all that machine code depends on beside its source.

    The version of llvmlite stands for that of numba: each release of numba has one of llvmlite.
    """
    import llvmlite
    import llvmlite.binding as llvm

    features = llvm.get_host_cpu_features().flatten()
    wanted = [os.environ.get(f"NUMBA_{name}", "") for name in OPTIONS]
    own = llvmlite.__version__, llvm.get_default_triple(), llvm.get_host_cpu_name(), features
    return repr((*own, *wanted))


@cache
def _folder(given: str | None) -> Path:
    """Folder of kept kernels: `given` by numba's variable, beside the sources, or the user's."""
    here = Path(__file__).parent
    if given is None and os.access(here, os.W_OK):
        return here / "__pycache__"
    name = f"{here.name}_{hashlib.sha256(str(here).encode()).hexdigest()[:16]}"
    if given is not None:
        return Path(given) / name
    home = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA")
    try:
        return (Path(home) if home else Path.home() / ".cache") / "skfem_cosserat" / name
    except RuntimeError:  # a user without a home: nothing is kept
        return Path(os.devnull) / name


def folder() -> Path:
    """Folder where kernels are kept."""
    return _folder(os.environ.get("NUMBA_CACHE_DIR") or None)


def _file(key: Key) -> Path:
    family, name, kinds = key
    digest = hashlib.sha256(repr((_processor(), kinds)).encode()).hexdigest()[:16]
    return folder() / f"{_named(family, name)}-{stamp()}-{digest}.kernel"


def _named(family: str, name: str) -> str:
    return f"{family}.{name}".replace(" ", "_")


def _files(family: str, name: str) -> Iterator[Path]:
    """Files of a kernel of these sources, for whatever processor and kinds."""
    return folder().glob(f"{_named(family, name)}-{stamp()}-*.kernel")


def promising() -> bool:
    """True if the loop over a step is on disk, which all scenes take: other kernels may be, too."""
    if folder() not in _PROMISING and any(_files("step", "solve")):
        _PROMISING.add(folder())
    return folder() in _PROMISING


def cold(family: str, name: str) -> bool:
    """True if no version of a kernel is in this process or on disk, where it could be kept."""
    if any(key[:2] == (family, name) for key in _ADDRESSES) or any(_files(family, name)):
        return False
    there = next((path for path in (folder(), *folder().parents) if path.exists()), folder())
    return there.is_dir() and os.access(there, os.W_OK)


def keep(key: Key, symbol: str, needs: Sequence[str], code: bytes) -> None:
    """Keep machine code on disk, in place of that of older sources; or not, if that cannot be.

    Parameters
    ----------
    symbol : str
        Name of the function in it.
    needs : sequence of str
        Functions of other libraries that it calls.
    """
    about = {"symbol": symbol, "needs": [*needs], "sha256": hashlib.sha256(code).hexdigest()}
    path = _file(key)
    part = path.with_name(f"{path.name}.{os.getpid()}.{threading.get_ident()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.write_bytes(json.dumps(about).encode() + b"\n" + code)
        part.replace(path)  # whole or not at all
        own = _named(*key[:2])
        for other in path.parent.glob(f"{own}-*"):  # parts of one, and locks, too
            if not other.name.startswith(f"{own}-{stamp()}-"):
                other.unlink()
    except OSError:
        with suppress(OSError):
            part.unlink()


def _load(key: Key) -> int | None:
    """Address of a kernel that is on disk; None: it is not, or is damaged."""
    try:
        about, code = _file(key).read_bytes().split(b"\n", 1)
        told = json.loads(about)
        if hashlib.sha256(code).hexdigest() != told["sha256"]:
            return None
    except (OSError, ValueError, LookupError, TypeError):
        return None
    import llvmlite.binding as llvm

    if os.name == "nt":  # numba names functions there that machine code may need
        import_module("numba.core.registry").cpu_target.target_context  # noqa: B018
    linker = _linker()
    if any(llvm.address_of_symbol(name) is None for name in told["needs"]):
        return None  # the linker would end the process
    linker.add_object_file(llvm.ObjectFileRef.from_data(code))
    linker.finalize_object()
    return int(linker.get_function_address(told["symbol"])) or None


@contextmanager
def _alone(path: Path) -> Iterator[None]:
    """While a file is made: other processes that would make it wait, where that can be told."""
    try:
        import fcntl

        path.parent.mkdir(parents=True, exist_ok=True)
        lock = path.with_suffix(".lock").open("w")
        fcntl.flock(lock, fcntl.LOCK_EX)  # ends with the process, however that ends
    except (ImportError, OSError):
        yield
        return
    try:
        yield
    finally:
        with suppress(OSError):
            os.unlink(lock.name)
        lock.close()


def address(family: str, name: str, kinds: Sequence[Any], source: Source = Source.COMPILER) -> int:
    """Address of a kernel for arguments of these kinds.

    Parameters
    ----------
    family : str
        See :func:`.jit.function_named`.
    kinds : sequence
        Kinds of structures, :data:`VECTOR`, or ``int``.

    Raises
    ------
    NotKept
        If it is in none of the places that it may come from.
    """
    key = family, name, tuple(kinds)
    place = _ADDRESSES.get(key)
    if place is not None:
        return place
    with _LOADING:
        place = _load(key)
        if place is None:
            if source < Source.COMPILER:
                raise NotKept(name)
            with _alone(_file(key)):
                place = _load(key)  # if another process was faster
                if place is None:
                    # by its name: it imports this module, and numba
                    place = int(import_module(".jit", __package__).compiled(key))
        _ADDRESSES[key] = place
    return place


#: ``status f(double *result, void **error, void *structure, int64 flag)``; it keeps the lock of
#: Python, and what it calls back may raise
_ENTRY = ctypes.PYFUNCTYPE(
    ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64
)


def entry(
    family: str, name: str, structure: Any, source: Source = Source.COMPILER
) -> Callable[..., float]:
    """Function that calls a kernel of one structure and a flag: ``number = call(flag=0)``.

    Raises
    ------
    NotKept
        As :func:`address`.
    """
    function = _ENTRY(address(family, name, (structure.kind, int), source))
    result, error = ctypes.c_double(), ctypes.c_void_p()
    given = ctypes.addressof(result), ctypes.addressof(error), structure.address

    def call(flag: int = 0) -> float:
        if function(*given, flag):
            raise RuntimeError(f"the kernel {name} has failed")
        return result.value

    call.structure = structure  # type: ignore[attr-defined]  # lives as long
    return call


# -- help on an empty disk -------------------------------------------------------------------------


def processors() -> int:
    """Number of processors that this process may use."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


#: what a helper does
HELP = "import pickle, sys; pickle.load(sys.stdin.buffer)()"


def help_with(keys: Sequence[Key]) -> None:
    """Compile these kernels, in this order, and keep them."""
    for key in keys:
        address(*key)


@contextmanager
def helped(keys: Sequence[Key]) -> Iterator[None]:
    """While kernels are compiled, a second process compiles these and keeps them on disk.

    Where both meet, the rest is read from the disk. Whatever happens to the helper, nothing is lost
    but time.
    """
    helper = None
    # embedded in another program, the executable may be anything
    if processors() > 1 and Path(sys.executable).stem.lower().startswith(("python", "pypy")):
        path, none = os.pathsep.join(filter(None, sys.path)), subprocess.DEVNULL
        with suppress(OSError):
            helper = subprocess.Popen(
                [sys.executable, "-c", HELP],
                env={**os.environ, "PYTHONPATH": path},
                stdin=subprocess.PIPE,
                stdout=none,
                stderr=none,
            )
            assert helper.stdin is not None
            with helper.stdin as given:
                pickle.dump(partial(help_with, keys), given)
    try:
        yield
    finally:
        if helper is not None:
            helper.kill()  # files get into the cache whole or not at all
            helper.wait()
