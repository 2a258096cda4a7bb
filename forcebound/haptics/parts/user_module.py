"""Files with a user's code, and the parts that they define.

``kind: my_spring.py`` or ``kind: my_spring.py:MySpring`` in a launch file names such a part. Its
file is read as Python reads a module, once in a process: after a change, start the graph again.
Loading it runs its code, as ``python my_spring.py`` would, and it imports files beside it.

Objects of a class that was loaded can be pickled to any process that has forcebound and the file.
"""

import ast
import contextlib
import copyreg
import dataclasses
import hashlib
import re
import sys
import traceback
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

from forcebound.errors import ConfigError, ForceboundError
from forcebound.files import read_bytes, reason

MAX_BYTES = 1_000_000  # of a file of code
_IN_LINE = re.compile(  # of numba's report: what is wrong, an empty line, the place
    r'^\s*(?P<what>\S[^\n]*)\n\s*\n\s*File "(?P<file>[^"\n]+)", line (?P<line>\d+)', re.MULTILINE
)
_KIND = re.compile(r"(?P<file>.+\.py)(?::(?P<name>[A-Za-z_][A-Za-z0-9_]*))?", re.DOTALL)


@dataclasses.dataclass(frozen=True)
class _File:
    module: ModuleType
    source: str
    imported: frozenset[str]  # names that its import statements bind


_files: dict[Path, _File] = {}
_folders: set[Path] = set()  # of the files
_theirs: set[str] = set()  # modules that a program had from such a folder before: they stay
_parts: dict[str, object] = {}  # by absolute kind, FILE.py:NAME


def names_file(kind: str) -> bool:
    """Return whether a ``kind`` names a user's file."""
    return _KIND.fullmatch(kind) is not None


def is_absolute(kind: str) -> bool:
    """Return whether a ``kind`` of a file names the part and an absolute path."""
    match = _match(kind)
    return match["name"] is not None and Path(match["file"]).is_absolute()


def file_of(kind: str, folder: Path) -> Path:
    """Return the absolute path of the file that ``FILE.py:NAME`` names in a folder."""
    return (folder / _match(kind)["file"]).absolute()


def load(kind: str, folder: Path, fits: Callable[[object], bool], expected: str) -> Any:
    """Return the part that ``kind``, ``FILE.py`` or ``FILE.py:NAME``, names: a class or an object.

    A relative path starts from ``folder``. ``fits`` distinguishes the part from helpers in the
    file, ``expected`` says for messages what the file should define. ConfigError if there is no
    such file, its code fails (with the line), or it does not define the name, or no part, or
    several.
    """
    path = file_of(kind, folder)
    if path not in _files:
        _files[path] = _load(path)
    name = _name_in(_files[path], path, _match(kind)["name"], fits, expected)
    part = vars(_files[path].module)[name]
    if isinstance(part, type):
        copyreg.pickle(part, _reduce)
    _parts[f"{path}:{name}"] = part
    return part


def kind_of(part: object) -> str | None:
    """Return the ``kind`` of a part that was loaded, its path absolute; None for any other."""
    return next((kind for kind, known in _parts.items() if known is part), None)


def source_of(kind: str) -> str | None:
    """Return the text of the file of a part that was loaded; None for any other ``kind``."""
    match = _KIND.fullmatch(kind)
    file = None if match is None else _files.get(Path(match["file"]).absolute())
    return None if file is None else file.source


def describe_user_error(error: BaseException, anywhere: bool = False) -> str:
    """Return what was raised, of ours its cause; its line, in a user's file or ``anywhere``."""
    if isinstance(error, ForceboundError):
        error = error.__cause__ or error
    frames = traceback.extract_tb(error.__traceback__) if anywhere else []
    return _describe(error, {*map(str, _files), *(frame.filename for frame in frames[-1:])})


@contextlib.contextmanager
def user_code(call: str, field: str | None = None) -> Iterator[None]:
    """Turn whatever code of a user raises into a ConfigError that names the call, if not empty.

    ``field`` is the key of the section that is wrong, if it is one.
    """
    start = f"{call}: " if call else ""
    try:
        yield
    except ConfigError as error:
        raise ConfigError(f"{start}{error}", field=field or error.field) from error
    except (Exception, SystemExit) as error:
        raise ConfigError(f"{start}{describe_user_error(error)}", field=field) from error


def _match(kind: str) -> re.Match[str]:
    match = _KIND.fullmatch(kind)
    assert match is not None, kind
    return match


