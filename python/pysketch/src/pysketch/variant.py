"""Values on the wire: what Python has for a variant, in the binary form and as JSON.

| variant | Python |
|---|---|
| null, bool | None, bool |
| i8 to u64 | int (also Python 2's long) |
| f32, f64 | float |
| string | text: str in Python 3, unicode in Python 2 |
| bytes | bytes in Python 3, bytearray in Python 2 |
| list, map | list, dict with text keys |

Python writes an int as i64 (u64 where i64 is too small), a float as f64. A str of Python 2 is written as a
string if it is UTF-8, else as bytes; a bytearray is always bytes. `Typed` writes another width.
"""

import base64
import json
import struct
import sys

PYTHON2 = sys.version_info[0] == 2
if PYTHON2:
    TEXT, INTEGERS, BYTES_OUT = unicode, (int, long), bytearray  # noqa: F821
else:
    TEXT, INTEGERS, BYTES_OUT = str, (int,), bytes

DEPTH_MAX = 64
NULL, BOOL, I8, I16, I32, I64, U8, U16, U32, U64, F32, F64, STRING, BYTES, LIST, MAP = range(16)
BINARY, JSON = 0, 1
# As users call them.
FORMS = {"variant": BINARY, "json": JSON}

_NUMBERS = {
    I8: struct.Struct("<b"), I16: struct.Struct("<h"), I32: struct.Struct("<i"), I64: struct.Struct("<q"),
    U8: struct.Struct("<B"), U16: struct.Struct("<H"), U32: struct.Struct("<I"), U64: struct.Struct("<Q"),
    F32: struct.Struct("<f"), F64: struct.Struct("<d"),
}
_NAMES = {
    "i8": I8, "i16": I16, "i32": I32, "i64": I64, "u8": U8, "u16": U16, "u32": U32, "u64": U64,
    "f32": F32, "f64": F64,
}
_COUNT = struct.Struct("<I")


class VariantError(ValueError):
    """A value that cannot be a variant, or bytes that are none."""


class Typed(object):
    """A number with the width that it has on the wire: `Typed("u8", 5)`."""

    __slots__ = ("kind", "value")

    def __init__(self, kind, value):
        if kind not in _NAMES:
            raise VariantError("no number is called %r; there are %s" % (kind, ", ".join(sorted(_NAMES))))
        self.kind, self.value = _NAMES[kind], value

    def __repr__(self):
        return "Typed(%r)" % (self.value,)


def encode(value):
    """The binary form of a value, as bytes."""
    out = bytearray()
    _write(out, value, 0)
    return bytes(out)


def _write(out, value, depth):
    if depth > DEPTH_MAX:
        raise VariantError("lists and dicts nest at most %d deep" % DEPTH_MAX)
    if value is None:
        out.append(NULL)
    elif value is True or value is False:
        out.append(BOOL)
        out.append(1 if value else 0)
    elif isinstance(value, float):
        out.append(F64)
        out += _NUMBERS[F64].pack(value)
    elif isinstance(value, INTEGERS):
        _write_integer(out, value)
    elif isinstance(value, TEXT):
        _write_sized(out, STRING, value.encode("utf-8"))
    elif isinstance(value, (bytes, bytearray, memoryview)):
        _write_bytes(out, value)
    elif isinstance(value, dict):
        _write_map(out, value, depth)
    elif isinstance(value, (list, tuple)):
        out.append(LIST)
        out += _COUNT.pack(len(value))
        for item in value:
            _write(out, item, depth + 1)
    elif isinstance(value, Typed):
        out.append(value.kind)
        out += _packed(value.kind, value.value)
    else:
        _write(out, _plain(value), depth)


def _write_integer(out, value):
    kind = I64 if -(1 << 63) <= value < 1 << 63 else U64
    out.append(kind)
    out += _packed(kind, value)


def _packed(kind, value):
    try:
        return _NUMBERS[kind].pack(value)
    except (struct.error, OverflowError, TypeError):
        name = [name for name, number in _NAMES.items() if number == kind][0]
        raise VariantError("%r does not fit into %s" % (value, name))


def _write_sized(out, kind, data):
    out.append(kind)
    out += _COUNT.pack(len(data))
    out += data


def _write_bytes(out, value):
    if PYTHON2 and isinstance(value, bytes):
        try:
            value.decode("utf-8")
        except UnicodeDecodeError:
            return _write_sized(out, BYTES, value)
        return _write_sized(out, STRING, value)
    _write_sized(out, BYTES, value.tobytes() if isinstance(value, memoryview) else value)


def _write_map(out, value, depth):
    entries = sorted((_key(key), item) for key, item in value.items()) if PYTHON2 else sorted(
        ((_key(key), item) for key, item in value.items()), key=lambda entry: entry[0])
    out.append(MAP)
    out += _COUNT.pack(len(entries))
    for key, item in entries:
        out += _COUNT.pack(len(key))
        out += key
        _write(out, item, depth + 1)


def _key(key):
    if isinstance(key, TEXT):
        return key.encode("utf-8")
    if PYTHON2 and isinstance(key, bytes):
        return key
    raise VariantError("a key of a dict is text, not %s" % type(key).__name__)


