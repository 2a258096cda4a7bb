"""Places of the league: device, world and network, and the hands that touch it there.

All of them are words of launch files, ``NAME:=VALUE``, so that ``forcebound simulate`` repeats any
run of the league.
"""

from collections.abc import Mapping
from typing import NamedTuple, TypeAlias

from forcebound_proofs.cases import NOISES, Range, decode

Words: TypeAlias = tuple[str, ...]


class Device(NamedTuple):
    """A simulated device: its launch file, and how strong it is."""

    file: str
    strength: float  # forces of attacking hands, as a share of those on the PHANToM
    released: str  # target of the released hand
    stiffness: float  # N/m, of the wall of its launch file


class World(NamedTuple):
    """An environment, and the hands that touch it."""

    words: Words
    hands: tuple[str, ...]  # keys of HANDS
    file: str = ""  # launch file; empty: that of the device


class Place(NamedTuple):
    """Where a method is played: keys of the three tables."""

    device: str
    world: str
    network: str

    @property
    def label(self) -> str:
        """In words, of a page."""
        return f"{self.device}, {self.world}, {self.network}"

    @property
    def stiffness(self) -> float:
        """Of its wall, in N/m."""
        return SOFT if self.world == "soft wall" else DEVICES[self.device].stiffness


#: All commands of a place have these: an answer counts for as long as the slowest network needs.
ALWAYS: Words = ("age_limit:=1 s",)

DEVICES = {
    "PHANToM": Device("stiff_wall", 1.0, "90 mm", 10_000.0),
    "2DIY": Device("five_bar_wall", 0.1, "30 mm", 2_000.0),
}

_LINKS = ("links.environment_query", "links.environment_reply")
_JITTER = tuple(f"{link}.{word}" for link in _LINKS for word in ("jitter:=5 ms", "loss:=10 %"))

NETWORKS: dict[str, Words] = {
    **{f"{ms} ms": (f"delay:={ms} ms",) for ms in (0, 1, 5, 20, 100)},
    "20 ms, jitter 5 ms, loss 10 %": ("delay:=20 ms", *_JITTER),
    **{name: tuple(f"{link}.preset:={name}" for link in _LINKS) for name in ("wifi", "starlink")},
}
DELAYS = [name for name, words in NETWORKS.items() if len(words) == 1]
TUNED_AT = "20 ms"

_RELEASED = ("mass:=0 kg", "stiffness:=50 N/m", "damping:=0 N s/m", "start:=10 mm")
_SWING = ("kind:=trembling", "start:=0 mm", "end:=0 mm")
SHAKER, RELEASED, CARRIER = "shaker", "released", "carrier"
LONG = (SHAKER, CARRIER)  # hands whose runs are long
CARRIED = 0.4  # Hz, well below the ball's own 0.91 Hz
_CARRIER = ("mass:=0.1 kg", "stiffness:=1000 N/m", "damping:=10 N s/m", "tremor:=40 N")
#: Hands of the world's launch file but for these words; the shaker has a launch file of its own.
HANDS: dict[str, Words] = {
    "fast": (),
    "slow": ("approach_speed:=35 mm/s",),
    RELEASED: (
        *(f"operator.{word}" for word in (*_RELEASED, "approach_speed:=10 m/s")),
        "device.engage_time:=0 s",
    ),
    SHAKER: (),
    CARRIER: tuple(
        f"operator.{w}" for w in (*_SWING, *_CARRIER, f"tremor_frequency:={CARRIED} Hz")
    ),
    "swing of 1 Hz": tuple(
        f"operator.{w}" for w in (*_SWING, "tremor:=15 N", "tremor_frequency:=1 Hz")
    ),
    "swing of 5 Hz": tuple(
        f"operator.{w}" for w in (*_SWING, "tremor:=5 N", "tremor_frequency:=5 Hz")
    ),
}
FREE, CART = "free motion", "cart-pendulum"
SOFT = 1000.0  # N/m, of the soft wall, at which transparency is measured
PERSONS = ("fast", "slow")  # hands whose feeling counts; the energy of all hands does
RESTING = (*PERSONS, RELEASED)  # hands that are meant to come to rest
WORLDS: dict[str, World] = {
    "wall": World((), RESTING),
    "soft wall": World((f"stiffness:={SOFT:g} N/m",), (*RESTING, SHAKER)),
    FREE: World(("environment.position:=1 m",), ("swing of 1 Hz", "swing of 5 Hz")),
    CART: World((), (*PERSONS, CARRIER), "cart_pendulum"),
}
TOUCHED = ("wall", "soft wall")  # worlds with a stiffness
#: What is played: worlds and networks of each device.
PLAYED: Mapping[tuple[str, str], tuple[str, ...]] = {
    ("PHANToM", "wall"): tuple(NETWORKS),
    ("PHANToM", "soft wall"): ("1 ms", "20 ms"),
    ("PHANToM", FREE): ("20 ms",),
    ("PHANToM", CART): ("0 ms", "20 ms"),
    ("2DIY", "wall"): ("20 ms",),
}
SMALL: Mapping[tuple[str, str], tuple[str, ...]] = {
    ("PHANToM", "wall"): ("0 ms", "20 ms"),
    ("PHANToM", "soft wall"): ("1 ms",),
    ("PHANToM", FREE): ("20 ms",),
    ("PHANToM", CART): ("20 ms",),
}

