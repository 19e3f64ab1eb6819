"""What a frame description may hold: pydantic models, a sentence for every key (the text an error quotes).

A description says which bytes make a message of a gyro and what they mean. It holds no expressions and no code:
only the keys below.
"""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from drivers.frames._units import QUANTITY_OF_ROLE, UNITS

Role = Literal[
    "rate",
    "delta_angle",
    "cumulative_angle",
    "accel",
    "delta_velocity",
    "temp",
    "case_temp",
    "counter",
    "status",
    "time",
    "since_pulse",
    "aux",
]
GYRO_ROLES = ("rate", "delta_angle", "cumulative_angle")
ACCEL_ROLES = ("accel", "delta_velocity")
NUMBER_BYTES = {"u8": 1, "i8": 1, "u16": 2, "i16": 2, "u24": 3, "i24": 3, "u32": 4, "i32": 4, "u64": 8}
FLOAT_BYTES = {"f32": 4, "f64": 8}
MOST_PARTS, _MOST_POINTS = 256, 4096
"""Of fields, variants, status bits, vectors; of a table. No unit has near as many, and checks go by pairs."""
_NAME = r"^[a-z][a-z0-9_]{0,39}$"


def _hex_bytes(value: Any) -> Any:
    if not isinstance(value, str):
        raise ValueError("bytes in hexadecimal, such as 'EB 90'")
    text = "".join(value.split())
    if not text or len(text) % 2 or not re.fullmatch(r"[0-9A-Fa-f]+", text):
        raise ValueError("whole bytes in hexadecimal, such as 'EB 90'")
    return bytes.fromhex(text)


def _hex_number(value: Any) -> Any:
    if isinstance(value, str):
        return int(value.replace(" ", "").removeprefix("0x"), 16)
    return value


def listed(value: Any) -> Any:
    return value if isinstance(value, (list, tuple)) else [value]


def _known_unit(value: str) -> str:
    if value not in UNITS:
        raise ValueError("one of " + ", ".join(UNITS))
    return value


HexBytes = Annotated[bytes, BeforeValidator(_hex_bytes)]
HexNumber = Annotated[int, BeforeValidator(_hex_number), Field(ge=0)]
Unit = Annotated[str, AfterValidator(_known_unit)]
Endian = Literal["big", "little"]


