"""Tables of parts: laws, devices, operators, controllers and environments by their kind.

A part has one of three origins:

* it ships with forcebound: an entry ``"module:NAME"`` of a table, imported when it is first used;
* an installed package offers it: an entry point of the group ``forcebound.SECTION``, such as
  ``forcebound.environments``; it cannot replace a part that ships;
* it stands in a user's file, ``my_spring.py`` or ``my_spring.py:MySpring``
  (:mod:`forcebound.haptics.parts.user_module`).
"""

import inspect
import logging
from collections.abc import Iterator, Mapping, MutableMapping
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar, cast

from forcebound.errors import ConfigError
from forcebound.haptics.parts import user_module
from forcebound.haptics.parts.contract import is_frozen

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

Part = TypeVar("Part")

_logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class PartShape:
    """Requirements on a part of a table."""

    base: str  # "module:NAME" of the class that a part inherits, as a frozen dataclass
    is_object: bool = False  # whether a part is an object of that class instead

    @property
    def expected(self) -> str:
        """The shape in words."""
        module, _, name = self.base.partition(":")
        if self.is_object:
            return f"a {name}"
        return f"a frozen dataclass that inherits {module}.{name}"

    def fits(self, part: object) -> bool:
        """Return whether this is meant to be the part, well formed or not."""
        base = _import(self.base)
        if self.is_object:
            return isinstance(part, base)
        return isinstance(part, type) and issubclass(part, base)

    def check(self, part: object, name: str) -> None:
        """Raise ConfigError, with ``name``, if ``part`` does not have this shape."""
        if not self.fits(part):
            got = "" if isinstance(part, type) else f", got an object of type {type(part).__name__}"
            raise ConfigError(f"{name} must be {self.expected}{got}")
        if self.is_object or not isinstance(part, type):
            return
        if not is_frozen(part):
            raise ConfigError(
                f"class {name} must be a frozen dataclass: write @dataclass(frozen=True) above"
            )
        missing = sorted(vars(part)["__abstractmethods__"])
        if missing:
            raise ConfigError(f"class {name} has no method {' and '.join(missing)}")
        for base in part.__mro__:
            if base.__module__.startswith("forcebound."):
                for method in vars(base):
                    if not method.startswith("_"):
                        _check_arguments(part, base, method, name)


