"""All traffic of a running SUMO simulation as arrays: the only importer of libsumo and traci.

SUMO's positions (centre of the front bumper) are kept. Its angles (degrees clockwise from north) and its
lateral positions (positive right in a left-hand network) are converted here, and nowhere else, to radians
counter-clockwise from +x and to left positive.
"""

import contextlib
import subprocess
import warnings
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

from sumo_net import columns
from sumo_net.arrays import Array
from sumo_net.batch import longer
from sumo_net.frames import heading_from_sumo_angle
from sumo_net.snapshot import Snapshot
from sumo_net.start_up import cause, is_left_hand, one_line, set_sumo_home, standard_error
from sumo_net.step import STEP_S

REMEMBERED_S = 300.0  # how long the name of a vehicle that has left is kept, for events evaluated later
_INVALID = -1e9  # SUMO's INVALID_DOUBLE_VALUE is -2**30


class TrafficError(RuntimeError):
    """SUMO could not start, has stopped, or runs with options that are not supported here."""


class NotRunningError(TrafficError):
    """There is no simulation to attach to."""


class _Kind(NamedTuple):
    """A vehicle's class and type when it entered."""

    vehicle_class: str
    type_id: str


class Traffic:
    """A SUMO simulation, started here (`start`) or by the user (`attach`). A context manager, too."""

    _started: ClassVar["Traffic | None"] = None

    def __init__(self, simulation: Any, owned: bool) -> None:
        """Use `attach` or `start`."""
        import traci.constants
        import traci.exceptions

        self._sumo = simulation
        self._owned = owned
        # The module's exceptions; a traci Connection has no such attributes.
        self._refused = getattr(simulation, "TraCIException", traci.exceptions.TraCIException)
        self._lost = (
            traci.exceptions.FatalTraCIError,
            getattr(simulation, "FatalTraCIError", traci.exceptions.FatalTraCIError),
        )
        self._check()
        self.net_file = Path(self._option("net-file"))
        self.left_hand = is_left_hand(self.net_file)
        self._side = -1.0 if self.left_hand else 1.0
        self.lane_ids: list[str] = list(simulation.lane.getIDList())
        self._lane_number = {lane: number for number, lane in enumerate(self.lane_ids)}
        self._next_handle = 0
        self._names: dict[int, str] = {}  # by handle
        self._kinds: dict[int, _Kind] = {}  # by handle
        self._left: deque[tuple[float, int]] = deque()  # (time in s, handle)
        self._bodies = np.zeros((256, 3))  # by handle: length, width, height
        self._numbers: dict[str, int] = {}  # handles of the vehicles that have not left
        self._routes: dict[int, tuple[str, int, tuple[str, ...]]] = {}
        self._reader = columns.reader_of(simulation, traci.constants)

    # --- beginning and end

    @classmethod
    def start(cls, arguments: Sequence[str], gui: bool = False) -> "Traffic":
        """Start SUMO in this process (libsumo), or with `gui` sumo-gui in its own (traci).

        `arguments` is SUMO's command line without the program. Raises TrafficError where it does not start
        (with SUMO's message), and where a simulation is running: a process can have only one.
        """
        if Traffic._started is not None:
            raise TrafficError("a simulation is already running in this process: close() it first")
        set_sumo_home()
        with standard_error() as words:
            try:
                simulation = _start_gui(arguments) if gui else _start_libsumo(arguments)
            except TrafficError:
                raise
            except Exception as error:
                why = cause(words(), str(error))
                hint = (
                    " (on a machine without a screen: xvfb-run -a sumo-adas ...)" if "display" in why else ""
                )
                raise TrafficError(f"SUMO did not start: {why}{hint}") from None
            try:
                traffic = cls(simulation, owned=True)
            except BaseException as error:
                with contextlib.suppress(Exception):  # the other process may have ended
                    simulation.close()
                if isinstance(error, NotRunningError):  # SUMO's process started, but failed to load
                    raise TrafficError(f"SUMO did not start: {cause(words(), str(error))}") from None
                raise
        Traffic._started = traffic
        return traffic

    @classmethod
    def attach(cls, simulation: Any) -> "Traffic":
        """Use a simulation that the user started: the module libsumo or traci, or a traci Connection.

        Raises TrafficError where it is not running, its step is not 0.1 s, or SUMO moves vehicles sideways.
        """
        return cls(simulation, owned=False)

    def close(self) -> None:
        """End the simulation if it was started here, which completes SUMO's own outputs; idempotent."""
        if self._owned:
            self._owned = False
            Traffic._started = None
            with contextlib.suppress(*self._lost, self._refused):
                self._sumo.close()

    def __enter__(self) -> "Traffic":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _check(self) -> None:
        try:
            # libsumo answers with defaults while nothing is loaded; a traci Connection cannot be asked.
            if not getattr(self._sumo, "isLoaded", lambda: True)():
                raise AttributeError
            step = float(self._sumo.simulation.getDeltaT())
        except (*self._lost, self._refused, AttributeError):
            raise NotRunningError(
                "the simulation is not running: start it first, as in "
                'libsumo.start(["sumo", "-c", "mine.sumocfg", "--step-length", "0.1"])'
            ) from None
        if abs(step - STEP_S) > 1e-9:
            raise TrafficError(f"the step length is {step:g} s, needed is 0.1 s: add --step-length 0.1")
        resolution = float(self._option("lateral-resolution") or -1)
        if resolution > 0:
            raise TrafficError(
                f"--lateral-resolution {resolution:g} (the sublane model) lets SUMO move vehicles sideways, "
                "which is computed here: add --lateral-resolution -1"
            )
        duration = float(self._option("lanechange.duration") or 0)
        if duration > 0:
            raise TrafficError(
                f"--lanechange.duration {duration:g} lets SUMO move vehicles sideways, "
                "which is computed here: add --lanechange.duration 0"
            )

    def _option(self, name: str) -> str:
        try:
            return str(self._sumo.simulation.getOption(name))
        except self._refused:
            return ""

    # --- time

    def step(self) -> None:
        """Let SUMO do one step of 0.1 s. Raises TrafficError where the simulation has ended meanwhile."""
        try:
            self._sumo.simulationStep()
        except (*self._lost, self._refused) as error:
            raise TrafficError(f"SUMO stopped: {one_line(str(error))}") from None

    @property
    def time_s(self) -> float:
        """SUMO's simulation time."""
        return float(self._sumo.simulation.getTime())

    # --- reading

    def snapshot(self) -> Snapshot:
        """All vehicles now; call once a step. Raises TrafficError where the simulation has ended."""
        try:
            return self._snapshot()
        except self._lost as error:
            raise TrafficError(f"SUMO stopped: {one_line(str(error))}") from None

    def _snapshot(self) -> Snapshot:
        numbers = self._numbers
        names = self._sumo.vehicle.getIDList()
        # In the order of their names, so that handles do not depend on the order of SUMO's list.
        for name in sorted(name for name in names if name not in numbers):
            self._register(name)
        if len(numbers) > len(names):
            self._forget(numbers.keys() - set(names))
        order = sorted([numbers[name] for name in names])
        known = self._names
        position, angle, speed, lanes, along = self._reader.places([known[handle] for handle in order])
        handles = np.array(order, dtype=np.int64)
        xy = np.fromiter(chain.from_iterable(position), np.float64, 2 * len(order)).reshape(-1, 2)
        lane = self._lane_indices(lanes)
        on_lane = lane >= 0
        bodies = self._bodies[handles]
        made = Snapshot(
            handle=handles,
            x_m=xy[:, 0].copy(),
            y_m=xy[:, 1].copy(),
            heading_rad=heading_from_sumo_angle(np.array(angle, dtype=np.float64)),
            speed_mps=np.array(speed, dtype=np.float64),
            lane=lane,
            lane_position_m=np.where(on_lane, np.array(along, dtype=np.float64), np.nan),
            length_m=bodies[:, 0].copy(),
            width_m=bodies[:, 1].copy(),
            height_m=bodies[:, 2].copy(),
        )
        somewhere = xy[:, 0] > _INVALID
        if somewhere.all():
            return made
        return Snapshot(*(part[somewhere] for part in made))

    def accelerations_mps2(self, handles: Array) -> Array:
        """Accelerations (n,) of vehicles of the last snapshot; 0 where SUMO has none (parked, vanished)."""
        names = [self._names[handle] for handle in handles.tolist()]
        try:
            found = np.array(list(map(self._reader.acceleration, names)), np.float64)
        except self._refused:  # one of them has vanished since the snapshot
            found = np.array(list(map(self._acceleration, names)), np.float64)
        return np.where(found > _INVALID, found, 0.0)

    def _acceleration(self, name: str) -> float:
        try:
            return self._reader.acceleration(name)
        except self._refused:
            return 0.0

    def vehicle_id(self, handle: int) -> str:
        """SUMO's name of a vehicle, until REMEMBERED_S after it has left. Raises KeyError later."""
        return self._names[handle]

    @property
    def names(self) -> Mapping[int, str]:
        """SUMO's names by handle, of vehicles that are present or left less than REMEMBERED_S ago."""
        return self._names

    def handle(self, vehicle_id: str) -> int:
        """The handle of a vehicle that has entered and not left. Raises KeyError."""
        return self._numbers[vehicle_id]

    def vehicle_class(self, handle: int) -> str:
        """SUMO's vehicle class: 'passenger', 'truck', 'bicycle' and so on."""
        return self._kinds[handle].vehicle_class

    def type_id(self, handle: int) -> str:
        """SUMO's vehicle type when the vehicle entered."""
        return self._kinds[handle].type_id

    def type_parameter(self, type_id: str, key: str) -> str:
        """A <param> of a vehicle type; '' where it has none."""
        try:
            return str(self._sumo.vehicletype.getParameter(type_id, key))
        except self._refused:
            return ""

    def vehicle_parameter(self, handle: int, key: str) -> str:
        """A <param> of a vehicle; '' where it has none, or has left."""
        try:
            return str(self._sumo.vehicle.getParameter(self._names[handle], key))
        except self._refused:
            return ""

    def route_ahead(self, handle: int) -> tuple[str, ...]:
        """The edges of the route from the current one on; () for a vehicle that has left.

        On a junction (an internal lane) the first edge is the one just left, as in SUMO's route index.
        """
        name = self._names[handle]
        try:
            route = self._sumo.vehicle.getRouteID(name)
            index = self._sumo.vehicle.getRouteIndex(name)
            known = self._routes.get(handle)
            if known is not None and known[0] == route and known[1] == index:
                return known[2]
            ahead = tuple(self._sumo.vehicle.getRoute(name)[max(index, 0) :])
        except (*self._lost, self._refused):
            return ()
        self._routes[handle] = (route, index, ahead)
        return ahead

    # --- writing

    def write_lateral(self, handles: Array, lateral_m: Array) -> None:
        """Set lateral positions (n,), in metres left of SUMO's lane centre, of vehicles by handle (n,).

        Takes effect in SUMO's next step. Vehicles that have left are ignored. Raises ValueError for a value
        that is not finite, which SUMO would accept.
        """
        if not np.isfinite(lateral_m).all():
            bad = int(np.asarray(handles)[~np.isfinite(lateral_m)][0])
            raise ValueError(f"lateral position of vehicle '{self._names[bad]}' is not finite")
        put, names = self._sumo.vehicle.setLateralLanePosition, self._names
        sumo_side = (self._side * np.asarray(lateral_m, dtype=np.float64)).tolist()
        for handle, lateral in zip(np.asarray(handles).tolist(), sumo_side, strict=True):
            try:  # contextlib.suppress would cost more than the call itself
                put(names[handle], lateral)
            except (*self._lost, self._refused):
                pass

    def set_color(self, handle: int, red: int, green: int, blue: int) -> None:
        """Colour a vehicle in sumo-gui, 0 to 255 each; one that has left is ignored."""
        with contextlib.suppress(self._refused):
            self._sumo.vehicle.setColor(self._names[handle], (red, green, blue, 255))

    @property
    def window(self) -> Any:
        """SUMO's interface to its window; None without one."""
        has = getattr(self._sumo, "hasGUI", lambda: hasattr(self._sumo, "gui"))
        try:
            return self._sumo.gui if has() else None
        except (*self._lost, self._refused):
            return None

    @property
    def vehicles(self) -> Any:
        """SUMO's own vehicle interface, for `influence`."""
        return self._sumo.vehicle

    @property
    def gone(self) -> tuple[type[Exception], ...]:
        """Exceptions that SUMO raises for an unknown vehicle, a refused request or a lost connection."""
        return (*self._lost, self._refused)

    # --- bookkeeping

    def _register(self, name: str) -> None:
        handle = self._next_handle
        self._next_handle += 1
        self._bodies = longer(self._bodies, handle + 1)
        vehicle = self._sumo.vehicle
        self._bodies[handle] = vehicle.getLength(name), vehicle.getWidth(name), vehicle.getHeight(name)
        self._kinds[handle] = _Kind(vehicle.getVehicleClass(name), vehicle.getTypeID(name))
        self._names[handle] = name
        self._numbers[name] = handle

    def _forget(self, absent: Iterable[str]) -> None:
        """Drop vehicles that have left for good; a teleporting one is absent, too, but will return."""
        # asked about a vehicle that has left, SUMO behind a socket prints an "Error" line
        for name in set(absent).difference(self._sumo.vehicle.getTeleportingIDList()):
            handle = self._numbers.pop(name)
            self._routes.pop(handle, None)
            self._left.append((self.time_s, handle))
        while self._left and self._left[0][0] < self.time_s - REMEMBERED_S:
            _, handle = self._left.popleft()
            del self._names[handle], self._kinds[handle]

    def _lane_indices(self, lanes: list[str]) -> Array:
        number = self._lane_number
        try:
            return np.array([number[lane] if lane else -1 for lane in lanes], dtype=np.int32)
        except KeyError:
            for lane in lanes:
                if lane and lane not in number:
                    number[lane] = len(self.lane_ids)
                    self.lane_ids.append(lane)
            return self._lane_indices(lanes)


def _start_libsumo(arguments: Sequence[str]) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the wheel's warning about Arrow versions is irrelevant here
        import libsumo

    if libsumo.isLoaded():
        raise TrafficError("a simulation is already running in this process: close it, or attach to it")
    try:
        libsumo.start(["sumo", *arguments])
    except BaseException:
        libsumo.close()  # after a late failure the simulation would stay loaded
        raise
    return libsumo


def _start_gui(arguments: Sequence[str]) -> Any:
    import sumolib
    import traci

    port = sumolib.miscutils.getFreeSocketPort()
    program = sumolib.checkBinary("sumo-gui")
    words = [program, *arguments, "--start", "--quit-on-end", "--remote-port", str(port)]
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL)
    try:
        with contextlib.redirect_stdout(None):  # traci prints every attempt
            return traci.connect(port, numRetries=600, proc=process, waitBetweenRetries=0.1)
    except BaseException:
        process.kill()
        process.wait()
        raise
