"""Files that learning reads: demonstrations as HDF5, zarr and LeRobotDataset.

Source of the layouts: HDF5, ``robomimic/utils/dataset.py`` of robomimic (d309eae); zarr, format 2,
``diffusion_policy/common/replay_buffer.py`` of diffusion policy (02373793), whose zarr reads no 3.
"""

import json
import shutil
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from forcebound.errors import ConfigError
from forcebound.extras import missing, needed
from forcebound.files import reason
from forcebound.recordings.demonstrations import DataSet
from forcebound.recordings.lerobot_dataset import write_lerobot


class _Format(NamedTuple):
    """A format of files.

    Attributes:
        name: For people.
        package: What writes it.
        mark: A file of each data set of it, in its folder; empty: it is a file itself.
        write: Writes a data set into a place where nothing is.
    """

    name: str
    package: str
    mark: str
    write: Callable[[DataSet, Path], None]


def write(data: DataSet, form: str, place: Path, overwrite: bool = False) -> None:
    """Write a data set as a file or folder.

    Args:
        data: The data set.
        form: One of :data:`FORMATS`.
        place: The file or folder.
        overwrite: Replace a data set of the same format that is there.

    Raises:
        ConfigError: If a package is missing, something is there, or it cannot be written.
    """
    chosen = FORMATS[form]
    if find_spec(chosen.package) is None:
        raise missing(f"an export to {chosen.name}", chosen.package, extra="export")
    if place.exists():
        if not overwrite:
            raise ConfigError(f"{place} exists: choose another name, or add --overwrite")
        if place.is_dir() != bool(chosen.mark) or not (place / chosen.mark).exists():
            raise ConfigError(f"{place} is no data set of {chosen.name}: choose another name")
        shutil.rmtree(place) if chosen.mark else place.unlink()
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        chosen.write(data, place)
    except OSError as error:  # the disk is full
        raise ConfigError(f"cannot write {place}: {reason(error)}") from error


def _write_hdf5(data: DataSet, path: Path) -> None:
    with needed("HDF5", "h5py").File(path, "w") as file:
        demos, total = file.create_group("data"), 0
        for count, one in enumerate(data.demonstrations()):
            demo = demos.create_group(f"demo_{count}")
            demo.attrs.update(one.about)
            for name, values in one.stamps.items():
                demo[name] = values
            for name, values in one.features.items():
                place = "actions" if name == "action" else f"obs/{name}"
                demo[place] = values
                demo[place].attrs.update(data.features[name])
            total += one.about["num_samples"]
        # robomimic opens no file without env_args; there is no simulator that it could start.
        arguments = {"env_name": "forcebound", "type": 2, "env_kwargs": {}}
        demos.attrs.update(total=total, fps=data.fps, env_args=json.dumps(arguments))


def _write_zarr(data: DataSet, path: Path) -> None:
    root = needed("zarr", "zarr").open_group(path, mode="w", zarr_format=2)
    root.attrs["fps"] = data.fps
    arrays, meta = root.create_group("data"), root.create_group("meta")
    episodes: list[dict[str, Any]] = []
    for one in data.demonstrations():
        for name, values in (one.stamps | one.features).items():
            if name not in arrays:
                shapes = {"shape": (0, *values.shape[1:]), "chunks": (4096, *values.shape[1:])}
                arrays.create_array(name, dtype=values.dtype, **shapes)
                arrays[name].attrs.update(data.features.get(name, {}))
            arrays[name].append(values)
        episodes.append(one.about)
    ends = np.cumsum([about["num_samples"] for about in episodes])
    meta.create_array("episode_ends", data=ends, chunks=ends.shape)
    meta.attrs["episodes"] = episodes


#: By the names of the options.
FORMATS = {
    "hdf5": _Format("HDF5", "h5py", "", _write_hdf5),
    "zarr": _Format("zarr", "zarr", ".zgroup", _write_zarr),
    "lerobot": _Format("LeRobotDataset", "pyarrow", "meta/info.json", write_lerobot),
}
