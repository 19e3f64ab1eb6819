"""Gyros on a serial port described by a TOML file: decoder, encoder and driver made from the description."""

from drivers.frames._decode import FrameDecoder, MessageReader, celsius, channels, messages_of, reader_of
from drivers.frames._encode import FrameEncoder
from drivers.frames._form import Form, Messages
from drivers.frames._kind import Frames, FramesConfig, bits_a_byte, kind_as_described
from drivers.frames._line_encode import LineEncoder
from drivers.frames._lines import LineDescription, LineSection
from drivers.frames._load import FrameFamily, family_of, load_family, refusal, shipped
from drivers.frames._model import GYRO_ROLES
from drivers.frames._settings import choices_of
from drivers.frames._units import factor as to_bench_unit
from drivers.frames._vectors import vector_mistakes

__all__ = [
    "GYRO_ROLES",
    "Form",
    "FrameDecoder",
    "FrameEncoder",
    "FrameFamily",
    "Frames",
    "FramesConfig",
    "LineDescription",
    "LineEncoder",
    "LineSection",
    "MessageReader",
    "Messages",
    "bits_a_byte",
    "celsius",
    "channels",
    "choices_of",
    "family_of",
    "kind_as_described",
    "load_family",
    "messages_of",
    "reader_of",
    "refusal",
    "shipped",
    "to_bench_unit",
    "vector_mistakes",
]