class Table(MutableMapping[str, Part], Generic[Part]):
    """The parts of one section, such as "environments", by kind.

    Iterating names the parts without importing them. ``table[kind]`` imports one; ``table[kind] =
    part`` adds one that was made in Python, for this process.
    """

    def __init__(self, section: str, shipped: Mapping[str, str], shape: PartShape) -> None:
        self.section = section
        self.shape = shape
        self._shipped = dict(shipped)
        self._added: set[str] = set()
        self._loaded: dict[str, Part] = {}

    def __getitem__(self, kind: str) -> Part:
        """Return the part of a kind.

        Raises:
            KeyError: If there is no such kind.
            ConfigError: If it cannot be imported, or is not of the shape.
        """
        if kind not in self._loaded:
            self._loaded[kind] = self._load(kind)
        return self._loaded[kind]

    def __setitem__(self, kind: str, part: Part) -> None:
        self.shape.check(part, kind)
        self._loaded[kind] = part
        self._added.add(kind)
        if kind in self._shipped and part is self._load(kind):  # it is put back
            self._added.remove(kind)

    def __delitem__(self, kind: str) -> None:
        self._added.remove(kind)
        del self._loaded[kind]

    def __contains__(self, kind: object) -> bool:
        """Return whether a kind is known, or names a file, which is not looked at."""
        return isinstance(kind, str) and (
            kind in self._shipped
            or kind in self._added
            or user_module.names_file(kind)
            or kind in self._entry_points
        )

    def __iter__(self) -> Iterator[str]:
        yield from (known := dict.fromkeys((*self._shipped, *self._added)))
        yield from (kind for kind in self._entry_points if kind not in known)

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def resolve(self, kind: str, folder: Path) -> str:
        """Return a kind that means the same in every process: of a file ``/PATH/FILE.py:NAME``.

        A relative path starts from ``folder``. ConfigError for a file that cannot be loaded.
        """
        if not user_module.names_file(kind) or user_module.is_absolute(kind):
            return kind
        return self.kind_of(self._load_file(kind, folder)) or kind

    def kind_of(self, part: object) -> str | None:
        """Return the kind under which the table has a part; None if it does not have it."""
        path = f"{part.__module__}:{part.__qualname__}" if isinstance(part, type) else ""
        for kind in self:
            entry = self._shipped.get(kind) or ""
            if not entry and kind not in self._added:
                entry = self._entry_points[kind].value
            if (path and entry == path) or self._loaded.get(kind) is part:
                return kind
        return user_module.kind_of(part)

    def known(self, part: object, name: str) -> str:
        """Return the kind of a part, which has it from now on; it replaces no other part."""
        kind = self.kind_of(part)
        if kind is None:
            names = (name if n == 1 else f"{name}_{n}" for n in count(1))
            kind = next(one for one in names if one not in self)
            self[kind] = cast("Part", part)
        return kind

    @property
    def added(self) -> dict[str, Part]:
        """The parts that were made in Python, in this process."""
        return {kind: self._loaded[kind] for kind in sorted(self._added)}

    def is_shipped(self, kind: str) -> bool:
        """Return whether the part of a kind ships with forcebound."""
        return kind in self._shipped and kind not in self._added

    def usable(self) -> dict[str, Part]:
        """Return the parts that can be imported; a warning names the others."""
        found = {}
        for kind in self:
            try:
                found[kind] = self[kind]
            except ConfigError as error:
                _logger.warning("%s", error)
        return found

    @cached_property
    def _entry_points(self) -> "dict[str, EntryPoint]":
        from importlib.metadata import entry_points

        return {point.name: point for point in entry_points(group=f"forcebound.{self.section}")}

    def _load(self, kind: str) -> Part:
        if kind in self._shipped:
            return cast(Part, _import(self._shipped[kind]))
        if user_module.names_file(kind):
            return self._load_file(kind, Path())
        return self._load_offered(self._entry_points[kind])

    def _load_file(self, kind: str, folder: Path) -> Part:
        part: Part = user_module.load(kind, folder, self.shape.fits, self.shape.expected)
        file, _, name = (user_module.kind_of(part) or "").rpartition(":")
        self.shape.check(part, f"{name} of {Path(file).name}")
        return part

    def _load_offered(self, point: "EntryPoint") -> Part:
        package = point.dist.name if point.dist is not None else "unknown"
        offer = f"{point.name!r} of the package {package} (entry point {point.value})"
        try:
            part: Part = point.load()
        except (Exception, SystemExit) as error:
            words = f"{type(error).__name__}: {error}"
            raise ConfigError(f"cannot import {offer}: {words}; mend or uninstall it") from error
        self.shape.check(part, offer)
        return part


def overridden(part: object, base: type) -> frozenset[str]:
    """Return the names of the methods of a base class that a part overrides."""
    return frozenset(
        name
        for name, default in vars(base).items()
        if inspect.isfunction(default) and inspect.getattr_static(part, name) is not default
    )


def _import(entry: str) -> Any:
    module, _, name = entry.partition(":")
    return getattr(import_module(module), name)


def _check_arguments(part: type, base: type, method: str, name: str) -> None:
    """Raise ConfigError if a method does not take the arguments that the base class promises."""
    promised, given = vars(base)[method], inspect.getattr_static(part, method)
    if given is promised or not inspect.isfunction(promised) or not inspect.isfunction(given):
        return
    count = len(inspect.signature(promised).parameters)
    try:
        inspect.signature(given).bind(*range(count))
    except TypeError as error:
        message = f"class {name}: {method} must take {count - 1} arguments besides self: {error}"
        raise ConfigError(message) from None
