"""Places of the league: device, world and network, and the hands that touch it there.

The tables are in ``league.yaml``. All of them are words of launch files, ``NAME:=VALUE``, so that
``forcebound simulate`` repeats any run of the league.
"""

from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from ruamel.yaml import YAML

from forcebound_proofs.cases import NOISES, Range, decode

Words: TypeAlias = tuple[str, ...]

TABLES: dict[str, Any] = YAML(typ="safe").load(Path(__file__).with_name("league.yaml"))
#: All commands of a place have these: an answer counts for as long as the slowest network needs.
ALWAYS: Words = ("age_limit:=1 s",)
NETWORKS: dict[str, Words] = {name: tuple(words) for name, words in TABLES["networks"].items()}
DELAYS = [name for name, words in NETWORKS.items() if len(words) == 1 and "delay:=" in words[0]]
TUNED_AT = "20 ms"
PHANTOM, WALL, SOFT, FREE, CART = "PHANToM", "wall", "soft wall", "free motion", "cart-pendulum"
SOFT_STIFFNESS = 1000.0  # N/m, of the soft wall, at which transparency is measured
TOUCHED = (WALL, SOFT)  # worlds with a stiffness
RELEASED, SHAKER, CARRIER = "released", "shaker", "carrier"
PERSONS = ("fast", "slow")  # hands whose feeling counts; the energy of all hands does
RESTING = (*PERSONS, RELEASED)  # hands that are meant to come to rest
LONG = (SHAKER, CARRIER)  # hands whose runs are long
CARRIED = 0.4  # Hz, of the carrier, well below the ball's own 0.91 Hz
ATTACKER = {name: Range(**row) for name, row in TABLES["attacker"].items()}
SURFACE = 0.010  # m


class Place(NamedTuple):
    """Where a method is played: keys of the tables."""

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
        stiffness: float = TABLES["devices"][self.device]["stiffness"]
        return SOFT_STIFFNESS if self.world == SOFT else stiffness

    @property
    def hands(self) -> list[str]:
        """The hands that touch it."""
        hands: list[str] = TABLES["worlds"][self.world]["hands"]
        return hands

    @property
    def file(self) -> str:
        """Its launch file."""
        file: str = TABLES["devices"][self.device]["file"]
        own: str = TABLES["worlds"][self.world].get("file", file)
        return own

    @property
    def words(self) -> Words:
        """What all of its runs have."""
        return (*TABLES["worlds"][self.world]["words"], *NETWORKS[self.network], *ALWAYS)

    def by_hand(self, hand: str) -> Words:
        """Return the launch file and the words of a run with one of its hands."""
        own = tuple(TABLES["hands"][hand])
        if hand == RELEASED:
            own = (*own, f"operator.end:={TABLES['devices'][self.device]['released']}")
        return ("impedance" if hand == SHAKER else self.file, *self.words, *own)

    def by_attack(self, code: str) -> Words:
        """Return the launch file and the words of an attack, a code of :func:`.cases.encode`.

        Raises:
            ConfigError: If it is no such code.
        """
        (seed,), numbers = decode(code, (NOISES,), ATTACKER)
        strength: float = TABLES["devices"][self.device]["strength"]
        push = strength * numbers.pop("push")
        numbers["tremor"] *= strength
        numbers["stiffness"] *= strength
        numbers["end"] = SURFACE + push / numbers["stiffness"]
        hand = (f"operator.{name}:={value:.6g}" for name, value in numbers.items())
        ends = ("device.engage_time:=10 ms", f"seed:={seed + 1}", "operator.kind:=trembling")
        return (self.file, *self.words, *ends, *hand)


def places(is_small: bool = False) -> list[Place]:
    """Return the places of a league."""
    return [
        Place(device, world, network)
        for device, worlds in TABLES["small" if is_small else "played"].items()
        for world, networks in worlds.items()
        for network in networks
    ]
