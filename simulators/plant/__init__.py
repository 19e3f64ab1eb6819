"""The plant: what happens physically in the emulated lab. Physics, no bytes."""

from simulators.plant.chamber import WEAK_CHAMBER, ChamberParameters
from simulators.plant.lab_plant import LabPlant, PlantConfig, UnitConfig, unit_model
from simulators.plant.table import TableAxis, TableParameters

__all__ = [
    "WEAK_CHAMBER",
    "ChamberParameters",
    "LabPlant",
    "PlantConfig",
    "TableAxis",
    "TableParameters",
    "UnitConfig",
    "unit_model",
]
