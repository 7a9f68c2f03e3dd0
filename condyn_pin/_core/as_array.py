"""AsArray: a value that works as the array of its components."""

from __future__ import annotations

from typing import Any

from numpy.lib.mixins import NDArrayOperatorsMixin

from condyn_pin._core.arrays import Array


class AsArray(NDArrayOperatorsMixin):
    """What has `components`, and can stand wherever NumPy takes an array of them."""

    components: Array

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        array = self.components if dtype is None else self.components.astype(dtype)
        return array.copy() if copy else array

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        plain = [x.components if isinstance(x, AsArray) else x for x in inputs]
        return getattr(ufunc, method)(*plain, **options)

    def __len__(self) -> int:
        return len(self.components)

    def __getitem__(self, index: Any) -> Any:
        return self.components[index]

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the components."""
        return self.components.shape

    @property
    def size(self) -> int:
        """Number of components."""
        return self.components.size

    def copy(self) -> Array:
        """Return the components in an array of their own."""
        return self.components.copy()

    def tolist(self) -> list[float]:
        """Return the components as a list."""
        return [float(x) for x in self.components]

    def round(self, decimals: int = 0) -> Array:
        """Return the components rounded to some `decimals`."""
        return self.components.round(decimals)
