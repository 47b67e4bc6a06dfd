"""What composes: Drake LeafSystems, one concept a file, and `make_station`, which joins them into one Diagram.

Every port is documented by its system: name, shape, unit, frame. Needs Drake; nothing here needs PyTorch.
"""

from importlib.util import find_spec
from typing import TYPE_CHECKING

from hotice.errors import MissingExtra
from hotice.lazy import lazy_face

if find_spec("pydrake") is None:
    raise MissingExtra("hotice.systems", "Drake", "drake")

if TYPE_CHECKING:
    from hotice.systems.faulty import InjectedFault, lost_box
    from hotice.systems.logs import SignalLog, read_logs
    from hotice.systems.record.hand_over import HandOverReport, report_hand_over
    from hotice.systems.record.picture import write_diagram, write_station_page
    from hotice.systems.record.play import play_station
    from hotice.systems.record.rollout import to_record
    from hotice.systems.safety_monitor import SafetyLimits, SafetyMonitor
    from hotice.systems.setup.config import StationConfig
    from hotice.systems.setup.rehearsal_config import RehearsalConfig
    from hotice.systems.station.make import Station, make_station
    from hotice.systems.visualizer import open_meshcat
else:
    __getattr__, __dir__ = lazy_face(__name__)

__all__ = [
    "HandOverReport",
    "InjectedFault",
    "RehearsalConfig",
    "SafetyLimits",
    "SafetyMonitor",
    "SignalLog",
    "Station",
    "StationConfig",
    "lost_box",
    "make_station",
    "open_meshcat",
    "play_station",
    "read_logs",
    "report_hand_over",
    "to_record",
    "write_diagram",
    "write_station_page",
]
