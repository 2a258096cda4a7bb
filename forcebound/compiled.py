"""Compilation of functions, for the whole project.

Kernels are plain functions of numbers; :func:`jit` compiles them with numba when they are first
needed. Two things are handled here and nowhere else:

* numba costs most of a second to import, so it is imported when something is compiled;
* numba's cache looks only at the file of the compiled function. A changed callee, or constant, in
  another file would leave stale machine code behind. The cache folder of a kernel is therefore
  named after a digest of the files of all functions and classes that it reaches and of the
  constants that these name, and where no such folder can be written nothing is cached.
"""

import fcntl
import hashlib
import logging
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from types import CodeType, FunctionType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ParamSpec,
    TypeVar,
    get_args,
    get_origin,
    get_type_hints,
)

from forcebound.folders import cache_folder

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_logger = logging.getLogger(__name__)

P = ParamSpec("P")
R = TypeVar("R")


def _digest(function: Callable[..., Any]) -> str:
    """Return a digest of all that the compiled code of a function depends on."""
    waiting: list[Any] = [function]
    files: set[str] = set()
    constants: set[str] = set()
    for one in waiting:
        if file := getattr(sys.modules.get(one.__module__), "__file__", None):
            files.add(file)
        for name, value in _named(one) if isinstance(one, FunctionType) else ():
            if isinstance(value, FunctionType | type):
                waiting += [value] if value not in waiting else []
            elif isinstance(value, int | float | str | tuple):
                constants.add(f"{one.__module__}.{name} = {value!r}")
    digest = hashlib.sha256("\n".join(sorted(constants)).encode())
    for file in sorted(files):
        digest.update(_content(file))
    return digest.hexdigest()[:16]


@cache
def _content(file: str) -> bytes:
    return Path(file).read_bytes()


def jit(function: Callable[P, R], *, parallel: bool = False, fast: bool = False) -> Callable[P, R]:
    """Return ``function`` compiled to machine code, cached on disk where that is possible.

    The functions of this package that it calls are compiled with it. Compiled code runs without
    Python's global lock. ``parallel`` spreads ``numba.prange`` loops over the cores; ``fast``
    reorders sums, so that results differ in rounding.
    """
    compiled: Callable[P, R] = _compiled(function, parallel, fast)
    return compiled


@cache
def _numba() -> Any:
    """Return numba. It imports scipy.linalg to see whether that is there, which takes 0.15 s."""
    import numba
    from numba.np import linalg

    check: Any = linalg.ensure_blas
    linalg.ensure_blas = lambda: import_module("scipy") and None
    arraymath: Any = import_module("numba.np.arraymath")
    arraymath.ensure_blas = linalg.ensure_blas = check  # for a kernel that needs it
    return numba


@cache
def _compiled(function: Callable[..., Any], parallel: bool, fast: bool) -> Any:
    numba = _numba()
    is_known = _is_known_by_name(function)
    folder = cache_folder(_digest(function)) if is_known else None
    if folder is not None:
        numba.config.CACHE_DIR = str(folder)
        if not any(folder.iterdir()):
            _say_that_it_compiles()
        _share_between_checkouts()
    allow_in_kernels(_called_by(function))
    compiled = numba.njit(
        cache=folder is not None, parallel=parallel, fastmath=fast, error_model="numpy", nogil=True
    )(function)
    if folder is not None:
        compiled.compile = _one_at_a_time(compiled.compile, folder / "lock")
    return compiled


def _one_at_a_time(compile_for: Callable[P, R], lock: Path) -> Callable[P, R]:
    """Let other processes wait, and then find what the first has compiled."""

    def compile_or_load(*signature: P.args, **options: P.kwargs) -> R:
        with ExitStack() as stack:
            with suppress(OSError):  # no such folder any more, or a file system without locks
                fcntl.flock(stack.enter_context(lock.open("w")), fcntl.LOCK_EX)
            return compile_for(*signature, **options)

    return compile_or_load


@cache
def _say_that_it_compiles() -> None:
    _logger.info("compiling (once, some 10 to 30 s)")


def _is_known_by_name(function: Callable[..., Any]) -> bool:
    """Return whether the names of all it encloses change with the source: else a cache is stale."""
    enclosed = [cell.cell_contents for cell in function.__closure__ or ()]
    modules = [one.__module__ for one in enclosed if isinstance(one, FunctionType)]
    return all(module.startswith(("forcebound.", "forcebound_user_")) for module in modules)


@cache
def _share_between_checkouts() -> None:
    """Let equal sources share compiled code wherever they are: the digest says that they are equal.

    numba would name its folder after the path. Before it compared contents (it compared times), the
    class had another name; there it does as it would.
    """
    from numba.core import caching

    if locator := getattr(caching, "UserProvidedCacheLocator", None):
        locator.get_suitable_cache_subpath = staticmethod(lambda file: Path(file).parent.name)


@cache
def record_type(kind: type) -> "np.dtype[Any]":
    """Return the record with the annotated fields of a class: numbers, records, arrays of them.

    Compiled functions read and write its fields by attribute. A field must not have the name of an
    attribute of numpy's scalars: interpreted functions do not see it then.
    """
    import numpy as np

    fields: list[Any] = []
    for name, hint in get_type_hints(kind, include_extras=True).items():
        shape: tuple[int, ...] = ()
        while get_origin(hint) is Annotated:  # Annotated[list[float], 6]: an array of six
            entries, *shape_of = get_args(hint)
            (hint,), shape = get_args(entries), (*shape, *shape_of)
        is_number = hint in (float, int, bool)
        fields.append((name, np.dtype(hint) if is_number else record_type(hint), shape))
    return np.dtype((np.record, fields))


def new_records(kind: type) -> "NDArray[Any]":
    """Return an array of one record, all zero: numba takes it over faster than a record."""
    import numpy as np

    return np.zeros(1, record_type(kind))


_allowed: set[Callable[..., object]] = set()
_outlined: set[Callable[..., object]] = set()


def outlined(function: Callable[P, R]) -> Callable[P, R]:
    """Mark a large function, which kernels shall call and not inline: they compile much faster."""
    _outlined.add(function)
    return function


def allow_in_kernels(functions: Iterable[Callable[..., object]]) -> None:
    """Let compiled kernels call these plain functions; they stay plain for everyone else.

    With them go the functions that they call, of this package and of their module. All are
    inlined, which makes loops fast; but for those that are :func:`outlined`.
    """
    from numba.extending import register_jitable

    for function in functions:
        if function not in _allowed:
            _allowed.add(function)
            allow_in_kernels(_called_by(function))
            register_jitable(forceinline=function not in _outlined)(function)


def _called_by(function: Callable[..., Any]) -> list[Callable[..., Any]]:
    """Return the plain functions that ``function`` encloses, or names and are not a library's."""
    return [one for _, one in _named(function) if isinstance(one, FunctionType)]


def _named(function: Callable[..., Any]) -> Iterator[tuple[str, Any]]:
    """Yield all that a function encloses and all globals that it names, but what a library has."""
    own = {__name__.partition(".")[0], function.__module__.partition(".")[0]}
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        yield name, cell.cell_contents
    codes = [function.__code__]
    for code in codes:
        codes += [one for one in code.co_consts if isinstance(one, CodeType)]
        for name in code.co_names:
            value = function.__globals__.get(name)
            value = getattr(value, "py_func", value)  # the plain function of a compiled one
            if getattr(value, "__module__", __name__).partition(".")[0] in own:
                yield name, value
