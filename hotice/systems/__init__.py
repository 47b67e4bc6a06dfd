"""What composes: Drake LeafSystems, one concept a file, and `make_station`, which joins them into one Diagram.

Every port is documented by its system: name, shape, unit, frame. Needs Drake; nothing here needs PyTorch.
"""

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from hotice.errors import MissingExtra

if find_spec("pydrake") is None:
    raise MissingExtra("hotice.systems", "Drake", "drake")

if TYPE_CHECKING:
    from hotice.systems.logs import read_logs
    from hotice.systems.record.picture import write_diagram, write_station_page
    from hotice.systems.setup.config import StationConfig
    from hotice.systems.station.make import Station, make_station

_LAZY = {
    "Station": "station.make",
    "StationConfig": "setup.config",
    "make_station": "station.make",
    "read_logs": "logs",
    "write_diagram": "record.picture",
    "write_station_page": "record.picture",
}

__all__ = ["Station", "StationConfig", "make_station", "read_logs", "write_diagram", "write_station_page"]


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"{__name__}.{_LAZY[name]}"), name)
