"""A launch file and the files that it includes, as one tree.

``include: other.yaml`` at the top of a file is read the same way, and what the including file says
overrides it, key by key. A section that names another ``kind`` is replaced as a whole, since the
parameters of one kind mean nothing to another; likewise a link that names a ``preset``, so that
only what stands beside it wins. An included file is looked for in the including one's folder, then
among those that come with the package.

``hands: {default: ...}`` is what a file says of all hands, those of the included file, too. It
overrides that file, and what the same file says of one hand overrides it.

``device: {include: device.yaml}`` takes the section ``device:`` of a file, such as one from
``forcebound identify``, or a file that is that section, and fills in its arguments. A file of
another kind of device is refused: its numbers would promise what this device does not keep.
"""

from collections.abc import Callable, Mapping
from pathlib import Path

from forcebound.errors import ConfigError
from forcebound.files import read_text
from forcebound.graph.arguments import Substitution
from forcebound.graph.names import DEFAULT
from forcebound.graph.problems import Place, Problems, nearest_file
from forcebound.graph.tree import Value, parse
from forcebound.messages.topology import HAND, HAND_SECTIONS, HANDS
from forcebound.network.presets import PRESET

MAX_BYTES = 256_000  # a launch file is a page or two; more is a mistake, and slow to read
DEVICE_FILE = "the file of the device"

SHIPPED = Path(__file__).parents[1] / "launch_files"

#: The launch files that come with the package, by what somebody looks for; each is in one group.
GROUPS = {
    group: names.split()
    for group, names in {
        "walls": "stiff_wall damped_wall time_varying_wall three_axes palpation sliding_friction"
        " released_hand impedance",
        "worlds": "touch_sphere touch_mesh touch_field touch_points membrane push_mass push_boxes"
        " cart_pendulum follow_path",
        "hands": "two_hands leader_follower leader_follower_transfer joint_arms servo_arms",
        "devices": "knob_wall odrive_knob five_bar_wall haply_2diy haply_inverse3 serial_arm_wall"
        " desktop_arm hold_arm servo_wall dynamixel_arm feetech_arm",
        "pages": "pointer_wall pointer_touch pointer_rabbit pointer_membrane pointer_two_hands",
        "paper": "paper_wall paper_time_varying_wall",
        "networks": "delayed_wall far_wall two_port_wall stress remote_wall leader_follower_remote",
    }.items()
}


def find(path: Path, folder: Path = Path()) -> Path | None:
    """Return the launch file meant by ``path`` in a folder: on disk, or else of those shipped."""
    on_disk = folder / path
    if not on_disk.is_file() and path.parent in (Path(), Path("launch")):
        for name in (path.name, f"{path.name}.yaml"):
            if name in shipped():
                return SHIPPED / name
    return on_disk if on_disk.exists() else None


def folder_of(path: Path) -> Path:
    """Return where the files of a launch file are; of a shipped one, the current folder."""
    found = find(path)
    return Path.cwd() if found is None or found.parent == SHIPPED else found.parent.resolve()


def shipped() -> list[str]:
    """Return the names of the launch files that come with the package."""
    return sorted(path.name for path in SHIPPED.glob("*.yaml"))


def descriptions() -> dict[str, dict[str, str]]:
    """Return what each launch file of the package describes, by group and name without ending."""
    return {group: {name: _description(name) for name in names} for group, names in GROUPS.items()}


def _description(name: str) -> str:
    tree = read(SHIPPED / f"{name}.yaml", Problems())
    return "" if tree is None else str(tree.entries["description"].content)


def missing(path: str | Path, folder: Path = Path()) -> str:
    """Return the message for a launch file that does not exist, with the nearest one."""
    named = folder / path
    beside = [one.name for one in named.parent.glob("*.y*ml")]
    guess = nearest_file(named.name, [*shipped(), *beside])
    return (
        f"there is no launch file {str(path)!r}; {guess}"
        "`forcebound launch` lists those that come with forcebound"
    )


def read(path: Path, problems: Problems, including: tuple[Path, ...] = ()) -> Value | None:
    """Return the tree of the file and all that it includes; None if nothing can be made of it."""
    try:
        text = read_text(path, "the launch file", MAX_BYTES)
    except ConfigError as error:
        problems.add(str(error), Place(""))
        return None
    root = parse(text, str(path), problems)
    if root is not None:
        base: Value | None = root.with_entries({})
        if "include" in root.entries:
            base = _included(root.entries["include"], path, problems, including)
        root = None if base is None else _with_default(base, root.without("include"))
    return None if root is None else _with_included_hands(root, path, problems, including)


def _included(
    value: Value, path: Path, problems: Problems, including: tuple[Path, ...]
) -> Value | None:
    """The tree of the file that an entry ``include`` of a file names; None with a problem noted."""
    named = Substitution(None, problems).apply(value)
    if named.is_broken:
        return None
    found = None
    if not isinstance(named.content, str):
        problems.add(f"include must name one launch file, got {named}", named.place)
    elif (found := find(Path(named.content), path.parent)) is None:
        problems.add(missing(named.content, path.parent), named.place)
    elif found.resolve() in (*including, path.resolve()):
        files = (*including, path, found)
        chain = " includes ".join(str(file.name) for file in files)
        problems.add(f"files include each other: {chain}", named.place)
        found = None
    return None if found is None else read(found, problems, (*including, path.resolve()))


