"""How the loops of `march` are compiled, and where what comes of it is cached."""

from __future__ import annotations

import hashlib
import pkgutil
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

from numba import njit
from numba.core.caching import FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase
from numba.core.compiler_machinery import PassManager
from numba.core.typed_passes import (
    AnnotateTypes,
    IRLegalization,
    NativeLowering,
    NoPythonBackend,
    NopythonTypeInference,
    PreLowerStripPhis,
)
from numba.core.untyped_passes import (
    DeadBranchPrune,
    FixupArgs,
    GenericRewrites,
    IRProcessing,
    ReconstructSSA,
    RewriteSemanticConstants,
    TranslateByteCode,
)

from pmr.errors.environment import uncollected
from pmr.files.whole import locked

#: What of Numba's pipeline these functions need: they have no closures, comprehensions and expressions of arrays.
PASSES = (
    *(TranslateByteCode, FixupArgs, IRProcessing, RewriteSemanticConstants, DeadBranchPrune, GenericRewrites),
    *(ReconstructSSA, DeadBranchPrune, NopythonTypeInference, PreLowerStripPhis, IRLegalization, AnnotateTypes),
    *(NativeLowering, NoPythonBackend),
)
# Without Numba's runtime nothing can be allocated.  NaN and infinity stay visible, while sums may be reordered.
OPTIONS = {"fastmath": {"reassoc", "contract", "nsz", "arcp"}, "error_model": "numpy", "nogil": True, "_nrt": False}


class _Part(JITCodeLibrary):
    """Code of a function that stands in others alone, where it is optimised and translated with theirs.

    Numba would do both for each function by itself as well, and again for all that it calls: most of the time that a
    loop takes to compile, for code that nobody calls.  Nor is what it calls joined to it here.
    """

    def _optimize_functions(self, module: Any) -> None:
        pass

    def finalize(self) -> None:
        """Nothing is left to be done."""
        self._finalize_dynamic_globals()
        self._finalized = True

    @property
    def parts(self) -> list[JITCodeLibrary]:
        """What it calls itself."""
        return list(self._linking_libraries)

    def get_pointer_to_function(self, name: str) -> int:
        """None: it has no address."""
        return 0

    @property
    def codegen(self) -> Any:
        """Itself, for callers that would set the address of an environment."""
        return self

    def set_env(self, name: str, environment: object) -> None:
        """Nothing: what can't raise or print needs none."""


class _Called(_Part):
    """That of a function that stands in others once, however often it is called."""

    def add_ir_module(self, module: Any) -> None:
        for function in module.functions:
            if not function.is_declaration and "alwaysinline" not in function.attributes:
                function.attributes.add("noinline")
        super().add_ir_module(module)


class _Whole(JITCodeLibrary):
    """Code of a function with all that it calls, each once, optimised once.

    Numba would do so twice: what counts references has to be found again after the first time, and nothing does here.
    """

    def finalize(self) -> None:
        """Join all parts and translate them."""
        found = dict.fromkeys(self._linking_libraries)
        left = list(found)
        while left:
            one = left.pop()
            new = [part for part in one.parts if part not in found] if isinstance(one, _Part) else []
            found.update(dict.fromkeys(new))
            left += new
        self._linking_libraries: list[JITCodeLibrary] = list(found)
        super().finalize()

    def _optimize_final_module(self) -> None:
        passes, builder = self._codegen._module_pass_manager()
        passes.run(self._final_module, builder)


class _Compiler(CompilerBase):
    """Numba's, with `PASSES` alone: most of its time goes into these."""

    def define_pipelines(self) -> list[PassManager]:
        """One."""
        passes = PassManager("nopython")
        for one in PASSES:
            passes.add_pass(one, one.__name__)
        passes.finalize()
        return [passes]


class _WholeCompiler(_Compiler):
    """For what Python or an address calls; what it makes of all parts is there until the end anyway."""

    def compile_extra(self, function: Callable[..., Any]) -> Any:
        self.state.library = _Whole(self.state.targetctx.codegen(), function.__qualname__)
        self.state.library.enable_object_caching()
        with uncollected():
            return super().compile_extra(function)