def _plain(value):
    """Numbers of other libraries, numpy's among them, and arrays with `tolist`."""
    if hasattr(value, "tolist"):
        return value.tolist()
    if hasattr(value, "__index__"):
        return value.__index__()
    if hasattr(value, "__float__"):
        return float(value)
    raise VariantError("%s cannot be sent; None, bool, int, float, str, bytes, list and dict can"
                       % type(value).__name__)


def decode(data):
    """The value of a binary form."""
    value, end = _read(memoryview(data), 0, 0)
    if end != len(data):
        raise VariantError("%d bytes after the value" % (len(data) - end))
    return value


def _read(data, at, depth):
    if depth > DEPTH_MAX:
        raise VariantError("lists and maps nest at most %d deep" % DEPTH_MAX)
    try:
        kind = data[at]
    except IndexError:
        raise VariantError("the bytes end before the value does")
    kind = ord(kind) if PYTHON2 else kind
    at += 1
    if kind in _NUMBERS:
        layout = _NUMBERS[kind]
        _need(data, at, layout.size)
        return layout.unpack_from(data, at)[0], at + layout.size
    if kind == STRING:
        raw, at = _sized(data, at)
        try:
            return raw.decode("utf-8"), at
        except UnicodeDecodeError:
            raise VariantError("a string that is not UTF-8")
    if kind == NULL:
        return None, at
    if kind == BOOL:
        _need(data, at, 1)
        flag = data[at:at + 1].tobytes()
        if flag not in (b"\0", b"\1"):
            raise VariantError("a bool that is neither 0 nor 1")
        return flag == b"\1", at + 1
    if kind == BYTES:
        raw, at = _sized(data, at)
        return BYTES_OUT(raw), at
    if kind == LIST:
        return _read_list(data, at, depth)
    if kind == MAP:
        return _read_map(data, at, depth)
    raise VariantError("no variant has the kind %d" % kind)


def _need(data, at, count):
    if len(data) - at < count:
        raise VariantError("the bytes end before the value does")


def _sized(data, at):
    _need(data, at, 4)
    count = _COUNT.unpack_from(data, at)[0]
    _need(data, at + 4, count)
    return data[at + 4:at + 4 + count].tobytes(), at + 4 + count


def _read_list(data, at, depth):
    _need(data, at, 4)
    count, at = _COUNT.unpack_from(data, at)[0], at + 4
    # Each item takes a byte at least: a count beyond that is a lie.
    _need(data, at, count)
    items = []
    for _ in range(count):
        item, at = _read(data, at, depth + 1)
        items.append(item)
    return items, at


def _read_map(data, at, depth):
    _need(data, at, 4)
    count, at = _COUNT.unpack_from(data, at)[0], at + 4
    _need(data, at, 5 * count)
    entries, last = {}, None
    for _ in range(count):
        raw, at = _sized(data, at)
        if last is not None and raw <= last:
            raise VariantError("the keys of a map are not in order")
        last = raw
        try:
            key = raw.decode("utf-8")
        except UnicodeDecodeError:
            raise VariantError("a key that is not UTF-8")
        entries[key], at = _read(data, at, depth + 1)
    return entries, at


def to_json(value):
    """JSON text of a value, as the hub writes it: bytes as `{"$bytes": base64}`."""
    return json.dumps(_for_json(value), sort_keys=True, separators=(",", ":"), ensure_ascii=False)


def _for_json(value):
    if value is None or value is True or value is False or isinstance(value, (float, TEXT) + INTEGERS):
        return None if isinstance(value, float) and value - value != 0 else value
    if isinstance(value, Typed):
        return value.value
    if isinstance(value, dict):
        return dict((_key(key).decode("utf-8"), _for_json(item)) for key, item in value.items())
    if isinstance(value, (list, tuple)):
        return [_for_json(item) for item in value]
    if isinstance(value, (bytes, bytearray, memoryview)):
        raw = value.tobytes() if isinstance(value, memoryview) else bytes(value)
        if PYTHON2 and isinstance(value, bytes):
            try:
                return raw.decode("utf-8")
            except UnicodeDecodeError:
                pass
        return {"$bytes": base64.b64encode(raw).decode("ascii")}
    return _for_json(_plain(value))


def from_json(text):
    """The value of JSON text."""
    try:
        return json.loads(text, object_hook=_from_object)
    except ValueError as error:
        raise VariantError("not JSON: %s" % error)


def _from_object(entries):
    if len(entries) == 1 and "$bytes" in entries:
        try:
            return BYTES_OUT(base64.b64decode(entries["$bytes"]))
        except (TypeError, ValueError):
            return entries
    return entries


def pack(value, form):
    """The bytes of a value on the wire, in the form `BINARY` or `JSON`."""
    if form == JSON:
        text = to_json(value)
        return text.encode("utf-8") if isinstance(text, TEXT) else text
    return encode(value)


def unpack(form, data):
    """The value of bytes on the wire."""
    if form == JSON:
        try:
            return from_json(bytes(data).decode("utf-8"))
        except UnicodeDecodeError:
            raise VariantError("JSON that is not UTF-8")
    return decode(data)
