"""Values of this project as JSON and back, to the last bit: dataclasses, enums, arrays, any number.

A recording that is to be decided upon again must hold exactly what was decided upon; text with four digits
would not do. Arrays travel as base64 of their bytes, floats as Python writes them (shortest that reads back
the same), infinities and not-a-number as words.
"""

from __future__ import annotations

import base64
import dataclasses
import enum
import functools
import math
import types
import typing
from collections.abc import Iterator
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from labr_autonomy.errors import BadInput

T = TypeVar("T")

_WORDS = {"inf": math.inf, "-inf": -math.inf, "nan": math.nan}


def pack(value: Any) -> Any:
    """JSON-ready."""
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, enum.Enum):
        return value.value
    if isinstance(value, (float, np.floating)):
        number = float(value)
        return number if math.isfinite(number) else {"float": str(number)}
    if isinstance(value, np.ndarray):
        data = base64.b64encode(np.ascontiguousarray(value).tobytes()).decode("ascii")
        return {"dtype": value.dtype.str, "shape": list(value.shape), "data": data}
    if isinstance(value, np.generic):
        return pack(value.item())
    if dataclasses.is_dataclass(value):
        return {f.name: pack(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, (tuple, list)):
        return [pack(v) for v in value]
    raise TypeError(f"nobody has said how a {type(value).__name__} is recorded")


def unpack(kind: type[T], packed: Any) -> T:
    """A value again.

    Args:
        kind: What was packed.
        packed: What `pack` made of it.

    Raises:
        BadInput: when it is something else.
    """
    try:
        return typing.cast(T, _unpack(kind, packed))
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise BadInput(
            f"the recording does not hold what a {kind.__name__} is now made of ({error})",
            "Replay it with the version that recorded it",
        ) from None


def differences(recorded: Any, now: Any, path: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Fields of two packed values that are not the same: (path, recorded, now)."""
    if isinstance(recorded, dict) and isinstance(now, dict):
        if "dtype" in recorded and "dtype" in now:
            if recorded != now:
                yield from _array_difference(recorded, now, path)
            return
        for name in dict.fromkeys([*recorded, *now]):
            below = f"{path}.{name}" if path else name
            yield from differences(recorded.get(name), now.get(name), below)
    elif isinstance(recorded, list) and isinstance(now, list) and len(recorded) == len(now):
        for i, (a, b) in enumerate(zip(recorded, now, strict=True)):
            yield from differences(a, b, f"{path}[{i}]")
    elif recorded != now:
        yield path, recorded, now


def _array_difference(recorded: Any, now: Any, path: str) -> Iterator[tuple[str, Any, Any]]:
    a, b = _array(recorded), _array(now)
    if a.shape != b.shape:
        yield f"{path}.shape", a.shape, b.shape
        return
    for place in np.argwhere((a != b) & ~((a != a) & (b != b))):
        where = tuple(int(i) for i in place)
        yield f"{path}[{', '.join(map(str, where))}]", a[where].item(), b[where].item()


def _array(packed: Any) -> np.ndarray:
    raw = np.frombuffer(base64.b64decode(packed["data"]), np.dtype(packed["dtype"]))
    return raw.reshape(packed["shape"]).copy()


def _unpack(kind: Any, packed: Any) -> Any:
    origin = get_origin(kind)
    if origin in (Union, types.UnionType):
        if packed is None:
            return None
        (inner,) = (k for k in get_args(kind) if k is not type(None))
        return _unpack(inner, packed)
    if origin is tuple:
        inner = get_args(kind)[0]
        return tuple(_unpack(inner, v) for v in packed)
    if origin is np.ndarray:
        return _array(packed)
    if kind is float:
        return _WORDS[packed["float"]] if isinstance(packed, dict) else float(packed)
    if dataclasses.is_dataclass(kind):
        hints = _hints(typing.cast(type, kind))
        return kind(**{name: _unpack(hints[name], value) for name, value in packed.items()})  # type: ignore[operator]
    if isinstance(kind, type) and issubclass(kind, enum.Enum):
        return kind(packed)
    if isinstance(packed, kind):
        return packed
    raise TypeError(f"{packed!r} is no {kind.__name__}")


@functools.cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)