class _PartCompiler(_Compiler):
    """For a function that is a part of others."""

    def compile_extra(self, function: Callable[..., Any]) -> Any:
        self.state.library = _Part(self.state.targetctx.codegen(), function.__qualname__)
        return super().compile_extra(function)


class _CalledCompiler(_Compiler):
    """For a function that others call."""

    def compile_extra(self, function: Callable[..., Any]) -> Any:
        self.state.library = _Called(self.state.targetctx.codegen(), function.__qualname__)
        return super().compile_extra(function)


#: For functions that are parts of others: a call would copy the headers of all arrays.  Python can't call them: what it
#: would call takes a third of the time in which they are compiled.
inlined = njit(
    pipeline_class=_PartCompiler, forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True, **OPTIONS
)

#: The same for parts that are long and stand in several places: one argument or two (`pmr.simulation.native.handles`)
#: are handed over in no time, and what is there once is compiled once.
called = njit(
    pipeline_class=_CalledCompiler, forceinline=False, no_cpython_wrapper=True, no_cfunc_wrapper=True, **OPTIONS
)


def addressed(function: Callable[..., Any]) -> Any:
    """The same for functions that others call by an address (`pmr.simulation.native.handles.address_of`) alone."""
    return _whole(function, forceinline=False, no_cpython_wrapper=True)


def compiled(function: Callable[..., Any]) -> Any:
    """Compile on the first call and keep the result on disk, as ``njit(cache=True)``."""
    return _whole(function, forceinline=False)


def compiled_and_inlined(function: Callable[..., Any]) -> Any:
    """The same for functions that compiled loops of others call."""
    return _whole(function, forceinline=True)


def compiled_for_python(function: Callable[..., Any]) -> Any:
    """The same for functions so short that to hand the interpreter to other threads would take as long."""
    return _whole(function, nogil=False)


def _whole(function: Callable[..., Any], **options: bool) -> Any:
    dispatcher = njit(pipeline_class=_WholeCompiler, no_cfunc_wrapper=True, **(OPTIONS | options))(function)
    with suppress(RuntimeError):  # no folder for it can be written to: it is compiled anew in each process
        dispatcher._cache = _Cache(dispatcher.py_func)
    return dispatcher


def claimed(function: Any) -> bool:
    """Whether another process compiles such a function at present, and will store it."""
    cache = function._cache
    return isinstance(cache, _Cache) and cache.claimed


class _Cache(FunctionCache):
    """Knows the sources of the inlined parts too: Numba's own looks at the file of the function alone.

    What one process compiles, others that need it wait for: its lock is held until it is stored.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._lock, self._held = Path(self.cache_path, f"{self._impl.filename_base}.lock"), ExitStack()

    @property
    def claimed(self) -> bool:
        """Whether another process holds the lock."""
        try:
            with locked(self._lock, wait=False) as free:
                return not free
        except OSError:  # nobody has compiled it here yet
            return False

    def load_overload(self, signature: Any, context: Any) -> Any:
        """What is stored, or None, with the lock."""
        found = self._stored(signature, context)
        if found is not None:
            return found
        self._held.close()  # of a time at which it could not be compiled
        with suppress(OSError):  # no folder for it can be written to
            self._impl.locator.ensure_cache_path()
            self._lock.touch()
            self._held.enter_context(locked(self._lock))
            found = self._stored(signature, context)
        if found is not None:
            self._held.close()
        return found

    def save_overload(self, signature: Any, data: Any) -> None:
        """Store what was compiled, and give the lock back."""
        with self._held:
            super().save_overload(signature, data)

    def _stored(self, signature: Any, context: Any) -> Any:
        """What Numba would load first, all that it compiles with, takes five times as long."""
        try:
            with self._guard_against_spurious_io_errors():
                return self._load_overload(signature, context)
        except (AttributeError, ImportError):  # sources of another version, in which a type had another name
            self.flush()
            return None

    def _index_key(self, *arguments: Any) -> Any:
        return (*super()._index_key(*arguments), _SOURCES)


def _digest() -> str:
    """Of the sources as they are imported, which a study's workers don't do from the files."""
    names = sorted(file.name for file in Path(__file__).parent.glob("*.py"))
    texts = [pkgutil.get_data(__package__, name) or b"" for name in names]
    return hashlib.sha256(b"".join(texts)).hexdigest()


_SOURCES = _digest()
