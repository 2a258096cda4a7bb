"""Digests of Python values: equal in every process for equal values and code, else different."""

import dis
import hashlib
import inspect
import json
import os
import pickle
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import forcebound
from forcebound.errors import ConfigError

#: Attributes of a class that count where it has no source file.
_OF_A_CLASS = (FunctionType, classmethod, staticmethod, property, int, float, str, tuple)


@cache
def sources() -> str:
    """Return the digest of forcebound's own sources; an edit in an editable install changes it."""
    digest = hashlib.sha256()
    root = Path(forcebound.__file__).parent
    for folder, _, names in sorted(os.walk(root, followlinks=True)):
        for path in (Path(folder, name) for name in sorted(names) if name.endswith(".py")):
            digest.update(f"{path.relative_to(root)}\0".encode() + path.read_bytes())
    return digest.hexdigest()


def digest_of(value: object) -> str:
    """Return the digest of a value: of its fields and, where it has code, of the code.

    A function or class counts with the source file that defines it; one of a notebook or of the
    program itself, whose other lines may change, with its bytecode and the globals that it names.
    An object counts as pickle sees it.

    Raises:
        ConfigError: If some of it has no such form: it cannot be pickled, or contains itself.
    """
    try:
        # Code that names itself is no circle: the second time it is a name.
        text = json.dumps(value, default=_Forms(), check_circular=False)
    except (TypeError, ValueError, AttributeError, RecursionError, pickle.PicklingError) as error:
        raise ConfigError(
            f"a case or argument has no form that is the same in each process ({error}): "
            "use a dataclass or NamedTuple of plain values"
        ) from error
    return hashlib.sha256(text.encode()).hexdigest()


class _Forms:
    """Forms of values that JSON does not know; of code that was seen before, its name."""

    def __init__(self) -> None:
        self._seen: set[int] = set()

    def __call__(self, value: Any) -> Any:
        value = inspect.unwrap(value) if callable(value) else value
        value = value.fget if isinstance(value, property) else value
        if isinstance(value, set | frozenset):
            return sorted(json.dumps(one, default=self, check_circular=False) for one in value)
        if isinstance(value, bytes):
            return value.hex()
        if isinstance(value, ModuleType):
            return value.__name__
        if isinstance(value, CodeType):
            return [value.co_code, value.co_consts, value.co_names]
        if not isinstance(value, type | FunctionType):
            return value.__reduce_ex__(2)
        name = f"{value.__module__}.{value.__qualname__}"
        if id(value) in self._seen:
            return name
        self._seen.add(id(value))
        source = _source_of(value.__module__)
        if isinstance(value, type):
            return [name, source or [v for v in vars(value).values() if isinstance(v, _OF_A_CLASS)]]
        known, code = value.__globals__, value.__code__
        used = {} if source else {one: known[one] for one in _globals_of(code) if one in known}
        cells = [cell.cell_contents for cell in value.__closure__ or ()]
        return [name, source, code, used, value.__defaults__, value.__kwdefaults__, cells]


def _source_of(module: str) -> str:
    if module == "__main__":
        return ""
    try:
        return inspect.getsource(sys.modules[module])
    except (KeyError, OSError, TypeError):  # typed in, or built in
        return ""


def _globals_of(code: CodeType) -> Iterator[str]:
    """Yield the names of globals in code, and in functions within it."""
    yield from (one.argval for one in dis.get_instructions(code) if one.opname == "LOAD_GLOBAL")
    for inside in code.co_consts:
        if isinstance(inside, CodeType):
            yield from _globals_of(inside)