def _with_default(base: Value, root: Value) -> Value:
    """A file laid over the one that it includes, with what its hands share in each of them."""
    empty = root.with_entries({})
    before, own = (side.entries.get(HANDS, empty) for side in (base, root))
    shared = merge(*[side.entries.get(DEFAULT, empty) for side in (before, own)])
    hands = {
        name: merge(shared, hand if hand.content is not None else hand.with_entries({}))
        for name, hand in {**dict.fromkeys(before.entries, empty), **own.entries}.items()
        if name != DEFAULT
    }
    if not hands or not shared.entries:  # a file to be included may have a default alone
        return merge(base, root)
    base = base.with_entries({**base.entries, HANDS: before.without(DEFAULT)})
    return merge(base, root.with_entries({**root.entries, HANDS: own.with_entries(hands)}))


def _with_included_hands(
    root: Value, path: Path, problems: Problems, including: tuple[Path, ...]
) -> Value | None:
    """A file with the files of one hand that its hands include: their sections and arguments."""
    if HANDS not in root.entries or not root.entries[HANDS].entries:
        return root
    hands, arguments = dict(root.entries[HANDS].entries), root.entries.get("arguments")
    for name, hand in hands.items():
        if "include" not in hand.entries:
            continue
        base = _included(hand.entries["include"], path, problems, including)
        if base is None:
            return None
        sections = {n: value for n, value in base.entries.items() if n in HAND_SECTIONS}
        hands[name] = merge(base.with_entries(sections), hand.without("include"))
        if "arguments" in base.entries:
            given = base.entries["arguments"]
            own = arguments or given.with_entries({})
            arguments = merge(_in_full(given), _in_full(own))
    entries = {**root.entries, HANDS: root.entries[HANDS].with_entries(hands)}
    if arguments is not None:
        entries["arguments"] = arguments
    return root.with_entries(entries)


def with_named_hands(root: Value) -> Value:
    """Return a launch file with its hands by name; sections on top are those of an only one."""
    if HANDS in root.entries:
        return root
    sections = {name: root.entries[name] for name in HAND_SECTIONS if name in root.entries}
    hands = Value({HAND: root.with_entries(sections)}, root.place, root.key)
    return root.with_entries({**root.without(*HAND_SECTIONS).entries, HANDS: hands})


def with_hands(root: Value, change: Callable[[Value], Value]) -> Value:
    """Return a launch file with hands by name, with each of them changed."""
    hands = {name: change(value) for name, value in root.entries[HANDS].entries.items()}
    return root.with_entries({**root.entries, HANDS: root.entries[HANDS].with_entries(hands)})


def merge(base: Value, above: Value) -> Value:
    """Return ``base`` with all that ``above`` says laid over it; see the module's page."""
    if not isinstance(base.content, Mapping) or not isinstance(above.content, Mapping):
        return above
    kinds = [side.entries["kind"].plain for side in (base, above) if "kind" in side.entries]
    if len(kinds) == 2 and kinds[0] != kinds[1]:
        return above
    if PRESET in above.entries and not kinds:
        return above
    entries = dict(base.content)
    for name, value in above.content.items():
        if name == "arguments" and name in entries:
            entries[name], value = _in_full(entries[name]), _in_full(value)
        entries[name] = merge(entries[name], value) if name in entries else value
    return above.with_entries(entries)


def _in_full(arguments: Value) -> Value:
    """``name: value`` as ``name: {default: value}``, so that help and choices stay."""
    return arguments.with_entries(
        {
            name: value
            if isinstance(value.content, Mapping)
            else value.with_entries({"default": value})
            for name, value in arguments.entries.items()
        }
    )


def with_device_file(root: Value, problems: Problems, arguments: Substitution) -> Value:
    """Return the sections of a hand with the file that its device includes under that section."""
    section = root.entries.get("device")
    if section is None or "include" not in section.entries:
        return root
    named, own = section.entries["include"], section.without("include")
    base = None
    if isinstance(named.content, str):
        path = named.folder / named.text
        try:
            base = arguments.apply(device_section(path, problems))
            kind, meant = (one.entries.get("kind") for one in (base, own))
            if kind is not None and meant is not None and kind.plain != meant.plain:
                raise ConfigError(
                    f"{path} is of a {kind.plain}; this launch file has a {meant.plain}. With a"
                    f" {kind.plain}, write kind: {kind.plain} beside include, or include a launch"
                    f" file of one; else run `forcebound identify {meant.plain}`"
                )
        except ConfigError as error:
            problems.add(str(error), named.place)
            base = None
    elif named.content is not None and not named.is_broken:
        problems.add(f"device: include must name one file, got {named}", named.place)
    device = own if base is None else merge(base, own)
    return root.with_entries({**root.entries, "device": device})


def device_section(path: Path, problems: Problems) -> Value:
    """Return the section of the device in a file; ConfigError if it cannot be read or has none."""
    root = parse(read_text(path, DEVICE_FILE, MAX_BYTES), str(path), problems)
    device = None if root is None else root.entries.get("device", root)
    if device is None or "kind" not in device.entries:
        expected = "the keys of a device with its kind, or a section device:"
        raise ConfigError(f"{path}: expected {expected}")
    return device