def _load(path: Path) -> _File:
    source = _read(path)
    # With the source in it, or numba would take compiled code of an earlier text for this one.
    digest = hashlib.sha256(str(path).encode("utf-8", "replace") + b"\0" + source).hexdigest()
    module = ModuleType(f"forcebound_user_{digest[:16]}")
    module.__file__ = str(path)
    sys.modules[module.__name__] = module  # before it runs: dataclasses look it up there
    try:
        # What it prints must not get into a --json document.
        with contextlib.redirect_stdout(sys.stderr):
            tree = ast.parse(source, str(path))
            with _importing_from(path.parent):
                exec(compile(source, str(path), "exec", dont_inherit=True), module.__dict__)
    except BaseException as error:
        del sys.modules[module.__name__]
        if isinstance(error, KeyboardInterrupt):
            raise
        raise ConfigError(f"cannot load {path.name}: {_describe(error, {str(path)})}") from error
    imports = [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
    imported = {alias.asname or alias.name for node in imports for alias in node.names}
    return _File(module, source.decode("utf-8", "replace"), frozenset(imported))


@contextlib.contextmanager
def _importing_from(folder: Path) -> Iterator[None]:
    """Let a file import the files in its folder before all others, and later after all others.

    A module of the same name from the folder of another user's file is not taken for one of these.
    """
    if folder not in _folders:
        _theirs.update(name for name, module in sys.modules.items() if _folder(module) == folder)
    for name in [name for name, module in sys.modules.items() if _is_of_another(module, folder)]:
        if name in _theirs:
            continue
        if (folder / f"{name.partition('.')[0]}.py").exists() or (folder / name).is_dir():
            del sys.modules[name]
    _folders.add(folder)
    sys.path[:] = [str(folder), *(one for one in sys.path if one != str(folder))]
    try:
        yield
    finally:
        sys.path.remove(str(folder))
        sys.path.append(str(folder))


def _is_of_another(module: ModuleType, folder: Path) -> bool:
    return _folder(module) in _folders - {folder}


def _folder(module: ModuleType) -> Path | None:
    file = getattr(module, "__file__", None)
    return Path(str(file)).parent if file else None


def _read(path: Path) -> bytes:
    try:
        return read_bytes(path, MAX_BYTES)
    except OSError as error:
        raise ConfigError(
            f"cannot read {path}: {reason(error)}; a relative path starts from the folder of the"
            " launch file, on the command line from the current folder"
        ) from None


def _describe(error: BaseException, files: set[str]) -> str:
    """Return the error, its place in one of these files, and the line itself."""
    place, text = None, ""
    words = str(error)
    if type(error).__module__.startswith("numba") and (found := _IN_LINE.search(words)):
        words = f"{found['what']} ({found['file']}:{found['line']})"  # which line of the law
    if isinstance(error, SyntaxError) and error.filename in files:
        place, text, words = f"{error.filename}:{error.lineno}", error.text or "", error.msg
    else:
        for frame in traceback.extract_tb(error.__traceback__):
            if frame.filename in files or Path(frame.filename).parent in _folders:
                place, text = f"{frame.filename}:{frame.lineno}", frame.line or ""
    message = f"{type(error).__name__}: {words}" if words else type(error).__name__
    return message if place is None else f"{message}\n  in {place}: {text.strip()}"


def _name_in(
    file: _File, path: Path, asked: str | None, fits: Callable[[object], bool], expected: str
) -> str:
    defined = {
        name: part
        for name, part in vars(file.module).items()
        if name not in file.imported and not name.startswith("__") and _is_part(name, part)
    }
    if asked is not None:
        if asked not in defined:
            known = ", ".join(sorted(defined)) or "none"
            raise ConfigError(f"{path.name} does not define {asked!r}; it has: {known}")
        return asked
    classes = [name for name, part in defined.items() if isinstance(part, type)]
    fitting = [name for name, part in defined.items() if fits(part)]
    # The class of an open environment has the methods of a stateless one, and is no dataclass.
    models = [name for name in fitting if dataclasses.is_dataclass(defined[name])]
    candidates = models or fitting or classes
    if not candidates:
        raise ConfigError(f"{path.name} defines no part; expected {expected}")
    if len(candidates) > 1:
        raise ConfigError(
            f"{path.name} defines several: {', '.join(candidates)};"
            f" name one, such as {path.name}:{candidates[0]}"
        )
    return candidates[0]


def _is_part(name: str, part: object) -> bool:
    """Return whether this may be a part: no second name of a class, no function, no plain value."""
    if isinstance(part, type):
        return part.__name__ == name
    return dataclasses.is_dataclass(part)


def _reduce(member: Any) -> tuple[Callable[..., Any], tuple[Any, ...]]:
    values = {f.name: getattr(member, f.name) for f in dataclasses.fields(member) if f.init}
    return _rebuild, (kind_of(type(member)), values)


def _rebuild(kind: str, values: Mapping[str, object]) -> Any:
    return load(kind, Path(), lambda part: True, "a class")(**values)
