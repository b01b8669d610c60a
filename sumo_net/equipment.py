"""Which vehicles are equipped: a share of them, named ones, or those whose SUMO type requests it.

The draw of a vehicle depends on (seed, vehicle id) only, so adding one vehicle changes no other.
"""

from pydantic import Field

from sumo_net.randomness import stream_key, uniform
from sumo_net.settings import SettingsError, settings
from sumo_net.traffic import Traffic

TYPE_PARAMETERS = ("adas.equipped", "has.adas.device")
VEHICLE_PARAMETER = "adas.equipped"  # 'has.adas.device' always reads 'false' on a vehicle

# Light road vehicles, which the car's dynamics represent; 'ignoring' is SUMO's class without restrictions.
LIGHT_CLASSES = (
    "passenger",
    "private",
    "taxi",
    "evehicle",
    "hov",
    "vip",
    "authority",
    "army",
    "emergency",
    "delivery",
    "custom1",
    "custom2",
    "ignoring",
)
HEAVY_CLASSES = ("truck", "trailer", "bus", "coach")
_YES, _NO = ("true", "1", "yes", "on"), ("false", "0", "no", "off")


@settings
class Equipment:
    """Which vehicles are equipped: those of `ids`, else as type or vehicle ask for, else by `fraction`."""

    fraction: float = Field(
        0.2, ge=0, le=1, description="share of the vehicles of `classes` that is equipped"
    )
    ids: tuple[str, ...] = Field((), description="SUMO ids of vehicles that are equipped in any case")
    classes: tuple[str, ...] = Field(
        LIGHT_CLASSES, description="SUMO vehicle classes to which `fraction` applies"
    )
    types_may_ask: bool = Field(True, description="heed <param key='has.adas.device'> and 'adas.equipped'")

    def __post_init__(self) -> None:
        road = (*LIGHT_CLASSES, *HEAVY_CLASSES)
        for name in self.classes:
            if name not in road:
                raise ValueError(f"classes: '{name}' is none of the road vehicles {', '.join(road)}")


class EquipmentChoice:
    """Decides for each vehicle whether it is equipped; reads each type's parameters once."""

    def __init__(self, equipment: Equipment, seed: int) -> None:
        self.equipment = equipment
        self.seed = seed
        self._by_type: dict[str, bool | None] = {}
        self._of_class: dict[str, list[int]] = {}  # equipped and all vehicles

    def choose(self, traffic: Traffic, handles: list[int]) -> list[int]:
        """Those of `handles` (vehicles seen for the first time) that are equipped, in the same order.

        Raises SettingsError where a parameter is neither true nor false.
        """
        return [handle for handle in handles if self._wants(traffic, handle)]

    def by_class(self) -> str:
        """How many vehicles of which SUMO class were equipped, as in 'passenger 2 of 9; truck 0 of 1'."""
        classes = sorted(self._of_class.items(), key=lambda item: (-item[1][1], item[0]))
        return "; ".join(f"{name} {equipped} of {seen}" for name, (equipped, seen) in classes)

    def _wants(self, traffic: Traffic, handle: int) -> bool:
        name = traffic.vehicle_id(handle)
        asked = None
        if self.equipment.types_may_ask:
            type_id = traffic.type_id(handle)
            if type_id not in self._by_type:
                self._by_type[type_id] = requested_by_type(traffic, type_id)
            asked = self._by_type[type_id]
            text = traffic.vehicle_parameter(handle, VEHICLE_PARAMETER)
            if text:
                asked = _truth(text, f"vehicle '{name}', param '{VEHICLE_PARAMETER}'")
        vehicle_class = traffic.vehicle_class(handle)
        wants = is_equipped(self.equipment, self.seed, name, vehicle_class, asked)
        counts = self._of_class.setdefault(vehicle_class, [0, 0])
        counts[0] += wants
        counts[1] += 1
        return wants


def requested_by_type(traffic: Traffic, type_id: str) -> bool | None:
    """What the parameters of a vehicle type request; None where it has none of them."""
    for key in TYPE_PARAMETERS:
        text = traffic.type_parameter(type_id, key)
        if text:
            return _truth(text, f"vType '{type_id}', param '{key}'")
    return None


def is_equipped(
    equipment: Equipment, seed: int, vehicle_id: str, vehicle_class: str, asked: bool | None = None
) -> bool:
    """Whether a vehicle is equipped; `asked`: what its own or its type's parameter says, None if absent."""
    if vehicle_id in equipment.ids:
        return True
    if asked is not None:
        return asked
    if vehicle_class not in equipment.classes:
        return False
    return bool(uniform(stream_key(seed, vehicle_id, "equipment"), 0) < equipment.fraction)


def _truth(text: str, where: str) -> bool:
    lowered = text.strip().lower()
    if lowered not in (*_YES, *_NO):
        raise SettingsError(f"{where} = '{text}': allowed are true and false")
    return lowered in _YES
