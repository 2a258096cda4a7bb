"""Code of a user tried in a process of its own, where it may hang, exit or crash."""

import re
import signal
from collections.abc import Callable, Sequence
from pathlib import Path

from forcebound.bounded_child import ChildError, in_bounded_child
from forcebound.errors import ConfigError


def tried(function: Callable[[], bytes], files: Sequence[Path], seconds: float) -> bytes:
    """Return what a function of a module, or a ``partial``, returns in a process of its own.

    ConfigError if it raises one of our errors, takes longer than so many ``seconds`` or ends its
    process; it names the ``files`` of the user's code, and the line that it was on.
    """
    try:
        return in_bounded_child(function, seconds)
    except ChildError as error:
        names, where = ", ".join(file.name for file in files), _where(error.trace, files)
        if error.status is None:
            raise ConfigError(
                f"{names}: loading and trying it took more than {seconds:g} s{where}\n"
                "  Does a loop never end? What takes long (a mesh, a compilation) can be done once,"
                " before the graph starts, and kept in a file that is read here."
            ) from None
        how = f"exit status {error.status}"
        if error.status < 0:
            how = f"signal {-error.status}, {signal.strsignal(-error.status)}"
        raise ConfigError(
            f"{names}: it ended its process ({how}){where}\n"
            "  A part must not exit; to refuse a parameter, raise ValueError in __post_init__."
        ) from None


def _where(trace: str, files: Sequence[Path]) -> str:
    """The innermost line of the user's files in what faulthandler wrote, if there is one."""
    names = "|".join(re.escape(str(file)) for file in files)
    found = re.search(rf'File "({names})", line (\d+)', trace)
    if found is None:
        return ""
    file, number = Path(found[1]), int(found[2])
    lines = file.read_text("utf-8", "replace").splitlines()
    text = lines[number - 1].strip() if number <= len(lines) else ""
    return f"\n  in {file}:{number}: {text}"
