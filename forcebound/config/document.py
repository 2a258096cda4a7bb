"""A launch file and the files that it includes, as one tree.

``include: other.yaml`` at the top of a file is read the same way and lies beneath the including
file: what the including file says wins, key by key. A section that names another ``kind`` is
replaced as a whole, since the parameters of one kind mean nothing to another. An included file is
looked for in the including one's folder, then among those that come with the package.
"""

import difflib
from collections.abc import Mapping
from dataclasses import replace
from itertools import islice
from pathlib import Path

from forcebound.config.arguments import Substitution
from forcebound.config.problems import Place, Problems, nearest_file, unknown
from forcebound.config.tree import Value, parse
from forcebound.files import not_text, place_in, read_bytes, reason

MAX_BYTES = 256_000  # a launch file is a page or two; more is a mistake, and slow to read
MAX_INCLUDES = 10  # files that include one another, one after the other
MOST_BESIDE = 200  # files of a folder that are looked through for the nearest name
NEARLY = 0.8  # likeness of two words; inculde has 0.86

SHIPPED = Path(__file__).parent.parent / "launch"


def find(path: Path, folder: Path = Path()) -> Path | None:
    """Return the launch file meant by ``path`` in a folder: on disk, or else of those shipped."""
    on_disk = folder / path
    try:
        if on_disk.is_file():
            return on_disk
        if path.parent in (Path(), Path("launch")):
            for name in (path.name, f"{path.name}.yaml"):
                if name in shipped():
                    return SHIPPED / name
        return on_disk if on_disk.exists() else None
    except (OSError, ValueError):  # a path that no file can have
        return None


def folder_of(path: Path) -> Path:
    """Return the folder of a launch file's own files; of a shipped one, the current folder."""
    found = find(path)
    return Path.cwd() if found is None or found.parent == SHIPPED else found.parent.resolve()


def shipped() -> list[str]:
    """Return the names of the launch files that come with the package."""
    return sorted(path.name for path in SHIPPED.glob("*.yaml"))


def descriptions() -> dict[str, str]:
    """Return what each launch file of the package describes, by its name without ending."""
    trees = {name: read(SHIPPED / name, Problems()) for name in shipped()}
    return {
        Path(name).stem: str(tree.entries["description"].content)
        for name, tree in trees.items()
        if tree is not None
    }


def missing(path: str | Path, folder: Path = Path()) -> str:
    """Return the message for a launch file that does not exist, with the nearest one."""
    wanted = folder / path
    try:
        beside = [one.name for one in islice(wanted.parent.glob("*.y*ml"), MOST_BESIDE)]
    except (OSError, ValueError):  # a path that no file can have
        beside = []
    guess = nearest_file(wanted.name, [*shipped(), *beside])
    return (
        f"there is no launch file {str(path)!r}; {guess}"
        "`forcebound launch` lists those that come with forcebound"
    )


def read(path: Path, problems: Problems, including: tuple[Path, ...] = ()) -> Value | None:
    """Return the tree of the file and all that it includes; None if nothing can be made of it."""
    text = _text_of(path, problems)
    root = None if text is None else parse(text, str(path), problems)
    if root is None or _means_include(root, problems):
        return None
    if "include" not in root.entries:
        return root
    return _include(root, path, problems, (*including, path.resolve()))


def _means_include(root: Value, problems: Problems) -> bool:
    """Note a key that is nearly ``include``: without it, all that follows seems to be missing."""
    if "include" in root.entries:
        return False
    for name, value in root.entries.items():
        if difflib.SequenceMatcher(None, name, "include").ratio() > NEARLY:
            message = unknown("key in the launch file:", name, ["include"])
            problems.add(message, value.key or value.place)
            return True
    return False


def _include(
    root: Value, path: Path, problems: Problems, including: tuple[Path, ...]
) -> Value | None:
    rest = {name: value for name, value in root.entries.items() if name != "include"}
    wanted = Substitution(None, problems).apply(root.entries["include"])
    if wanted.is_broken:
        return None
    if not isinstance(wanted.content, str):
        problems.add(f"include must name one launch file, got {wanted}", wanted.place)
        return None
    found = find(Path(wanted.content), path.parent)
    if found is None:
        problems.add(missing(wanted.content, path.parent), wanted.place)
        return None
    if len(including) > MAX_INCLUDES:
        problems.add(f"more than {MAX_INCLUDES} files include one another", wanted.place)
        return None
    if found.resolve() in including:
        chain = " includes ".join(str(file.name) for file in (*including, found))
        problems.add(f"files include each other: {chain}", wanted.place)
        return None
    beneath = read(found, problems, including)
    return None if beneath is None else merge(beneath, replace(root, content=rest))


def merge(beneath: Value, above: Value) -> Value:
    """Return ``beneath`` with all that ``above`` says laid over it; see the module's page."""
    if not isinstance(beneath.content, Mapping) or not isinstance(above.content, Mapping):
        return above
    kinds = [side.entries["kind"].plain for side in (beneath, above) if "kind" in side.entries]
    if len(kinds) == 2 and kinds[0] != kinds[1]:
        return above
    entries = dict(beneath.content)
    for name, value in above.content.items():
        if name == "arguments" and name in entries:
            value = replace(value, content={k: _default(v) for k, v in value.entries.items()})
            old = entries[name]
            entries[name] = replace(old, content={k: _default(v) for k, v in old.entries.items()})
        entries[name] = merge(entries[name], value) if name in entries else value
    return replace(above, content=entries)


def _default(argument: Value) -> Value:
    """``name: value`` as ``name: {default: value}``, so that help and choices stay beneath it."""
    if isinstance(argument.content, Mapping):
        return argument
    return replace(argument, content={"default": argument})


def _text_of(path: Path, problems: Problems) -> str | None:
    try:
        data = read_bytes(path, MAX_BYTES)
    except OSError as error:
        problems.add(f"cannot read the launch file: {reason(error)}", Place(str(path)))
        return None
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        place = Place(str(path), *place_in(data, error.start))
        problems.add(not_text(data, error.start), place)
        return None
