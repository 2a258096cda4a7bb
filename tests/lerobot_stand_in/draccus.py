"""What lerobot and the plug-ins use of draccus."""

from typing import Any, ClassVar


class ChoiceRegistry:
    choices: ClassVar[dict[str, type[Any]]] = {}  # of all, by base and name

    @classmethod
    def register_subclass(cls, name: str) -> Any:
        return lambda kind: ChoiceRegistry.choices.setdefault(f"{cls.__name__} {name}", kind)


def decode(base: type[ChoiceRegistry], raw: dict[str, Any]) -> Any:
    kind = ChoiceRegistry.choices[f"{base.__name__} {raw['type']}"]
    return kind(**{key: value for key, value in raw.items() if key != "type"})
