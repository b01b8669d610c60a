"""What must be there once the wheel is installed: `python installed.py CHECKOUT`, from an empty folder."""

import importlib
import sys
from importlib import metadata, resources
from pathlib import Path

PACKAGES = ("sumo_net", "camera_synth", "radar_synth", "ego_synth", "plugin", "analysis")
DATA = {  # package: patterns that must find something
    "sumo_net": ("scenarios/*.toml",),
    "analysis": ("window.xml", "window.html", "protocol/standards/*.toml", "report/templates/*"),
}


def main(checkout: Path) -> None:
    """Exit status 1, naming what is not as it must be."""
    faults = []
    for name in PACKAGES:
        place = Path(str(importlib.import_module(name).__file__)).parent
        if checkout.resolve() in place.resolve().parents:
            faults.append(f"{name} is that of the checkout: {place}")
        if not (place / "py.typed").is_file():
            faults.append(f"{name}/py.typed is missing")
        sources = {file.relative_to(checkout / name) for file in (checkout / name).rglob("*.py")}
        faults += [f"{name}/{file} is missing" for file in sorted(sources) if not (place / file).is_file()]
        for pattern in DATA.get(name, ()):
            wanted = {file.name for file in (checkout / name).glob(pattern)}
            there = {file.name for file in Path(str(resources.files(name))).glob(pattern)}
            if not wanted or wanted - there:
                faults.append(f"{name}/{pattern}: {sorted(wanted - there) or 'nothing in the checkout'}")
    if not any(one.name == "sumo-adas" for one in metadata.entry_points(group="pytest11")):
        faults.append("the plug-in of pytest is not registered")
    from plugin import DriverAssistance  # noqa: F401 (what a user imports first)

    if faults:
        sys.exit("\n".join(faults))
    print(f"{metadata.version('sumo-adas')}: {len(PACKAGES)} packages with types and data")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
