"""A part that a user wrote: the class that a file of their own holds.

``kind: my_spring.py`` or ``kind: my_spring.py:MySpring`` in a launch file names such a class. Its
file is read as Python reads a module, once in a process: whoever changes it starts the graph anew.
Loading it runs its code, as ``python my_spring.py`` would.

Objects of such a class can be pickled to any process that has forcebound and the file.
"""

import contextlib
import copyreg
import dataclasses
import hashlib
import inspect
import re
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

from forcebound.errors import ConfigError
from forcebound.files import reason

_KIND = re.compile(r"(?P<file>.+\.py)(?::(?P<name>[A-Za-z_][A-Za-z0-9_]*))?", re.DOTALL)


@dataclasses.dataclass(frozen=True)
class _File:
    module: ModuleType
    source: str


_FILES: dict[Path, _File] = {}  # that were loaded
_PATHS: dict[type, Path] = {}  # of the classes that were loaded


def names_file(kind: str) -> bool:
    """Return whether a ``kind`` means a file of the user's own."""
    return _KIND.fullmatch(kind) is not None


def file_of(kind: str, beside: Path) -> Path:
    """Return the absolute path of the file that a ``kind`` means; ``beside``: where it starts."""
    return (beside / _parts(kind)["file"]).absolute()


def _parts(kind: str) -> re.Match[str]:
    match = _KIND.fullmatch(kind)
    assert match is not None, kind
    return match


def kind_of(member: type) -> str | None:
    """Return the ``kind`` of a class that was loaded, its path absolute; None for any other."""
    path = _PATHS.get(member)
    return None if path is None else f"{path}:{member.__name__}"


def source_of(member: type) -> str | None:
    """Return the text of the file that a class was loaded from; None for any other class."""
    path = _PATHS.get(member)
    return None if path is None else _FILES[path].source


def load_class(kind: str, beside: Path, methods: dict[str, int]) -> type:
    """Return the class that ``kind`` names.

    Args:
        kind: ``FILE.py`` or ``FILE.py:CLASS``.
        beside: Folder that a relative path starts from.
        methods: Methods that it must have, and the number of their arguments without ``self``.

    Raises:
        ConfigError: If there is no such file, its code fails (with the line), or it has no class,
            several, or one that is no frozen dataclass with these methods.
    """
    path = file_of(kind, beside)
    if path not in _FILES:
        _FILES[path] = _load(path)
    member = _class_in(_FILES[path].module, path, _parts(kind)["name"], methods)
    _check(member, path, methods)
    _PATHS[member] = path
    copyreg.pickle(member, _reduced)
    return member


def blame(error: BaseException, member: type) -> str:
    """Return what code of a loaded class raised, and on which line of its file."""
    return _told(error, _PATHS[member])


def _load(path: Path) -> _File:
    source = _read(path)
    digest = hashlib.sha256(str(path).encode("utf-8", "replace")).hexdigest()
    module = ModuleType(f"forcebound_own_{digest[:16]}")
    module.__file__ = str(path)
    sys.modules[module.__name__] = module  # before it runs: dataclasses look it up there
    try:
        # What it prints must not get into a --json document.
        with contextlib.redirect_stdout(sys.stderr):
            exec(compile(source, str(path), "exec", dont_inherit=True), module.__dict__)
    except BaseException as error:
        del sys.modules[module.__name__]
        if isinstance(error, KeyboardInterrupt):
            raise
        raise ConfigError(f"cannot load {path.name}: {_told(error, path)}") from error
    return _File(module, source.decode("utf-8", "replace"))


def _read(path: Path) -> bytes:
    try:
        if path.is_file():
            return path.read_bytes()
        found = "is not a file" if path.exists() else "does not exist"
    except (OSError, ValueError) as error:  # ValueError: a path that no file can have
        raise ConfigError(f"cannot read {path}: {reason(error)}") from None
    raise ConfigError(f"{path} {found}; a relative path starts from the folder of the launch file")


def _told(error: BaseException, path: Path) -> str:
    """What was raised, where in the user's file, and the line itself."""
    line, text = None, ""
    if isinstance(error, SyntaxError) and error.filename == str(path):
        line, text = error.lineno, error.text or ""
        words = error.msg
    else:
        words = str(error)
        for frame in traceback.extract_tb(error.__traceback__):
            if frame.filename == str(path):
                line, text = frame.lineno, frame.line or ""
    message = f"{type(error).__name__}: {words}" if words else type(error).__name__
    if line is None:
        return message
    return f"{message}\n  in {path}:{line}: {text.strip()}"


def _class_in(module: ModuleType, path: Path, wanted: str | None, methods: dict[str, int]) -> type:
    classes = {
        name: member
        for name, member in vars(module).items()
        if isinstance(member, type)
        and member.__module__ == module.__name__
        and member.__name__ == name  # no second name of the same class
    }
    if wanted is not None:
        if wanted not in classes:
            known = ", ".join(sorted(classes)) or "none"
            raise ConfigError(f"{path.name} has no class {wanted!r}; it has: {known}")
        return classes[wanted]
    fitting = [name for name, member in classes.items() if all(hasattr(member, m) for m in methods)]
    candidates = fitting or list(classes)
    if not candidates:
        raise ConfigError(f"{path.name} has no class; expected a frozen dataclass")
    if len(candidates) > 1:
        raise ConfigError(
            f"{path.name} has several classes: {', '.join(candidates)};"
            f" say which one, such as {path.name}:{candidates[0]}"
        )
    return classes[candidates[0]]


def _check(member: type, path: Path, methods: dict[str, int]) -> None:
    who = f"class {member.__name__} of {path.name}"
    parameters = member.__dict__.get("__dataclass_params__")
    if parameters is None or not parameters.frozen:
        raise ConfigError(f"{who} must be a frozen dataclass: write @dataclass(frozen=True) above")
    for name, count in methods.items():
        method = inspect.getattr_static(member, name, None)
        if not callable(getattr(member, name, None)):
            raise ConfigError(f"{who} has no method {name}")
        given = count if isinstance(method, staticmethod | classmethod) else count + 1  # with self
        try:
            inspect.signature(getattr(member, name)).bind(*range(given))
        except (TypeError, ValueError) as error:
            words = f"{name} must take {count} arguments beside self: {error}"
            raise ConfigError(f"{who}: {words}") from None


def _reduced(member: Any) -> tuple[Callable[..., Any], tuple[Any, ...]]:
    values = {f.name: getattr(member, f.name) for f in dataclasses.fields(member) if f.init}
    return _rebuilt, (kind_of(type(member)), values)


def _rebuilt(kind: str, values: dict[str, Any]) -> Any:
    return load_class(kind, Path(), {})(**values)