class Part(BaseModel):
    """A section: no other keys than its own."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Link(Part):
    """`[link]`: the line as the maker sets it; a bench file has the last word."""

    baud: int = Field(default=115_200, ge=50, le=12_000_000, description="the line's bit/s")
    bytesize: Literal[7, 8] = Field(default=8, description="data bits a byte, 7 or 8")
    parity: Literal["N", "E", "O"] = Field(default="N", description="'N', 'E' or 'O'")
    stopbits: Literal[1, 2] = Field(default=1, description="1 or 2")
    nominal_rate_hz: float = Field(
        default=100.0, gt=0, le=100_000, description="frames a second as delivered"
    )


class LengthField(Part):
    """Where a frame says how long it is: total bytes = the number found there + `add`."""

    at: int = Field(ge=0, le=65_535, description="offset of the length in the frame")
    type: Literal["u8", "u16", "u24", "u32"] = Field(description="'u8', 'u16', 'u24' or 'u32'")
    endian: Endian | None = Field(default=None, description="'big' or 'little'")
    add: int = Field(default=0, description="what is added to give the whole frame's bytes")
    times: int = Field(default=1, ge=1, le=8, description="bytes a unit of the length (2 for words)")

    @property
    def bytes(self) -> int:
        """How many bytes of the frame it takes."""
        return int(self.type[1:]) // 8


class Match(Part):
    """Bytes that a frame must have at a place, besides its sync word."""

    at: int = Field(ge=0, le=65_535, description="offset in the frame")
    equals: HexBytes = Field(description="the bytes, in hexadecimal")
    mask: HexBytes | None = Field(default=None, description="which bits count, as many bytes as `equals`")


class Checksum(Part):
    """One check of a frame: `kind` over `ranges`, found at `at`."""

    kind: Literal["sum8", "xor8", "neg8", "sum16", "sum16_words", "crc8", "crc16", "crc32"] = Field(
        description="sum8, xor8, neg8 (all bytes add up to 0), sum16, sum16_words, crc8, crc16 or crc32"
    )
    ranges: Annotated[tuple[tuple[int, int], ...], Field(min_length=1, max_length=4)] = Field(
        description="half-open byte ranges [first, end], joined in order; negative counts from the frame's "
        "end, and an end of 0 is the frame's end"
    )
    at: int = Field(
        ge=-65_535, le=65_535, description="offset of the check value, negative from the frame's end"
    )
    endian: Endian | None = Field(default=None, description="'big' or 'little': order of the check's bytes")
    words: Endian | None = Field(default=None, description="'big' or 'little': order of sum16_words' words")
    poly: HexNumber | None = Field(
        default=None, description="the CRC's polynomial in hexadecimal, normal form"
    )
    init: HexNumber = Field(default=0, description="what the check starts from, in hexadecimal")
    reflected: bool = Field(default=False, description="true if bytes go in least significant bit first")
    xorout: HexNumber = Field(default=0, description="what is XORed to the CRC at the end, in hexadecimal")
    pad_to: int = Field(default=1, ge=1, le=64, description="zeros are appended to a multiple of this")


class FrameSection(Part):
    """`[frame]`: what makes a frame; a `[[variant]]` has the same keys and takes the rest from here."""

    endian: Endian | None = Field(default=None, description="'big' or 'little', the usual order of fields")
    sync: Annotated[tuple[HexBytes, ...], BeforeValidator(listed)] | None = Field(
        default=None,
        max_length=64,
        description="the first bytes of a frame in hexadecimal, or a list of such",
    )
    sync_mask: HexBytes | None = Field(
        default=None, description="which bits of the sync count, as many bytes as the sync"
    )
    match: tuple[Match, ...] = Field(
        default=(), max_length=16, description="further bytes that tell frames apart"
    )
    length: int | None = Field(
        default=None, ge=2, le=65_535, description="bytes a frame, sync and check included"
    )
    length_field: LengthField | None = Field(default=None, description="where the frame says its length")
    max_length: int | None = Field(default=None, ge=2, le=65_535, description="the longest frame there is")
    terminator: HexBytes | None = Field(default=None, description="the last bytes of a frame, in hexadecimal")
    checksum: Annotated[tuple[Checksum, ...], BeforeValidator(listed)] | None = Field(
        default=None, max_length=16, description="the check, or a list of checks"
    )


class Scale(Part):
    """physical = raw * mul / div * 2**pow2 (+ offset)."""

    mul: float = Field(default=1.0, allow_inf_nan=False, description="a factor")
    div: float = Field(default=1.0, gt=0, allow_inf_nan=False, description="a divisor")
    pow2: int = Field(default=0, ge=-64, le=64, description="a power of two")

    @property
    def factor(self) -> float:
        """The one factor that raw values are multiplied by."""
        return self.mul * 2.0**self.pow2 / self.div


class When(Part):
    """A multiplexed field is there when another field of the frame says so: modulo, or under a mask."""

    field: str = Field(description="the name of the field that tells")
    mod: int | None = Field(default=None, ge=2, description="divide that field by this ...")
    mask: HexNumber | None = Field(default=None, description="... or look at these of its bits")
    equals: int = Field(ge=0, description="what must be left")


class ValidRule(Part):
    """A field counts when bits of another one have a value."""

    field: str = Field(description="the name of the field that tells")
    bit: int = Field(ge=0, le=63, description="which bit of it, 0 the least significant")
    value: Literal[0, 1] = Field(default=1, description="what the bit is when this field is good")


class Transform(Part):
    """What a linear scale cannot say: a thermistor behind a divider, a table, a polynomial.

    thermistor: R = k raw / (full - raw), T = 1 / (a + b ln R + c ln^2 R + d ln^3 R) in K; the field's unit is
    degC. table: linear between (xs, ys), constant outside. polynomial: coefficients from the constant up.
    """

    kind: Literal["thermistor", "table", "polynomial"] = Field(description="thermistor, table or polynomial")
    k: float = Field(default=1.0, gt=0, description="divider resistance over unit resistance")
    full: float = Field(default=1.0, gt=0, description="raw value of full scale")
    a: float = 0.0
    b: float = 0.0
    c: float = 0.0
    d: float = 0.0
    xs: tuple[float, ...] = Field(default=(), max_length=_MOST_POINTS, description="raw values, rising")
    ys: tuple[float, ...] = Field(
        default=(), max_length=_MOST_POINTS, description="physical values, one for each of xs"
    )
    coefficients: tuple[float, ...] = Field(default=(), max_length=32, description="constant first")


class FieldSection(Part):
    """`[[field]]`: a number in the frame."""

    name: str = Field(pattern=_NAME, description="lower-case letters, digits and _, a letter first")
    at: int = Field(ge=-65_535, le=65_535, description="offset in the frame, negative from its end")
    type: str = Field(
        pattern=r"^(u8|i8|u16|i16|u24|i24|u32|i32|u64|f32|f64|text:[1-9]\d?)$",
        description="u8 i8 u16 i16 u24 i24 u32 i32 u64 f32 f64, or text:<bytes>",
    )
    endian: Endian | None = Field(default=None, description="'big' or 'little'")
    bits: tuple[int, int] | None = Field(
        default=None, description="[first, count] of an unsigned type, 0 the least significant bit"
    )
    scale: Scale = Field(default=Scale(), description="{mul=..., div=..., pow2=...}")
    offset: float = Field(default=0.0, allow_inf_nan=False, description="added after scaling")
    unit: Unit = Field(default="1", description="the unit after scaling")
    role: Role = Field(default="aux", description="what the field is to the bench")
    axis: Literal["x", "y", "z"] | None = Field(default=None, description="'x', 'y' or 'z'")
    axes: str | None = Field(
        default=None,
        pattern=r"^(xy|xz|yx|yz|zx|zy|xyz|xzy|yxz|yzx|zxy|zyx)$",
        description="'xyz': a field <name>_<axis> for each letter, one behind the other, in that order",
    )
    valid: ValidRule | None = Field(default=None, description="{field=..., bit=..., value=...}")
    when: When | None = Field(default=None, description="{field=..., mod=..., equals=...}")
    sentinel: tuple[HexNumber, ...] = Field(
        default=(), max_length=64, description="raw values that mean 'not available'"
    )
    transform: Transform | None = Field(default=None, description="{kind='thermistor', ...}")
    usual: float | None = Field(default=None, description="what an emulated unit sends (default 0)")

    def each(self) -> tuple[FieldSection, ...]:
        """Return the fields it stands for: itself, or one for each of `axes`."""
        if self.axes is None:
            return (self,)
        return tuple(
            self.model_copy(
                update={
                    "name": f"{self.name}_{axis}",
                    "at": self.at + n * self.bytes,
                    "axis": axis,
                    "axes": None,
                }
            )
            for n, axis in enumerate(self.axes)
        )

    @property
    def bytes(self) -> int:
        """How many bytes of the frame it takes."""
        if self.type.startswith("text:"):
            return int(self.type[5:])
        return (NUMBER_BYTES | FLOAT_BYTES)[self.type]

    @property
    def quantity(self) -> str | None:
        """The quantity its unit must be one of, None where any will do."""
        return QUANTITY_OF_ROLE.get(self.role)


class Counter(Part):
    """`[counter]`: what shows lost frames. It counts frames (`step`) or time (`ticks_per_s`)."""

    field: str = Field(description="the name of the counting field")
    modulo: int | None = Field(default=None, ge=2, description="where it wraps; default the field's range")
    step: int = Field(default=1, ge=1, description="how much it rises a frame")
    ticks_per_s: float | None = Field(
        default=None, gt=0, description="for a clock: how much it rises a second"
    )


class StatusBit(Part):
    """`[[status]]`: a bit with a meaning. A bad bit of severity "error" makes the frame's rates invalid."""

    field: str = Field(description="the name of the field that has the bit")
    bit: int = Field(ge=0, le=63, description="which bit, 0 the least significant")
    name: str = Field(pattern=_NAME, description="a short name for the bit")
    good: Literal[0, 1] = Field(default=0, description="the bit's value when all is well")
    severity: Literal["info", "warn", "error"] = Field(default="error", description="info, warn or error")
    axis: Literal["x", "y", "z"] | None = Field(default=None, description="the axis it speaks of; none: all")


