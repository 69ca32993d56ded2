"""Machine code for functions of numbers and arrays, kept from one process to the next."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from types import ModuleType
from typing import Any, Literal, TypedDict, TypeVar, cast

import numpy as np
from llvmlite.binding import Linkage
from numba import njit
from numba.core import event as events
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_machinery import AnalysisPass, register_pass
from numba.core.dispatcher import Dispatcher
from numba.core.typed_passes import IRLegalization
from numpy.typing import NDArray

Compiled = TypeVar("Compiled", bound=Callable[..., Any])


class _Options(TypedDict):
    fastmath: set[str]
    error_model: Literal["numpy"]


# Sums may run in vector lanes; NaN and infinity keep their meaning, and a division by zero gives them.
OPTIONS: _Options = {"fastmath": {"reassoc", "contract", "nsz"}, "error_model": "numpy"}


def compiled(function: Compiled) -> Compiled:
    """The function, inlined into the compiled functions that call it."""
    return cast(Compiled, njit(**OPTIONS)(function))


def compiled_entry(function: Compiled) -> Compiled:
    """The function, to be called from Python: compiled at its first call and stored where Python keeps its own.

    That is ``__pycache__`` beside the source, or the user's cache where the installation cannot be written to. What is
    stored is renewed when anything changes that went into it: the source of a compiled function that it reaches,
    whatever file that stands in, a constant, or this file. The process that compiles computes the same bits as those
    that load.
    """
    return _kept(function, njit(pipeline_class=cast(Any, _Pipeline), **OPTIONS)(function))


def exactly_compiled_entry(function: Compiled) -> Compiled:
    """As :func:`compiled_entry`, but each operation is rounded as written, as NumPy does it; calls none of the others.

    For what took NumPy a call for each of many small arrays, where results must stay the same to the bit.
    """
    return _kept(function, njit(error_model="numpy")(function))


def compiled_here() -> list[str]:
    """Names of the functions whose machine code this process made; of the others it is what an earlier one stored."""
    return sorted(_COMPILED_HERE)


_COMPILED_HERE: set[str] = set()


def _kept(function: Compiled, dispatcher: Any) -> Compiled:
    with suppress(RuntimeError):  # no place can be written to: each process compiles for itself
        dispatcher._cache = _Cache(function)  # Numba's own place for it
    return cast(Compiled, dispatcher)


class _OwnCopies(JITCodeLibrary):
    """Machine code of which nothing is replaced.

    What a function calls is compiled into its own code, with roundings of its own where sums may be reordered. Numba
    gives those copies names that the linker may resolve to another function's copy: the one that was there first, which
    is another in the process that compiles than in one that loads. Here the copies have no name outside.
    """

    def _optimize_final_module(self) -> None:
        module: Any = self._final_module
        for function in module.functions:
            if not function.is_declaration and function.linkage == Linkage.linkonce_odr:
                function.linkage = Linkage.internal
        super()._optimize_final_module()


@register_pass(mutates_CFG=False, analysis_only=True)
class _WithOwnCopies(AnalysisPass):
    """Before machine code is made: it goes into such a library."""

    _name = "own_copies"

    def __init__(self) -> None:
        AnalysisPass.__init__(self)

    def run_pass(self, state: Any) -> bool:
        state.library = _OwnCopies(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return False


class _Pipeline(CompilerBase):
    """Numba's own, with :class:`_OwnCopies`."""

    def define_pipelines(self) -> list[Any]:
        passes = DefaultPassBuilder.define_nopython_pipeline(self.state)
        passes.add_pass_after(_WithOwnCopies, IRLegalization)
        passes.finalize()
        return [passes]


class _Cache(FunctionCache):
    """Numba's cache of a function, which by itself looks at the time of the function's own file only."""

    _stamped = False

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The machine code of that signature, or None; what it calls is all there by the first call."""
        self._stamp()
        return super().load_overload(sig, target_context)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keeps it, if there is something to keep.

        LLVM hands machine code over in a callback, and says nothing where Ctrl-C ends that: the code works, but cannot
        be kept. The interrupt itself is raised again a moment later (:mod:`highfive.hil.runtime.interrupts`).
        """
        if not _handed_over(data.library):
            return
        _COMPILED_HERE.add(f"{self._py_func.__module__.rpartition('.')[2]}.{self._py_func.__name__}")
        self._stamp()
        with suppress(OSError):  # a disk that is full: the code works, and the next process compiles it again
            super().save_overload(sig, data)

    def _stamp(self) -> None:
        if not self._stamped:
            self._cache_file = IndexDataCacheFile(self._cache_path, self._impl.filename_base, reached(self._py_func))
            self._stamped = True


def _handed_over(library: Any) -> bool:
    try:
        library.serialize_using_object_code()
    except RuntimeError:
        return False
    return True


def reached(function: Callable[..., Any]) -> str:
    """A digest of all that the function's machine code is made from.

    That is the source of this file, of every file with a compiled function that it calls, directly or not, and the
    constants that they read; names are looked up as the compiler does.
    """
    files: dict[str, None] = {__file__: None}
    constants: set[str] = set()
    seen: set[int] = set()
    waiting: list[Callable[..., Any]] = [function]
    while waiting:
        one = waiting.pop()
        if id(one) in seen:
            continue
        seen.add(id(one))
        files.setdefault(one.__code__.co_filename)
        for name, value in _read(one):
            if isinstance(value, Dispatcher):
                waiting.append(cast("Dispatcher[Callable[..., Any]]", value).py_func)
            elif isinstance(value, np.ndarray):
                array = cast("NDArray[Any]", value)
                constants.add(f"{name} {array.dtype} {array.shape} {array.tobytes().hex()}")
            elif isinstance(value, (bool, int, float, str, tuple)):
                constants.add(f"{name} {value!r}")
    digest, sources = sha256(), (_source(file) for file in files)
    for text in (*sorted(filter(None, sources)), *sorted(constants)):
        digest.update(sha256(text.encode()).digest())
    return digest.hexdigest()


def _read(function: Callable[..., Any]) -> Iterator[tuple[str, Any]]:
    """Global names that a function reads, closed-over ones, and those that it reads through a module."""
    variables = inspect.getclosurevars(function)
    for name, value in (*variables.globals.items(), *variables.nonlocals.items()):
        if isinstance(value, ModuleType):
            found = ((f"{name}.{part}", vars(value).get(part)) for part in variables.unbound)
            yield from ((part, it) for part, it in found if it is not None)
        else:
            yield name, value


@cache
def _source(file: str) -> str:
    path = Path(file)
    return path.read_text(encoding="utf-8") if path.is_file() else ""


class _Listener(events.Listener):
    def __init__(self, tell: Callable[[], Any]):
        self._tell, self._said = tell, False

    def on_start(self, event: events.Event) -> None:
        if not self._said:
            self._said = True
            self._tell()

    def on_end(self, event: events.Event) -> None:
        """Nothing to tell."""


@contextmanager
def when_compiling(tell: Callable[[], Any]) -> Generator[None]:
    """Calls ``tell`` once, as soon as a function really is compiled meanwhile; what is only loaded is quick."""
    with events.install_listener("numba:compile", _Listener(tell)):
        yield
