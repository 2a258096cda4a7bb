"""Packages that only some work needs: each is of an extra of the distribution."""

from importlib import import_module
from importlib.util import find_spec
from typing import Any

from forcebound.errors import ConfigError

#: The extra of each package, by the name of its module.
EXTRAS = {
    "PIL": "mesh",
    "cloudpickle": "lab",
    "distributed": "cluster",
    "foxglove": "foxglove",
    "gymnasium": "gymnasium",
    "h5py": "export",
    "matplotlib": "plot",
    "mujoco": "mujoco",
    "pyarrow": "lab",
    "pylsl": "study",
    "scipy": "lab",
    "statsmodels": "study",
    "tornado": "view",
    "trimesh": "mesh",
    "websockets": "inverse3",
    "zarr": "export",
}


def missing(what: str, package: str, reason: object = "", extra: str | None = None) -> ConfigError:
    """Return the error that ``what`` needs a package, with how to install it: with an extra."""
    extra = extra or EXTRAS.get(package)
    name = package if extra is None else f"'forcebound[{extra}]'"
    words = f" ({reason})" if reason else ""
    return ConfigError(f"{what} needs {package}: pip install {name}{words}")


def check_installed(what: str, *packages: str) -> None:
    """Raise ConfigError, with how to install it, if a package that something needs is missing."""
    for package in packages:
        if find_spec(package) is None:
            raise missing(what, package)


def needed(what: str, package: str) -> Any:
    """Return a module that something needs; ConfigError if it is missing."""
    try:
        return import_module(package)
    except ImportError as error:
        raise missing(what, package.partition(".")[0]) from error