class Variant(FrameSection):
    """`[[variant]]`: one of several kinds of message on a port; keys of [frame] and fields of its own.

    A field named as one of the description's replaces it here; `without` leaves out fields.
    """

    name: str = Field(pattern=_NAME, description="a name for the message")
    counter: Counter | None = Field(
        default=None, description="a [variant.counter] section in place of [counter]"
    )
    without: tuple[str, ...] = Field(
        default=(), max_length=MOST_PARTS, description="names of the description's fields it lacks"
    )
    field: tuple[FieldSection, ...] = Field(
        default=(), max_length=MOST_PARTS, description="[[variant.field]] entries"
    )


class FieldChange(Part):
    """What a choice makes of a field: the keys given replace the field's own, of a scale each part by itself."""

    scale: dict[Literal["mul", "div", "pow2"], float | int] | None = Field(
        default=None, description="{mul=..., div=..., pow2=...}"
    )
    offset: float | None = Field(default=None, description="added after scaling")
    unit: Unit | None = Field(default=None, description="the unit after scaling")
    role: Role | None = Field(default=None, description="what the field is to the bench")
    type: str | None = Field(default=None, description="another number type of the same size")
    axis: Literal["x", "y", "z"] | None = Field(default=None, description="'x', 'y' or 'z'")


