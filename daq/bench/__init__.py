"""Reads the description of a bench: bench.toml."""

from typing import TYPE_CHECKING

from dbc.lazy import lazy

if TYPE_CHECKING:
    from ..channels import sensor_of as sensor_of
    from ..channels import sensor_of_signal as sensor_of_signal
    from .bench_tables import campaign_limits as campaign_limits
    from .campaign import Method as Method
    from .campaign import Origin as Origin
    from .campaign import Step as Step
    from .campaign import sketch as sketch
    from .channel_map import ChannelMap as ChannelMap
    from .channel_map import load_channel_map as load_channel_map
    from .config import BusConfig as BusConfig
    from .config import on_bus as on_bus
    from .config import parse_bench as parse_bench
    from .config import with_database as with_database
    from .databases import Database as Database
    from .databases import each_bus as each_bus
    from .databases import file_and_bus as file_and_bus
    from .databases import stored_text as stored_text
    from .edit import with_campaign as with_campaign
    from .edit import with_channel as with_channel
    from .edit import with_facts as with_facts
    from .edit import with_vehicle as with_vehicle
    from .edit import with_weights as with_weights
    from .ready_maps import ready_map as ready_map
    from .ready_maps import ready_map_names as ready_map_names
    from .sensors import Sensor as Sensor
    from .sensors import sensors_codec as sensors_codec
    from .toml_file import holds_toml as holds_toml
else:
    __all__, __dir__, __getattr__ = lazy(__name__)
