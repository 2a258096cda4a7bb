"""Imports of commands: a module is imported when a name of it is used.

Help, completion and the start of a command then wait for no module that they do not need: those of
a graph take 0.2 s, numpy 0.1 s. Type checkers and import-linter see usual imports.
"""

import builtins
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from types import SimpleNamespace
from typing import Any


class _Module:
    """A module that is imported when a name of it is used."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, name: str) -> Any:
        return getattr(import_module(self._name), name)


@contextmanager
def when_used() -> Iterator[None]:
    """Let ``import package`` and ``from package import module`` import when the module is used.

    At the top of a file, and of modules only: ``from module import name`` would need the name now.
    """

    def find(package: str, *details: Any) -> Any:
        _, _, names, _ = details
        if names is None:
            return _Module(package)
        return SimpleNamespace(**{name: _Module(f"{package}.{name}") for name in names})

    usual = builtins.__import__
    builtins.__import__ = find  # type: ignore[assignment]
    try:
        yield
    finally:
        builtins.__import__ = usual
