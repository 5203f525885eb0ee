"""Numbers that a caller hands over: what an array says beside its numbers is taken as it is meant, or refused.

A mask, a unit, a date or a second part is lost where numpy makes an array of floats of it: what was not measured would
be used as if it were, and milliseconds as seconds.
"""

from __future__ import annotations

from datetime import date, timedelta
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import SceneError
from .quantities import converted, quantity

Array = NDArray[np.float64]
PLAIN = {int, float, np.float64}
CARRIERS = (("units", "magnitude"), ("unit", "value"), ("units", "value"))  # of pint, of astropy, of unyt


def numbers(name: str, values: ArrayLike, unit: str = "1") -> Array:
    """A contiguous copy in double precision of any array-like, in ``unit``, which quantities and durations are
    converted to; not a number where nothing is known.

    Raises SceneError, by the ``name``, for masked values, units of another kind, dates, truth values, complex numbers
    and what is no array of numbers.
    """
    try:
        return np.asarray(_floats(values, unit), order="C")
    except SceneError as problem:
        raise SceneError(f"{name}: {problem}") from None
    except (TypeError, ValueError, OverflowError):
        raise SceneError(f"{name}: not an array of numbers") from None


def number(name: str, value: object, unit: str = "1") -> float:
    """One number in ``unit``. Raises SceneError as :func:`numbers` does, and where it is none or more than one."""
    result = numbers(name, value, unit)  # type: ignore[arg-type]
    if value is None or result.ndim:
        raise SceneError(f"{name} = {value!r}: needs one number{'' if unit == '1' else f' in {unit}'}")
    return float(result)


def whole(name: str, values: ArrayLike) -> NDArray[np.int64]:
    """Whole numbers as an array. Raises SceneError as :func:`numbers` does, and for any other number."""
    result = numbers(name, values)
    if not (result == np.rint(result)).all():
        raise SceneError(f"{name}: needs an array of integers")
    return result.astype(np.int64)


def truths(name: str, values: ArrayLike) -> NDArray[np.bool_]:
    """Truth values, or numbers as such. Raises SceneError for masked ones."""
    if isinstance(values, list | tuple):
        return np.array([truths(name, item) for item in values], dtype=bool)
    result = np.asarray(numbers(name, values) if _unit_and_number(values)[0] else _unmasked(values, f"{name}: "))
    if result.dtype.kind not in "biuf":
        raise SceneError(f"{name}: needs truth values, not {result.dtype}")
    return result.astype(bool)


def as_written(value: Any) -> object:
    """A value as a scene file has it: arrays as lists, a quantity as text with its unit. Raises SceneError for masked
    values.
    """
    unit, magnitude = _unit_and_number(value)
    if unit:
        return _in_unit(numbers("value", magnitude).tolist(), unit)
    if isinstance(value, timedelta) or getattr(getattr(value, "dtype", None), "kind", "") == "m":
        return _in_unit(numbers("value", value, "s").tolist(), "s")
    return _unmasked(value).tolist() if hasattr(value, "tolist") else str(value)


def plain(name: str, values: Any) -> Any:
    """Cells of a column, texts too, quantities as texts with their unit. Raises SceneError for masked ones."""
    if isinstance(values, list | tuple):
        return [plain(name, item) for item in values]
    try:
        return as_written(values) if _unit_and_number(values)[0] else _unmasked(values)
    except SceneError as problem:
        raise SceneError(f"{name}: {problem}") from None


def _in_unit(values: Any, unit: str) -> object:
    return [_in_unit(item, unit) for item in values] if isinstance(values, list) else f"{values!r} {unit}"


def _floats(values: Any, unit: str) -> Array:
    if isinstance(values, list | tuple):
        if not set(map(type, values)) <= PLAIN:  # what an entry says, numpy would drop
            return np.array([_floats(item, unit) for item in values])
        return np.array(values, dtype=np.float64)
    given, magnitude = _unit_and_number(values)
    if given:
        return _floats(magnitude, "1") * _factor(given, unit)
    if isinstance(values, str):
        return _text(values, unit)
    if isinstance(values, timedelta):
        return np.array(values.total_seconds() * _factor("s", unit))
    return _of_array(np.asarray(_unmasked(values)), values, unit)


def _of_array(array: NDArray[Any], values: Any, unit: str) -> Array:
    """Numbers in ``unit`` of the ``array`` that numpy makes of ``values``."""
    if isinstance(values, date) or array.dtype.kind == "M":
        raise SceneError("dates are no numbers; give the time since the first of them")
    if array.dtype.kind == "m" and np.datetime_data(array.dtype)[0] != "generic":
        return np.asarray(array / np.timedelta64(1, "s")) * _factor("s", unit)
    if array.dtype.kind in "OU":
        if not array.ndim:
            return np.array(values, dtype=np.float64)
        return np.array([_floats(item, unit) for item in array.ravel().tolist()], np.float64).reshape(array.shape)
    if array.dtype.kind not in "iuf":
        raise SceneError(f"{array.dtype} are no numbers of this kind; give real ones")
    return array.astype(np.float64)


def _text(text: str, unit: str) -> Array:
    try:
        return np.array(quantity(text, unit, f"1 {unit}"))
    except ValueError as problem:
        raise SceneError(f"{text!r}: {problem}") from None


def _factor(given: str, wanted: str) -> float:
    try:
        return converted(1.0, given, wanted)
    except ValueError as problem:
        raise SceneError(str(problem)) from None


def _unit_and_number(values: Any) -> tuple[str, Any]:
    """The unit that an array-like carries, "1" for none of a quantity, and what it is a unit of; "" for no quantity."""
    if isinstance(values, date | timedelta):  # a pandas.Timedelta has a unit and a value, which is nanoseconds
        return "", values
    for unit, number in CARRIERS:
        if getattr(values, unit, None) is not None and hasattr(values, number):
            return str(getattr(values, unit)).replace("dimensionless", "") or "1", getattr(values, number)
    noted = getattr(values, "attrs", None)  # of xarray
    return (str(noted["units"]), np.asarray(values)) if isinstance(noted, dict) and noted.get("units") else ("", values)


def _unmasked(values: Any, at: str = "") -> Any:
    """The values themselves. Raises SceneError where some are masked."""
    if not isinstance(values, np.ma.MaskedArray):
        return values
    if masked := int(np.ma.getmaskarray(values).sum()):
        raise SceneError(f"{at}{masked} of {values.size} values are masked; give numbers for them, or leave them out")
    return values.data
