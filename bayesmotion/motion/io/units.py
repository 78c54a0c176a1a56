"""Words for units of length."""

_METRES = {
    "mm": 1e-3, "millimeter": 1e-3, "millimetre": 1e-3,
    "cm": 1e-2, "centimeter": 1e-2, "centimetre": 1e-2,
    "dm": 1e-1, "decimeter": 1e-1, "decimetre": 1e-1,
    "m": 1.0, "meter": 1.0, "metre": 1.0,
    "in": 0.0254, "inch": 0.0254, "inches": 0.0254, '"': 0.0254,
    "ft": 0.3048, "foot": 0.3048, "feet": 0.3048,
}  # fmt: skip


def metres_of(word: str) -> float | None:
    """Return the metres in a unit such as ``mm``, ``Millimeters`` or ``inch``; None if unknown."""
    word = word.strip(" \t\0[]().").lower()
    return _METRES.get(word, _METRES.get(word.removesuffix("s")) if len(word) > 2 else None)
