"""The names of `stability` in the last version; they go with the next."""

from condyn_pin._core import forward

_STABILITY = "simulation.stability"


def _unknown(name: str) -> None:
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__getattr__ = forward(
    __name__,
    _unknown,
    {
        "wall": f"{_STABILITY}.stability_limit",
        "check_wall": f"{_STABILITY}.check_stability_limit",
        "growth": f"{_STABILITY}.growth",
        "is_beyond": f"{_STABILITY}.is_beyond",
    },
)
