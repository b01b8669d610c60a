"""Who is equipped."""

import numpy as np
import pytest

from sumo_net.equipment import Equipment, EquipmentChoice, is_equipped, requested_by_type
from sumo_net.settings import SettingsError, read

NAMES = [f"flow.{k}" for k in range(4000)]


class FakeTraffic:
    """Vehicles with types and parameters, as Traffic answers for them."""

    def __init__(self, vehicles: dict[str, tuple[str, str]], types: dict[str, dict[str, str]]) -> None:
        self._names = list(vehicles)
        self._vehicles = vehicles
        self._types = types
        self.parameters: dict[str, str] = {}
        self.asked = 0

    def vehicle_id(self, handle: int) -> str:
        return self._names[handle]

    def vehicle_class(self, handle: int) -> str:
        return self._vehicles[self._names[handle]][0]

    def type_id(self, handle: int) -> str:
        return self._vehicles[self._names[handle]][1]

    def type_parameter(self, type_id: str, key: str) -> str:
        self.asked += 1
        return self._types.get(type_id, {}).get(key, "")

    def vehicle_parameter(self, handle: int, key: str) -> str:
        return self.parameters.get(self._names[handle], "") if key == "adas.equipped" else ""


def chosen(equipment: Equipment, seed: int, names: list[str], vehicle_class: str = "passenger") -> set[str]:
    return {name for name in names if is_equipped(equipment, seed, name, vehicle_class)}


@pytest.mark.parametrize("fraction", [0.0, 0.05, 0.2, 0.5, 1.0])
def test_share(fraction: float) -> None:
    share = len(chosen(Equipment(fraction=fraction), 1, NAMES)) / len(NAMES)
    assert share == pytest.approx(fraction, abs=4 * np.sqrt(fraction * (1 - fraction) / len(NAMES)))


def test_a_vehicles_choice_depends_on_seed_and_name_only() -> None:
    equipment = Equipment(fraction=0.2)
    alone = chosen(equipment, 7, NAMES[:100])
    assert alone == chosen(equipment, 7, NAMES[::-1]) & set(NAMES[:100])
    assert alone != chosen(equipment, 8, NAMES[:100])


def test_a_larger_share_takes_none_away() -> None:
    assert chosen(Equipment(fraction=0.1), 3, NAMES) < chosen(Equipment(fraction=0.3), 3, NAMES)


@pytest.mark.parametrize(
    "vehicle_class", ["bicycle", "pedestrian", "rail", "rail_fast", "tram", "ship", "motorcycle", "truck"]
)
def test_what_the_car_model_is_not_for_is_not_in_the_share(vehicle_class: str) -> None:
    assert not chosen(Equipment(fraction=1.0), 1, NAMES[:50], vehicle_class)


def test_heavy_vehicles_on_request() -> None:
    equipment = Equipment(fraction=1.0, classes=("truck",))
    assert is_equipped(equipment, 1, "a", "truck")
    assert not is_equipped(equipment, 1, "a", "passenger")


def test_named_vehicles_and_types_that_ask() -> None:
    traffic = FakeTraffic(
        {
            "named": ("truck", "plain"),
            "asks": ("passenger", "yes"),
            "declines": ("passenger", "no"),
            "own": ("passenger", "no"),
            "plain": ("passenger", "plain"),
        },
        {"yes": {"has.adas.device": "true"}, "no": {"adas.equipped": "0"}},
    )
    traffic.parameters["own"] = "true"
    handles = list(range(5))
    none = EquipmentChoice(Equipment(fraction=0.0, ids=("named",)), 1)
    assert none.choose(traffic, handles) == [0, 1, 3]
    everyone = EquipmentChoice(Equipment(fraction=1.0), 1)
    assert everyone.choose(traffic, handles) == [1, 3, 4]
    assert sum(int(part.split()[-1]) for part in everyone.by_class().split("; ")) == len(handles)
    assert sum(int(part.split()[-3]) for part in everyone.by_class().split("; ")) == 3
    deaf = EquipmentChoice(Equipment(fraction=1.0, types_may_ask=False), 1)
    assert deaf.choose(traffic, handles) == [1, 2, 3, 4]


def test_a_type_is_asked_once() -> None:
    traffic = FakeTraffic(dict.fromkeys(NAMES[:100], ("passenger", "plain")), {})
    EquipmentChoice(Equipment(), 1).choose(traffic, list(range(100)))
    assert traffic.asked == 2


def test_a_parameter_that_is_neither_true_nor_false() -> None:
    traffic = FakeTraffic({}, {"odd": {"has.adas.device": "maybe"}})
    with pytest.raises(
        SettingsError, match=r"vType 'odd', param 'has.adas.device' = 'maybe': allowed are true"
    ):
        requested_by_type(traffic, "odd")


@pytest.mark.parametrize(
    ("mapping", "words"),
    [
        ({"fraction": 1.2}, "fraction = 1.2"),
        ({"fracton": 0.2}, "did you mean 'fraction'"),
        ({"classes": ["boat"]}, "'boat' is none of the road vehicles"),
        ({"fraction": float("nan")}, "fraction = nan"),
    ],
)
def test_bad_settings(mapping: dict[str, object], words: str) -> None:
    with pytest.raises(SettingsError) as refused:
        read(Equipment, mapping, "x.toml")
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)
