"""The configuration: what `config.yaml` may hold, checked once, with the place of every mistake."""

from plcemu.runtime.config.mistakes import problem_text
from plcemu.runtime.config.overrides import plant_parameters
from plcemu.runtime.config.quantities import Duration, Texts
from plcemu.runtime.config.reading import ConfigText, find_config, load_config
from plcemu.runtime.config.sections import (
    AlarmSection,
    Config,
    PlantSection,
    PointSection,
    RealtimeSection,
    Section,
    TaskSection,
)

__all__ = [
    "AlarmSection",
    "Config",
    "ConfigText",
    "Duration",
    "PlantSection",
    "PointSection",
    "RealtimeSection",
    "Section",
    "TaskSection",
    "Texts",
    "find_config",
    "load_config",
    "plant_parameters",
    "problem_text",
]