class Choice(Part):
    """One of the ways in which a unit may be set up or made."""

    field: dict[str, FieldChange] = Field(
        default_factory=dict, description="field = {keys that differ}, in [[field]] and every variant"
    )
    message: str | tuple[str, ...] | None = Field(
        default=None, description="the message or messages that a bench reads then"
    )


class Setting(Part):
    """`[setting.<name>]`: what the bytes do not tell, since the unit was ordered or set up so."""

    what: str = Field(default="", description="what it is about, in words")
    default: str = Field(description="the choice where the bench file names none")
    choice: dict[str, Choice] = Field(min_length=1, description="choice = {field = {...}}")


class Known(Part):
    """What is known of a vector, of bytes or of a line."""

    tolerance: float = Field(default=1e-6, ge=0, description="relative tolerance of numbers")
    origin: str = Field(default="", description="who says so")
    settings: dict[str, str] = Field(default_factory=dict, description="setting = choice, as the unit had it")


class Vector(Known):
    """`[[vector]]`: bytes with known content, checked whenever the description is."""

    hex: HexBytes = Field(description="the frame's bytes in hexadecimal")
    expect: dict[str, float | int | bool | str] = Field(default_factory=dict, description="field = value")
    variant: str | None = Field(default=None, description="which variant it is")


class Description(Part):
    """A whole file."""

    schema_: Literal[1] = Field(alias="schema", description="1")
    name: str = Field(pattern=_NAME, description="the name bench files use")
    title: str = Field(min_length=1, description="what it is, in words")
    maker: str = Field(default="", description="who makes the device")
    model: str = Field(default="", description="the device's model")
    source: str = Field(default="", description="document or code the layout is from")
    note: str = Field(default="", description="anything a user should know")
    message: str | tuple[str, ...] | None = Field(
        default=None,
        description="the message a bench reads unless told another, or a list of those that take turns; default "
        "the first it hears",
    )
    setting: dict[Annotated[str, Field(pattern=_NAME)], Setting] = Field(
        default_factory=dict, description="[setting.<name>] sections"
    )
    link: Link = Field(default=Link(), description="a [link] section")
    frame: FrameSection = Field(description="a [frame] section with sync, length and checksum")
    counter: Counter | None = Field(default=None, description="a [counter] section")
    field: tuple[FieldSection, ...] = Field(
        default=(), max_length=MOST_PARTS, description="[[field]] entries"
    )
    status: tuple[StatusBit, ...] = Field(default=(), max_length=MOST_PARTS, description="[[status]] entries")
    variant: tuple[Variant, ...] = Field(default=(), max_length=MOST_PARTS, description="[[variant]] entries")
    vector: tuple[Vector, ...] = Field(default=(), max_length=MOST_PARTS, description="[[vector]] entries")