#: Numbers of an attacking hand, which presses and trembles; SI units, forces as on the PHANToM.
ATTACKER: dict[str, Range] = {
    "mass": Range(0.01, 1.0, is_logarithmic=True, zero_share=0.2),
    "stiffness": Range(10.0, 2000.0, is_logarithmic=True),
    "damping": Range(0.1, 10.0, is_logarithmic=True, zero_share=0.3),
    "start": Range(-0.010, 0.010),
    "push": Range(0.3, 5.0, is_logarithmic=True),  # N, of its spring at the surface in the end
    "approach_speed": Range(0.02, 2.0, is_logarithmic=True),
    "tremor": Range(0.1, 4.0, is_logarithmic=True, zero_share=0.2),  # N
    "tremor_frequency": Range(0.5, 30.0, is_logarithmic=True),
    "tremor_phase": Range(0.0, 6.28),
}
SURFACE = 0.010  # m


def places(is_small: bool = False) -> list[Place]:
    """Return the places of a league."""
    played = SMALL if is_small else PLAYED
    return [Place(*both, network) for both, networks in played.items() for network in networks]


def file_of(place: Place) -> str:
    """Return the launch file of a place."""
    return WORLDS[place.world].file or DEVICES[place.device].file


def words_of(place: Place, hand: str) -> Words:
    """Return the words of a place with one of its hands; the first one is the launch file."""
    device, world = DEVICES[place.device], WORLDS[place.world]
    own = HANDS[hand]
    if hand == RELEASED:
        own = (*own, f"operator.end:={device.released}")
    file = "impedance" if hand == SHAKER else file_of(place)
    return (file, *world.words, *NETWORKS[place.network], *ALWAYS, *own)


def attack_of(place: Place, code: str) -> Words:
    """Return the words of a place under an attack, a code of :func:`.cases.encode`.

    Raises:
        ConfigError: If it is no such code.
    """
    (seed,), numbers = decode(code, (NOISES,), ATTACKER)
    world = WORLDS[place.world]
    push, strength = numbers.pop("push"), DEVICES[place.device].strength
    numbers["tremor"] *= strength
    numbers["stiffness"] *= strength
    numbers["end"] = SURFACE + strength * push / numbers["stiffness"]
    hand = (f"operator.{name}:={value:.6g}" for name, value in numbers.items())
    ends = ("device.engage_time:=10 ms", f"seed:={seed + 1}", "operator.kind:=trembling", *hand)
    return (file_of(place), *world.words, *NETWORKS[place.network], *ALWAYS, *ends)
