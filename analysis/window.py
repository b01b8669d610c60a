"""A run in SUMO's own window: vehicles coloured by state, with warnings; one camera image in a file."""

import contextlib
import os
import shutil
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from analysis.drive_picture import DrivePictures
from analysis.live import last_step
from plugin.assistance import DriverAssistance
from plugin.warning import collision, departure
from sumo_net.traffic import Traffic

PICTURE, PAGE = "camera.png", "camera.html"
PARAMETER = "adas.warning"  # vehicle parameter, shown beside it
VIEW_SETTINGS = Path(__file__).with_name("window.xml")
PAGE_SOURCE = Path(__file__).with_name("window.html")

_VIEW = "View #0"
_ZOOM_HEIGHT_M = 60.0
_PICTURE_EVERY = 2  # steps
_HIGHLIGHT_EVERY, _HIGHLIGHT_S = 10, 1.5  # a ring fades after that, and is redrawn while needed


class State(NamedTuple):
    """A vehicle's state: colour and label."""

    red: int
    green: int
    blue: int
    label: str  # beside the vehicle, '' for none


# later ones have priority; palette of Okabe and Ito, for colour-blind readers
INACTIVE = State(90, 120, 150, "")
READY = State(86, 180, 233, "")
NOT_SEEN = State(204, 121, 167, "lane not seen")
LANE_LEFT = State(230, 159, 0, "LDW left")
LANE_RIGHT = State(230, 159, 0, "LDW right")
REMINDER = State(240, 228, 66, "FCW")
DANGER = State(213, 94, 0, "FCW danger")
STATES = (INACTIVE, READY, NOT_SEEN, LANE_LEFT, LANE_RIGHT, REMINDER, DANGER)
_FIRST_WARNING = STATES.index(LANE_LEFT)
_BY_DEPARTURE = {
    "inactive": 0,
    "ready": 1,
    "suppressed": 1,
    "lane not seen": 2,
    "warning left": 3,
    "warning right": 4,
}
_BY_COLLISION = {"reminder": 5, "danger": 6}
_FROM_DEPARTURE = np.array([_BY_DEPARTURE[name] for name in departure.CODES])
_FROM_COLLISION = np.array([_BY_COLLISION.get(name, 0) for name in collision.CODES])


def states(departure_code: Any, collision_code: Any) -> Any:
    """(n,) index into STATES of n vehicles with these codes; the more urgent has priority."""
    return np.maximum(_FROM_DEPARTURE[departure_code], _FROM_COLLISION[collision_code])


class FleetWindow:
    """Updates the window; call `step` after that of the assistance."""

    def __init__(self, traffic: Traffic, adas: DriverAssistance, directory: Path) -> None:
        """`directory`: for the camera image, and a page that reloads it."""
        self._traffic, self._adas, self._directory = traffic, adas, directory
        self._gui = traffic.window
        self._shown: dict[int, int] = {}  # state by handle, as shown in the window
        self._mine = -1  # handle of the vehicle that this object set the view to follow
        self._steps = 0
        directory.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(PAGE_SOURCE, directory / PAGE)

    def step(self) -> None:
        """Colour, label and follow vehicles; every few steps write the camera image."""
        latest = self._adas.latest
        if latest is None:
            return
        now = states(latest.departure_code, latest.collision_code)
        for handle, state in zip(latest.handle.tolist(), now.tolist(), strict=True):
            changed = self._shown.get(handle) != state
            if changed:
                self._show(handle, state)
            if state >= _FIRST_WARNING and (changed or self._steps % _HIGHLIGHT_EVERY == 0):
                self._highlight(handle, state)
        selected = self._selected(latest.handle.tolist(), now.tolist())
        if selected >= 0 and self._steps % _PICTURE_EVERY == 0:
            self._picture(selected)
        self._steps += 1

    def _show(self, handle: int, state: int) -> None:
        self._shown[handle] = state
        meant = STATES[state]
        self._traffic.set_color(handle, meant.red, meant.green, meant.blue)
        name, vehicles = self._traffic.vehicle_id(handle), self._traffic.vehicles
        with contextlib.suppress(*self._traffic.gone):
            vehicles.setParameter(name, PARAMETER, meant.label)

    def _highlight(self, handle: int, state: int) -> None:
        meant = STATES[state]
        colour = (meant.red, meant.green, meant.blue, 255)
        with contextlib.suppress(*self._traffic.gone):
            self._traffic.vehicles.highlight(
                self._traffic.vehicle_id(handle), colour, size=8.0, alphaMax=200, duration=_HIGHLIGHT_S
            )

    def _selected(self, handles: list[int], now: list[int]) -> int:
        """Handle of the equipped vehicle that the view follows; if it follows none, one is chosen."""
        if self._gui is None:
            return handles[0]
        try:
            tracked = str(self._gui.getTrackedVehicle(_VIEW))
        except self._traffic.gone:
            return -1
        if tracked:
            with contextlib.suppress(KeyError):
                handle = self._traffic.handle(tracked)
                if handle in self._shown and handle in handles:
                    return handle
            return -1  # the user follows a vehicle that is not equipped
        if self._mine in handles:  # the user stopped following it
            return self._mine
        # the most urgent state first, then the newest vehicle, which has the longest way to go
        self._mine = max(zip(now, handles, strict=True))[1]
        with contextlib.suppress(*self._traffic.gone):
            self._gui.trackVehicle(_VIEW, self._traffic.vehicle_id(self._mine))
            if self._steps == 0:
                self._zoom(self._mine)
        return self._mine

    def _zoom(self, handle: int) -> None:
        x, y = self._traffic.vehicles.getPosition(self._traffic.vehicle_id(handle))
        half = _ZOOM_HEIGHT_M / 2
        self._gui.setBoundary(_VIEW, x - 2 * half, y - half, x + 2 * half, y + half)

    def _picture(self, handle: int) -> None:
        drive = last_step(self._adas, self._traffic.vehicle_id(handle))
        if drive is None:
            return
        _, png = cv2.imencode(".png", DrivePictures(drive).of(0), (cv2.IMWRITE_PNG_COMPRESSION, 1))
        part = self._directory / f".{PICTURE}.part"
        part.write_bytes(png.tobytes())
        os.replace(part, self._directory / PICTURE)  # so that readers never see an incomplete file
