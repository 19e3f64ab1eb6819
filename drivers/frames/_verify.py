"""What must agree inside a description: layouts that can be, fields that refer to each other, vectors."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator

from drivers.frames._checks import check_bytes, places
from drivers.frames._form import Form
from drivers.frames._model import ACCEL_ROLES, GYRO_ROLES, Description, FieldSection
from drivers.frames._units import UNITS
from drivers.kit.config import Mistake


def verify(description: Description, forms: list[Form]) -> Iterator[Mistake]:
    """Yield everything that makes the description impossible."""
    own = [each.name for group in description.field for each in group.each()]
    yield from _names("field", own)
    yield from _names("variant", [each.name for each in description.variant])
    for variant in description.variant:
        own = [each.name for group in variant.field for each in group.each()]
        yield from _names(f"variant {variant.name!r}: field", own)
    for form in forms:
        problems = list(_head(form))
        yield from problems
        if not problems:
            yield from _layout(form)
        yield from _fields(form)
    yield from _gyro(forms)
    yield from _references(description, forms)
    if all(form.syncs for form in forms):
        yield from _told_apart(forms)


def _names(what: str, names: list[str]) -> Iterator[Mistake]:
    for name in sorted({name for name in names if names.count(name) > 1}):
        yield Mistake(f"{what} {name!r}", f"{names.count(name)} of that name", "names that differ")


def _head(form: Form) -> Iterator[Mistake]:
    if form.syncs == (b"",) and form.length is not None:
        return  # A line's row of numbers: the line has its own checks.
    if not form.syncs:
        yield Mistake(f"{form.key}.sync", "nothing", "the first bytes of a frame in hexadecimal")
        return
    sizes = {len(sync) for sync in form.syncs}
    if len(sizes) > 1 or len(form.mask) not in sizes:
        found = f"syncs of {sorted(sizes)} bytes and a mask of {len(form.mask)}"
        yield Mistake(f"{form.key}.sync", found, "syncs and sync_mask of the same length")
        return
    for rule in form.match:
        if rule.mask is not None and len(rule.mask) != len(rule.equals):
            yield Mistake(
                f"{form.key}.match", f"{len(rule.mask)} bytes of mask", f"{len(rule.equals)}, as `equals` has"
            )
            return
        if form.length is not None and rule.at + len(rule.equals) > form.length:
            found = f"bytes {rule.at} to {rule.at + len(rule.equals) - 1}"
            yield Mistake(f"{form.key}.match", found, f"bytes of the frame's {form.length}")
            return
    if not any(form.places(sync) for sync in form.syncs):
        yield Mistake(f"{form.key}.sync_mask", "no bit that counts", "at least one whole byte to look for")
    if form.length is None and form.length_field is None:
        yield Mistake(f"{form.key}.length", "nothing", "the frame's bytes: length, or length_field")
    elif form.length is not None and form.length_field is not None:
        yield Mistake(f"{form.key}.length", "length and length_field", "one of the two")
    elif form.length_field is not None and not form.max_length:
        yield Mistake(
            f"{form.key}.max_length", "nothing", "the longest frame, where a field gives the length"
        )
    for number, check in enumerate(form.checksums):
        key = f"{form.key}.checksum[{number}]"
        if check.kind.startswith("crc"):
            if check.poly is None:
                yield Mistake(f"{key}.poly", "nothing", "the CRC's polynomial in hexadecimal")
            elif max(check.poly, check.init, check.xorout) >> 8 * check_bytes(check.kind):
                yield Mistake(f"{key}.poly", f"more than {8 * check_bytes(check.kind)} bits", check.kind)
        elif check.poly is not None or check.pad_to != 1:
            yield Mistake(f"{key}.poly", "poly or pad_to", f"neither: {check.kind} is no CRC")


def _layout(form: Form) -> Iterator[Mistake]:
    length = form.shortest
    if length > form.longest:
        yield Mistake(
            f"{form.key}.max_length", str(form.longest), f"at least {length}, for head, fields and check"
        )
        return
    taken: list[tuple[int, int, str, FieldSection | None]] = []
    for sync in form.syncs[:1]:
        taken += [
            (at, at + 1, "the sync or match bytes", None) for at, _, bits in form.places(sync) if bits == 255
        ]
    if (rule := form.length_field) is not None:
        taken.append((rule.at, rule.at + int(rule.type[1:]) // 8, "length_field", None))
    for number, check in enumerate(form.checksums):
        key = f"{form.key}.checksum[{number}]"
        ranges, at = places(check, length)
        size = check_bytes(check.kind)
        if not 0 <= at <= length - size:
            yield Mistake(f"{key}.at", f"bytes {at} to {at + size}", f"a place within {_bytes(form)}")
            continue
        for first, end in ranges:
            if not 0 <= first < end <= length:
                yield Mistake(f"{key}.ranges", f"[{first}, {end}]", f"a range within {_bytes(form)}")
            elif first < at + size and at < end:
                yield Mistake(
                    f"{key}.ranges", f"[{first}, {end}] with the check at {at}", "ranges without it"
                )
            elif check.kind == "sum16_words" and (end - first) % 2:
                yield Mistake(f"{key}.ranges", f"{end - first} bytes", "whole 16-bit words")
        taken.append((at, at + size, f"checksum[{number}]", None))
    if form.terminator:
        taken.append((length - len(form.terminator), length, "the terminator", None))
    for spec in form.fields:
        at = spec.at + length if spec.at < 0 else spec.at
        if not 0 <= at <= length - spec.bytes:
            yield Mistake(
                f"{form.key}: field {spec.name!r}.at",
                f"bytes {at} to {at + spec.bytes}",
                f"a place within {_bytes(form)}",
            )
            continue
        for first, end, what, other in taken:
            if first < at + spec.bytes and at < end and not _share(spec, other):
                yield Mistake(
                    f"{form.key}: field {spec.name!r}.at",
                    f"bytes {at} to {at + spec.bytes - 1}",
                    f"bytes of its own ({what} is there)",
                )
                break
        taken.append((at, at + spec.bytes, f"field {spec.name!r}", spec))


def _share(one: FieldSection, other: FieldSection | None) -> bool:
    """Whether two fields may have bytes in common: different bits, or one multiplexed."""
    if other is None:
        return False
    if one.when is not None or other.when is not None:
        return True
    if one.bits is None and other.bits is None:
        return False
    if one.bits is None or other.bits is None:
        return True  # A status word, and bits of it by a name of their own.
    if (one.at, one.type) != (other.at, other.type):
        return True
    return one.bits[0] + one.bits[1] <= other.bits[0] or other.bits[0] + other.bits[1] <= one.bits[0]


def _bytes(form: Form) -> str:
    return (
        f"the frame's {form.length} bytes"
        if form.length is not None
        else f"{form.shortest} to {form.longest} bytes"
    )


def _fields(form: Form) -> Iterator[Mistake]:
    names = {spec.name for spec in form.fields}
    numbers = {spec.name for spec in form.fields if spec.type[0] in "ui"}
    for spec in form.fields:
        key = f"{form.key}: field {spec.name!r}"
        if spec.quantity is not None and UNITS[spec.unit][0] != spec.quantity:
            known = ", ".join(unit for unit, parts in UNITS.items() if parts[0] == spec.quantity)
            yield Mistake(f"{key}.unit", repr(spec.unit), f"a unit of {spec.quantity}: {known}")
        if spec.role in (*GYRO_ROLES, *ACCEL_ROLES) and not spec.axis:
            yield Mistake(f"{key}.axis", "nothing", f"'x', 'y' or 'z' for the role {spec.role}")
        if spec.bits is not None:
            first, count = spec.bits
            if spec.type[0] != "u" or first < 0 or count < 1 or first + count > 8 * spec.bytes:
                yield Mistake(
                    f"{key}.bits", f"{list(spec.bits)} of {spec.type}", "bits that an unsigned type has"
                )
        if spec.type.startswith("text:") and spec.role != "aux":
            yield Mistake(f"{key}.role", spec.role, "'aux' for a text")
        if spec.role == "cumulative_angle" and (
            spec.type.startswith("text:") or spec.offset or spec.transform
        ):
            yield Mistake(f"{key}.type", spec.type, "a number, without offset or transform")
        if spec.sentinel and spec.type.startswith("text:"):
            yield Mistake(f"{key}.sentinel", "a text", "a number")
        for value in spec.sentinel:
            if value >> 8 * spec.bytes:
                yield Mistake(f"{key}.sentinel", f"{value:X}", f"{spec.bytes} bytes, as the field has")
        for what, rule in (("when", spec.when), ("valid", spec.valid)):
            if rule is not None and rule.field not in (numbers if rule.field in names else ()):
                yield Mistake(
                    f"{key}.{what}.field",
                    repr(rule.field),
                    "the name of a whole-number field of this message",
                )
        if spec.when is not None and (spec.when.mod is None) == (spec.when.mask is None):
            yield Mistake(f"{key}.when", "not one of mod and mask", "either mod or mask")
        if spec.transform is not None:
            yield from _transform(key, spec)


def _transform(key: str, spec: FieldSection) -> Iterator[Mistake]:
    rule = spec.transform
    assert rule is not None
    if rule.kind == "table" and (len(rule.xs) < 2 or len(rule.xs) != len(rule.ys)):
        yield Mistake(
            f"{key}.transform", f"{len(rule.xs)} xs and {len(rule.ys)} ys", "two or more of each, as many"
        )
    elif rule.kind == "table" and any(a >= b for a, b in itertools.pairwise(rule.xs)):
        yield Mistake(f"{key}.transform.xs", "values that do not rise", "rising raw values")
    elif rule.kind == "polynomial" and not rule.coefficients:
        yield Mistake(f"{key}.transform.coefficients", "nothing", "at least one coefficient")
    elif rule.kind == "thermistor" and not (rule.a or rule.b):
        yield Mistake(f"{key}.transform", "no a and b", "the Steinhart-Hart coefficients a, b, c, d")
    elif rule.kind == "thermistor" and spec.unit != "degC":
        yield Mistake(f"{key}.unit", repr(spec.unit), "'degC', which a thermistor gives")


def _gyro(forms: list[Form]) -> Iterator[Mistake]:
    if not any(form.measures for form in forms):
        yield Mistake(
            "field",
            "no gyro channel",
            "a field of role rate, delta_angle or cumulative_angle in some message",
        )
    for form in forms:
        seen: dict[tuple[str, str | None], str] = {}
        for spec in form.fields:
            if spec.role in (*GYRO_ROLES, *ACCEL_ROLES) and spec.when is None:
                what = (spec.role, spec.axis)
                if what in seen:
                    yield Mistake(
                        f"{form.key}: field {spec.name!r}.role",
                        f"{spec.role} {spec.axis}",
                        f"a channel of its own ({seen[what]!r} is this one)",
                    )
                seen[what] = spec.name


def _references(description: Description, forms: list[Form]) -> Iterator[Mistake]:
    all_names = {spec.name for form in forms for spec in form.fields}
    numbers = {spec.name: spec for form in forms for spec in form.fields if spec.type[0] in "ui"}
    counter = description.counter
    if counter is not None:
        if counter.field in all_names and counter.field not in numbers and counter.ticks_per_s is not None:
            if counter.modulo is None:
                yield Mistake(
                    "counter.modulo", "nothing", "where a clock that is no whole number wraps, in ticks"
                )
        elif counter.field not in numbers:
            yield Mistake("counter.field", repr(counter.field), _one_of(numbers))
        else:
            spec = numbers[counter.field]
            bits = 8 * spec.bytes if spec.bits is None else spec.bits[1]
            if counter.modulo is not None and counter.modulo > 1 << bits:
                yield Mistake("counter.modulo", str(counter.modulo), f"at most {1 << bits}, for {spec.type}")
            if any(f.measures and counter.field not in {s.name for s in f.fields} for f in forms):
                yield Mistake(
                    "counter.field", repr(counter.field), "a field that every message with rates has"
                )
    for number, bit in enumerate(description.status):
        key = f"status[{number}] {bit.name!r}"
        if bit.field not in numbers:
            yield Mistake(f"{key}.field", repr(bit.field), _one_of(numbers))
        elif bit.bit >= 8 * numbers[bit.field].bytes:
            yield Mistake(f"{key}.bit", str(bit.bit), f"0 to {8 * numbers[bit.field].bytes - 1}")
    for own in description.variant:
        for gone in own.without:
            known = {
                name for group in description.field for name in (group.name, *(e.name for e in group.each()))
            }
            if gone not in known:
                yield Mistake(
                    f"variant {own.name!r}.without", repr(gone), "names of the description's own fields"
                )
    names = {form.name for form in forms}
    yield from _message(description, {form.name: form for form in forms if form.measures})
    for number, vector in enumerate(description.vector):
        if vector.variant is not None and vector.variant not in names:
            yield Mistake(f"vector[{number}].variant", repr(vector.variant), _one_of(names))
        for name in vector.expect:
            if name not in all_names:
                yield Mistake(f"vector[{number}].expect", repr(name), _one_of(all_names))


def _message(description: Description, measuring: dict[str, Form]) -> Iterator[Mistake]:
    """Yield what keeps `message` from naming what a bench reads."""
    wanted = description.message or ()
    wanted = (wanted,) if isinstance(wanted, str) else wanted
    if unknown := [name for name in wanted if name not in measuring]:
        yield Mistake("message", ", ".join(map(repr, unknown)), _one_of(measuring))
        return
    kinds = {name: str((measuring[name].counter, _channels_of(measuring[name]))) for name in wanted}
    if len(set(kinds.values())) > 1:
        yield Mistake("message", f"{', '.join(kinds)}: they differ", "messages of the same rates and counter")


def _channels_of(form: Form) -> list[FieldSection]:
    gyros = [spec for spec in form.fields if spec.role in GYRO_ROLES]
    return [spec for spec in gyros if spec.role == gyros[0].role]


def _told_apart(forms: list[Form]) -> Iterator[Mistake]:
    for one, other in itertools.combinations(forms, 2):
        for sync, sync_other in itertools.product(one.syncs, other.syncs):
            first, second = one.places(sync), {at: (v, m) for at, v, m in other.places(sync_other)}
            same = all(
                (value ^ second[at][0]) & bits & second[at][1] == 0
                for at, value, bits in first
                if at in second
            )
            if same:
                yield Mistake(
                    other.key, f"the beginning of {one.key}", "a sync or match that tells the two apart"
                )
                break


def _one_of(names: Iterable[str]) -> str:
    return "one of " + ", ".join(sorted(names))
