"""Compilation of functions, for the whole project.

Kernels are plain functions of numbers; :func:`jit` compiles them with numba when they are first
needed. Two things are handled here and nowhere else:

* numba costs most of a second to import, so it is imported when something is compiled;
* numba's cache looks only at the file of the compiled function. A changed callee in another file
  would leave stale machine code behind. The cache folder is therefore named after a digest of
  every source file of the package, and where no such folder can be written nothing is cached.
"""

import hashlib
import os
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from types import FunctionType
from typing import Any, ParamSpec, TypeVar

from forcebound.folders import runtime_folder

P = ParamSpec("P")
R = TypeVar("R")


@cache
def _cache_folder() -> str | None:
    """Return a writable folder for compiled code of exactly these sources; None without one."""
    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.rglob("*.py")):
        digest.update(source.read_bytes())
    home = os.path.expanduser("~")
    bases = [Path(home) / ".cache"] if os.path.isabs(home) else []
    private = runtime_folder()  # others may not put compiled code there
    for base in [*bases, *([private] if private else [])]:
        folder = base / "forcebound" / digest.hexdigest()[:16]
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK) and folder.stat().st_uid == os.getuid():
            return str(folder)
    return None


def jit(function: Callable[P, R], *, parallel: bool = False, fast: bool = False) -> Callable[P, R]:
    """Return ``function`` compiled to machine code, cached on disk where that is possible.

    The functions of this package that it calls are compiled with it. Compiled code runs without
    Python's global lock.

    Args:
        function: A function of numbers and arrays that numba understands.
        parallel: Spread ``numba.prange`` loops over the cores.
        fast: Allow reassociation of sums, so that results differ in rounding. Never for anything
            that must equal the interpreted function.
    """
    compiled: Callable[P, R] = _compiled(function, parallel, fast)
    return compiled


@cache
def _compiled(function: Callable[..., Any], parallel: bool, fast: bool) -> Any:
    import numba

    folder = _cache_folder() if _is_known_by_name(function) else None
    if folder is not None:
        config: Any = numba.config  # pyright: ignore[reportPrivateImportUsage]
        config.CACHE_DIR = folder
    allow_in_kernels(_called_by(function))
    return numba.njit(
        cache=folder is not None, parallel=parallel, fastmath=fast, error_model="numpy", nogil=True
    )(function)


def _is_known_by_name(function: Callable[..., Any]) -> bool:
    """Whether the name of all that it encloses changes with the source: else a cache goes stale."""
    enclosed = [cell.cell_contents for cell in function.__closure__ or ()]
    modules = [one.__module__ for one in enclosed if isinstance(one, FunctionType)]
    return all(module.startswith(("forcebound.", "forcebound_user_")) for module in modules)


_allowed: set[Callable[..., object]] = set()


def allow_in_kernels(functions: Iterable[Callable[..., object]]) -> None:
    """Let compiled kernels call these plain functions; they stay plain for everyone else.

    With them go the functions that they call, of this package and of their own module. All are
    inlined, since only then a loop over simulations side by side is one over vector registers.
    """
    from numba.extending import register_jitable

    for function in functions:
        if function not in _allowed:
            _allowed.add(function)
            allow_in_kernels(_called_by(function))
            register_jitable(forceinline=True)(function)


def _called_by(function: Callable[..., Any]) -> list[Callable[..., Any]]:
    """Return the plain functions that ``function`` encloses, or names and are not a library's."""
    own = {__name__.partition(".")[0], function.__module__.partition(".")[0]}
    called: list[Callable[..., Any]] = []
    for cell in function.__closure__ or ():
        if isinstance(cell.cell_contents, FunctionType):
            called.append(cell.cell_contents)
    for name in function.__code__.co_names:
        one = function.__globals__.get(name)
        if isinstance(one, FunctionType) and one.__module__.partition(".")[0] in own:
            called.append(one)
    return called
